// A click on a cell of the map writes the command that shows its injection; the cell's title says where it is.
(() => {
  const told = document.getElementById("cell"), code = told.querySelector("code"), name = told.dataset.model;
  const model = /^[\w./@-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`;
  for (const title of document.querySelectorAll(".heat .cell title")) {
    const cell = title.parentNode, words = title.textContent;
    const found = /^energising time, µs (?<time>[\d.]+); rail pressure, MPa (?<rail>[\d.]+):/.exec(words)
      || /^quantity, mm³ [\d.]+; rail pressure, MPa (?<rail>[\d.]+): (?<time>[\d.]+)[†‡*]? µs$/.exec(words);
    if (!found || !cell.closest("figure").getAttribute("aria-label").match(/^(Energising time|Injected quantity) of/)) continue;
    cell.style.cursor = "pointer";
    cell.addEventListener("click", () => {
      code.textContent = `commonrail simulate ${model} --rail-pressure ${found.groups.rail}MPa --energising-time ${found.groups.time}us --report injection.html`;
      told.classList.add("named");
      cell.closest("figure").before(told);
    });
  }
  told.hidden = false;
})();
