// Where the observer is: turned around a target in the occ frame (x forward, y left, z up).
//
// Yaw is counter-clockwise from straight ahead, pitch is downwards; the observer never rolls.

const HFOV = (36 * Math.PI) / 180;
const MARGIN = 0.02;
const PITCHES = { behind: (32 * Math.PI) / 180, above: Math.PI / 2 };
const LOWEST = (-80 * Math.PI) / 180;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a, by) => [a[0] * by, a[1] * by, a[2] * by];
const sum = (...all) => [0, 1, 2].map((n) => all.reduce((total, a) => total + a[n], 0));
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];

// The observer's own axes.
function axesOf({ yaw, pitch }) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  return { forward: [cp * cy, cp * sy, -sp], right: [sy, -cy, 0], up: [sp * cy, sp * sy, cp] };
}

function eyeOf(orbit) {
  return sum(orbit.target, scaled(axesOf(orbit).forward, -orbit.distance));
}

// As near as lets all the points into the picture, as the figures' own view does: the points bound
// the eye along each side of the lens; where left meets right, and top meets bottom, is nearest.
function fitted(points, pitch, aspect) {
  const { forward, right, up } = axesOf({ yaw: 0, pitch });
  const slopeX = Math.tan(HFOV / 2) * (1 - 2 * MARGIN);
  const slopeY = slopeX / aspect;
  let [east, west, south, north] = [-Infinity, Infinity, -Infinity, Infinity];
  let [near, far] = [Infinity, -Infinity];
  for (const point of points) {
    const [x, y, z] = [dot(right, point), -dot(up, point), dot(forward, point)];
    [east, west] = [Math.max(east, x - slopeX * z), Math.min(west, x + slopeX * z)];
    [south, north] = [Math.max(south, y - slopeY * z), Math.min(north, y + slopeY * z)];
    [near, far] = [Math.min(near, z), Math.max(far, z)];
  }
  const depth = Math.min((west - east) / (2 * slopeX), (north - south) / (2 * slopeY));
  const eye = sum(
    scaled(right, (west + east) / 2),
    scaled(up, -(north + south) / 2),
    scaled(forward, depth),
  );
  const distance = (near + far) / 2 - depth;
  return { target: sum(eye, scaled(forward, distance)), yaw: 0, pitch, distance };
}

// What moves to the right in the picture is what the pointer holds: the observer goes left.
function turned(orbit, right, down) {
  const pitch = Math.min(Math.max(orbit.pitch + down, LOWEST), Math.PI / 2);
  return { ...orbit, yaw: orbit.yaw - right, pitch };
}

// By shares of the picture's width.
function moved(orbit, right, down) {
  const { right: across, up } = axesOf(orbit);
  const width = 2 * orbit.distance * Math.tan(HFOV / 2);
  const target = sum(orbit.target, scaled(across, -right * width), scaled(up, down * width));
  return { ...orbit, target };
}

function zoomed(orbit, factor, [nearest, furthest]) {
  return { ...orbit, distance: Math.min(Math.max(orbit.distance * factor, nearest), furthest) };
}
