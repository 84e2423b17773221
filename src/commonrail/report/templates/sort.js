// Tables sorted by a click on a head, numbers by value, what has none at the end; another click turns the order round.
for (const table of document.querySelectorAll("main table")) {
  const body = table.tBodies[0], heads = table.tHead ? [...table.tHead.rows[0].cells] : [];
  if (!body || body.rows.length < 3) continue;
  heads.forEach((head, column) => {
    const sort = () => {
      const turn = head.getAttribute("aria-sort") === "descending" ? 1 : -1;
      const text = (row) => (row.cells[column] ? row.cells[column].textContent.trim() : "");
      const value = (row) => parseFloat(text(row).replace("−", "-").replace(/^[^\d.-]+/, "").replace(/,(?=\d{3})/g, ""));
      const numeric = !head.classList.contains("word");
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", turn > 0 ? "ascending" : "descending");
      body.append(...[...body.rows].sort((a, b) => {
        if (!numeric) return -turn * text(a).localeCompare(text(b), undefined, { numeric: true });
        const [x, y] = [value(a), value(b)];
        return Number.isNaN(x) || Number.isNaN(y) ? Number.isNaN(x) - Number.isNaN(y) : turn * (x - y);
      }));
    };
    head.tabIndex = 0;
    head.title = "sort";
    head.style.cursor = "pointer";
    head.addEventListener("click", sort);
    head.addEventListener("keydown", (event) => { if (event.key === "Enter") sort(); });
  });
}
