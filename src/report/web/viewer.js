// The views of a scene side by side, which all show it through one camera.

const up = { x: 0, y: 0, z: 1 };
const BEHIND = { eye: { x: -1.8, y: 0, z: 1.15 }, center: { x: -0.05, y: 0, z: -0.15 }, up };
const ABOVE = { eye: { x: -0.01, y: 0, z: 2 }, center: { x: 0, y: 0, z: 0 }, up };
// How a key moves the camera: by how much it turns and tilts (rad), and how far it goes away.
const TURNS = { ArrowLeft: [-0.1, 0, 1], ArrowRight: [0.1, 0, 1] };
const TILTS = { ArrowDown: [0, -0.1, 1], ArrowUp: [0, 0.1, 1] };
const ZOOMS = { "+": [0, 0, 0.87], "-": [0, 0, 1.15] };

function moved({ eye, center }, [turn, tilt, away]) {
  const [x, y, z] = ["x", "y", "z"].map((name) => eye[name] - center[name]);
  const yaw = Math.atan2(y, x) + turn;
  const pitch = Math.min(Math.max(Math.atan2(z, Math.hypot(x, y)) + tilt, -1.5), 1.56);
  const far = Math.hypot(x, y, z) * away;
  const flat = far * Math.cos(pitch);
  const place = { x: flat * Math.cos(yaw), y: flat * Math.sin(yaw), z: far * Math.sin(pitch) };
  for (const name in place) place[name] += center[name];
  return { eye: place, center, up };
}

class Viewer {
  constructor(box) {
    [this.box, this.camera, this.divs] = [box, BEHIND, all(".view", box)];
    [this.select, this.mode] = all("select", box);
    this.select.addEventListener("change", () => this.open());
    this.mode.addEventListener("change", () => this.draw());
    for (const button of all(".play", box)) button.addEventListener("click", () => this.play(button));
    for (const button of all("[data-key]", box))
      button.addEventListener("click", () => this.command(button.dataset.key));
    for (const button of all("[data-kind]", box))
      button.addEventListener("click", (event) => this.toggle(button, event.shiftKey));
    this.divs.forEach((div) => this.prepare(div));
    this.follow();
  }

  // Makes a view listen. The page scrolls past a view that was not pressed before.
  prepare(div) {
    const hold = (event) => {
      if (event.type === "mousedown") div.focus({ preventScroll: true });
      if (document.activeElement === div) this.held = div;
      else event.stopPropagation();
    };
    for (const kind of ["mousedown", "wheel", "touchstart", "touchmove"])
      div.addEventListener(kind, hold, true);
    div.addEventListener("keydown", (event) => this.command(event.key) && event.preventDefault());
    Plotly.newPlot(div, [], {}, CONFIG);
    div.on("plotly_hover", ({ points: [point] }) => this.name(point));
  }

  async open() {
    const index = this.select.value;
    const packed = Uint8Array.from(atob(all(".scene")[index].textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    this.scene = await new Response(stream).json();
    all(".photo img", this.box)[0].src = all(".still")[index].querySelector("img").src;
    await this.draw();
    this.box.dataset.scene = index;
  }

  // Shows one scene after the other, from the first if it was at the last, until pressed again.
  async play(button) {
    const last = this.select.length - 1;
    button.ariaPressed = button.ariaPressed !== "true";
    if (this.select.selectedIndex === last) this.select.selectedIndex = -1;
    while (button.ariaPressed === "true") {
      this.select.selectedIndex += 1;
      await Promise.all([this.open(), new Promise((done) => setTimeout(done, 200))]);
      if (this.select.selectedIndex === last) button.ariaPressed = false;
    }
  }

  // Draws every view anew, for what the reader has chosen to see.
  draw() {
    [this.box.dataset.mode, this.held] = [this.mode.value, null];
    return Promise.all(this.divs.map((div, n) => this.drawView(div, this.scene.views[n])));
  }

  drawView(div, view) {
    div.parentElement.hidden = !view;
    if (!view) return Plotly.react(div, [], {}, CONFIG);
    const [name, counts] = div.previousElementSibling.children;
    [name.textContent, counts.textContent] = [view.name, view.counts];
    const pressed = all("[data-kind][aria-pressed=true]", this.box);
    const kinds = new Set(pressed.map((button) => button.dataset.kind));
    const meshes = view.meshes[this.mode.value] ?? view.meshes.classes;
    const shown = meshes.filter((mesh) => kinds.has(mesh.name));
    div.dataset.faces = shown.reduce((count, mesh) => count + mesh.meta.length, 0);
    const layout = structuredClone(this.scene.layout);
    layout.scene.camera = structuredClone(this.camera);
    return Plotly.react(div, [...shown, ...this.scene.lines], layout, CONFIG);
  }

  // Follows the view that the reader holds. Its events do not tell: it glides on after the last.
  follow() {
    const camera = this.held?._fullLayout.scene?._scene?.getCamera();
    const place = ({ eye, center }) => JSON.stringify([eye, center]);
    if (camera && place(camera) !== place(this.camera)) this.look(camera, this.held);
    requestAnimationFrame(() => this.follow());
  }

  // Turns every view but the one that is held.
  look(camera, held = null) {
    [this.camera, this.held] = [camera, held];
    for (const div of this.divs.filter((each) => each !== held && !each.parentElement.hidden))
      Plotly.relayout(div, { "scene.camera": structuredClone(camera) });
  }

  // Does what a key stands for; false for one that stands for nothing.
  command(key) {
    const step = { ...TURNS, ...TILTS, ...ZOOMS }[key];
    const camera = { 1: BEHIND, 2: ABOVE }[key] ?? (step && moved(this.camera, step));
    if (camera) this.look(camera);
    return Boolean(camera);
  }

  // Hides or shows a kind of voxels; with Shift, that kind alone or again all.
  toggle(button, isAlone) {
    const kinds = [...button.parentElement.children];
    const wasAlone = kinds.every((each) => each.ariaPressed === String(each === button));
    if (isAlone) for (const each of kinds) each.ariaPressed = wasAlone || each === button;
    else button.ariaPressed = button.ariaPressed !== "true";
    this.draw();
  }

  // Says what the voxel under the pointer is in every view, and marks it in the image.
  name({ data, pointNumber }) {
    const { shape, lower, voxel, views, names, share_from_occ: matrix } = this.scene;
    const index = data.meta[pointNumber >> 1]; // a face is two triangles
    const layer = shape[1] * shape[2];
    const cell = [index / layer, (index % layer) / shape[2], index % shape[2]].map(Math.floor);
    const middle = cell.map((n, axis) => lower[axis] + (n + 0.5) * voxel);
    const place = ["ahead", "left", "up"].map((way, n) => `${way} ${middle[n].toFixed(1)} m`);
    const classes = views.map(({ name, labels }) => `${name}: ${names[labels[index]]}`);
    all(".probe", this.box)[0].textContent = [place.join(", "), ...classes].join(" · ");
    const row = (weights) => middle.reduce((sum, m, n) => sum + m * weights[n], weights[3]);
    const [across, down, depth] = matrix.map(row);
    const [dot] = all(".photo i", this.box);
    dot.hidden = depth <= 0 || Math.min(across, down) < 0 || Math.max(across, down) > depth;
    [dot.style.left, dot.style.top] = [across, down].map((way) => `${(100 * way) / depth}%`);
  }
}
