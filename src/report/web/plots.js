// Learning curves that name their values where the pointer is, or where the arrow keys have moved.

function makeReadable(plot) {
  const stops = JSON.parse(plot.dataset.stops);
  const svg = plot.querySelector("svg");
  const cursor = svg.querySelector(".cursor");
  const epoch = plot.querySelector(".stop b");
  const values = all(".runs b", plot);
  let shown = stops.length - 1;
  const show = (index, isPointed = true) => {
    shown = index;
    cursor.style.visibility = isPointed ? "visible" : "hidden";
    cursor.setAttribute("x1", stops[index].x);
    cursor.setAttribute("x2", stops[index].x);
    epoch.textContent = stops[index].epoch;
    values.forEach((value, run) => (value.textContent = stops[index].texts[run]));
  };
  const showLast = () => show(stops.length - 1, false);
  const point = (event) => {
    const box = svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * svg.viewBox.baseVal.width;
    const away = stops.map((stop) => Math.abs(stop.x - x));
    show(away.indexOf(Math.min(...away)));
  };
  svg.addEventListener("pointermove", point);
  svg.addEventListener("pointerdown", point);
  svg.addEventListener("pointerleave", showLast);
  svg.addEventListener("blur", showLast);
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "Escape") showLast();
    if (!step) return;
    event.preventDefault();
    show(Math.min(Math.max(shown + step, 0), stops.length - 1));
  });
}
