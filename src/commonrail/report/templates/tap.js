// A tap on a cell of a heat map on a telephone shows its place and number below the map.
for (const map of document.querySelectorAll(".drawing.heat")) {
  const words = [...map.querySelectorAll("svg.wide .cell title")].map((title) => title.textContent);
  const line = Object.assign(document.createElement("p"), { className: "note tapped" });
  [...map.querySelectorAll("svg.narrow .cells path")].forEach((cell, i) => cell.addEventListener("click", () => {
    line.textContent = words[i];
    map.append(line);
  }));
}
