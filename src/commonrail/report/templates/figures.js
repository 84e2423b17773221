// Charts of reports and pages: zoom, a cursor over all panels with the same horizontal axis, legend, files. `figure.py`
// draws them; its rules hold here: coordinates within a pane are tenths of a pixel, ticks are those of `axis.py`. Ends of
// a logarithmic axis are powers of ten.
const charts = (() => {
  "use strict";
  const NS = "http://www.w3.org/2000/svg", list = [];
  const all = (node, query) => [...node.querySelectorAll(query)];
  const log10 = (value) => Math.log10(Math.max(value, 1e-300));

  function set(node, attributes) {
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
    return node;
  }
  function element(kind, attributes, holder) {
    const node = set(document.createElementNS(NS, kind), attributes);
    if (holder) holder.append(node);
    return node;
  }
  function label(holder, x, y, anchor, words) {
    element("text", { x, y, "text-anchor": anchor }, holder).textContent = words;
  }

  // Round values between two ends, about `most` of them, each with its text.
  function ticks(low, high, most) {
    const rough = (high - low) / Math.max(most, 1), power = 10 ** Math.floor(Math.log10(rough));
    const steps = [0.2, 0.5, 1, 2, 5, 10].map((digit) => digit * power);
    for (let i = steps.findIndex((one) => one >= rough * (1 - 1e-9)); ; i--) {
      const step = steps[i], found = [];
      for (let k = Math.ceil(low / step - 1e-9); k <= Math.floor(high / step + 1e-9); k++) found.push([k * step, text(k * step, step)]);
      if (found.length > 1 || !i) return found;
    }
  }
  function logTicks(low, high, most) {
    let found = [];
    for (const digits of [[1, 2, 5], [1]]) {
      found = [];
      for (let p = Math.floor(low); p <= Math.ceil(high); p++) for (const d of digits) found.push(d * 10 ** p);
      found = found.filter((v) => v * (1 + 1e-9) >= 10 ** low && v <= 10 ** high * (1 + 1e-9));
      if (found.length <= Math.max(most, 3)) break;
    }
    const every = Math.ceil(found.length / Math.max(most, 3));
    return found.filter((_, i) => i % every === 0).map((v) => [log10(v), text(v, 0)]);
  }
  function text(value, step) {
    const size = Math.max(Math.abs(value), step);
    let words = String(+value.toPrecision(10));
    if (size >= 1e6 || (size > 0 && size < 1e-4)) words = String(+value.toPrecision(6));
    else if (step) words = value.toFixed(Math.max(0, -Math.floor(Math.log10(step) + 1e-9)));
    return Number(words) ? words.replace("-", "−") : "0";
  }

  // Points of a path such as "M1 2l3 4-5 6" or "M1 2h1" in tenths of a pixel, null between stretches.
  function pointsOf(path) {
    const d = path.getAttribute("d");
    if (path._drawn === d) return path._points;
    const tokens = d.match(/[MlhLz]|-?[\d.]+/g) || [], found = [];
    let x = 0, y = 0, relative = false;
    for (let i = 0; i < tokens.length;) {
      const token = tokens[i];
      if (token === "M") { if (found.length) found.push(null); relative = false; i++; }
      else if (token === "l" || token === "L") { relative = token === "l"; i++; }
      else if (token === "h") i += 2;
      else if (token === "z") i++;
      else {
        x = Number(token) + (relative ? x : 0);
        y = Number(tokens[i + 1]) + (relative ? y : 0);
        found.push([x, y]);
        i += 2;
      }
    }
    path._drawn = d;
    return (path._points = found);
  }
  // Height of a line at a horizontal place, or of the nearest marker within `near`; null where there is none.
  function heightAt(path, across, near) {
    const found = pointsOf(path);
    if (path.classList.contains("marks")) {
      const nearest = found.reduce((best, p) => (p && Math.abs(p[0] - across) < (best ? Math.abs(best[0] - across) : near) ? p : best), null);
      return nearest && nearest[1];
    }
    for (let i = 1; i < found.length; i++) {
      const a = found[i - 1], b = found[i];
      if (a && b && (a[0] - across) * (b[0] - across) <= 0 && a[0] !== b[0]) return a[1] + ((across - a[0]) / (b[0] - a[0])) * (b[1] - a[1]);
    }
    return null;
  }

  class Panel {
    constructor(group, chart) {
      const pane = group.querySelector(".pane"), ends = (name) => pane.getAttribute(name).split(" ").map(Number);
      Object.assign(this, { group, chart, pane, frame: group.querySelector("rect"), title: group.dataset.title, fixed: "fixed" in pane.dataset, rows: "rows" in pane.dataset, log: "log" in pane.dataset, own: [] });
      this.x = ends("data-x");
      this.y = this.log ? ends("data-y").map(log10) : ends("data-y");
      this.view = { x: this.x, y: this.y };
      this.width = Number(pane.getAttribute("width"));
      this.height = Number(pane.getAttribute("height"));
    }

    get zoomed() { return this.view.x !== this.x || this.view.y !== this.y; }

    get curves() { return all(this.pane, ".curve, .marks").filter((path) => path.style.display !== "none"); }

    at(event) {
      const box = this.frame.getBoundingClientRect(), { x, y } = this.view;
      const across = (event.clientX - box.left) / box.width, down = (event.clientY - box.top) / box.height;
      return { across, down, x: x[0] + across * (x[1] - x[0]), y: y[1] - down * (y[1] - y[0]) };
    }

    across(x) { return (10 * this.width * (x - this.x[0])) / (this.x[1] - this.x[0]); }

    value(down) { return this.y[1] - (down / (10 * this.height)) * (this.y[1] - this.y[0]); }

    // Number of a vertical value with the decimals of a 500th of what is in sight.
    said(value) {
      const [low, high] = this.view.y, shown = this.log ? 10 ** value : value, size = this.log ? shown : high - low;
      return text(shown, 10 ** Math.floor(Math.log10(size / 500)));
    }

    show(x, y) {
      const w = this.width, h = this.height, fx = this.x[1] - this.x[0], fy = this.y[1] - this.y[0];
      const xs = this.group.querySelector(".xs"), ys = this.group.querySelector(".ys"), most = Math.max(3, Math.round(h / 45));
      const px = (v) => (w * (v - x[0])) / (x[1] - x[0]), py = (v) => (h * (y[1] - v)) / (y[1] - y[0]);
      this.view = { x, y };
      set(this.pane, { viewBox: [(10 * w * (x[0] - this.x[0])) / fx, (10 * h * (this.y[1] - y[1])) / fy, (10 * w * (x[1] - x[0])) / fx, (10 * h * (y[1] - y[0])) / fy].join(" ") });
      let grid = "";
      xs.replaceChildren();
      if (!this.rows) ys.replaceChildren();
      for (const [v, words] of ticks(x[0], x[1], Math.max(4, Math.round(w / 90)))) {
        grid += `M${px(v)} 0v${h}`;
        if ("texts" in xs.dataset) label(xs, px(v), h + 15, "middle", words);
      }
      for (const [v, words] of this.rows ? [] : (this.log ? logTicks : ticks)(y[0], y[1], most)) {
        grid += `M0 ${py(v)}h${w}`;
        label(ys, -6, py(v) + 4, "end", words);
      }
      set(this.group.querySelector(".grid"), { d: grid });
      const zero = this.group.querySelector(".zero");
      this.crossed ??= Boolean(zero.getAttribute("d"));
      set(zero, { d: this.crossed && y[0] < 0 && y[1] > 0 ? `M0 ${py(0)}h${w}` : "" });
    }

    // Vertical range of the curves between two ends.
    fit([low, high]) {
      const from = this.across(low), to = this.across(high), scaling = this.pane.dataset.scaled;
      const own = this.curves.filter((path) => !scaling || path.dataset.look === scaling || path._own);
      const downs = own.flatMap((path) => [
        ...pointsOf(path).filter((p) => p && p[0] >= from && p[0] <= to).map((p) => p[1]),
        ...[from, to].map((across) => heightAt(path, across, 0)).filter((v) => v !== null),
      ]);
      if (!downs.length) return this.y;
      const top = this.value(Math.min(...downs)), bottom = this.value(Math.max(...downs)), room = 0.04 * (top - bottom) || 0.02 * (this.y[1] - this.y[0]);
      return [bottom - room, top + room];
    }

    // Other ends of both axes; what is enlarged stays enlarged.
    range(x, y) {
      if (String([this.x, this.y]) === String([x, y])) return;
      const [view, was] = [this.view, this.zoomed];
      this.x = x;
      this.y = y;
      this.pane.dataset.x = x.join(" ");
      this.show(was ? view.x : x, was ? view.y : y);
    }

    // Makes room for drawn series that the vertical range does not hold.
    include() {
      const [low, high] = this.fit(this.view.x), [bottom, top] = this.view.y;
      if (low < bottom || high > top) this.show(this.view.x, [Math.min(low, bottom), Math.max(high, top)]);
    }

    // Draws series { key, name, x, y, colour, width, dash, marks, square, faint, still } in the units of the axes over what
    // the pane has; a still one keeps its arrays from one call to the next.
    draw(series) {
      while (this.own.length < series.length) this.own.push(element("path", { fill: "none", "stroke-linejoin": "bevel", "vector-effect": "non-scaling-stroke" }, this.pane));
      while (this.own.length > series.length) this.own.pop().remove();
      series.forEach((s, i) => {
        const path = this.own[i], style = [s.key, s.name, s.colour, s.width, s.dash, s.marks, s.square, s.faint, this.chart.off.has(String(s.key))].join("|");
        if (path._style !== style) {
          set(path, { class: s.marks ? "marks" : "curve", "data-key": s.key ?? "", "data-name": s.name ?? "", stroke: s.colour, "stroke-width": s.width,
            "stroke-dasharray": s.dash || "none", "stroke-linecap": s.marks ? (s.square ? "square" : "round") : "butt", opacity: s.faint ? 0.45 : 1 });
          path.style.display = this.chart.off.has(String(s.key)) ? "none" : "";
          path._style = style;
          path._own = true;
        }
        const still = s.still && path._y === s.y && path._ends === this.x && path._heights === this.y;
        if (!still) this.trace(path, s);
        Object.assign(path, { _y: s.y, _ends: this.x, _heights: this.y });
      });
      if (cursor && cursor.title === this.chart.title) this.mark(cursor.x);
    }

    trace(path, { x, y, marks }) {
      const fx = (10 * this.width) / (this.x[1] - this.x[0]), fy = (10 * this.height) / (this.y[1] - this.y[0]);
      const points = [];
      let d = "", open = false;
      for (let i = 0; i < x.length; i++) {
        const px = Math.round(fx * (x[i] - this.x[0])), py = Math.round(fy * (this.y[1] - (this.log ? log10(y[i]) : y[i])));
        if (!Number.isFinite(px + py)) { open = false; points.push(null); continue; }
        points.push([px, py]);
        d += marks ? `M${px} ${py}h1` : `${open ? "L" : "M"}${px} ${py}`;
        open = true;
      }
      set(path, { d });
      path._drawn = d;
      path._points = points;
    }

    // Line of the cursor and dots on the curves; returns names and values there.
    mark(x) {
      this.reader ??= element("path", { class: "reader" }, this.group);
      this.dots ??= element("path", { class: "dots" }, this.group);
      const { view, width, height } = this, place = (width * (x - view.x[0])) / (view.x[1] - view.x[0]);
      if (x === null || place < 0 || place > width) return this.unmark();
      const found = [], near = (80 * (view.x[1] - view.x[0])) / (this.x[1] - this.x[0]);
      let dots = "";
      for (const path of this.curves) {
        const down = heightAt(path, this.across(x), near);
        if (down === null) continue;
        const value = this.value(down), top = (height * (view.y[1] - value)) / (view.y[1] - view.y[0]);
        if (top >= 0 && top <= height) dots += `M${place} ${top}h.1`;
        found.push([path.dataset.name || this.chart.names[path.dataset.key] || "", this.said(value)]);
      }
      set(this.reader, { d: `M${place} 0v${height}` });
      set(this.dots, { d: dots });
      return found;
    }

    unmark() {
      if (this.reader) set(this.reader, { d: "" });
      if (this.dots) set(this.dots, { d: "" });
      return [];
    }
  }

  let cursor = null, tip = null; // { title, x } of the horizontal axis whose panels it crosses

  // Cursor at a value of all panels in sight that have this horizontal axis; those of one group are told together.
  function point(chart, x, event) {
    cursor = { title: chart.title, x };
    document.dispatchEvent(new CustomEvent("reader", { detail: cursor }));
    const lines = [];
    for (const other of list) {
      if (other.title !== chart.title || !other.seen) continue;
      for (const panel of other.panels.filter((one) => !one.fixed)) {
        const found = panel.mark(x);
        if (other.mates.includes(chart) && found.length) lines.push(panel.title, ...found.filter(([name]) => name).map(([name, value]) => `  ${name} ${value}`));
      }
    }
    tip ??= document.body.appendChild(Object.assign(document.createElement("div"), { className: "readout" }));
    const [, name, unit] = /^(.*?)(?:, ([^,]*))?$/.exec(chart.title), view = chart.panels[0].view.x;
    tip.textContent = [[name, text(x, 10 ** Math.floor(Math.log10((view[1] - view[0]) / 500))), unit].filter(Boolean).join(" "), ...lines].slice(0, 22).join("\n");
    tip.style.display = "block";
    const panel = event ? chart.panelOf(event) : chart.panels[0], box = (panel || chart.panels[0]).frame.getBoundingClientRect();
    const left = (x - view[0]) / (view[1] - view[0]) > 0.5; // beside the curves where they are read: on the other half
    tip.style.left = `${Math.max(4, left ? box.left + 6 : Math.min(box.right, window.innerWidth) - tip.offsetWidth - 6)}px`;
    tip.style.top = `${Math.max(4, Math.min(box.top + 4, window.innerHeight - tip.offsetHeight - 4))}px`;
  }
  function leave() {
    cursor = null;
    if (tip) tip.style.display = "none";
    for (const chart of list) for (const panel of chart.panels) panel.unmark();
  }

  class Chart {
    constructor(svg) {
      Object.assign(this, { svg, title: svg.dataset.xTitle, off: new Set(), names: {}, pointers: new Map(), from: null, pinch: null, tapped: -Infinity });
      this.panels = all(svg, ".panel").map((group) => new Panel(group, this));
      this.group = svg.closest(".linked");
      if (!this.panels.some((panel) => !panel.fixed)) return;
      list.push(this);
      set(svg, { tabindex: 0, role: "group" });
      svg.classList.add("active");
      for (const kind of ["down", "move", "up", "cancel"]) svg.addEventListener(`pointer${kind}`, (event) => this[kind](event));
      svg.addEventListener("pointerleave", (event) => { if (event.pointerType !== "touch") leave(); });
      svg.addEventListener("dblclick", () => this.reset());
      svg.addEventListener("keydown", (event) => this.key(event));
      this.entries();
    }

    // Charts that are enlarged together.
    get mates() { return list.filter((one) => one === this || (this.group && one.group === this.group && one.title === this.title)); }

    get seen() {
      const box = this.svg.getBoundingClientRect();
      return box.width > 0 && box.bottom > 0 && box.top < window.innerHeight;
    }

    panelOf(event) {
      const group = event.target.closest(".panel");
      return this.panels.find((panel) => panel.group === group && !panel.fixed);
    }

    down(event) {
      const panel = this.panelOf(event);
      if (!panel || event.button) return;
      this.pointers.set(event.pointerId, event);
      if (event.pointerType !== "touch") {
        this.from = { panel, ...panel.at(event) };
        panel.group.setPointerCapture(event.pointerId);
        this.svg.focus({ preventScroll: true });
        event.preventDefault();
      } else if (this.pointers.size === 2) {
        const [one, other] = [...this.pointers.values()].map((p) => panel.at(p));
        this.pinch = { panel, x: [one.x, other.x], apart: Math.abs(one.across - other.across) };
      }
    }

    move(event) {
      const panel = this.panelOf(event);
      if (this.pointers.has(event.pointerId)) this.pointers.set(event.pointerId, event);
      if (this.pinch && this.pointers.size === 2) return this.spread();
      if (panel) point(this, panel.at(event).x, event);
      if (this.from) this.outline(event);
    }

    outline(event) {
      const { panel } = this.from, at = panel.at(event), flat = Math.abs(at.down - this.from.down) < FLAT;
      this.frame ??= element("rect", { class: "frame" }, panel.group);
      set(this.frame, { x: panel.width * Math.min(this.from.across, at.across), width: panel.width * Math.abs(this.from.across - at.across),
        y: flat ? 0 : panel.height * Math.min(this.from.down, at.down), height: panel.height * (flat ? 1 : Math.abs(this.from.down - at.down)) });
    }

    up(event) {
      const { from } = this, moved = this.pinch;
      this.cancel(event);
      if (from) {
        const at = from.panel.at(event), ends = (key) => [Math.min(from[key], at[key]), Math.max(from[key], at[key])];
        if (Math.abs(at.across - from.across) > SHORT) this.zoom(ends("x"), Math.abs(at.down - from.down) < FLAT ? null : [from.panel, ends("y")]);
      } else if (event.pointerType === "touch" && !moved) {
        if (event.timeStamp - this.tapped < 300) this.reset();
        this.tapped = event.timeStamp;
      }
    }

    cancel(event) {
      this.pointers.delete(event.pointerId);
      this.from = null;
      if (!this.pointers.size) this.pinch = null; // the last finger of two that goes is no tap
      if (this.frame) { this.frame.remove(); this.frame = null; }
    }

    // Two fingers: what was below them stays there.
    spread() {
      const { panel, x, apart } = this.pinch, shares = [...this.pointers.values()].map((p) => panel.at(p).across);
      const span = ((x[1] - x[0]) / (shares[1] - shares[0])) || 0;
      if (Math.abs(shares[1] - shares[0]) < 0.05 || !apart || !(span > 0)) return;
      this.zoom([x[0] - shares[0] * span, x[0] + (1 - shares[0]) * span], null);
    }

    // Shows a range of the horizontal axis in all charts beside, with the curves there over the whole height, or one panel
    // in a vertical range of its own.
    zoom([low, high], own) {
      for (const chart of this.mates) {
        for (const panel of chart.panels.filter((one) => !one.fixed || one.rows)) {
          const x = [Math.max(low, panel.x[0]), Math.min(high, panel.x[1])];
          if (x[0] <= panel.x[0] && x[1] >= panel.x[1] && !own) panel.show(panel.x, panel.y);
          else if (x[1] - x[0] > 1e-6 * (panel.x[1] - panel.x[0])) panel.show(x, own && own[0] === panel ? own[1] : panel.fit(x));
        }
      }
      leave();
    }

    reset() {
      for (const chart of this.mates) for (const panel of chart.panels) if (!panel.fixed || panel.rows) panel.show(panel.x, panel.y);
      leave();
    }

    key(event) {
      const panel = this.panels.find((one) => !one.fixed), [low, high] = panel.view.x;
      const at = cursor && cursor.title === this.title ? cursor.x : (low + high) / 2, by = { "+": 0.5, "=": 0.5, "-": 2 }[event.key];
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (by) this.zoom([at - by * (at - low), at + by * (high - at)], null);
      else if (event.key === "0") this.reset();
      else if (event.key === "Escape") leave();
      if (step) point(this, Math.min(Math.max(at + (step * (high - low)) / 100, low), high));
      if (by || step || event.key === "0") event.preventDefault();
    }

    // Entries of the legend: a click hides what one stands for.
    entries() {
      for (const entry of all(this.svg, ".entry[data-key]")) {
        const { key } = entry.dataset;
        this.names[key] = entry.textContent;
        set(entry, { role: "button", tabindex: 0, "aria-pressed": "true" });
        entry.addEventListener("click", () => this.toggle(key));
        entry.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); this.toggle(key); } });
      }
    }

    toggle(key) {
      if (!this.off.delete(key)) this.off.add(key);
      const off = this.off.has(key);
      for (const node of all(this.svg, ".pane [data-key]")) if (node.dataset.key === key) node.style.display = off ? "none" : "";
      for (const entry of all(this.svg, ".entry")) if (entry.dataset.key === key) { entry.classList.toggle("off", off); entry.setAttribute("aria-pressed", String(!off)); }
    }

    // Legend of drawn series, each name once, in rows above the panels.
    legend(series) {
      const words = series.map((s) => [s.key, s.name, s.colour, s.dash].join("|")).join();
      if (this.words === words) return;
      this.words = words;
      all(this.svg, ".entry").forEach((node) => node.remove());
      let x = 8, y = 16;
      for (const s of series) {
        const entry = element("g", { class: `entry${this.off.has(String(s.key)) ? " off" : ""}`, "data-key": s.key }, this.svg);
        element("path", { d: s.marks ? "M10 -4h.1" : "M0 -4h20", stroke: s.colour, "stroke-width": s.width, "stroke-dasharray": s.dash || "none", "stroke-linecap": s.marks ? "round" : "butt" }, entry);
        label(entry, 26, 0, "start", s.name);
        const wide = 26 + entry.lastChild.getComputedTextLength();
        if (x > 8 && x + wide > this.svg.viewBox.baseVal.width - 8) { x = 8; y += 16; }
        set(entry, { transform: `translate(${x} ${y})` });
        x += wide + 14;
      }
      this.entries();
    }

    // Drawing alone, in the colours of paper.
    get text() {
      const copy = this.svg.cloneNode(true), { width, height } = this.svg.viewBox.baseVal;
      all(copy, ".reader, .dots, .frame, .now").forEach((node) => node.remove());
      copy.prepend(element("rect", { width, height, fill: "#fff" }));
      return new XMLSerializer().serializeToString(set(copy, { width, height }));
    }

    get csv() {
      const quoted = (words) => `"${words.replaceAll('"', '""')}"`, rows = [["panel", "curve", this.title, "value"].map(quoted).join(",")];
      for (const panel of this.panels) {
        for (const path of panel.curves) {
          const name = path.dataset.name || this.names[path.dataset.key] || path.dataset.look || "", span = panel.x[1] - panel.x[0];
          for (const p of pointsOf(path)) {
            if (!p) continue;
            const value = panel.value(p[1]), x = panel.x[0] + (p[0] / (10 * panel.width)) * span;
            rows.push([quoted(panel.title), quoted(name), +x.toPrecision(7), +(panel.log ? 10 ** value : value).toPrecision(6)].join(","));
          }
        }
      }
      return ["# read from the drawing: to a tenth of a pixel", ...rows, ""].join("\n");
    }

    png() {
      const { width, height } = this.svg.viewBox.baseVal, image = new Image(), canvas = Object.assign(document.createElement("canvas"), { width: 2 * width, height: 2 * height });
      image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(this.text)}`;
      return image.decode().then(() => {
        canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
        return new Promise((done) => canvas.toBlob(done, "image/png"));
      });
    }
  }

  const FLAT = 0.06, SHORT = 0.02; // shares of a panel: lower, a drag is along the axis alone; shorter, it is none
  const WAYS = {
    SVG: (chart) => new Blob([chart.text], { type: "image/svg+xml" }), PNG: (chart) => chart.png(), CSV: (chart) => new Blob([chart.csv], { type: "text/csv" }),
  };

  function offer(name, blob) {
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  // Row below a drawing: what the mouse or fingers do, and its files.
  function tools(drawing, found) {
    const row = Object.assign(document.createElement("div"), { className: "tools" }), touch = window.matchMedia("(pointer: coarse)").matches;
    const hint = document.createElement("span"), menu = document.createElement("details"), handle = document.createElement("summary");
    hint.textContent = touch ? "two fingers zoom, a double tap resets" : "drag to zoom, double-click to reset";
    handle.textContent = "⋯";
    set(handle, { "aria-label": "Save the chart", title: "Save the chart" });
    menu.append(handle);
    for (const [kind, made] of Object.entries(WAYS)) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: kind });
      button.addEventListener("click", async () => {
        const chart = found.find((one) => one.seen) || found[0];
        offer(`${chart.svg.getAttribute("aria-label").replace(/[^\w.-]+/g, "-") || "chart"}.${kind.toLowerCase()}`, await made(chart));
        menu.open = false;
      });
      menu.append(button);
    }
    row.append(hint, menu);
    drawing.append(row);
  }

  for (const drawing of all(document, ".drawing")) {
    const found = all(drawing, "svg.figure").map((svg) => new Chart(svg)).filter((chart) => list.includes(chart));
    if (found.length) tools(drawing, found);
  }
  for (const button of navigator.clipboard ? all(document, ".copy") : []) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText(button.previousElementSibling.textContent);
      button.textContent = "copied";
      setTimeout(() => { button.textContent = "copy"; }, 1500);
    });
  }
  // The one of a drawing's charts that is displayed, without laying out the page: `base.html` hides the other one.
  const narrow = window.matchMedia("(max-width: 720px)");
  const shown = (found) => found.find((chart) => chart.svg.classList.contains("narrow") === narrow.matches) || found[0];

  return { list, narrow, shown, of: (holder) => list.filter((chart) => holder.contains(chart.svg)), offer };
})();
