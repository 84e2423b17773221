// Line plots: axes with round ticks, lines, points, a cursor that reads values. A canvas has axes and still curves and is
// seldom drawn anew; what moves are paths of a drawing upon it, which the browser paints beside the page's own thread.
"use strict";

function niceStep(range, count) {
  const raw = range / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const share = raw / power;
  return power * (share > 5 ? 10 : share > 2 ? 5 : share > 1 ? 2 : 1);
}

// Colours of the theme by the name of their property; asking the style each time would lay out the page in every frame.
let palette = new Map();

function colourOf(name) {
  if (!name.startsWith("--")) return name;
  if (!palette.has(name)) palette.set(name, getComputedStyle(document.documentElement).getPropertyValue(name));
  return palette.get(name);
}

const percent = (share) => `${100 * share}%`;

class Plot {
  // options: { title, unit, x: axis title, height, zero: include zero }
  constructor(holder, options) {
    this.options = { height: 180, zero: true, ...options };
    this.area = document.createElement("div");
    this.area.className = "area";
    this.back = document.createElement("canvas");
    this.front = ofDrawing("svg");
    this.reader = ofDrawing("line");
    this.reader.setAttribute("class", "reader");
    this.lines = [];
    this.front.setAttribute("role", "img");
    this.front.setAttribute("preserveAspectRatio", "none");
    this.front.setAttribute("aria-label", options.title);
    this.back.setAttribute("aria-hidden", "true");
    this.readout = document.createElement("output");
    this.readout.className = "readout";
    this.front.append(this.reader);
    this.area.append(this.back, this.front);
    holder.append(this.area, this.readout);
    this.series = [];
    this.range = null;
    this.cursor = null;
    this.drawn = []; // that decides over the canvas behind
    this.area.addEventListener("pointermove", (event) => this.point(event));
    this.area.addEventListener("pointerleave", () => { this.cursor = null; this.draw(); });
    this.resize();
    new ResizeObserver(() => { this.resize(); this.draw(); }).observe(holder);
  }

  resize() {
    const ratio = window.devicePixelRatio || 1, width = this.area.clientWidth;
    this.width = Math.max(width, 120);
    this.height = this.options.height;
    this.area.style.height = `${this.height}px`;
    this.back.width = Math.round(this.width * ratio);
    this.back.height = Math.round(this.height * ratio);
    this.back.style.height = `${this.height}px`;
    const context = this.back.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.lineJoin = "bevel";
    this.drawn = [];
  }

  // series: { name, x, y, colour, width, dots, faint, dash, still }; x and y are arrays of one length, x ascending; a
  // still one keeps its arrays from one call to the next
  show(series, xRange) {
    this.series = series;
    this.xRange = xRange;
    this.draw();
  }

  // Range of the values; the former one stays while the curves fill more than half of it.
  settle() {
    let low = this.options.zero ? 0 : Infinity, high = this.options.zero ? 0 : -Infinity;
    for (const s of this.series) {
      for (const y of s.y) {
        if (y < low) low = y;
        if (y > high) high = y;
      }
    }
    if (!(high > low)) { low = Math.min(low, 0) || 0; high = low + 1; }
    const span = high - low, step = niceStep(span * 1.04, 4), kept = this.range;
    const below = low < -0.08 * span ? Math.floor(low / step) * step : Math.min(low, 0) * 1.1;
    const fits = kept && kept.low <= low && kept.high >= high && span > 0.45 * (kept.high - kept.low);
    this.range = fits ? kept : { low: below, high: Math.ceil((high * 1.02) / step) * step, step };
  }

  draw() {
    if (!this.xRange) return;
    this.settle();
    const left = 46, right = 8, top = 6, bottom = this.options.x ? 34 : 18;
    const [x0, x1] = this.xRange, { low, high } = this.range;
    const wide = this.width - left - right, tall = this.height - top - bottom;
    const px = (x) => left + ((x - x0) / (x1 - x0)) * wide, py = (y) => top + (1 - (y - low) / (high - low)) * tall;
    this.place = { px, py, left, top, wide, tall, x0, x1 };
    const still = this.series.filter((s) => s.still), ink = colourOf("--soft");
    const decides = [ink, x0, x1, low, high, ...still.flatMap((s) => [s.x, s.y, s.colour])];
    if (decides.length !== this.drawn.length || decides.some((one, i) => one !== this.drawn[i])) {
      this.axes(this.back.getContext("2d"), ink);
      this.curves(this.back.getContext("2d"), still);
      this.drawn = decides;
    }
    this.move(this.series.filter((s) => !s.still));
    if (this.cursor !== null) this.read();
    else if (this.readout.textContent) this.readout.textContent = "";
    this.reader.style.visibility = this.cursor === null ? "hidden" : "visible";
  }

  // The paths of what moves; their element has the size and place of the plot's area, as shares of its width: on paper,
  // where nothing is drawn anew, they stay where the canvas has its axes.
  move(series) {
    const { px, py, left, top, wide, tall } = this.place;
    this.front.style.cssText = `left: ${percent(left / this.width)}; top: ${top}px; width: ${percent(wide / this.width)}; height: ${tall}px`;
    this.front.setAttribute("viewBox", `0 0 ${wide * FINE} ${tall * FINE}`);
    while (this.lines.length < series.length) this.lines.push(this.front.insertBefore(ofDrawing("path"), this.reader));
    while (this.lines.length > series.length) this.lines.pop().remove();
    series.forEach((s, i) => {
      const path = new Path();
      (s.dots ? squares : trace)(path, s, (x) => px(x) - left, (y) => py(y) - top);
      const colour = s.colour.startsWith("--") ? `var(${s.colour})` : s.colour;
      const width = s.dots ? 0 : (s.width || 1.8) * FINE, dashes = s.dash ? s.dash.map((one) => one * FINE).join(" ") : "none";
      this.lines[i].setAttribute("d", path);
      this.lines[i].style.cssText = `stroke: ${colour}; stroke-width: ${width}; stroke-dasharray: ${dashes}; fill: ${s.dots ? colour : "none"}; opacity: ${s.faint ? 0.45 : 1}`;
    });
  }

  axes(g, ink) {
    const { px, py, left, top, wide, tall, x0, x1 } = this.place, { low, high, step } = this.range;
    g.clearRect(0, 0, this.width, this.height);
    g.font = "11px system-ui, sans-serif";
    g.fillStyle = ink;
    g.strokeStyle = colourOf("--line");
    g.lineWidth = 1;
    g.beginPath();
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (let i = Math.ceil(low / step - 1e-9); i * step <= high * (1 + 1e-9) + 1e-12; i++) {
      const y = Math.round(py(i * step)) + 0.5;
      g.moveTo(left, y);
      g.lineTo(left + wide, y);
      g.fillText(String(+(i * step).toPrecision(6)), left - 5, y);
    }
    const xStep = niceStep(x1 - x0, wide / 80);
    g.textAlign = "center";
    g.textBaseline = "top";
    for (let i = Math.ceil(x0 / xStep - 1e-9); i * xStep <= x1 + 1e-9 * (x1 - x0); i++) {
      const x = Math.round(px(i * xStep)) + 0.5;
      g.moveTo(x, top);
      g.lineTo(x, top + tall);
      const text = String(+(i * xStep).toPrecision(6)), half = g.measureText(text).width / 2;
      g.fillText(text, Math.min(x, this.width - half), top + tall + 4); // the last one within the canvas
    }
    g.stroke();
    if (this.options.x) g.fillText(this.options.x, left + wide / 2, this.height - 13);
  }

  curves(g, series) {
    const { px, py, left, top, wide, tall } = this.place;
    g.save();
    g.beginPath();
    g.rect(left, top, wide, tall);
    g.clip();
    for (const s of series) this.curve(g, s, px, py);
    g.restore();
  }

  curve(g, s, px, py) {
    const colour = colourOf(s.colour);
    g.globalAlpha = s.faint ? 0.45 : 1;
    if (s.dots) {
      g.fillStyle = colour;
      g.beginPath();
      squares(g, s, px, py);
      g.fill();
    } else {
      g.strokeStyle = colour;
      g.lineWidth = s.width || 1.8;
      g.setLineDash(s.dash || []);
      g.beginPath();
      trace(g, s, px, py);
      g.stroke();
      g.setLineDash([]);
    }
    g.globalAlpha = 1;
  }

  point(event) {
    if (!this.place) return;
    const at = event.clientX - this.area.getBoundingClientRect().left, { left, wide, x0, x1 } = this.place;
    this.cursor = at < left || at > left + wide ? null : x0 + ((at - left) / wide) * (x1 - x0);
    this.draw();
  }

  read() {
    const { px, left, tall } = this.place, x = Math.round(px(this.cursor) - left) + 0.5;
    for (const [name, value] of Object.entries({ x1: x, x2: x, y1: 0, y2: tall })) this.reader.setAttribute(name, value * FINE);
    const named = this.series.filter((s) => s.name && s.x.length);
    const texts = named.map((s) => `${s.name} ${(+valueAt(s, this.cursor)).toPrecision(4)}`);
    this.readout.textContent = `${Math.round(this.cursor)} ${this.options.xUnit || ""}: ${texts.join(", ")} ${this.options.unit || ""}`;
  }
}

function ofDrawing(kind) {
  return document.createElementNS("http://www.w3.org/2000/svg", kind);
}

const FINE = 10; // units of a drawing in a pixel: whole numbers are written and read faster

// Text of a path, with the methods of a canvas' path, which pass over points that are no numbers as these do.
class Path {
  constructor() {
    this.text = "";
    this.x = this.y = 0;
    this.level = false; // the last line is level, and has not been written
  }

  moveTo(x, y) {
    if (!Number.isFinite(x + y)) return;
    this.x = Math.round(x * FINE);
    this.y = Math.round(y * FINE);
    this.text += `M${this.x} ${this.y}`;
  }

  lineTo(x, y) {
    if (!this.text) return this.moveTo(x, y);
    if (!Number.isFinite(x + y)) return;
    const y0 = this.y;
    this.y = Math.round(y * FINE);
    if (this.level && this.y !== y0) this.text += `H${this.x}`;
    this.x = Math.round(x * FINE);
    this.level = this.y === y0;
    if (!this.level) this.text += `L${this.x} ${this.y}`;
  }

  rect(x, y, width, height) {
    if (!Number.isFinite(x + y)) return;
    this.moveTo(x, y);
    this.text += `h${width * FINE}v${height * FINE}h${-width * FINE}z`;
  }

  toString() {
    return this.level ? `${this.text}H${this.x}` : this.text;
  }
}

function squares(g, s, px, py) {
  const size = s.size || 3;
  for (let i = 0; i < s.x.length; i++) g.rect(px(s.x[i]) - size / 2, py(s.y[i]) - size / 2, size, size);
}

const CLOSE = 1; // [px] between points of a line: those nearer to each other are drawn as their lowest and highest

function trace(g, s, px, py) {
  const n = s.x.length;
  let i = 0;
  while (i < n) {
    const x = px(s.x[i]), y = py(s.y[i]);
    let low = y, high = y, last = y, rising = true, j = i + 1;
    for (; j < n && px(s.x[j]) - x < CLOSE; j++) {
      last = py(s.y[j]);
      if (last < low) { low = last; rising = false; }
      if (last > high) { high = last; rising = true; }
    }
    if (Number.isFinite(y)) {
      g.lineTo(x, y);
      if (high - low > CLOSE) {
        g.lineTo(x, rising ? low : high);
        g.lineTo(x, rising ? high : low);
        g.lineTo(x, last);
      }
    }
    i = j;
  }
}

function valueAt(s, x) {
  let low = 0, high = s.x.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (s.x[middle] <= x) low = middle; else high = middle;
  }
  const span = s.x[high] - s.x[low];
  const part = span > 0 ? Math.min(Math.max((x - s.x[low]) / span, 0), 1) : 0;
  return s.y[low] + part * (s.y[high] - s.y[low]);
}
