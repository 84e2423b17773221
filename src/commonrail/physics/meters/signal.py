"""Signal that a meter shows of a simulated flow: filter, echoes, zeroing, then delay, gain and offset."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.physics.meters.meter import QUANTITIES, Meter, first_order, low_pass

Given = Mapping[str, Floats]  # values of a meter's quantities, (candidates,) each

_ECHOES = ("echo", "second_echo")


class Flow(NamedTuple):
    """Simulated flow of candidates.

    Attributes
    ----------
    rates : (candidates, steps)
        Means over the steps; not finite for a failed simulation.
    start, step : float
        Begin of the first step and length of each [s].
    """

    rates: Floats
    start: float
    step: float


def given_values(meter: Meter, columns: Mapping[str, Floats], candidates: int) -> dict[str, Floats]:
    """Values of a meter's quantities for each candidate; those without value and default are absent.

    `columns` (mapping of str to (candidates,)): quantities that vary.
    """
    known = {key: q.default for key, q in QUANTITIES.items() if q.default is not None} | dict(meter.values)
    return {key: np.full(candidates, value) for key, value in known.items()} | dict(columns)


def shown_rates(meter: Meter, given: Given, flow: Flow, bounds: Floats) -> Floats:
    """Rates (candidates, samples) that a meter shows, means between the bounds of the samples.

    `given` (mapping of str to (candidates,)): of `given_values`; `bounds` (samples + 1,): [s].

    Between steps the cumulated flow is a cubic with continuous slope (Catmull–Rom), so that a sample is a smooth
    function of the delay; with linear interpolation J has a kink at every step.
    """
    sound = np.isfinite(flow.rates).all(axis=1)
    shown = np.full((len(flow.rates), len(bounds) - 1), np.nan)
    if not sound.any():
        return shown
    own = {key: values[sound] for key, values in given.items()}
    rates = _after_zeroing(own, *_with_echoes(own, _direct(meter, own, flow.rates[sound], flow.step), flow.step))
    places = (bounds - flow.start - own["delay"][:, None]) / flow.step
    cumulated = _cumulated_at(flow.step * np.cumsum(rates, axis=1), places)
    means = np.diff(cumulated, axis=1) / np.diff(bounds)
    shown[sound] = own["gain"][:, None] * means + own["offset"][:, None]
    return shown


def shown_quantities(given: Given, quantities: Floats) -> Floats:
    """Quantities per stroke (candidates, points) that a meter shows of true ones, by gain and offset.

    `given` (mapping of str to (candidates,)): of `given_values`; `quantities` (candidates, points): [m³].
    """
    return np.asarray(given["gain"][:, None] * quantities + given["quantity_offset"][:, None])


def _direct(meter: Meter, given: Given, rates: Floats, step: float) -> Floats:
    """Low-passed signal; with a late cut-off, the two filters blended from the opening peak on."""
    early = _for_each(lambda signal, f: low_pass(signal, step, meter.law, meter.order, f), rates, given["cutoff"])
    if "late_cutoff" not in given:
        return early
    late = _for_each(lambda signal, f: low_pass(signal, step, meter.law, meter.order, f), rates, given["late_cutoff"])
    since = step * (np.arange(rates.shape[1]) - _opening_peaks(early)[:, None])
    share = np.clip(since / given["blend"][:, None], 0.0, 1.0)
    return np.asarray((1.0 - share) * early + share * late)


def _opening_peaks(signals: Floats) -> Floats:
    """Index of the first maximum above half of the greatest value of each signal, to a fraction of a step."""
    found = np.empty(len(signals))
    for i, signal in enumerate(signals):
        first = int(np.argmax(signal > 0.5 * signal.max()))
        falls = np.flatnonzero(np.diff(signal[first:]) < 0.0)
        k = first + int(falls[0]) if len(falls) else len(signal) - 1
        found[i] = k + _vertex(signal, k)
    return found


def _vertex(signal: Floats, k: int) -> float:
    """Distance of a parabola's top from the sample k, through it and both neighbours."""
    if not 0 < k < len(signal) - 1:
        return 0.0
    left, middle, right = signal[k - 1 : k + 2]
    curve = left - 2.0 * middle + right
    return float(0.5 * (left - right) / curve) if curve < 0.0 else 0.0


def _with_echoes(given: Given, direct: Floats, step: float) -> tuple[Floats, Floats]:
    """The direct signal, and it with its echoes, which take their shares from it: an echo makes no fuel."""
    left = 1.0 - np.sum([given[f"{echo}_share"] for echo in _ECHOES], axis=0)
    total = left[:, None] * direct
    for echo in _ECHOES:
        share = given[f"{echo}_share"]
        if share.any():
            steps = np.arange(direct.shape[1] + 1) - given[f"{echo}_delay"][:, None] / step
            late = np.diff(_cumulated_at(np.cumsum(direct, axis=1), steps), axis=1)
            with np.errstate(divide="ignore"):
                decay = step / given[f"{echo}_lag"]
            total = total + share[:, None] * _for_each(first_order, late, decay)
    return direct, total


def _after_zeroing(given: Given, direct: Floats, total: Floats) -> Floats:
    """The signal, zero once the direct part has fallen to a share of its peak for good."""
    if not given["zeroing"].any():
        return total
    kept = total.copy()
    for i, share in enumerate(given["zeroing"]):
        level = share * direct[i].max()
        above = np.flatnonzero(direct[i] > level)
        if share > 0.0 and len(above) and above[-1] + 1 < direct.shape[1]:
            k = int(above[-1])
            part = (direct[i, k] - level) / (direct[i, k] - direct[i, k + 1])  # of the next step, before the crossing
            kept[i, k + 1] *= part
            kept[i, k + 2 :] = 0.0
    return kept


def _for_each(law: Callable[[Floats, float], Floats], signals: Floats, values: Floats) -> Floats:
    """A law with one value for each signal; all at once where the values are the same."""
    if (values == values[0]).all():
        return law(signals, float(values[0]))
    return np.stack([law(signal, float(value)) for signal, value in zip(signals, values, strict=True)])


def _cumulated_at(cumulated: Floats, places: Floats) -> Floats:
    """Cumulated signals (candidates, steps), zero before the first step, at places in steps (candidates, places)."""
    ends = np.pad(cumulated, ((0, 0), (3, 3)), mode="edge")
    ends[:, :3] = 0.0
    inside = np.clip(places, -1.0, cumulated.shape[1] + 1.0)
    whole = np.floor(inside)
    u, k = inside - whole, whole.astype(np.intp) + 2  # `ends` begins two steps before the first one
    p0, p1, p2, p3 = (np.take_along_axis(ends, k + i, axis=1) for i in (-1, 0, 1, 2))
    bend = 2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + u * (3.0 * (p1 - p2) + p3 - p0)
    return np.asarray(p1 + 0.5 * u * (p2 - p0 + u * bend))
