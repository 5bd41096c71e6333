"use strict";
(function () {
  const root = document.documentElement;
  const status = document.getElementById("status");

  // Light and dark: the system's, until one is chosen.
  const theme = document.getElementById("theme");
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (root.dataset.theme || (system.matches ? "dark" : "light")) === "dark";
  const showTheme = () => theme.setAttribute("aria-pressed", String(isDark()));
  theme.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    try { localStorage.setItem("graspcast-theme", root.dataset.theme); } catch (error) { /* not kept */ }
    showTheme();
  });
  system.addEventListener("change", showTheme);
  showTheme();

  // Tables sort by a column: numbers by their values, text by its letters, what is empty last.
  const compare = new Intl.Collator("en", { numeric: true }).compare;
  function sort(heading) {
    const table = heading.closest("table");
    const column = heading.cellIndex;
    const falling = heading.getAttribute("aria-sort") === "ascending";
    const body = table.tBodies[0];
    const numeric = heading.classList.contains("number");
    const key = (row) => {
      const cell = row.cells[column];
      if (!numeric) return cell.textContent.trim();
      return cell.dataset.v === undefined ? null : Number(cell.dataset.v);
    };
    const rows = Array.from(body.rows, (row) => [key(row), row]);
    rows.sort(([a], [b]) => {
      if (a === null || b === null) return (a === null) - (b === null);
      const order = numeric ? a - b : compare(a, b);
      return falling ? -order : order;
    });
    body.append(...rows.map(([, row]) => row));
    for (const other of table.tHead.rows[0].cells) other.setAttribute("aria-sort", "none");
    heading.setAttribute("aria-sort", falling ? "descending" : "ascending");
    status.textContent = `Sorted by ${heading.textContent.trim()}, ${falling ? "falling" : "rising"}`;
  }
  for (const heading of document.querySelectorAll("table.sorts thead th")) {
    heading.querySelector("button").addEventListener("click", () => sort(heading));
  }

  // Cases larger, one after the other.
  const viewer = document.getElementById("viewer");
  const viewed = document.getElementById("viewed");
  const title = document.getElementById("viewer-title");
  const cases = Array.from(document.querySelectorAll("article.case"));
  const withPictures = cases.filter((one) => one.querySelector("button.zoom"));
  let at = 0;
  function show(number) {
    at = (number + withPictures.length) % withPictures.length;
    const one = withPictures[at];
    title.textContent = one.querySelector("h3, h4, h5").textContent;
    const mode = document.createElement("p");
    const of = one.closest("section.mode").querySelector("h3, h4").textContent;
    mode.textContent = `${of} (${at + 1} of ${withPictures.length})`;
    const shots = document.createElement("div");
    shots.className = "shots";
    for (const shot of one.querySelectorAll(".shot")) shots.append(shot.cloneNode(true));
    viewed.replaceChildren(mode, shots, one.querySelector("dl").cloneNode(true));
    viewed.scrollTop = 0;
    status.textContent = title.textContent;
  }
  withPictures.forEach((one, number) => {
    one.querySelector("button.zoom").addEventListener("click", () => {
      show(number);
      viewer.showModal();
    });
  });
  document.getElementById("previous").addEventListener("click", () => show(at - 1));
  document.getElementById("next").addEventListener("click", () => show(at + 1));
  document.getElementById("close").addEventListener("click", () => viewer.close());
  viewer.addEventListener("click", (event) => { if (event.target === viewer) viewer.close(); });
  viewer.addEventListener("keydown", (event) => {
    if (event.key === "ArrowLeft") show(at - 1);
    else if (event.key === "ArrowRight") show(at + 1);
    else return;
    event.preventDefault();
  });
  viewer.addEventListener("close", () => {
    const button = withPictures[at].querySelector("button.zoom");
    button.focus();
    button.scrollIntoView({ block: "nearest" });
  });
})();
