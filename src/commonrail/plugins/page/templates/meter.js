// A rate as a meter shows it: the steps of commonrail's observation of a simulated flow, in the same order.
"use strict";

// Signal through a filter whose response begins at `first` steps.
function filtered(signal, { response, first }) {
  const n = signal.length, m = response.length, out = new Float64Array(n);
  for (let k = 0; k < n; k++) {
    let sum = 0;
    const low = Math.max(0, k - first - m + 1), high = Math.min(n - 1, k - first);
    for (let j = low; j <= high; j++) sum += signal[j] * response[k - first - j];
    out[k] = sum;
  }
  return out;
}

function summed(signal) {
  const out = new Float64Array(signal.length);
  let sum = 0;
  for (let k = 0; k < signal.length; k++) out[k] = sum += signal[k];
  return out;
}

// Cumulated signal, zero before the first step, at a place in steps: a cubic with continuous slope.
function cumulatedAt(cumulated, place) {
  const n = cumulated.length, inside = Math.min(Math.max(place, -1), n + 1), whole = Math.floor(inside), u = inside - whole;
  const at = (i) => (i < 0 ? 0 : cumulated[Math.min(i, n - 1)]);
  const [p0, p1, p2, p3] = [at(whole - 2), at(whole - 1), at(whole), at(whole + 1)];
  const bend = 2 * p0 - 5 * p1 + 4 * p2 - p3 + u * (3 * (p1 - p2) + p3 - p0);
  return p1 + 0.5 * u * (p2 - p0 + u * bend);
}

function lagged(signal, decay) {
  if (!Number.isFinite(decay)) return signal;
  const keep = Math.exp(-decay), mean = -Math.expm1(-decay) / decay, out = new Float64Array(signal.length);
  let y = 0, before = 0;
  for (let k = 0; k < signal.length; k++) {
    y = (1 - mean) * signal[k] + (mean - keep) * before + keep * y;
    before = signal[k];
    out[k] = y;
  }
  return out;
}

// First maximum above half of the largest value, to a fraction of a step.
function openingPeak(signal) {
  let top = -Infinity;
  for (const y of signal) if (y > top) top = y;
  let k = signal.findIndex((y) => y > 0.5 * top);
  if (k < 0) k = 0;
  while (k + 1 < signal.length && signal[k + 1] >= signal[k]) k++;
  if (k < 1 || k >= signal.length - 1) return k;
  const [left, middle, right] = [signal[k - 1], signal[k], signal[k + 1]], curve = left - 2 * middle + right;
  return k + (curve < 0 ? (0.5 * (left - right)) / curve : 0);
}

function directOf(meter, rates, step) {
  const early = meter.early ? filtered(rates, meter.early) : rates;
  if (!meter.late) return early;
  const late = filtered(rates, meter.late), peak = openingPeak(early);
  return early.map((y, k) => {
    const share = Math.min(Math.max((step * (k - peak)) / meter.blend, 0), 1);
    return (1 - share) * y + share * late[k];
  });
}

function withEchoes(meter, direct, step) {
  const left = 1 - meter.echoes.reduce((sum, echo) => sum + echo.share, 0); // an echo takes its share from the direct signal
  const total = direct.map((y) => left * y), cumulated = summed(direct);
  for (const echo of meter.echoes) {
    const late = direct.map((_, k) => cumulatedAt(cumulated, k + 1 - echo.delay / step) - cumulatedAt(cumulated, k - echo.delay / step));
    lagged(late, echo.lag > 0 ? step / echo.lag : Infinity).forEach((y, k) => { total[k] += echo.share * y; });
  }
  return total;
}

// The signal, zero once its direct part has fallen to a share of its peak for good.
function zeroed(meter, direct, total) {
  if (!(meter.zeroing > 0)) return total;
  let top = -Infinity, k = direct.length - 1;
  for (const y of direct) if (y > top) top = y;
  const level = meter.zeroing * top;
  while (k >= 0 && !(direct[k] > level)) k--;
  if (k < 0 || k + 1 >= direct.length) return total;
  total[k + 1] *= (direct[k] - level) / (direct[k] - direct[k + 1]);
  total.fill(0, k + 2);
  return total;
}

// Rates [m3/s] between bounds [s] that a meter shows of rates in steps from `start` on.
function shownRates(meter, rates, start, step, bounds) {
  const direct = directOf(meter, rates, step), signal = zeroed(meter, direct, withEchoes(meter, direct, step));
  const cumulated = summed(signal), shown = new Float64Array(bounds.length - 1);
  let before = 0;
  for (let i = 0; i < bounds.length; i++) {
    const here = step * cumulatedAt(cumulated, (bounds[i] - start - meter.delay) / step);
    if (i > 0) shown[i - 1] = meter.gain * ((here - before) / (bounds[i] - bounds[i - 1])) + meter.offset;
    before = here;
  }
  return shown;
}
