// Tables that are sorted by a click on the head of a column.

const words = new Intl.Collator("en", { numeric: true });

// The value to sort a row by: a number, a text, or null for an empty cell.
function entryOf(row, column) {
  const cell = row.cells[column];
  if (cell.dataset.value !== undefined) return Number(cell.dataset.value);
  if (cell.classList.contains("empty")) return null;
  return cell.dataset.text ?? cell.textContent;
}

// Numbers before texts; empty cells come last in both directions.
function compare(a, b, sign) {
  if (a === null || b === null) return (a === null) - (b === null);
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
  return sign * (typeof a === "number" ? a - b : words.compare(a, b));
}

// The directions that clicks on a head go through; "none" is the order of the report.
function nextDirection(head) {
  const first = head.firstElementChild.dataset.first;
  const second = first === "ascending" ? "descending" : "ascending";
  return { none: first, [first]: second, [second]: "none" }[head.ariaSort];
}

function sortTable(table, rows, column, direction) {
  const sign = direction === "descending" ? -1 : 1;
  const sorted = direction === "none" ? rows : [...rows].sort(
    (a, b) => compare(entryOf(a, column), entryOf(b, column), sign),
  );
  table.tBodies[0].append(...sorted);
}

function makeSortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  const rows = [...table.tBodies[0].rows];
  heads.forEach((head, column) => {
    head.firstElementChild.addEventListener("click", () => {
      const direction = nextDirection(head);
      for (const other of heads) other.ariaSort = "none";
      head.ariaSort = direction;
      sortTable(table, rows, column, direction);
    });
  });
}
