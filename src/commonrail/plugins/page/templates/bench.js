// The page: its state, sliders, curves, address and files. It simulates the curve of a moved slider itself, at once;
// workers simulate the fan, J and the map.
"use strict";

const model = JSON.parse(document.getElementById("model").textContent);
const byId = (id) => document.getElementById(id);
const MICRO = 1e6;

function moduleBytes() {
  return Uint8Array.from(atob(byId("wasm").textContent.trim()), (c) => c.charCodeAt(0));
}

function refused(error) {
  say(`The simulation could not be started: ${error.message}`, true);
}

// --- Workers: one message under way each, the newest state next --------------------------------------------------

class Client {
  // `spacing`: least time [ms] between two messages, `delay`: from a change to its message
  constructor(receive, { spacing = 0, delay = 0 } = {}) {
    const text = byId("worker").textContent;
    this.worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this.answer(data);
    this.worker.onerror = refused;
    this.receive = receive;
    this.spacing = spacing;
    this.delay = delay;
    this.working = true; // until it is ready
    this.next = null;
    this.timer = 0;
    this.sent = -Infinity;
    this.count = 0;
    const wasm = moduleBytes();
    this.worker.postMessage({ model, wasm: wasm.buffer }, [wasm.buffer]);
  }

  get busy() {
    return this.working || this.next !== null;
  }

  ask(message) {
    this.next = message;
    this.plan();
  }

  plan() {
    if (this.working || this.timer || !this.next) return;
    const wait = Math.max(this.sent + this.spacing - performance.now(), this.delay);
    if (wait > 0) this.timer = setTimeout(() => { this.timer = 0; this.send(); }, wait);
    else this.send();
  }

  send() {
    this.working = true;
    this.sent = performance.now();
    this.worker.postMessage({ id: ++this.count, ...this.next });
    this.next = null;
  }

  answer(data) {
    this.working = false;
    if (!data.ready) this.receive(data);
    this.plan();
  }
}

// --- State ---------------------------------------------------------------------------------------------------------

const first = model.presets[0];
let state = null;

function copyOf(one) {
  return { ...one, pulses: one.pulses.map((p) => [...p]), measured: [...one.measured], values: { ...one.values } };
}

function stateOf(preset) {
  const point = preset.point || (state ?? stateOf(first));
  return copyOf({
    rail: point.rail, cylinder: point.cylinder, low: point.low, start: point.start, pulses: point.pulses,
    data: preset.data ?? null,
    measured: preset.data === undefined || preset.data === null ? [false, false, false, false] : model.data[preset.data].courses.map(Boolean),
    temperature: preset.values ? model.temperature.at : state.temperature,
    values: preset.values || (state ? state.values : {}),
    fan: state ? state.fan : false,
  });
}

function densityAt(cylinder, temperature) {
  const { cylinders, rows } = model.density, row = rows[temperature];
  let i = 0;
  while (i < cylinders.length - 2 && cylinders[i + 1] < cylinder) i++;
  const part = (cylinder - cylinders[i]) / (cylinders[i + 1] - cylinders[i]);
  return row[i] + part * (row[i + 1] - row[i]);
}

function pointOf(s) {
  const end = s.pulses.reduce((_, p) => p[0] + p[1], s.start);
  const least = s.data === null ? 0 : model.data[s.data].point.duration;
  const duration = model.traced ? least : Math.max(end - s.start + model.tail, least);
  return { rail: s.rail, cylinder: s.cylinder, low: s.low, start: s.start, pulses: s.pulses, duration };
}

function columnsOf(values) {
  return Object.entries(values).map(([name, value]) => [model.columnOf[name], value]);
}

function fanOf(s) {
  if (!s.fan || !model.fan) return null;
  const own = new Set(model.fan.names);
  const others = columnsOf(Object.fromEntries(Object.entries(s.values).filter(([name]) => !own.has(name))));
  return model.fan.members.map((member) => [...others, ...member.map((value, i) => [model.columnOf[model.fan.names[i]], value])]);
}

// What is simulated.
function request(s) {
  return {
    point: pointOf(s), data: s.data, measured: s.measured, temperature: s.temperature, values: columnsOf(s.values),
    every: model.every, density: densityAt(s.cylinder, s.temperature),
  };
}

// --- Simulation of the curve ------------------------------------------------------------------------------------

const LONG = 8; // [ms] of a simulation, beyond which the page simulates once a frame of the screen
let bench = null; // the physics, once it is there
let lasted = 0; // last simulation [ms]
let waiting = null; // state to be simulated in the next frame
let gesture = 0; // instant of the key or pointer that moves a slider; the slider's own event is made after it

for (const kind of ["keydown", "pointerdown", "pointermove"]) {
  window.addEventListener(kind, (event) => { gesture = event.timeStamp; }, { capture: true, passive: true });
}

function stampOf(event) {
  return event ? (event.isTrusted && gesture ? gesture : event.timeStamp) : 0;
}

function simulate(asked, stamp) {
  if (bench && lasted < LONG) return simulateNow({ asked, stamp });
  if (!waiting && bench) requestAnimationFrame(() => simulateNow(waiting));
  waiting = { asked, stamp };
}

function simulateNow({ asked, stamp }) {
  waiting = null;
  const begun = performance.now(), course = bench.course(asked);
  lasted = performance.now() - begun;
  draw({ state: asked, stamp, course, work: lasted });
}

async function start() {
  const { instance } = await WebAssembly.instantiate(moduleBytes(), {});
  bench = new Bench(model, instance);
  measureEffects();
  build();
  if (waiting) simulateNow(waiting);
}

// --- Curves --------------------------------------------------------------------------------------------------------

// Curves of one of the page's drawings, which has a panel: those of a wide page or those of a telephone.
class View {
  constructor(id) {
    this.figures = charts.of(byId(id));
    for (const { panels } of this.figures) for (const panel of panels) panel.pane.replaceChildren();
    this.heights = null;
  }

  // The former range stays while the curves fill more than half of it.
  settle(series) {
    let low = 0, high = 0;
    for (const s of series) {
      for (const y of s.y) {
        if (y < low) low = y;
        if (y > high) high = y;
      }
    }
    if (!(high > low)) high = low + 1;
    const span = high - low, kept = this.heights, step = niceStep(span * 1.04, 4);
    if (kept && kept[0] <= low && kept[1] >= high && span > 0.45 * (kept[1] - kept[0])) return kept;
    return (this.heights = [low < -0.08 * span ? Math.floor(low / step) * step : Math.min(low, 0) * 1.1, Math.ceil((high * 1.02) / step) * step]);
  }

  // series: { key, name, x, y, colour, width, dash, marks, faint, still }; x and y are arrays of one length, x ascending
  show(series, range) {
    const chart = charts.shown(this.figures), [panel] = chart.panels;
    this.last = [series, range];
    panel.range(range, this.settle(series));
    panel.draw(series);
    chart.legend(series.filter((s) => s.name));
  }
}

function niceStep(range, count) {
  const raw = range / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw)), share = raw / power;
  return power * (share > 5 ? 10 : share > 2 ? 5 : share > 1 ? 2 : 1);
}

const views = Object.fromEntries(["rate", "lift", "pressure", "current", "map", "residual"].map((id) => [id, new View(id)]));
const at = Object.fromEntries(model.channels.map((name, i) => [name, i]));
const { looks } = model;
const NEAR = 0.01; // share of a rail pressure within which a measured point is drawn beside the curve at it
let shown = null; // last course
let fanned = null; // last fan: mass injected of its members, and the state that it belongs to
let mapped = null; // last map
let panelling = 0; // frame in which the panels will be drawn
let panelled = -Infinity; // instant of the frame in which they were drawn last
const REST = 30; // least time [ms] between two drawings of the panels, which leaves the frames between to the rate
let scored = null; // last J of the data, and the rate that is compared with the one that is shown
let held = null; // curve that is kept for comparison
const frames = []; // [ms] from an input to its drawn curve
const fans = []; // the same of drawn fans

function timesOf(count, every, start) {
  const times = new Float64Array(count);
  for (let i = 0; i < count; i++) times[i] = (start + i * every * model.dt) * MICRO;
  return times;
}

// Means over intervals of `every` steps, at their middles.
function rateOf(mass, every, start, density) {
  const count = mass.length - 1, x = new Float64Array(count), y = new Float64Array(count);
  const scale = MICRO / (every * model.dt * density);
  for (let i = 0; i < count; i++) {
    x[i] = (start + (i + 0.5) * every * model.dt) * MICRO;
    y[i] = (mass[i + 1] - mass[i]) * scale;
  }
  return { x, y };
}

function thinned(injected, every) {
  const kept = new Float64Array(Math.floor((injected.length - 1) / every) + 1);
  for (let i = 0; i < kept.length; i++) kept[i] = injected[i * every];
  return kept;
}

// Mean flow by volume between the bounds of a data set's samples, at their middles.
function measuredOf(d) {
  if (!d.x) {
    const bounds = numbersOf(d.bounds), rate = numbersOf(d.rate);
    d.x = Float64Array.from(rate, (_, i) => 0.5 * (bounds[i] + bounds[i + 1]) * MICRO);
    d.y = rate.map((value) => value * MICRO);
  }
  return d;
}

function rangeOf({ state: asked, course }) {
  return [asked.point.start * MICRO, endOf(asked, course) * MICRO];
}

function drawRate(answer) {
  const { state: asked, course } = answer, { start } = asked.point, series = [];
  if (state.fan && fanned) series.push(...fanned.series, { ...looks.start, key: "fan", name: model.fan.short, dash: "", x: [], y: [] });
  if (asked.data !== null) {
    const d = measuredOf(model.data[asked.data]);
    const away = !isAtData(asked); // measured at another point than the one that is simulated
    series.push({ ...looks.measured, key: "measured", name: `${d.origin} ${d.name}${away ? ": another operating point" : ""}`, x: d.x, y: d.y, marks: true, square: true, faint: away, still: true });
  }
  if (held) series.push({ ...looks.held, key: "held", name: "held", ...held, still: true });
  if (asked.data !== null && model.data[asked.data].meter && scored && scored.rate && scored.data === asked.data && isAtData(asked)) {
    const d = measuredOf(model.data[asked.data]);
    series.push({ ...looks.paper, key: "meter", name: `as ${d.meter.name} shows it`, x: d.x, y: scored.rate.map((value) => value * MICRO) });
  }
  const rate = rateOf(thinned(course.injected, asked.every), asked.every, start, asked.density);
  series.push({ ...looks.best, key: "best", name: "simulated", ...rate }, ...delaysOf(answer));
  views.rate.show(series, rangeOf(answer));
  return rate;
}

// Bars on the axis of the rate: from the begin of energising to the opening, from its end to the closing.
function delaysOf({ state: asked, course: { figures } }) {
  const { start, pulses } = asked.point, instant = (steps) => (start + steps * model.dt) * MICRO;
  if (!pulses.length) return [];
  const ends = pulses.map(([from, lasting]) => (from + lasting) * MICRO);
  const bar = (look, name, x) => ({ ...looks[look], key: name, name, x, y: [0, 0], width: 8, dash: "" });
  return [bar("start", "opening delay", [pulses[0][0] * MICRO, instant(figures.opening)]),
    bar("paper", "closing delay", [ends[ends.length - 1], instant(figures.closing)])].filter(({ x }) => x[1] > x[0]);
}

// End of the time that is drawn [s]: behind the last closing and the measured curve, in round numbers.
function endOf({ point, data }, { figures, steps }) {
  const { start, pulses, duration } = point, end = pulses.reduce((_, p) => p[0] + p[1], start);
  const closing = Number.isFinite(figures.closing) ? start + figures.closing * model.dt : start + duration;
  const used = Math.max(end, closing) + 300e-6, round = 250e-6;
  const seen = data === null ? 0 : model.data[data].point.start + model.data[data].point.duration;
  return Math.min(Math.max(Math.ceil(used / round) * round, seen), start + steps * model.dt);
}

function draw(answer) {
  shown = answer;
  answer.rate = drawRate(answer);
  note(frames, answer.stamp, answer.work);
  // the other panels follow in a frame of the screen, once for all courses that it has seen
  if (!panelling) panelling = requestAnimationFrame(drawPanels);
}

function note(list, stamp, work) {
  if (stamp) list.push({ ms: performance.now() - stamp, work });
  if (list.length > 2000) list.splice(0, 1000);
}

// The fan that is drawn belongs to the state before while a slider moves: it follows the curve as fast as it can.
function takeFan({ state: asked, stamp, fan }) {
  const series = fan.filter(Boolean).map((mass) => ({
    ...rateOf(mass, asked.fanEvery, asked.point.start, asked.density), ...looks.start, dash: "", key: "fan", width: 1, faint: true, still: true,
  }));
  fanned = { state: asked, masses: fan, series, stamp };
  if (shown && state.fan && !panelling) panelling = requestAnimationFrame(drawPanels);
}

function drawPanels(now) {
  panelling = 0;
  if (fanned && state.fan && !fanned.drawn) {
    drawRate(shown);
    note(fans, fanned.stamp);
    fanned.drawn = true;
  }
  if (now - panelled < REST) {
    panelling = requestAnimationFrame(drawPanels);
    return;
  }
  panelled = now;
  const { state: asked, course } = shown, { start } = asked.point, width = model.channels.length;
  const range = rangeOf(shown), x = timesOf(course.rows + 1, course.every, start);
  for (const [id, lines] of Object.entries(model.lines)) {
    const series = lines.filter(({ channel }) => channel in at).map((line) => {
      const y = new Float64Array(course.rows + 1);
      for (let i = 0; i <= course.rows; i++) y[i] = course.channels[i * width + at[line.channel]] * line.scale;
      return { ...line, key: line.channel, x, y };
    });
    if (id === "current") series.push(...asked.point.pulses.map(([from, lasting], i) => ({ ...looks.rigid, key: "energised", name: i ? "" : "energised", x: [from * MICRO, (from + lasting) * MICRO], y: [0, 0], width: 8, dash: "" })));
    views[id].show(series, range);
  }
  drawFigures(shown);
  drawSection(shown, x);
}

const SLOW = 8; // [s] of the slow motion
const scales = JSON.parse(byId("anatomy").dataset.scales); // from SI to what is shown, by channel
let anatomy = null, largest = null; // section of the injector, and the largest values of its first courses

// Moves the section by the courses that are shown, as shares of the largest ones of the first simulation.
function drawSection({ state: asked, course, rate }, times) {
  const width = model.channels.length, { start, pulses, rail } = asked.point, every = asked.every * model.dt * MICRO;
  const x = times.filter((t) => t <= rangeOf(shown)[1]), values = { time: x };
  const column = (name, scale, below = 0) => x.map((_, i) => (course.channels[i * width + at[name]] - below) * scale);
  for (const [name, scale] of Object.entries(scales)) if (name in at) values[name] = column(name, scale);
  values.rail_pressure ??= x.map(() => rail / MICRO);
  const top = "plunger_lift" in at ? "plunger_lift" : "needle_lift";
  values.plunger = column(top, MICRO, course.channels[at[top]]);
  values.rate = x.map((t) => rate.y[Math.min(Math.floor((t - start * MICRO) / every), rate.y.length - 1)]);
  values.energised = x.map((t) => Number(pulses.some(([from, lasting]) => t >= from * MICRO && t < (from + lasting) * MICRO)));
  if (x.length < 2 || Object.values(values).some((y) => y.some(Number.isNaN))) return; // of a simulation that failed
  largest ??= Object.fromEntries(Object.entries(values).map(([name, y]) => [name, y.reduce((a, b) => Math.max(a, b), 1e-9)]));
  const full = Math.max(...Object.keys(largest).filter((name) => name.endsWith("pressure")).map((name) => largest[name]));
  const size = (name) => (name.endsWith("pressure") ? full : largest[name === "plunger" ? "needle_lift" : name]);
  const shares = Object.fromEntries(Object.entries(values).map(([name, y]) => [name, name === "time" ? y : y.map((v) => v / size(name))]));
  byId("anatomy").hidden = false;
  anatomy ??= anatomyOf(byId("anatomy"), ["rate", "lift", "pressure", "current"].map((id) => `#${id} .pane`).join());
  anatomy.take(shares, values, SLOW, values.needle_lift.indexOf(Math.max(...values.needle_lift)));
}

const SENTENCES = {
  ok: "",
  "still injecting": "The needle had not closed at the end of the simulated time.",
  "not closed": "Needle or valve does not rest on its seat before energising; move the last slider back.",
  failed: "The simulation left the range of the model; move the last slider back.",
  "too long": "The injections last longer than the page simulates; shorten the dwell.",
};

function say(text, bad) {
  const line = byId("status");
  if (line.textContent !== text) line.textContent = text;
  line.className = bad ? "bad" : "";
}

function drawFigures({ course, state: asked, rate }) {
  const f = course.figures, rho = asked.density, begin = asked.point.pulses[0]?.[0] ?? asked.point.start, instant = (steps) => asked.point.start + steps * model.dt;
  const bad = course.status === "failed" || course.status === "not closed" || course.status === "too long";
  say(SENTENCES[course.status] || stopped, bad);
  const end = asked.point.pulses.reduce((_, p) => p[0] + p[1], begin), micro = (s) => (Number.isFinite(s) ? (s * MICRO).toFixed(1) : "–");
  let peak = 0;
  for (const y of rate.y) if (y > peak) peak = y;
  const rows = [
    ["quantity, mm³", ((f.injected / rho) * 1e9).toFixed(3)],
    ["quantity, mg", (f.injected * 1e6).toFixed(3)],
    ["returned until rest, mm³", ((f.returned / rho) * 1e9).toFixed(2)],
    [model.traced ? "opening at, µs" : "opening delay, µs", micro(instant(f.opening) - begin)],
    [model.traced ? "closing at, µs" : "closing delay, µs", micro(instant(f.closing) - end)],
    ["injection lasts, µs", micro(instant(f.closing) - instant(f.opening))],
    ["peak rate, mm³/ms", peak.toFixed(2)],
    ["largest lift, µm", (f.greatest_lift * MICRO).toFixed(1)],
  ];
  fill(byId("figures"), rows, bad);
}

function fill(list, rows, bad) {
  if (list.children.length !== rows.length) {
    list.replaceChildren(...rows.map(([name]) => {
      const pair = document.createElement("div"), term = document.createElement("dt"), value = document.createElement("dd");
      term.textContent = name;
      pair.append(term, value);
      return pair;
    }));
  }
  rows.forEach(([, value], i) => { list.children[i].lastChild.textContent = bad ? "–" : value; });
}

// The rate that a meter shows belongs to the data's own operating point.
function isAtData(asked) {
  const { point, courses } = model.data[asked.data];
  const same = (key, i) => (courses[i] ? asked.measured[i] : asked.point[key] === point[key]);
  return same("rail", 0) && same("cylinder", 1) && same("low", 2) && String(asked.point.pulses) === String(point.pulses);
}

function drawScores({ state: asked, scores }) {
  scored = { ...scores, data: asked.data };
  if (shown && asked.data !== null && model.data[asked.data].meter) draw({ ...shown, stamp: 0 });
  fillScores("curve-scores", "J, mm³/ms, at each curve's operating point", model.data, scores.j);
  fillScores("map-scores", "J of each map at its operating points, errors in tolerances", model.maps, scores.maps.map((one) => one.j));
  drawResiduals();
  if (mapped) drawMap({ map: mapped });
}

// Table of J of some data, as the sliders have the parameters and of the fit.
function fillScores(id, caption, data, j) {
  if (!data.length) return;
  const body = byId("scores");
  let table = byId(id);
  if (!table) {
    table = Object.assign(document.createElement("table"), { id });
    table.innerHTML = "<caption class='soft'></caption><thead><tr><th scope='col'>bench data</th><th scope='col'>role</th><th scope='col'>J now</th><th scope='col'></th></tr></thead><tbody></tbody>";
    table.caption.textContent = caption;
    table.tHead.rows[0].cells[3].textContent = model.reference.label;
    for (const d of data) {
      const row = table.tBodies[0].insertRow();
      for (const text of [d.name, d.role, "", d.reference === null ? "–" : d.reference.toFixed(2)]) row.insertCell().textContent = text;
    }
    body.append(table);
  }
  j.forEach((one, i) => { table.tBodies[0].rows[i].cells[2].textContent = one === null ? "–" : one.toFixed(2); });
}

// Points of the maps nearest to one of the drawn rail pressures and within a share of it, at their energising times: what
// `value` makes of a row and its simulated value.
function pointsAt(rail, share, value) {
  const points = model.maps.flatMap((m, k) => m.rows.map((row, i) => [row, scored ? scored.maps[k].values[i] : null]))
    .filter(([row]) => nearestRail(pointOfRow(row).rail) === rail && Math.abs(pointOfRow(row).rail - rail) <= share * rail)
    .map(([row, simulated]) => [pointOfRow(row).pulses[0][1] * MICRO, value(row, simulated)])
    .filter(([, y]) => y !== null).sort((one, other) => one[0] - other[0]);
  return { x: points.map(([x]) => x), y: points.map(([, y]) => y), marks: true };
}

function nearestRail(rail) {
  return model.map.pressures.reduce((best, one) => (Math.abs(one - rail) < Math.abs(best - rail) ? one : best));
}

// The middle one of three points about a dead time.
function pointOfRow(row) {
  return row.points[row.points.length >> 1];
}

function drawResiduals() {
  if (!model.maps.length) return;
  const series = model.map.pressures.map((rail, i) => ({
    key: i, name: `${+(rail * 1e-6).toPrecision(3)} MPa`, colour: model.map.colours[i], width: 5, square: i % 2 === 1,
    ...pointsAt(rail, Infinity, (row, simulated) => (row.dead || simulated === null ? null : (simulated - row.target) * 1e9)),
  }));
  byId("residual").querySelector("h3").textContent = `Simulated − ${originOfMaps()}, mm³, at the points of the maps`;
  views.residual.show(series, [0, model.map.times[model.map.times.length - 1] * MICRO]);
}

function originOfMaps() {
  return model.maps.every((m) => m.origin === model.maps[0].origin) ? model.maps[0].origin : "bench data";
}

function drawMap({ map }) {
  mapped = map;
  const x = map.times.map((t) => t * MICRO);
  const series = map.pressures.map((rail, i) => ({
    key: i, name: `${+(rail * 1e-6).toPrecision(3)} MPa`, x, y: map.quantity[i].map((m) => (m / map.density) * 1e9), colour: model.map.colours[i], width: 1.8,
  }));
  if (shown && shown.state.point.pulses.length === 1) {
    series.push({ x: [shown.state.point.pulses[0][1] * MICRO], y: [(shown.course.figures.injected / shown.state.density) * 1e9], colour: looks.ink, marks: true, width: 9 });
  }
  if (model.maps.length) {
    map.pressures.forEach((rail, i) => series.push({ key: i, colour: model.map.colours[i], width: 6, square: i % 2 === 1, ...pointsAt(rail, NEAR, (row) => row.quantity * 1e9) }));
    series.push({ ...looks.measured, key: "measured", name: `points: ${originOfMaps()}`, x: [], y: [], marks: true, width: 6 });
  }
  views.map.show(series, [0, x[x.length - 1]]);
}

// --- Sliders -------------------------------------------------------------------------------------------------------

const sliders = [];
let stopped = ""; // sentence of a constraint that has stopped the slider that moved last

class Slider {
  // options: { id, label, soft, unit, factor (shown per SI), low, high (SI), get, set, nodes }
  constructor(holder, options) {
    this.options = options;
    const box = document.createElement("div");
    box.className = "slider";
    const label = document.createElement("label");
    label.htmlFor = options.id;
    label.append(options.label);
    if (options.soft) {
      const soft = document.createElement("span");
      soft.className = "soft";
      soft.textContent = ` ${options.soft}`;
      label.append(soft);
    }
    const low = options.low * options.factor + (options.offset || 0), high = options.high * options.factor + (options.offset || 0);
    this.range = Object.assign(document.createElement("input"), { type: "range", id: options.id, min: low, max: high, step: options.step || niceStep(high - low, 600) });
    this.exact = Object.assign(document.createElement("input"), { type: "number", min: low, max: high, step: "any" });
    this.exact.setAttribute("aria-label", `${options.label}, ${options.unit || "number"}`);
    const unit = document.createElement("span");
    unit.className = "unit";
    unit.textContent = options.unit;
    box.append(label, this.range, this.exact, unit);
    holder.append(box);
    this.box = box;
    this.range.addEventListener("input", (event) => this.take(+this.range.value, event));
    this.exact.addEventListener("change", (event) => {
      const value = Math.min(Math.max(+this.exact.value, low), high);
      if (Number.isFinite(value)) this.take(value, event);
    });
    sliders.push(this);
    this.refresh();
  }

  take(shownValue, event) {
    stopped = "";
    this.options.set((shownValue - (this.options.offset || 0)) / this.options.factor);
    this.refresh();
    changed(event);
  }

  refresh() {
    const value = this.options.get() * this.options.factor + (this.options.offset || 0), text = String(+value.toPrecision(5));
    if (+this.range.value !== value) this.range.value = value;
    if (document.activeElement !== this.exact || +this.exact.value !== value) this.exact.value = text;
    this.range.setAttribute("aria-valuetext", `${text} ${this.options.unit}`);
    this.box.classList.toggle("changed", Boolean(this.options.moved && this.options.moved()));
  }
}

function ordered(name, value) {
  const held = constrained(model, state.values, name, value);
  if (held.stopped) stopped = held.stopped;
  return held.value;
}

function pressureSlider(holder, id, label, key, column) {
  const limits = model.limits[key];
  return new Slider(holder, {
    id, label, unit: "MPa", factor: 1e-6, low: limits[0], high: limits[1], get: () => state[key],
    set: (value) => { state[key] = value; state.measured[column] = false; },
  });
}

function pulseSliders(holder) {
  const limits = model.limits.energising, gap = model.limits.dwell;
  state.pulses.forEach((pulse, i) => {
    if (i > 0) {
      const before = () => state.pulses[i - 1][0] + state.pulses[i - 1][1];
      new Slider(holder, {
        id: `dwell-${i + 1}`, label: `Dwell before injection ${i + 1}`, unit: "µs", factor: MICRO, low: gap[0], high: gap[1],
        get: () => state.pulses[i][0] - before(), set: (value) => shift(i, before() + value - state.pulses[i][0]),
      });
    }
    new Slider(holder, {
      id: `energising-${i + 1}`, label: state.pulses.length > 1 ? `Energising time ${i + 1}` : "Energising time", unit: "µs", factor: MICRO,
      low: limits[0], high: limits[1], get: () => state.pulses[i][1],
      set: (value) => { const by = value - state.pulses[i][1]; state.pulses[i][1] = value; shift(i + 1, by); },
    });
  });
}

// Moves the energisings from one on: the dwells stay.
function shift(from, by) {
  for (let i = from; i < state.pulses.length; i++) state.pulses[i][0] += by;
}

function setCount(count) {
  while (state.pulses.length > count) state.pulses.pop();
  while (state.pulses.length < count) {
    const last = state.pulses[state.pulses.length - 1];
    state.pulses.push([last[0] + last[1] + 600e-6, last[1]]);
  }
}

// Effects of the parameters where the run has none: change of the rate, of the state that the page opens with, for a
// hundredth of the range.
function measureEffects() {
  if (model.sliders.every((p) => p.effect !== null)) return;
  const asked = request(stateOf(first)), rateAt = (values) => thinned(bench.course({ ...asked, every: 0, values }).injected, 3 * model.every);
  const present = rateAt(asked.values);
  for (const p of model.sliders) {
    const step = 0.01 * (p.high - p.low), at = p.value + step > p.high ? p.value - step : p.value + step;
    const moved = rateAt([...asked.values, [model.columnOf[p.name], at]]);
    p.effect = present.reduce((sum, y, i) => sum + Math.abs(y - (moved[i] ?? y)), 0) || 0;
  }
}

// Parameters by component, those of the largest effect first.
function byEffect() {
  const strongest = {}, partOf = (p) => p.name.split(".")[0];
  for (const p of model.sliders) strongest[partOf(p)] = Math.max(strongest[partOf(p)] || 0, p.effect || 0);
  return [...model.sliders].sort((a, b) => strongest[partOf(b)] - strongest[partOf(a)] || partOf(a).localeCompare(partOf(b)) || b.effect - a.effect);
}

function groupOf(holder, p) {
  const part = p.name.split(".")[0].replaceAll("_", " "), last = holder.lastElementChild;
  if (last && last.dataset.part === part) return last;
  const group = document.createElement("section"), head = document.createElement("h3");
  head.textContent = group.dataset.part = part;
  group.append(head);
  holder.append(group);
  return group;
}

// Hides the parameters whose names and meanings lack what was typed.
function filter() {
  const words = byId("filter").value.toLowerCase();
  for (const slider of document.querySelectorAll("#parameter-sliders .slider")) slider.hidden = !slider.firstChild.textContent.toLowerCase().includes(words);
  for (const group of byId("parameter-sliders").children) group.hidden = !group.querySelector(".slider:not([hidden])");
}

function build() {
  sliders.length = 0;
  const point = byId("point-sliders"), parameters = byId("parameter-sliders");
  point.replaceChildren();
  parameters.replaceChildren();
  pressureSlider(point, "rail", "Rail pressure", "rail", 0);
  if (!model.traced) pulseSliders(point);
  pressureSlider(point, "cylinder", "Cylinder pressure", "cylinder", 1);
  pressureSlider(point, "low", "Return pressure", "low", 2);
  const nodes = model.temperature.nodes, step = nodes[1] - nodes[0];
  new Slider(point, {
    id: "temperature", label: "Fuel temperature", unit: "°C", factor: 1, offset: -273.15, low: nodes[0], high: nodes[nodes.length - 1], step,
    get: () => nodes[state.temperature], set: (value) => { state.temperature = Math.min(Math.max(Math.round((value - nodes[0]) / step), 0), nodes.length - 1); },
  });
  for (const p of byEffect()) {
    new Slider(groupOf(parameters, p), {
      id: p.name, label: p.meaning, soft: p.name, unit: p.unit, factor: p.factor, low: p.low, high: p.high,
      get: () => state.values[p.name] ?? p.value, set: (value) => { state.values[p.name] = ordered(p.name, value); },
      moved: () => state.values[p.name] !== undefined && state.values[p.name] !== p.value,
    });
  }
  filter();
  byId("count").value = String(state.pulses.length);
  byId("data").value = state.data === null ? "" : String(state.data);
  byId("fanned").setAttribute("aria-pressed", String(state.fan));
  byId("fan-note").textContent = state.fan && model.fan ? model.fan.note : "";
}

// --- Changes, address, presets -------------------------------------------------------------------------------------

// J as often as a person can read it; the map takes as long as sixty courses, and leaves the processor to the curves.
const scores = model.data.length || model.maps.length ? new Client(drawScores, { spacing: 60 }) : null;
const maps = model.map ? new Client(drawMap, { spacing: 700, delay: 150 }) : null;
let spread = null; // worker of the fan, once it is asked for
let addressing = 0;

function changed(event) {
  const asked = request(state), stamp = stampOf(event), members = fanOf(state);
  simulate(asked, stamp);
  if (members) {
    spread ??= new Client(takeFan);
    spread.ask({ stamp, state: { ...asked, fan: members, fanEvery: 3 * model.every } });
  }
  if (scores) scores.ask({ state: { ...asked, want: "scores" } });
  if (maps) maps.ask({ state: { ...asked, want: "map", map: model.map } });
  clearTimeout(addressing);
  addressing = setTimeout(() => history.replaceState(null, "", `#${address()}`), 250);
}

function address() {
  const written = new URLSearchParams();
  written.set("rail", state.rail);
  written.set("cylinder", state.cylinder);
  written.set("return", state.low);
  written.set("pulses", state.pulses.map((p) => p.join("+")).join("_"));
  if (state.start) written.set("start", state.start);
  if (state.data !== null) written.set("data", `${state.data}.${state.measured.map(Number).join("")}`);
  if (state.temperature !== model.temperature.at) written.set("temperature", state.temperature);
  if (state.fan) written.set("fan", 1);
  for (const [name, value] of Object.entries(state.values)) written.set(name, value);
  return written.toString();
}

// State of an address; what cannot be read keeps its value.
function fromAddress(text) {
  const read = new URLSearchParams(text), found = stateOf(first);
  const numeric = (key, keep, [low, high]) => {
    const value = parseFloat(read.get(key));
    return value >= low && value <= high ? value : keep;
  };
  found.rail = numeric("rail", found.rail, model.limits.rail);
  found.cylinder = numeric("cylinder", found.cylinder, model.limits.cylinder);
  found.low = numeric("return", found.low, model.limits.low);
  const pulses = (read.get("pulses") || "").split("_").map((pair) => pair.split("+").map(Number));
  const sound = !model.traced && pulses.every((p, i) => p.length === 2 && p.every(Number.isFinite) && p[1] >= 0 && p[1] <= model.limits.energising[1] && (i === 0 || p[0] >= pulses[i - 1][0] + pulses[i - 1][1]));
  if (sound && pulses.length <= 4) found.pulses = pulses;
  found.start = Math.min(numeric("start", found.start, [-1, 1]), found.pulses[0]?.[0] ?? found.start);
  const [data, measured] = (read.get("data") || "").split(".");
  if (data !== "" && model.data[+data]) {
    found.data = +data;
    found.measured = model.data[+data].courses.map((course, i) => Boolean(course) && (i === 3 || (measured || "")[i] === "1"));
  }
  const node = parseInt(read.get("temperature") ?? "", 10);
  if (node >= 0 && node < model.temperature.nodes.length) found.temperature = node;
  found.fan = Boolean(model.fan) && read.get("fan") === "1";
  for (const p of model.sliders) {
    const value = parseFloat(read.get(p.name));
    if (value >= p.low && value <= p.high) found.values[p.name] = value;
  }
  return found;
}

function take(next) {
  state = next;
  stopped = "";
  build();
  changed();
}

function setFan(on) {
  state.fan = on && Boolean(model.fan);
  byId("fanned").setAttribute("aria-pressed", String(state.fan));
  byId("fan-note").textContent = state.fan ? model.fan.note : "";
  changed();
}

function hold() {
  held = held ? null : shown && { x: shown.rate.x, y: shown.rate.y };
  byId("held").setAttribute("aria-pressed", String(Boolean(held)));
  if (shown) draw({ ...shown, stamp: 0 });
}

function setTheme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  byId("theme").textContent = dark ? "Light" : "Dark";
}

// --- Files ---------------------------------------------------------------------------------------------------------

function csv() {
  const { course, state: asked } = shown, width = model.channels.length;
  const notes = [
    `# ${model.title}`, `# ${location.href}`, "# simulated in the browser by a page of commonrail",
    "# time [s]; rate: mean since the row before, by volume at the density at cylinder pressure [mm3/ms]; channels in SI units",
  ];
  const rows = [["time", "rate", ...model.channels].join(",")];
  for (let i = 0; i <= course.rows; i++) {
    const mass = course.injected[i * course.every], before = course.injected[Math.max(i - 1, 0) * course.every];
    const rate = ((mass - before) / (course.every * model.dt * asked.density)) * MICRO;
    const values = Array.from(course.channels.subarray(i * width, (i + 1) * width));
    rows.push([asked.point.start + i * course.every * model.dt, rate, ...values].join(","));
  }
  return [...notes, ...rows, ""].join("\n");
}

// The injector's file with the values of the sliders; what was moved is marked as set by hand.
function toml() {
  const kelvin = model.temperature.nodes[state.temperature], moved = { ...state.values };
  if (state.temperature !== model.temperature.at) moved["fuel.temperature"] = kelvin;
  let room = "";
  return model.toml.split("\n").map((line) => {
    const table = /^\[(.*)\]$/.exec(line);
    if (table) room = table[1];
    const key = /^(\w+) = \{/.exec(line), name = key && `${room}.${key[1]}`;
    if (!name || moved[name] === undefined || moved[name] === model.present[name]) return line;
    const unit = model.units[name], value = unit === "1" ? floating(moved[name]) : `"${floating(moved[name])} ${unit}"`;
    return `${key[1]} = {value = ${value}, mark = "E", source = "set on a bench page"}`;
  }).join("\n");
}

// A number as TOML's floats are written.
function floating(value) {
  const text = String(value);
  return /[.e]/.test(text) ? text.replace(/^(-?\d+)e/, "$1.0e") : `${text}.0`;
}

async function copyLink() {
  history.replaceState(null, "", `#${address()}`);
  try {
    await navigator.clipboard.writeText(location.href);
    say("The link is in the clipboard.");
  } catch {
    say("The address bar holds the link.");
  }
}

// --- Start ---------------------------------------------------------------------------------------------------------

function options(select, texts) {
  select.replaceChildren(...texts.map(([value, text]) => new Option(text, value)));
}

options(byId("preset"), model.presets.map((preset, i) => [i, preset.name]));
options(byId("data"), [...(model.traced ? [] : [["", "none"]]), ...model.data.map((d, i) => [i, `${d.name} (${d.role})`])]);
byId("data-bar").hidden = !model.data.length;
byId("fanned").hidden = !model.fan;
byId("count-bar").hidden = model.traced;
byId("map").hidden = !model.map;
byId("residual").hidden = !model.maps.length;
byId("filter").addEventListener("input", filter);
charts.narrow.addEventListener("change", () => Object.values(views).forEach((view) => view.last && view.show(...view.last)));
byId("preset").addEventListener("change", () => take(stateOf(model.presets[+byId("preset").value])));
byId("data").addEventListener("change", () => {
  const chosen = byId("data").value;
  take(chosen === "" ? { ...copyOf(state), data: null, measured: [false, false, false, false] } : stateOf({ point: model.data[+chosen].point, data: +chosen }));
});
byId("count").addEventListener("change", () => { setCount(+byId("count").value); build(); changed(); });
const actions = {
  r: () => { byId("preset").value = "0"; take({ ...stateOf(first), fan: false }); },
  f: () => model.fan && setFan(!state.fan),
  h: hold,
  d: () => setTheme(document.documentElement.dataset.theme !== "dark"),
};
byId("reset").addEventListener("click", actions.r);
byId("fanned").addEventListener("click", actions.f);
byId("held").addEventListener("click", actions.h);
byId("theme").addEventListener("click", actions.d);
byId("csv").addEventListener("click", () => shown && charts.offer("bench.csv", new Blob([csv()], { type: "text/csv" })));
byId("toml").addEventListener("click", () => charts.offer(`${model.injector}.toml`, new Blob([toml()], { type: "application/toml" })));
byId("link").addEventListener("click", copyLink);
document.addEventListener("keydown", (event) => {
  const typing = event.target.matches("input[type=number], input[type=search], select, textarea");
  if (!typing && !event.ctrlKey && !event.metaKey && !event.altKey && actions[event.key]) actions[event.key]();
});
window.addEventListener("hashchange", () => take(fromAddress(location.hash.slice(1))));
setTheme(window.matchMedia("(prefers-color-scheme: dark)").matches);
take(location.hash.length > 1 ? fromAddress(location.hash.slice(1)) : stateOf(first));
start().catch(refused);

// For the console, and for tests.
window.commonrail = {
  model, frames, fans, csv, toml, address, take, state: () => state, shown: () => shown, map: () => mapped,
  scores: () => scored, fan: () => (state.fan ? fanned : null),
  settled: () => shown !== null && !waiting && !panelling && ![scores, state.fan && spread].some((one) => one && one.busy),
};
