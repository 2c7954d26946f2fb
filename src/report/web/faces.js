// The faces of drawn voxels that a viewer can see, with the light on their corners.
//
// A face is 12 bytes: its voxel as three uint16 and two bytes of room, then uint8 side (2 * axis,
// plus 1 towards the higher index), kind, openness (two bits a corner) and sun (one bit a corner).
// Corners are numbered u + 2 v along the two axes that follow the face's own.

const FACE_BYTES = 12;
const SUN = [-0.42, 0.52, 0.95];
const CORNER_INSET = 0.06;

// A copy of what is drawn (1 or 0), with an empty voxel all around it, and its strides.
function paddedDrawn(kinds, [X, Y, Z]) {
  const strides = [(Y + 2) * (Z + 2), Z + 2, 1];
  const drawn = new Uint8Array((X + 2) * strides[0]);
  for (let x = 0, i = 0; x < X; x++) {
    for (let y = 0; y < Y; y++) {
      const start = (x + 1) * strides[0] + (y + 1) * strides[1] + 1;
      for (let z = 0; z < Z; z++, i++) drawn[start + z] = kinds[i] === HIDDEN ? 0 : 1;
    }
  }
  return { drawn, strides, shape: [X, Y, Z] };
}

// Calls back for each face that borders on nothing drawn: voxel, its padded index, axis, direction.
function eachFace({ drawn, strides, shape: [X, Y, Z] }, callback) {
  for (let x = 0; x < X; x++) {
    for (let y = 0; y < Y; y++) {
      for (let z = 0; z < Z; z++) {
        const at = (x + 1) * strides[0] + (y + 1) * strides[1] + z + 1;
        if (!drawn[at]) continue;
        for (let axis = 0; axis < 3; axis++) {
          if (!drawn[at - strides[axis]]) callback(x, y, z, at, axis, -1);
          if (!drawn[at + strides[axis]]) callback(x, y, z, at, axis, 1);
        }
      }
    }
  }
}

// How many of the three neighbours at each corner leave it open, in two bits each.
function openness({ drawn, strides }, outside, axis) {
  const [du, dv] = [strides[(axis + 1) % 3], strides[(axis + 2) % 3]];
  let bits = 0;
  for (let corner = 0; corner < 4; corner++) {
    const [u, v] = [corner & 1 ? du : -du, corner & 2 ? dv : -dv];
    const [first, second] = [drawn[outside + u], drawn[outside + v]];
    const open = first && second ? 0 : 3 - first - second - drawn[outside + u + v];
    bits |= open << (2 * corner);
  }
  return bits;
}

// Whether nothing drawn stands between a place, in padded voxels, and the sun.
function seesSun({ drawn, strides, shape }, place) {
  const cell = place.map(Math.floor);
  const step = SUN.map(Math.sign);
  const wait = SUN.map((along) => 1 / Math.abs(along));
  const next = SUN.map(
    (along, a) => (along > 0 ? cell[a] + 1 - place[a] : place[a] - cell[a]) * wait[a],
  );
  for (;;) {
    const a = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : next[1] < next[2] ? 1 : 2;
    cell[a] += step[a];
    if (cell[a] < 1 || cell[a] > shape[a]) return true;
    if (drawn[cell[0] * strides[0] + cell[1] * strides[1] + cell[2]]) return false;
    next[a] += wait[a];
  }
}

// Which corners of a face the sun reaches, in one bit each.
function sunlight(grid, voxel, axis, direction) {
  if (SUN[axis] * direction <= 0) return 0;
  const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
  let bits = 0;
  for (let corner = 0; corner < 4; corner++) {
    const place = voxel.map((index) => index + 1.5);
    place[axis] += direction * 0.501;
    place[u] += (corner & 1 ? 1 : -1) * (0.5 - CORNER_INSET);
    place[v] += (corner & 2 ? 1 : -1) * (0.5 - CORNER_INSET);
    if (seesSun(grid, place)) bits |= 1 << corner;
  }
  return bits;
}

// All faces, as bytes for the graphics card.
function facesOf(kinds, shape) {
  const grid = paddedDrawn(kinds, shape);
  let count = 0;
  eachFace(grid, () => count++);
  const bytes = new Uint8Array(count * FACE_BYTES);
  const cells = new Uint16Array(bytes.buffer);
  let face = 0;
  eachFace(grid, (x, y, z, at, axis, direction) => {
    cells.set([x, y, z], (face * FACE_BYTES) / 2);
    const side = 2 * axis + (direction > 0 ? 1 : 0);
    const kind = kinds[(x * shape[1] + y) * shape[2] + z];
    const open = openness(grid, at + direction * grid.strides[axis], axis);
    bytes.set(
      [side, kind, open, sunlight(grid, [x, y, z], axis, direction)],
      face * FACE_BYTES + 8,
    );
    face++;
  });
  return { bytes, count };
}
