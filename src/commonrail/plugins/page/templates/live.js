// The report's main chart simulates: points of the forest plot are dragged, or moved by arrow keys.
const live = (() => {
  "use strict";
  const model = JSON.parse(document.getElementById("model").textContent), told = document.getElementById("live");
  const figures = charts.of(document.getElementById("figure-0")), MICRO = 1e6, MM3 = 1e9, SLICE = 6, PAUSE = 80; // [ms]: simulations between two drawings, and from a drag to J of the other data
  const values = {}, frames = [], sliders = new Map(model.sliders.map((s) => [s.name, s]));
  const curve = model.data.findIndex((d) => d.name === model.main), map = model.maps.findIndex((m) => m.name === model.main);
  const reference = Object.fromEntries([...model.data, ...model.maps].map((d) => [d.name, d.reference])), now = {};
  let bench = null, left = [], next = 0, stamp = 0, timer = 0, stopped = "", quantities = [];

  function parameters() {
    bench.setParameters(Object.entries(values).map(([name, value]) => [model.columnOf[name], value]), 0);
  }

  // What is still to be simulated: the curve, or each point of the map, and then the other data, whose J alone is told.
  function ask(event) {
    if (!bench) return;
    stamp = event ? event.timeStamp : 0;
    const rows = map < 0 ? [] : model.maps[map].rows.map((_, i) => (i + next) % model.maps[map].rows.length);
    const others = [...model.data.keys()].filter((i) => i !== curve).map((i) => () => { now[model.data[i].name] = j(bench.score(bench.data[i], 0)); });
    const maps = [...model.maps.keys()].filter((i) => i !== map).map((i) => () => { now[model.maps[i].name] = bench.quantities(bench.model.maps[i], 0).j; });
    left = [...(curve < 0 ? [] : [drawCurve]), ...rows.map((i) => () => takeRow(i)), ...(map < 0 ? [] : [closeMap]), null, ...others, ...maps];
    work();
  }

  function j(found) { return found && found.j; }

  function work() {
    clearTimeout(timer);
    timer = 0;
    const until = performance.now() + SLICE;
    parameters();
    while (left.length && performance.now() < until) {
      const task = left.shift();
      if (!task) { timer = setTimeout(work, PAUSE); break; }
      task();
    }
    if (map >= 0) drawMap();
    if (stamp) { frames.push({ ms: performance.now() - stamp, work: performance.now() - until + SLICE }); stamp = 0; }
    tell();
    if (left.length && !timer) timer = setTimeout(work);
  }

  function draw(panels) {
    const chart = charts.shown(figures);
    chart.svg.classList.toggle("moved", panels.some((series) => series.length));
    chart.panels.forEach((panel, i) => {
      panel.draw(panels[i] || []);
      if (panel.own.length) panel.include();
    });
  }

  function drawCurve() {
    const d = bench.data[curve], found = bench.score(d, 0), x = Array.from(d.rate, (_, i) => 0.5 * (d.bounds[i] + d.bounds[i + 1]) * MICRO);
    now[model.main] = j(found);
    const series = (y) => [{ ...model.moved, key: "moved", name: "moved", x, y }];
    draw(found ? [series(found.rate.map((v) => v * MICRO)), series(found.rate.map((v, i) => (v - d.rate[i]) * MICRO))] : []);
  }

  function takeRow(i) {
    const m = model.maps[map];
    quantities[i] = bench.valueOf(m, m.rows[i], 0);
    next = i + 1;
  }

  function closeMap() { now[model.main] = bench.judged(model.maps[map], quantities).j; }

  // Lines and errors of the points that have been simulated, in the colours of their rail pressures.
  function drawMap() {
    const rows = model.maps[map].rows.map((row, i) => ({ row, value: quantities[i], point: row.points[row.points.length >> 1] })).filter(({ row, value }) => !row.dead && value > -1);
    const rails = [...new Set(model.maps[map].rows.filter((row) => !row.dead).map((row) => row.points[0].rail))].sort((a, b) => a - b);
    const [chart] = figures, units = { "error, %": (e, q) => (q > model.limit ? (100 * e) / q : NaN), "error, mm³": (e, q) => (q > model.limit ? NaN : e * MM3) };
    draw(chart.panels.map((panel) => rails.map((rail, i) => {
      const own = rows.filter(({ point }) => point.rail === rail).sort((a, b) => a.point.pulses[0][1] - b.point.pulses[0][1]), error = units[panel.title];
      return { key: i, name: "moved", colour: model.colours[i], width: error ? 7 : model.moved.width, marks: Boolean(error),
        x: own.map(({ point }) => point.pulses[0][1] * MICRO), y: own.map(({ row, value }) => (error ? error(value - row.target, row.target) : value * MM3)) };
    })));
  }

  function tell() {
    const moved = Object.keys(values).length;
    const texts = Object.entries(reference).filter(([name]) => name in now).map(([name, before]) => `${name}: J ${now[name] === null ? "–" : now[name].toFixed(1)}${before ? ` (calibrated ${before.toFixed(1)})` : ""}`);
    told.firstElementChild.textContent = moved ? [stopped, curve < 0 ? "" : "Thick line: moved", ...texts].filter(Boolean).join(" · ") : "Drag a point, or move it by the arrow keys: the chart is simulated again.";
    told.lastElementChild.hidden = !moved;
  }

  // --- Bars of the parameters -------------------------------------------------------------------------------------

  const bars = [...document.querySelectorAll(".forest-bar[data-name]")].filter((bar) => sliders.has(bar.dataset.name));

  function take(name, value, event) {
    const s = sliders.get(name), held = constrained(model, values, name, Math.min(Math.max(value, s.low), s.high));
    stopped = held.stopped;
    if (held.value === s.value) delete values[name];
    else values[name] = held.value;
    refresh(name);
    ask(event);
  }

  function refresh(name) {
    const s = sliders.get(name), value = values[name] ?? s.value, [lower, upper] = model.bounds[name];
    const words = `${+(value * s.factor).toPrecision(4)} ${s.unit}`.replace("-", "−").replace("um", "µm").replace("us", "µs").replace("mm3", "mm³");
    for (const bar of bars.filter((one) => one.dataset.name === name)) {
      const number = bar.closest("tr").querySelector("[data-value]");
      bar.querySelector(".moved").style.left = `${(100 * (value - lower)) / (upper - lower)}%`;
      bar.classList.toggle("changed", name in values);
      number.dataset.value ||= number.textContent;
      number.textContent = name in values ? words : number.dataset.value;
      bar.setAttribute("aria-valuenow", value * s.factor);
      bar.setAttribute("aria-valuetext", words);
    }
  }

  function reset() {
    for (const name of Object.keys(values)) { delete values[name]; refresh(name); }
    stopped = "";
    left = [];
    clearTimeout(timer);
    timer = 0;
    for (const key of Object.keys(now)) delete now[key];
    quantities = [];
    draw([]);
    figures.forEach((chart) => chart.reset());
    tell();
  }

  for (const bar of bars) {
    const { name } = bar.dataset, [lower, upper] = model.bounds[name], s = sliders.get(name);
    const at = (event) => { const box = bar.getBoundingClientRect(); return lower + ((event.clientX - box.left) / box.width) * (upper - lower); };
    bar.append(Object.assign(document.createElement("i"), { className: "moved" }));
    Object.entries({ role: "slider", tabindex: 0, "aria-valuemin": s.low * s.factor, "aria-valuemax": s.high * s.factor }).forEach(([key, value]) => bar.setAttribute(key, value));
    bar.addEventListener("pointerdown", (event) => { bar.setPointerCapture(event.pointerId); bar.focus({ preventScroll: true }); event.preventDefault(); take(name, at(event), event); });
    bar.addEventListener("pointermove", (event) => { if (bar.hasPointerCapture(event.pointerId)) take(name, at(event), event); });
    bar.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!step) return;
      event.preventDefault();
      take(name, (values[name] ?? s.value) + (step * (upper - lower)) / 100, event);
    });
  }
  sliders.forEach((_, name) => refresh(name));
  told.lastElementChild.addEventListener("click", reset);
  WebAssembly.instantiate(Uint8Array.from(atob(document.getElementById("wasm").textContent.trim()), (c) => c.charCodeAt(0)), {}).then(({ instance }) => {
    bench = new Bench(model, instance);
    document.body.classList.add("simulates");
    tell();
  });
  return { model, frames, take, reset, now, values, settled: () => bench !== null && !timer };
})();
