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
  // Verdicts by their word and by what is typed; a part of a bar is a link to those it counts.
  const filter = (section) => {
    const words = new Map(), chosen = new Set(), rows = [...section.querySelectorAll("tbody tr")];
    const of = new Map(rows.map((row) => [row, row.querySelector(".verdict")?.dataset.word]));
    const asked = document.createElement("input"), bar = document.createElement("p");
    const shown = document.createElement("span");
    const show = () => {
      const text = asked.value.trim().toLowerCase();
      for (const [word, button] of words) button.setAttribute("aria-pressed", String(chosen.has(word)));
      for (const row of rows) {
        const fits = (!chosen.size || chosen.has(of.get(row))) && row.textContent.toLowerCase().includes(text);
        row.hidden = !fits;
      }
      section.querySelectorAll("table").forEach((table) => {
        const empty = [...table.tBodies[0].rows].every((row) => row.hidden);
        (table.closest("details") ?? table.closest(".scroll")).hidden = empty;
      });
      shown.textContent = `${rows.filter((row) => !row.hidden).length} of ${rows.length} rows`;
    };
    for (const word of new Set(of.values())) {
      if (!word) continue;
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: word, className: `verdict ${section.querySelector(`[data-word="${word}"]`).classList[1]}` });
      button.addEventListener("click", () => { if (!chosen.delete(word)) chosen.add(word); show(); });
      words.set(word, button);
    }
    Object.assign(asked, { type: "search", placeholder: "filter, metric, words", ariaLabel: "Show rows with these words" });
    asked.addEventListener("input", show);
    bar.className = "chooser";
    bar.append(...words.values(), asked, shown);
    section.querySelector("h2").after(bar);
    show();
    document.querySelectorAll(`a[data-word][href="#${section.id}"]`).forEach((link) => link.addEventListener("click", () => {
      chosen.clear();
      chosen.add(link.dataset.word);
      asked.value = "";
      section.querySelectorAll("details").forEach((part) => { part.open = true; });
      show();
    }));
  };
  document.querySelectorAll("section.verdicts").forEach(filter);
  document.querySelectorAll("thead th > button").forEach((button) => {
    button.addEventListener("click", () => sort(button.parentElement));
  });
  document.querySelectorAll("figcaption").forEach((caption) => {
    const button = document.createElement("button"), svg = caption.closest("figure").querySelector("svg");
    Object.assign(button, { type: "button", className: "tool enlarge" });
    caption.append(button);
    enlarge(button, false);
    const toggle = () => enlarge(button, button.getAttribute("aria-pressed") !== "true");
    button.addEventListener("click", toggle);
    if (!("live" in svg.dataset)) svg.addEventListener("click", toggle);
  });
  // What is folded is printed unfolded, but for the config, of which paper names the file.
  const folded = [];
  window.addEventListener("beforeprint", () => {
    folded.push(...document.querySelectorAll("details:not(.screen, [open])"));
    folded.forEach((part) => { part.open = true; });
  });
  window.addEventListener("afterprint", () => folded.splice(0).forEach((part) => { part.open = false; }));
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    document.querySelectorAll("figure.large .enlarge").forEach((button) => enlarge(button, false));
  });
})();
