// Line plots on a canvas: axes with round ticks, lines, points, a cursor that reads values.
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

class Plot {
  // options: { title, unit, x: axis title, height, zero: include zero, keep: ranges stay while they fit }
  constructor(holder, options) {
    this.options = { height: 180, zero: true, ...options };
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", options.title);
    this.readout = document.createElement("output");
    this.readout.className = "readout";
    holder.append(this.canvas, this.readout);
    this.series = [];
    this.range = null;
    this.cursor = null;
    this.canvas.addEventListener("pointermove", (event) => this.point(event));
    this.canvas.addEventListener("pointerleave", () => { this.cursor = null; this.draw(); });
    this.resize();
    new ResizeObserver(() => { this.resize(); this.draw(); }).observe(holder);
  }

  resize() {
    const ratio = window.devicePixelRatio || 1, width = this.canvas.parentElement.clientWidth;
    this.width = Math.max(width, 120);
    this.height = this.options.height;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.canvas.style.height = `${this.height}px`;
    this.context = this.canvas.getContext("2d");
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }

  // series: { name, x, y, colour, width, dots, faint, dash }; x and y are arrays of one length
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
    const g = this.context, ink = colourOf("--soft"), line = colourOf("--line");
    const left = 46, right = 8, top = 6, bottom = this.options.x ? 34 : 18;
    const [x0, x1] = this.xRange, { low, high, step } = this.range;
    const wide = this.width - left - right, tall = this.height - top - bottom;
    const px = (x) => left + ((x - x0) / (x1 - x0)) * wide, py = (y) => top + (1 - (y - low) / (high - low)) * tall;
    this.place = { px, py, left, wide, x0, x1 };
    g.clearRect(0, 0, this.width, this.height);
    g.font = "11px system-ui, sans-serif";
    g.fillStyle = ink;
    g.strokeStyle = line;
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
      g.fillText(String(+(i * xStep).toPrecision(6)), x, top + tall + 4);
    }
    g.stroke();
    if (this.options.x) g.fillText(this.options.x, left + wide / 2, this.height - 13);
    g.save();
    g.beginPath();
    g.rect(left, top, wide, tall);
    g.clip();
    for (const s of this.series) this.curve(g, s, px, py);
    g.restore();
    if (this.cursor !== null) this.read(g, top, tall, ink);
    else this.readout.textContent = "";
  }

  curve(g, s, px, py) {
    const colour = colourOf(s.colour);
    g.globalAlpha = s.faint ? 0.45 : 1;
    if (s.dots) {
      g.fillStyle = colour;
      const size = s.size || 3;
      for (let i = 0; i < s.x.length; i++) g.fillRect(px(s.x[i]) - size / 2, py(s.y[i]) - size / 2, size, size);
    } else {
      g.strokeStyle = colour;
      g.lineWidth = s.width || 1.8;
      g.setLineDash(s.dash || []);
      g.beginPath();
      for (let i = 0; i < s.x.length; i++) {
        if (Number.isFinite(s.y[i])) g.lineTo(px(s.x[i]), py(s.y[i]));
      }
      g.stroke();
      g.setLineDash([]);
    }
    g.globalAlpha = 1;
  }

  point(event) {
    if (!this.place) return;
    const at = event.clientX - this.canvas.getBoundingClientRect().left, { left, wide, x0, x1 } = this.place;
    this.cursor = at < left || at > left + wide ? null : x0 + ((at - left) / wide) * (x1 - x0);
    this.draw();
  }

  read(g, top, tall, ink) {
    const { px } = this.place, x = Math.round(px(this.cursor)) + 0.5;
    g.strokeStyle = ink;
    g.setLineDash([3, 3]);
    g.beginPath();
    g.moveTo(x, top);
    g.lineTo(x, top + tall);
    g.stroke();
    g.setLineDash([]);
    const named = this.series.filter((s) => s.name && s.x.length);
    const texts = named.map((s) => `${s.name} ${(+valueAt(s, this.cursor)).toPrecision(4)}`);
    this.readout.textContent = `${Math.round(this.cursor)} ${this.options.xUnit || ""}: ${texts.join(", ")} ${this.options.unit || ""}`;
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
