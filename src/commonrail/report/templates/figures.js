(function () {
  "use strict";
  var NS = "http://www.w3.org/2000/svg", readout = null;
  function all(node, query) { return Array.prototype.slice.call(node.querySelectorAll(query)); }
  function ends(text) { return text.split(" ").map(Number); }
  function ticks(low, high, most) {
    var rough = (high - low) / most, power = Math.pow(10, Math.floor(Math.log10(rough)));
    var step = [1, 2, 5, 10].map(function (d) { return d * power; }).find(function (s) { return s >= rough * (1 - 1e-9); });
    var found = [];
    for (var i = Math.ceil(low / step - 1e-9); i <= Math.floor(high / step + 1e-9); i++) found.push(i * step);
    return { step: step, values: found };
  }
  function text(value, step) {
    var decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    return (decimals > 6 ? value.toPrecision(6) : value.toFixed(decimals)).replace("-", "−");
  }
  function label(group, x, y, anchor, words) {
    var node = document.createElementNS(NS, "text");
    node.setAttribute("x", x); node.setAttribute("y", y); node.setAttribute("text-anchor", anchor);
    node.textContent = words; group.appendChild(node);
  }
  // Points of a path: "M1 2l3 4-5 6", in tenths of a pixel; null between stretches.
  function points(path) {
    var tokens = path.getAttribute("d").match(/[Mlh]|-?\d+/g) || [], found = [], x = 0, y = 0, relative = false;
    for (var i = 0; i < tokens.length;) {
      if (tokens[i] === "M") { if (found.length) found.push(null); relative = false; i++; }
      else if (tokens[i] === "l") { relative = true; i++; }
      else if (tokens[i] === "h") { i += 2; continue; }
      x = Number(tokens[i]) + (relative ? x : 0); y = Number(tokens[i + 1]) + (relative ? y : 0);
      found.push([x, y]); i += 2;
    }
    return found;
  }
  function Panel(group) {
    this.group = group;
    this.pane = group.querySelector(".pane");
    this.fixed = this.pane.hasAttribute("data-fixed");
    this.x = ends(this.pane.getAttribute("data-x"));
    this.y = ends(this.pane.getAttribute("data-y"));
    this.view = { x: this.x, y: this.y };
    this.width = Number(this.pane.getAttribute("width"));
    this.height = Number(this.pane.getAttribute("height"));
    this.before = { xs: group.querySelector(".xs").innerHTML, ys: group.querySelector(".ys").innerHTML,
      grid: group.querySelector(".grid").getAttribute("d"), zero: group.querySelector(".zero").getAttribute("d"),
      box: this.pane.getAttribute("viewBox") };
  }
  Panel.prototype.place = function (event) {
    var box = this.pane.getBoundingClientRect(), v = this.view;
    var across = (event.clientX - box.left) / box.width, down = (event.clientY - box.top) / box.height;
    return { across: across, down: down, x: v.x[0] + across * (v.x[1] - v.x[0]), y: v.y[1] - down * (v.y[1] - v.y[0]) };
  };
  Panel.prototype.reset = function () {
    this.view = { x: this.x, y: this.y };
    this.pane.setAttribute("viewBox", this.before.box);
    this.group.querySelector(".grid").setAttribute("d", this.before.grid);
    this.group.querySelector(".zero").setAttribute("d", this.before.zero);
    this.group.querySelector(".xs").innerHTML = this.before.xs;
    this.group.querySelector(".ys").innerHTML = this.before.ys;
  };
  Panel.prototype.show = function (x, y) {
    var w = this.width, h = this.height, fx = this.x[1] - this.x[0], fy = this.y[1] - this.y[0];
    this.view = { x: x, y: y };
    this.pane.setAttribute("viewBox", [10 * w * (x[0] - this.x[0]) / fx, 10 * h * (this.y[1] - y[1]) / fy,
      10 * w * (x[1] - x[0]) / fx, 10 * h * (y[1] - y[0]) / fy].join(" "));
    var tx = ticks(x[0], x[1], Math.max(4, Math.round(w / 90))), ty = ticks(y[0], y[1], Math.max(3, Math.round(h / 45)));
    var grid = "", xs = this.group.querySelector(".xs"), ys = this.group.querySelector(".ys");
    xs.textContent = ""; ys.textContent = "";
    tx.values.forEach(function (v) {
      var at = w * (v - x[0]) / (x[1] - x[0]);
      grid += "M" + at + " 0v" + h;
      if (xs.hasAttribute("data-texts")) label(xs, at, h + 15, "middle", text(v, tx.step));
    });
    ty.values.forEach(function (v) {
      var at = h * (y[1] - v) / (y[1] - y[0]);
      grid += "M0 " + at + "h" + w;
      label(ys, -6, at + 4, "end", text(v, ty.step));
    });
    this.group.querySelector(".grid").setAttribute("d", grid);
    var zero = h * y[1] / (y[1] - y[0]);
    this.group.querySelector(".zero").setAttribute("d", this.before.zero && zero > 0 && zero < h ? "M0 " + zero + "h" + w : "");
  };
  // Value of a curve at a horizontal place, both in tenths of a pixel of the whole panel.
  function height_at(path, across) {
    var found = path._points || (path._points = points(path));
    for (var i = 1; i < found.length; i++) {
      var a = found[i - 1], b = found[i];
      if (a && b && (a[0] - across) * (b[0] - across) <= 0 && a[0] !== b[0])
        return a[1] + (across - a[0]) / (b[0] - a[0]) * (b[1] - a[1]);
    }
    return null;
  }
  function tell(panel, event) {
    var at = panel.place(event), y = panel.y, step = Math.pow(10, Math.floor(Math.log10((panel.view.y[1] - panel.view.y[0]) / 500)));
    var xstep = Math.pow(10, Math.floor(Math.log10((panel.view.x[1] - panel.view.x[0]) / 500)));
    var lines = [text(at.x, xstep) + "; " + text(at.y, step)];
    var across = 10 * panel.width * (at.x - panel.x[0]) / (panel.x[1] - panel.x[0]);
    all(panel.pane, ".curve").forEach(function (curve) {
      var found = height_at(curve, across), name = curve.getAttribute("data-name");
      if (found !== null && name) lines.push(name + ": " + text(y[1] - found / (10 * panel.height) * (y[1] - y[0]), step));
    });
    if (!readout) { readout = document.createElement("div"); readout.className = "readout"; document.body.appendChild(readout); }
    readout.textContent = lines.slice(0, 12).join("\n");
    readout.style.display = "block";
    var left = Math.min(event.clientX + 14, window.innerWidth - readout.offsetWidth - 8);
    readout.style.left = left + "px";
    readout.style.top = Math.max(4, event.clientY - readout.offsetHeight - 10) + "px";
  }
  function hide() { if (readout) readout.style.display = "none"; }
  all(document, ".copy").forEach(function (button) {
    if (!navigator.clipboard) return;
    button.hidden = false;
    button.addEventListener("click", function () {
      navigator.clipboard.writeText(button.previousElementSibling.textContent).then(function () {
        button.textContent = "copied";
        setTimeout(function () { button.textContent = "copy"; }, 1500);
      });
    });
  });
  all(document, "svg.figure").forEach(function (figure) {
    var panels = all(figure, ".panel").map(function (group) { return new Panel(group); });
    panels.forEach(function (panel) {
      if (panel.fixed) return;
      var from = null, frame = null;
      panel.group.style.cursor = "crosshair";
      panel.group.addEventListener("pointerdown", function (event) {
        if (event.pointerType === "touch" || event.button) return;
        from = panel.place(event);
        panel.group.setPointerCapture(event.pointerId);
        event.preventDefault();
      });
      panel.group.addEventListener("pointermove", function (event) {
        if (event.pointerType === "touch") return;
        tell(panel, event);
        if (!from) return;
        var at = panel.place(event);
        if (!frame) { frame = document.createElementNS(NS, "rect"); frame.setAttribute("class", "frame"); panel.group.appendChild(frame); }
        frame.setAttribute("x", panel.width * Math.min(from.across, at.across));
        frame.setAttribute("y", panel.height * Math.min(from.down, at.down));
        frame.setAttribute("width", panel.width * Math.abs(from.across - at.across));
        frame.setAttribute("height", panel.height * Math.abs(from.down - at.down));
      });
      panel.group.addEventListener("pointerup", function (event) {
        var at = panel.place(event), start = from;
        from = null;
        if (frame) { frame.remove(); frame = null; }
        if (!start || Math.abs(at.across - start.across) < 0.02 || Math.abs(at.down - start.down) < 0.02) return;
        var x = [Math.min(start.x, at.x), Math.max(start.x, at.x)], y = [Math.min(start.y, at.y), Math.max(start.y, at.y)];
        panels.forEach(function (other) {
          if (!other.fixed && other.x.join() === panel.x.join()) other.show(x, other === panel ? y : other.view.y);
        });
      });
      panel.group.addEventListener("pointerleave", hide);
      panel.group.addEventListener("dblclick", function () { panels.forEach(function (other) { if (!other.fixed) other.reset(); }); });
    });
  });
})();
