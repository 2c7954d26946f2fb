// Scenes as the page holds them, and what each of their voxels is drawn as.
//
// A voxel (x, y, z) of the shape [X, Y, Z] has the index (x * Y + y) * Z + z; x is forward, y left
// and z up. A kind is an index into the palette: the classes first, then the errors.

const FREE = 8;
const HIDDEN = 255;
const ERRORS = [
  { name: "right", color: [160, 170, 182] },
  { name: "other class", color: [255, 146, 40] },
  { name: "false alarm", color: [70, 184, 255] },
  { name: "missed", color: [226, 38, 120] },
]; // hues that no class has, and that the colour-blind tell apart
const [RIGHT, OTHER_CLASS, FALSE_ALARM, MISSED] = [0, 1, 2, 3];

async function unpackLabels(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function readScene(json) {
  const scene = JSON.parse(json);
  scene.volumes = await Promise.all(
    scene.volumes.map(async ({ name, labels }) => ({ name, labels: await unpackLabels(labels) })),
  );
  return scene;
}

// How a prediction fares in a voxel with a known truth, or -1 where both are free.
function errorOf(truth, label) {
  if (truth >= FREE) return label < FREE ? FALSE_ALARM : -1;
  if (label >= FREE) return MISSED;
  return truth === label ? RIGHT : OTHER_CLASS;
}

// How often each error is made where the truth is known.
function errorCounts(truth, labels, unknown) {
  const counts = ERRORS.map(() => 0);
  for (let i = 0; i < truth.length; i++) {
    const error = truth[i] === unknown ? -1 : errorOf(truth[i], labels[i]);
    if (error >= 0) counts[error]++;
  }
  return counts;
}

// The kind of each voxel, HIDDEN for one that is not drawn. `shown` says which classes and errors
// are; an error is of the class that is there, a false alarm of the one that is not.
function kindsOf(truth, labels, { unknown, beyond, errors, shown }) {
  const kinds = new Uint8Array(labels.length).fill(HIDDEN);
  for (let i = 0; i < labels.length; i++) {
    const known = truth[i] !== unknown;
    if (!known && (!beyond || labels === truth)) continue;
    if (errors && known && labels !== truth) {
      const error = errorOf(truth[i], labels[i]);
      if (error < 0 || !shown.errors[error]) continue;
      if (shown.classes[truth[i] < FREE ? truth[i] : labels[i]]) kinds[i] = FREE + error;
    } else if (!(errors && !known) && labels[i] < FREE && shown.classes[labels[i]]) {
      kinds[i] = labels[i];
    }
  }
  return kinds;
}

// Everything occupied that is known, the UAV, and the ground under it: what a view should show.
function pointsToShow({ shape: [X, Y, Z], lower, voxel, volumes, floor }, unknown) {
  const truth = volumes[0].labels;
  const half = (UAV_SHARE * X * voxel) / 2;
  const points = [
    [-half, -half, 0],
    [-half, half, 0],
    [half, -half, 0],
    [half, half, 0],
    [0, 0, floor],
  ];
  for (let x = 0, i = 0; x < X; x++) {
    for (let y = 0; y < Y; y++) {
      for (let z = 0; z < Z; z++, i++) {
        if (truth[i] === unknown || volumes.every(({ labels }) => labels[i] >= FREE)) continue;
        points.push([x, y, z].map((index, a) => lower[a] + (index + 0.5) * voxel));
      }
    }
  }
  return points;
}
