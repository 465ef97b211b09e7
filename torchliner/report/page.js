"use strict";
// A click on a heading sorts its table; what is no number stands behind the numbers.
for (const table of document.querySelectorAll("table")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => head.firstElementChild.addEventListener("click", () => {
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const text = (row) => row.cells[column].textContent.replaceAll("\u2212", "-");
    const number = (row) => Number.isNaN(parseFloat(text(row))) ? Infinity : parseFloat(text(row));
    const order = (a, b) => sign * (number(a) - number(b) || text(a).localeCompare(text(b)));
    [...table.tBodies[0].rows].sort(order).forEach((row) => table.tBodies[0].append(row));
    for (const each of heads) each.setAttribute("aria-sort", "none");
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  }));
}
