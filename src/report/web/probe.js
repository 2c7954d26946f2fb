// Which voxel the pointer is on, and what it is in each view.

// The first drawn voxel on a ray, as [x, y, z], or null. The ray is cut to the grid, then followed
// from voxel to voxel.
function firstHit(scene, kinds, eye, ray) {
  const [Y, Z] = scene.shape.slice(1);
  const start = eye.map((at, a) => (at - scene.lower[a]) / scene.voxel);
  let [enter, leave] = [0, Infinity];
  for (let a = 0; a < 3; a++) {
    const ends = [-start[a] / ray[a], (scene.shape[a] - start[a]) / ray[a]];
    if (ray[a] === 0 && (start[a] < 0 || start[a] > scene.shape[a])) return null;
    if (ray[a] === 0) continue;
    [enter, leave] = [Math.max(enter, Math.min(...ends)), Math.min(leave, Math.max(...ends))];
  }
  if (enter >= leave) return null;
  const inside = (index, a) => Math.min(Math.max(index, 0), scene.shape[a] - 1);
  const cell = start.map((at, a) =>
    inside(Math.floor(at + enter * ray[a] + 1e-9 * Math.sign(ray[a])), a),
  );
  const step = ray.map(Math.sign);
  const wait = ray.map((along) => Math.abs(1 / along));
  const next = ray.map((along, a) => (cell[a] + (along > 0) - start[a]) / along);
  while (cell.every((index, a) => index >= 0 && index < scene.shape[a])) {
    if (kinds[(cell[0] * Y + cell[1]) * Z + cell[2]] !== HIDDEN) return cell;
    const a = [0, 1, 2].reduce(
      (best, n) => (next[n] < next[best] || step[best] === 0 ? n : best),
      0,
    );
    cell[a] += step[a];
    next[a] += wait[a];
  }
  return null;
}

function middleOf(scene, cell) {
  return cell.map((index, a) => scene.lower[a] + (index + 0.5) * scene.voxel);
}

function directionWords([x, y, z]) {
  const far = (value) => `${Math.abs(value).toFixed(1)} m`;
  const along = `${far(x)} ${x < 0 ? "behind" : "ahead"}`;
  const across = `${far(y)} ${y < 0 ? "right" : "left"}`;
  return `${along}, ${across}, ${far(z)} ${z < 0 ? "below" : "above"}`;
}

// What each view holds at a voxel.
function labelWords(scene, cell, names, unknown) {
  const index = (cell[0] * scene.shape[1] + cell[1]) * scene.shape[2] + cell[2];
  const word = (label) => (label === unknown ? "unknown" : label === FREE ? "free" : names[label]);
  return scene.volumes.map(({ name, labels }) => [name, word(labels[index])]);
}

// The voxel that the pointer is on: its edges in every view, its place in the image, and words.
class Marker {
  constructor(renderer, box) {
    this.renderer = renderer;
    this.words = box.querySelector(".probe");
    this.photo = box.querySelector(".photo img");
    this.dot = box.querySelector(".photo i");
    this.cell = this.mesh = null;
  }

  // False where nothing has changed.
  set(scene, cell, { names, unknown }, colors, ratio) {
    if (String(cell) === String(this.cell)) return false;
    this.cell = cell;
    this.renderer.release(this.mesh);
    this.mesh = cell && this.renderer.lineMesh(voxelEdges(scene, cell, colors.mark), ratio);
    this.words.replaceChildren("\u00a0");
    if (cell) {
      const labels = labelWords(scene, cell, names, unknown);
      const parts = labels.flatMap(([name, label]) => [` · ${name}: `, element("b", {}, label)]);
      this.words.replaceChildren(directionWords(middleOf(scene, cell)), ...parts);
    }
    this.markPhoto(scene, cell);
    return true;
  }

  markPhoto(scene, cell) {
    this.dot.hidden = true;
    if (!cell || !scene.frustum) return;
    const lens = cameraLens(
      scene.frustum,
      this.photo.naturalWidth / this.photo.naturalHeight,
      scene,
    );
    const place = placeOf(lens, middleOf(scene, cell));
    if (!place || Math.max(...place.map(Math.abs)) > 1) return;
    this.dot.hidden = false;
    this.dot.style.left = `${(place[0] + 1) * 50}%`;
    this.dot.style.top = `${(1 - place[1]) * 50}%`;
  }
}
