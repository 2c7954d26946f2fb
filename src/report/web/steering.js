// Mouse, touch and keys on a view. A view takes the wheel, and one finger's vertical movement, only
// when it was pressed before, so that the page can be scrolled past it.

const TURN_PER_WIDTH = 2.6;
const KEY_TURN = (6 * Math.PI) / 180;
const KEY_MOVE = 0.06;
const KEY_ZOOM = 1.15;
const WHEEL_ZOOM = 0.0015;

const KEYS = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

// The middle of the held pointers, and how far apart they are.
function gripOf(held) {
  const places = [...held.values()];
  const middle = [0, 1].map((n) => places.reduce((total, at) => total + at[n], 0) / places.length);
  const spread =
    places.length > 1 ? Math.hypot(places[0][0] - places[1][0], places[0][1] - places[1][1]) : 0;
  return { middle, spread };
}

function steerByPointer(canvas, steer) {
  const held = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "mouse") canvas.focus({ preventScroll: true });
    if (event.button === 1) event.preventDefault();
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, [event.clientX, event.clientY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held.has(event.pointerId)) return steer.point(event.clientX, event.clientY);
    const before = gripOf(held);
    held.set(event.pointerId, [event.clientX, event.clientY]);
    const now = gripOf(held);
    const [right, down] = [0, 1].map(
      (n) => (now.middle[n] - before.middle[n]) / canvas.clientWidth,
    );
    if (held.size > 1 || event.shiftKey || event.buttons & 6) steer.move(right, down);
    else steer.turn(right * TURN_PER_WIDTH, down * TURN_PER_WIDTH);
    if (held.size > 1 && now.spread > 0) steer.zoom(before.spread / now.spread);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => held.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", () => steer.point(null));
  canvas.addEventListener("click", (event) => {
    canvas.focus({ preventScroll: true });
    steer.point(event.clientX, event.clientY);
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
}

function steerByWheel(canvas, steer) {
  const onWheel = (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    const pixels = event.deltaY * [1, 16, 400][event.deltaMode];
    steer.zoom(Math.exp(pixels * WHEEL_ZOOM * (event.ctrlKey ? 5 : 1)));
  };
  canvas.addEventListener("wheel", onWheel, { passive: false });
}

function steerByKey(canvas, steer) {
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const way = KEYS[event.key];
    const actions = {
      "+": () => steer.zoom(1 / KEY_ZOOM),
      "=": () => steer.zoom(1 / KEY_ZOOM),
      "-": () => steer.zoom(KEY_ZOOM),
      Escape: () => canvas.blur(),
    };
    if (way && event.shiftKey) steer.move(...way.map((n) => n * KEY_MOVE));
    else if (way) steer.turn(...way.map((n) => n * KEY_TURN));
    else if (actions[event.key]) actions[event.key]();
    else if (!steer.command(event.key.toLowerCase())) return;
    event.preventDefault();
  });
}

function makeSteerable(canvas, steer) {
  steerByPointer(canvas, steer);
  steerByWheel(canvas, steer);
  steerByKey(canvas, steer);
}
