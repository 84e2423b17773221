(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("each").textContent);
  var field = document.getElementById("injector"), table = document.getElementById("values");
  var told = document.getElementById("told"), list = document.getElementById("injectors");
  data.each.forEach(function (one) {
    var option = document.createElement("option");
    option.value = one.injector;
    list.appendChild(option);
  });
  var heads = Array.from(table.parentNode.querySelectorAll("th"), function (head) { return head.textContent; });
  function cell(row, text) {
    var node = row.insertCell(), place = row.cells.length - 1;
    node.textContent = text;
    if (place) node.dataset.label = heads[place];
    else node.className = "word";
  }
  function short(value) { return value === null || value === undefined ? "–" : Number(value).toPrecision(5).replace("-", "−"); }
  function show() {
    var one = data.each.find(function (found) { return found.injector === field.value; });
    table.textContent = "";
    told.textContent = one ? "J fell from " + short(one.J[0]) + " to " + short(one.J[1]) + "." : field.value ? "This page has no injector of this name." : "";
    if (!one) return;
    data.parameters.forEach(function (p, i) {
      var row = table.insertRow(), value = one.values[i];
      cell(row, p.name + (p.unit ? ", " + p.unit : ""));
      cell(row, short(value));
      cell(row, short(p.median));
      cell(row, p.lower === null || p.lower === undefined ? "–" : Math.round(100 * (value - p.lower) / (p.upper - p.lower)));
    });
  }
  field.addEventListener("input", show);
  field.value = data.each[0].injector;
  show();
})();
