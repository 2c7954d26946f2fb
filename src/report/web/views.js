// One view of a scene: its canvas, its caption, and the faces it shows.

class View {
  constructor(renderer, steer) {
    this.renderer = renderer;
    this.canvas = element("canvas", { tabindex: 0, role: "img" });
    this.context = this.canvas.getContext("2d");
    [this.name, this.errors] = [element("b"), element("span")];
    this.figure = element(
      "figure",
      {},
      element("figcaption", {}, this.name, this.errors),
      this.canvas,
    );
    makeSteerable(this.canvas, steer(this));
  }

  take({ name, labels }) {
    this.labels = labels;
    this.name.textContent = name;
    this.canvas.setAttribute("aria-label", `${name}: voxels in 3-D; the arrow keys turn them`);
  }

  // The faces for what is to be shown now, and in words how the prediction fares.
  rebuild(scene, how) {
    const truth = scene.volumes[0].labels;
    this.kinds = kindsOf(truth, this.labels, how);
    const faces = facesOf(this.kinds, scene.shape);
    this.renderer.release(this.mesh);
    this.mesh = this.renderer.faceMesh(faces);
    this.canvas.dataset.faces = faces.count;
    this.errors.textContent = "";
    if (!how.errors || this.labels === truth) return;
    const counts = errorCounts(truth, this.labels, how.unknown);
    this.errors.textContent = ERRORS.map(
      ({ name }, n) => `${name} ${counts[n].toLocaleString("en")}`,
    ).join(" · ");
  }

  // As many pixels as the screen has, within reason.
  resize(ratio) {
    const { canvas } = this;
    const sides = [canvas.clientWidth, canvas.clientHeight];
    const [width, height] = sides.map((side) => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== width) canvas.width = width;
    if (canvas.height !== height) canvas.height = height;
  }

  get aspect() {
    return this.canvas.width / this.canvas.height;
  }

  draw(scene, lens, palette, stage, marked) {
    const { renderer, canvas, mesh } = this;
    const size = [canvas.width, canvas.height];
    renderer.begin(...size);
    renderer.drawFaces(mesh, lens, scene, palette, stage.colors.haze);
    stage.draw(lens, size);
    if (marked) {
      renderer.drawHiddenLines(marked, lens, size);
      renderer.drawLines(marked, lens, size);
    }
    renderer.copyTo(this.context);
  }

  // The voxel under a place of the window, or null.
  voxelAt(scene, lens, clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    const x = ((clientX - box.left) / box.width) * 2 - 1;
    const y = 1 - ((clientY - box.top) / box.height) * 2;
    return firstHit(scene, this.kinds, lens.eye, rayThrough(lens, x, y));
  }

  remove() {
    this.renderer.release(this.mesh);
    this.figure.remove();
  }
}
