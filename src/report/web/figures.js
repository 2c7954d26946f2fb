// What stands among the voxels, in metres of the occ frame: the floor, the UAV, its camera.
//
// Lines are {from, to, color, width}, with the width in pixels; triangles are lists of places.

const FLOOR_LINE_M = 10;
const UAV_SHARE = 0.045;

function gridEnds(scene) {
  return scene.shape.map((n, a) => [scene.lower[a], scene.lower[a] + n * scene.voxel]);
}

// The two ends and the multiples of 10 m between them.
function ticksBetween([low, high]) {
  const ticks = new Set([low, high]);
  for (let n = Math.ceil(low / FLOOR_LINE_M); n * FLOOR_LINE_M <= high; n++)
    ticks.add(n * FLOOR_LINE_M);
  return [...ticks];
}

function floorLines(scene, color) {
  const [along, across] = gridEnds(scene);
  const z = scene.floor;
  const line = (from, to) => ({ from, to, color, width: 1 });
  return [
    ...ticksBetween(along).map((x) => line([x, across[0], z], [x, across[1], z])),
    ...ticksBetween(across).map((y) => line([along[0], y, z], [along[1], y, z])),
  ];
}

function discTriangles(middle, radius, color, corners = 20) {
  const at = (n) => {
    const angle = (2 * Math.PI * n) / corners;
    return [middle[0] + radius * Math.cos(angle), middle[1] + radius * Math.sin(angle), middle[2]];
  };
  return Array.from({ length: corners }, (_, n) => ({ places: [middle, at(n), at(n + 1)], color }));
}

// A quadrotor at the origin, its plumb line, and where that meets the floor.
function uavFigure(scene, colors) {
  const span = UAV_SHARE * scene.shape[0] * scene.voxel;
  const lift = 0.02 * span;
  const lines = [{ from: [0, 0, 0], to: [0, 0, scene.floor], color: colors.plumb, width: 1.5 }];
  const triangles = discTriangles([0, 0, scene.floor], 0.2 * span, colors.plumb);
  for (const [x, y] of [
    [1, 1],
    [1, -1],
    [-1, -1],
    [-1, 1],
  ]) {
    const rotor = [x * 0.36 * span, y * 0.36 * span, 0];
    lines.push({ from: [0, 0, 0], to: rotor, color: colors.uav, width: 3 });
    triangles.push(...discTriangles(rotor, 0.26 * span, colors.uav));
    triangles.push(...discTriangles([rotor[0], rotor[1], lift], 0.17 * span, colors.rotor));
  }
  triangles.push(...discTriangles([0, 0, lift], 0.2 * span, colors.uav));
  return { lines, triangles };
}

// The pyramid between the lens and the image: `points` are the lens, then the image's corners.
function frustumLines(points, color) {
  const [lens, ...corners] = points;
  return corners.flatMap((corner, n) => [
    { from: lens, to: corner, color, width: 2 },
    { from: corner, to: corners[(n + 1) % 4], color, width: 2 },
  ]);
}

// The edges of one voxel, a little outside it.
function voxelEdges(scene, cell, color) {
  const ends = cell.map((index, a) => {
    const low = scene.lower[a] + index * scene.voxel;
    return [low - 0.04 * scene.voxel, low + 1.04 * scene.voxel];
  });
  const corner = (bits) => ends.map((end, a) => end[(bits >> a) & 1]);
  const edges = [];
  for (let bits = 0; bits < 8; bits++) {
    for (let a = 0; a < 3; a++) {
      if (!(bits & (1 << a))) {
        edges.push({ from: corner(bits), to: corner(bits | (1 << a)), color, width: 2.5 });
      }
    }
  }
  return edges;
}
