// The views of a scene side by side, which all show it from one place.

const MOST_PIXELS_PER_PIXEL = 2;
const IMAGE_SHARE = 0.96; // of a view through the camera

class Viewer {
  constructor(box, classes, scripts, fail) {
    this.box = box;
    this.classes = classes;
    this.scripts = scripts;
    this.palette = [...classes.colors, ...ERRORS.map(({ color }) => color)].map((c) =>
      scaled(c, 1 / 255),
    );
    this.shown = { classes: classes.names.map(() => true), errors: ERRORS.map(() => true) };
    this.state = { mode: "classes", preset: "behind", orbit: null, steered: false, beyond: false };
    this.views = [];
    this.renderer = new Renderer(() => fail("the graphics card was lost; load the page again"));
    this.stage = new Stage(this.renderer, box);
    this.marker = new Marker(this.renderer, box);
    this.observer = new ResizeObserver(() => this.resize());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolor());
  }

  get ratio() {
    return Math.min(devicePixelRatio || 1, MOST_PIXELS_PER_PIXEL);
  }

  // --------------------------------------------------------------------------------- scenes

  async open(index) {
    this.index = index;
    const scene = await readScene(this.scripts[index].textContent);
    if (this.index !== index) return; // another one was asked for meanwhile
    this.scene = scene;
    this.points = pointsToShow(scene, this.classes.unknown);
    this.box.querySelector(".photo img").src = all(".still")[index].querySelector("img").src;
    this.makeViews();
    this.rebuild();
    this.recolor();
    if (this.state.preset === "camera" && !scene.frustum) this.state.preset = "behind";
    for (const view of this.views) view.resize(this.ratio);
    if (!this.state.steered) this.look(this.state.preset);
    showState(this);
    this.box.dataset.scene = index;
  }

  // To the next or the previous scene, round and round.
  step(by) {
    const n = this.scripts.length;
    return this.open((this.index + by + n) % n);
  }

  // A view for each volume; those of the scene before are used again.
  makeViews() {
    const { volumes } = this.scene;
    const place = this.box.querySelector(".views");
    while (this.views.length > volumes.length) this.removeView();
    while (this.views.length < volumes.length) this.addView(place);
    this.views.forEach((view, n) => view.take(volumes[n]));
    const cells = volumes.length + 1;
    const columns = cells === 4 ? 2 : Math.min(cells, 3);
    place.style.setProperty("--columns", columns);
    place.style.setProperty("--aspect", columns === 2 ? "5 / 3" : "4 / 3");
  }

  addView(place) {
    const view = new View(this.renderer, (made) => ({
      turn: (right, down) => this.steer((orbit) => turned(orbit, right, down)),
      move: (right, down) => this.steer((orbit) => moved(orbit, right, down)),
      zoom: (factor) => this.steer((orbit) => zoomed(orbit, factor, this.reach())),
      point: (x, y) => this.point(made, x, y),
      command: (key) => command(this, key),
    }));
    place.append(view.figure);
    this.observer.observe(view.canvas);
    this.views.push(view);
  }

  removeView() {
    const view = this.views.pop();
    this.observer.unobserve(view.canvas);
    view.remove();
  }

  // ------------------------------------------------------------------------- what is shown

  set(changes) {
    Object.assign(this.state, changes);
    showState(this);
    this.rebuild();
  }

  // The faces of all views, for what is to be shown now.
  rebuild() {
    const { mode, beyond } = this.state;
    const how = {
      unknown: this.classes.unknown,
      beyond,
      errors: mode === "errors",
      shown: this.shown,
    };
    for (const view of this.views) view.rebuild(this.scene, how);
    this.point(null);
    this.draw();
  }

  recolor() {
    this.stage.build(this.scene, this.ratio);
    this.draw();
  }

  // ------------------------------------------------------------------------- from where

  // One of the three views, anew.
  look(preset) {
    if (preset === "camera" && !this.scene.frustum) return;
    const { aspect } = this.views[0];
    const orbit = preset === "camera" ? null : fitted(this.points, PITCHES[preset], aspect);
    Object.assign(this.state, { preset, orbit, steered: false });
    showState(this);
    this.draw();
  }

  // From the camera's place one can only go back to behind the UAV, and on from there.
  steer(change) {
    if (!this.state.orbit) this.look("behind");
    this.state.orbit = change(this.state.orbit);
    this.state.steered = true;
    this.point(null);
    showState(this);
    this.draw();
  }

  // How near and how far one may zoom.
  reach() {
    return [2 * this.scene.voxel, 6 * diagonalOf(this.scene)];
  }

  lens() {
    const {
      scene,
      state: { orbit },
      views: [{ aspect }],
    } = this;
    return orbit
      ? orbitLens(orbit, aspect, scene)
      : cameraLens(scene.frustum, aspect, scene, IMAGE_SHARE);
  }

  resize() {
    for (const view of this.views) view.resize(this.ratio);
    if (!this.state.steered && this.state.orbit) this.look(this.state.preset);
    this.drawNow(); // a canvas of another size is empty, and would flash
  }

  // -------------------------------------------------------------------------------- drawing

  // All views, once before the screen shows the next picture.
  draw() {
    this.drawing ??= requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    if (this.drawing) cancelAnimationFrame(this.drawing);
    this.drawing = null;
    const lens = this.lens();
    for (const view of this.views) {
      view.draw(this.scene, lens, this.palette, this.stage, this.marker.mesh);
    }
    report("ready", "true");
  }

  // Mark and name the voxel under a place of the window; nothing without a view.
  point(view, x, y) {
    const cell = view && view.voxelAt(this.scene, this.lens(), x, y);
    if (this.marker.set(this.scene, cell, this.classes, this.stage.colors, this.ratio)) this.draw();
  }
}
