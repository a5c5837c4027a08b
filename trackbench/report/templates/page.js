"use strict";
(() => {
  const value = (row, column) => {
    const cell = row.cells[column];
    const number = parseFloat(cell.dataset.sort);
    return Number.isNaN(number) && cell.dataset.sort === undefined ? cell.textContent.trim() : number;
  };
  const order = (a, b) => {
    if (typeof a === "number" && typeof b === "number") return a - b;
    return String(a).localeCompare(String(b), "en", { numeric: true });
  };
  // "inf" and "nan" of the data are words to parseFloat: they stay last whatever the direction.
  const missing = (x) => typeof x === "number" && Number.isNaN(x);
  const sort = (header) => {
    const table = header.closest("table");
    const rows = [...table.tBodies[0].rows];
    const direction = header.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
    const sign = direction === "ascending" ? 1 : -1;
    table.querySelectorAll("thead th").forEach((th) => th.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", direction);
    const keys = new Map(rows.map((row) => [row, value(row, header.cellIndex)]));
    rows.sort((r, s) => {
      const [a, b] = [keys.get(r), keys.get(s)];
      if (missing(a) || missing(b)) return missing(a) - missing(b);
      return sign * order(a, b);
    });
    table.tBodies[0].append(...rows);
  };
  const enlarge = (button, large) => {
    button.closest("figure").classList.toggle("large", large);
    button.setAttribute("aria-pressed", String(large));
    button.textContent = large ? "Close" : "Enlarge";
  };
  document.querySelectorAll("thead th > button").forEach((button) => {
    button.addEventListener("click", () => sort(button.parentElement));
  });
  document.querySelectorAll(".enlarge").forEach((button) => {
    const toggle = () => enlarge(button, button.getAttribute("aria-pressed") !== "true");
    button.addEventListener("click", toggle);
    button.closest("figure").querySelector("svg").addEventListener("click", toggle);
  });
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    document.querySelectorAll("figure.large .enlarge").forEach((button) => enlarge(button, false));
  });
})();
