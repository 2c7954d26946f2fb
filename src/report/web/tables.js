// Tables that are sorted by a click on the head of a column.

const words = new Intl.Collator("en", { numeric: true });

// What to sort a row by, and before all a rank that holds in both directions: numbers, then
// differences that stand below scores, then texts; empty cells come last.
function entryOf(row, column) {
  const cell = row.cells[column];
  const { value, apart } = cell.dataset;
  if (value !== undefined) return { rank: apart === undefined ? 0 : 1, value: Number(value) };
  if (cell.classList.contains("empty")) return { rank: 3, value: 0 };
  return { rank: 2, value: cell.textContent };
}

function compare(a, b, sign) {
  if (a.rank !== b.rank) return a.rank - b.rank;
  return sign * (a.rank === 2 ? words.compare(a.value, b.value) : a.value - b.value);
}

// The directions that clicks on a head go through; "none" is the order of the report.
function nextDirection(head) {
  const first = head.firstElementChild.dataset.first;
  const second = first === "ascending" ? "descending" : "ascending";
  return { none: first, [first]: second, [second]: "none" }[head.getAttribute("aria-sort")];
}

function sortTable(table, rows, column, direction) {
  const sign = direction === "descending" ? -1 : 1;
  const sorted =
    direction === "none"
      ? rows
      : [...rows].sort((a, b) => compare(entryOf(a, column), entryOf(b, column), sign));
  table.tBodies[0].append(...sorted);
  // The lines are between rows of the report's order.
  table.classList.toggle("sorted", direction !== "none");
}

function makeSortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const rows = [...table.tBodies[0].rows];
  heads.forEach((head, column) => {
    head.firstElementChild.addEventListener("click", () => {
      const direction = nextDirection(head);
      for (const other of heads) other.setAttribute("aria-sort", "none");
      head.setAttribute("aria-sort", direction);
      sortTable(table, rows, column, direction);
    });
  });
}
