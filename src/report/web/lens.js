// From the occ frame to the picture, and back: clip = [across . d, up . d, depth, forward . d] of
// the way d from the eye to a point.

const NEAR_M = 0.1;

function lensOf(eye, across, up, forward, far, hazeFromTo) {
  const slope = (far + NEAR_M) / (far - NEAR_M);
  const rows = [across, up, scaled(forward, slope), forward];
  const shifts = [0, 0, (-2 * far * NEAR_M) / (far - NEAR_M), 0];
  const columns = [0, 1, 2].map((n) => rows.map((row) => row[n]));
  const last = rows.map((row, n) => shifts[n] - dot(row, eye));
  return {
    eye,
    across,
    up,
    forward,
    hazeFromTo,
    clipFromOcc: new Float32Array([...columns, last].flat()),
  };
}

function diagonalOf(scene) {
  return Math.hypot(...scene.shape) * scene.voxel;
}

function orbitLens(orbit, aspect, scene) {
  const { forward, right, up } = axesOf(orbit);
  const eye = eyeOf(orbit);
  const wide = Math.tan(HFOV / 2);
  const length = scene.shape[0] * scene.voxel;
  const from = Math.max(orbit.distance - length / 2, 0);
  return lensOf(
    eye,
    scaled(right, 1 / wide),
    scaled(up, aspect / wide),
    forward,
    orbit.distance + 3 * diagonalOf(scene),
    [from, from + length],
  );
}

// Through the UAV's camera: `frustum` is the lens and the image's corners, clockwise from the top
// left. The whole image fits into that
// share of the view.
function cameraLens(frustum, aspect, scene, share = 1) {
  const [eye, ...corners] = frustum;
  const [topLeft, topRight, , bottomLeft] = corners.map((corner) => sum(corner, scaled(eye, -1)));
  const unit = (a) => scaled(a, 1 / Math.hypot(...a));
  const right = unit(sum(topRight, scaled(topLeft, -1)));
  const down = unit(sum(bottomLeft, scaled(topLeft, -1)));
  const forward = cross(right, down);
  const depth = dot(topLeft, forward);
  const [west, east] = [dot(topLeft, right), dot(topRight, right)];
  const [north, south] = [dot(topLeft, down), dot(bottomLeft, down)];
  const wider = (east - west) / (south - north) / aspect;
  const [shareX, shareY] = [Math.min(1, 1 / wider), Math.min(1, wider)].map((all) => all * share);
  const across = scaled(
    sum(scaled(right, 2 * depth), scaled(forward, -west - east)),
    shareX / (east - west),
  );
  const up = scaled(
    sum(scaled(down, -2 * depth), scaled(forward, north + south)),
    shareY / (south - north),
  );
  const haze = [0, scene.shape[0] * scene.voxel];
  return { ...lensOf(eye, across, up, forward, 3 * diagonalOf(scene), haze), isCamera: true };
}

// The way from the eye through a place of the picture, from -1 to 1 to the right and upwards.
function rayThrough({ across, up, forward }, x, y) {
  const sides = [cross(up, forward), cross(forward, across), cross(across, up)];
  const volume = dot(across, sides[0]);
  return scaled(sum(scaled(sides[0], x), scaled(sides[1], y), sides[2]), 1 / volume);
}

// Where a point is in the picture, as [x, y], or null behind the eye.
function placeOf({ eye, across, up, forward }, point) {
  const way = sum(point, scaled(eye, -1));
  const depth = dot(forward, way);
  return depth > NEAR_M ? [dot(across, way) / depth, dot(up, way) / depth] : null;
}
