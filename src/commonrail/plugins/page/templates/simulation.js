// The compiled physics: what a page's state is simulated as. It knows no document: the page's own thread runs it for
// the curve of a moved slider, the workers for fan, J and map.
"use strict";

function unpacked(filter) {
  return filter && { ...filter, response: numbersOf(filter.response) };
}

// Energising time at which a small quantity is reached, by lines between three of them, no flatter than one that
// reaches it within `flattest`.
function crossing({ points, quantity }, [low, middle, high], flattest) {
  const [before, here, after] = points.map((point) => point.pulses[0][1]), later = middle < quantity;
  const slope = later ? (high - middle) / (after - here) : (middle - low) / (here - before);
  return here + (quantity - middle) / Math.max(slope, quantity / flattest);
}

// Value of a parameter that keeps the run's linear constraints as long as the others keep them, and a sentence on what
// has stopped it.
function constrained(model, values, name, value) {
  const valueOf = (other) => values[other] ?? model.present[other];
  let low = -Infinity, high = Infinity, below = "", above = "";
  for (const { terms, floor, label } of model.constraints) {
    if (!terms[name]) continue;
    const rest = Object.entries(terms).reduce((sum, [other, share]) => (other === name ? sum : sum + share * valueOf(other)), 0);
    const end = (floor - rest) / terms[name];
    if (terms[name] > 0 && end > low) [low, below] = [end, label];
    if (terms[name] < 0 && end < high) [high, above] = [end, label];
  }
  if (low > high || (value >= low && value <= high)) return { value, stopped: "" };
  const stopped = `${name} is stopped by the run's constraint ${value < low ? below : above}.`;
  return { value: value < low ? low : high, stopped };
}

class Bench {
  constructor(model, module) {
    this.model = model;
    this.m = module.exports;
    this.base = numbersOf(model.theta);
    this.fuel = model.temperature.coefficients.map(numbersOf);
    this.data = model.data.map((d) => ({
      ...d,
      bounds: numbersOf(d.bounds),
      rate: numbersOf(d.rate),
      courses: d.courses.map((course) => (course ? numbersOf(course) : null)),
      meter: d.meter && { ...d.meter, early: unpacked(d.meter.early), late: unpacked(d.meter.late) },
    }));
    const array = (place, length) => new Float64Array(this.m.memory.buffer, place, length);
    this.theta = array(this.m.theta(), model.columns);
    this.inputs = array(this.m.inputs(), 6 * model.mostSteps);
    this.injected = array(this.m.injected(), model.mostSteps + 1);
    this.channels = array(this.m.channels(), (model.mostRows + 1) * model.channels.length);
    this.figures = array(this.m.figures(), model.figures.length);
  }

  // Parameters by column; temperature by the place of its node.
  setParameters(values, temperature) {
    this.theta.set(this.base);
    this.theta.set(this.fuel[temperature], this.model.parameters);
    for (const [column, value] of values) this.theta[column] = value;
  }

  // Means over each step of the boundary pressures and of the drive's trace, and the clocks of the energising.
  setInputs(point) {
    if (point === this.point) return this.steps;
    const { dt } = this.model, { pulses, start } = point, table = this.inputs, count = pulses.length;
    const steps = Math.min(Math.max(Math.round(point.duration / dt), 1), this.model.mostSteps);
    const held = [point.rail, point.cylinder, point.low, 0];
    for (let column = 0; column < 4; column++) {
      const course = point.courses[column];
      for (let k = 0; k < steps; k++) {
        table[6 * k + column] = course ? course[Math.min(k, course.length - 1)] : held[column];
      }
    }
    let current = 0;
    for (let k = 0; k < steps; k++) {
      const begin = start + dt * k;
      while (current + 1 < count && pulses[current + 1][0] < begin + dt * (1 - 1e-9)) current++;
      let lasting = 0;
      for (let i = 0; i < current; i++) {
        const end = pulses[i][0] + pulses[i][1];
        lasting += Math.max(Math.min(end, begin + dt) - Math.max(pulses[i][0], begin), 0);
      }
      table[6 * k + 4] = count ? begin - pulses[current][0] + lasting : -1;
      table[6 * k + 5] = count ? begin - (pulses[current][0] + pulses[current][1]) : -1;
    }
    this.point = point;
    this.steps = steps;
    return steps;
  }

  // Simulates a point; the channels are kept every so many steps (0: not at all), and the mass injected every `stride`.
  // Unless it is simulated to its end, it ends once needle and valve rest.
  run(point, every, whole, stride = 1) {
    const wanted = this.setInputs(point), { dt, quiet, resting, ring } = this.model;
    const last = point.pulses.reduce((_, p) => p[0] + p[1], point.courses[3] ? Infinity : point.start) - point.start;
    const after = Math.min(Math.round((last + quiet) / dt), wanted), patience = whole ? 0 : Math.round(resting / dt);
    const steps = this.m.simulate(wanted, every, stride, ring, after, patience, dt, point.rail, point.cylinder, point.low);
    this.done = Math.max(steps, 0);
    const f = Object.fromEntries(this.model.figures.map((name, i) => [name, this.figures[i]]));
    const rows = every > 0 ? Math.floor(Math.max(steps, 0) / every) : 0;
    return { steps: Math.max(steps, 0), rows, figures: f, status: this.status(steps, f) };
  }

  // A state of the page as the module simulates it: its operating point with the measured courses that it follows.
  followed(state) {
    const d = state.data === null ? null : this.data[state.data];
    return { ...state.point, courses: [0, 1, 2, 3].map((column) => (d && state.measured[column] ? d.courses[column] : null)) };
  }

  // Course of a state: its channels every so many steps, and the mass injected after every step.
  course(state) {
    this.setParameters(state.values, state.temperature);
    const { every } = state, found = this.run(this.followed(state), every), width = this.model.channels.length;
    return { ...found, every, channels: this.channels.slice(0, (found.rows + 1) * width), injected: this.injected.slice(0, found.steps + 1) };
  }

  status(steps, f) {
    if (steps < 0) return "too long";
    if (f.closed_at_start === 0) return "not closed";
    if (f.sound === 0 || f.injected < -1e-7) return "failed";
    return f.closed_at_end === 0 ? "still injecting" : "ok";
  }

  // Mean flows by volume between the bounds of a data set's samples, and J [mm3/ms].
  compare(d, temperature) {
    const density = d.density[temperature] ?? d.density[0];
    const rate = d.meter ? this.metered(d, density) : this.sampled(d, density);
    return { rate, j: rate.reduce((sum, y, i) => sum + Math.abs(y - d.rate[i]), 0) * 1e6 };
  }

  // A data set at its operating point, as its meter shows it; null where the simulation fails.
  score(d, temperature) {
    const duration = d.point.duration + (d.meter ? d.meter.ahead : 0);
    const { status } = this.run({ ...d.point, duration, courses: d.courses }, 0, true);
    return status === "failed" || status === "not closed" ? null : this.compare(d, temperature);
  }

  quantities(m, temperature) {
    return this.judged(m, m.rows.map((row) => this.valueOf(m, row, temperature)));
  }

  // Values of the rows of a map, and its J: the sum of 2 (sqrt(1 + r^2) - 1) of the errors r over their tolerances. A
  // value is a quantity [m3] or, of a dead time that is judged as one, a time [s]; null where a simulation fails.
  judged(m, values) {
    const j = values.reduce((sum, value, i) => {
      const r = value === null ? NaN : (value - m.rows[i].target) / m.rows[i].tolerance;
      return sum + 2 * (Math.sqrt(1 + r * r) - 1);
    }, 0);
    return { values, j: Number.isFinite(j) ? j : null };
  }

  valueOf(m, row, temperature) {
    const densities = m.densities[row.density], density = densities[temperature] ?? densities[0];
    const found = row.points.map((point) => {
      // to its end: a SAC that is still emptying when a shorter run ends would count as an injection that goes on
      const { figures, status } = this.run({ ...point, courses: [null, null, null, null] }, 0, true);
      return status === "ok" ? m.gain * (figures.injected / density) + m.offset : NaN;
    });
    if (!found.every(Number.isFinite)) return null;
    return row.timed ? crossing(row, found, m.flattest) : found[0];
  }

  metered(d, density) {
    const { dt } = this.model, rates = new Float64Array(this.done);
    for (let k = 0; k < rates.length; k++) rates[k] = (this.injected[k + 1] - this.injected[k]) / (dt * density);
    return shownRates(d.meter, rates, d.point.start, dt, d.bounds);
  }

  sampled(d, density) {
    const { dt } = this.model, n = d.rate.length, rate = new Float64Array(n);
    const steps = Math.round(d.point.duration / dt);
    let mark = 0, before = 0, last = 0;
    for (let i = 0; i <= n; i++) {
      const bound = (d.bounds[i] - d.point.start) / dt, within = Math.min(bound, steps);
      last = Math.max(last, Math.max(Math.ceil(within) - 1, 0));
      const here = this.injected[last] + (within - last) * (this.injected[last + 1] - this.injected[last]);
      if (i > 0) rate[i - 1] = (here - mark) / (dt * (bound - before) * density);
      mark = here;
      before = bound;
    }
    return rate;
  }
}
