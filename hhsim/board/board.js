"use strict";
const value = (row, column) => row.cells[column].textContent.replace(/^[~]/, "").replaceAll(",", "");
function sort(table, column, down) {
  const rows = [...table.tBodies[0].rows];
  const order = (a, b) => {
    const [x, y] = [value(a, column), value(b, column)];
    const [p, q] = [parseFloat(x), parseFloat(y)];
    if (table.tHead.rows[0].cells[column].dataset.number === undefined) return x.localeCompare(y) * (down ? -1 : 1);
    if (isNaN(p) || isNaN(q)) return isNaN(p) - isNaN(q);
    return (p - q) * (down ? -1 : 1);
  };
  table.tBodies[0].append(...rows.sort(order));
  for (const head of table.tHead.rows[0].cells) head.removeAttribute("aria-sort");
  table.tHead.rows[0].cells[column].setAttribute("aria-sort", down ? "descending" : "ascending");
}
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement;
    sort(head.closest("table"), head.cellIndex, head.getAttribute("aria-sort") === "ascending");
  });
}
for (const input of document.querySelectorAll("input[data-table]")) {
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = [...document.getElementById(input.dataset.table).tBodies[0].rows];
    let shown = 0;
    for (const row of rows) {
      const text = [...row.cells].map((cell) => cell.textContent).join(" ").toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    document.getElementById(input.dataset.table + "-count").textContent = `${shown} of ${rows.length} rows`;
  });
}
