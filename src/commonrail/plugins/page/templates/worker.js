// Worker of the page: scores on the data, the fan, or the map of a state.
"use strict";

let bench = null;

// J of every data set at its own operating points, values of the maps, and the compared rate of the curve that is shown.
function scores(state) {
  bench.setParameters(state.values, state.temperature);
  const found = bench.data.map((d) => bench.score(d, state.temperature));
  const maps = bench.model.maps.map((m) => bench.quantities(m, state.temperature));
  return { maps, j: found.map((one) => one && one.j), rate: state.data === null ? null : found[state.data] && found[state.data].rate };
}

// Mass injected up to every so many steps, for each member of the fan.
function fan(state) {
  const point = bench.followed(state);
  return state.fan.map((values) => {
    bench.setParameters(values, state.temperature);
    const { steps, status } = bench.run(point, 0, false, state.fanEvery);
    if (status === "failed" || status === "not closed") return null;
    const kept = new Float64Array(Math.floor(steps / state.fanEvery) + 1);
    for (let i = 0; i < kept.length; i++) kept[i] = bench.injected[i * state.fanEvery];
    return kept;
  });
}

function map(state) {
  const { pressures, times } = state.map, courses = [null, null, null, null];
  bench.setParameters(state.values, state.temperature);
  const quantity = pressures.map((rail) => times.map((time) => {
    const point = { ...state.point, rail, start: 0, pulses: [[0, time]], duration: time + bench.model.tail, courses };
    const found = bench.run(point, 0);
    return found.status === "ok" || found.status === "still injecting" ? found.figures.injected : NaN;
  }));
  return { pressures, times, quantity, density: state.density };
}

onmessage = async ({ data: message }) => {
  if (message.model) {
    const { instance } = await WebAssembly.instantiate(message.wasm, {});
    bench = new Bench(message.model, instance);
    postMessage({ ready: true });
    return;
  }
  const { id, stamp, state } = message, answer = { id, stamp, state };
  if (state.want === "map") answer.map = map(state);
  else if (state.want === "scores") answer.scores = scores(state);
  else answer.fan = fan(state);
  postMessage(answer);
};
