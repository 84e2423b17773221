// The compiled physics: what a page's state is simulated as. It runs in the workers and knows no document.
"use strict";

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
    return steps;
  }

  // Simulates a point; the channels are kept every so many steps (0: not at all).
  run(point, every) {
    const steps = this.setInputs(point), { dt } = this.model;
    const rows = this.m.simulate(steps, every, this.model.ring, dt, point.rail, point.cylinder, point.low);
    const f = Object.fromEntries(this.model.figures.map((name, i) => [name, this.figures[i]]));
    return { steps, rows, figures: f, status: this.status(rows, f) };
  }

  status(rows, f) {
    if (rows < 0) return "too long";
    if (f.closed_at_start === 0) return "not closed";
    if (f.sound === 0 || f.injected < -1e-7) return "failed";
    return f.closed_at_end === 0 ? "still injecting" : "ok";
  }

  // Mean flows by volume between the bounds of a data set's samples, and J [mm3/ms].
  compare(d, temperature) {
    const { dt } = this.model, n = d.rate.length, rate = new Float64Array(n);
    const density = d.density[temperature] ?? d.density[0];
    const steps = Math.round(d.point.duration / dt);
    let mark = 0, before = 0, j = 0, last = 0;
    for (let i = 0; i <= n; i++) {
      const bound = (d.bounds[i] - d.point.start) / dt, within = Math.min(bound, steps);
      last = Math.max(last, Math.max(Math.ceil(within) - 1, 0));
      const here = this.injected[last] + (within - last) * (this.injected[last + 1] - this.injected[last]);
      if (i > 0) {
        rate[i - 1] = (here - mark) / (dt * (bound - before) * density);
        j += Math.abs(rate[i - 1] - d.rate[i - 1]);
      }
      mark = here;
      before = bound;
    }
    return { rate, j: j * 1e6 };
  }
}
