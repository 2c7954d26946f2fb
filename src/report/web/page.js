// Tables to sort, learning curves, and what the page says of itself to tests.

const root = document.documentElement;
const all = (selector, from = document) => [...from.querySelectorAll(selector)];
const CONFIG = { displayModeBar: false, responsive: true };

addEventListener("error", (event) => (root.dataset.error = event.message));
addEventListener("unhandledrejection", (event) => (root.dataset.error = event.reason));

// What to sort a row by, and before all a rank that holds in both directions: numbers come before
// differences that stand below scores, these before texts, and empty cells last.
function keyOf(row, column) {
  const cell = row.cells[column];
  const { value, apart } = cell.dataset;
  if (value !== undefined) return { rank: apart === undefined ? 0 : 1, value: Number(value) };
  return { rank: cell.classList.contains("empty") ? 3 : 2, value: cell.textContent };
}

function compare(a, b, sign) {
  if (a.rank < 2 || a.rank !== b.rank) return a.rank - b.rank || sign * (a.value - b.value);
  return sign * a.value.localeCompare(b.value, "en", { numeric: true });
}

// The heads of a table are buttons. The first press sorts by the best first, the second the other
// way round, and the third restores the order of the report.
function makeSortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const rows = [...table.tBodies[0].rows];
  heads.forEach((head, column) => {
    const { first } = head.firstElementChild.dataset;
    const second = first === "ascending" ? "descending" : "ascending";
    head.firstElementChild.addEventListener("click", () => {
      const direction = { [first]: second, [second]: "none" }[head.ariaSort] ?? first;
      for (const other of heads) other.ariaSort = other === head ? direction : "none";
      const sign = direction === "ascending" ? 1 : -1;
      const by = (a, b) => compare(keyOf(a, column), keyOf(b, column), sign);
      table.tBodies[0].append(...(direction === "none" ? rows : [...rows].sort(by)));
      table.classList.toggle("sorted", direction !== "none");
    });
  });
}

// Brings the page to life. Without scripts it still shows everything but curves and meshes.
async function start() {
  all(".table table").forEach(makeSortable);
  for (const div of all(".curves")) {
    const { data, layout } = JSON.parse(div.nextElementSibling.textContent);
    await Plotly.newPlot(div, data, layout, CONFIG);
  }
  const [box] = all(".viewer");
  if (box) box.hidden = !document.createElement("canvas").getContext("webgl");
  if (box && !box.hidden) await new Viewer(box).open();
  root.dataset.ready = true;
}
