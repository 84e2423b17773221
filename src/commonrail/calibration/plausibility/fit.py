"""Checks of a fitted model: fall of J, values at bounds, size of the error, and shifts or gains that explain it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.objective import MM3_PER_MS, quantity_residuals, soft_l1
from commonrail.calibration.plausibility import limits
from commonrail.calibration.plausibility.finding import Finding, found
from commonrail.calibration.score import DataScore, QuantityScore, RateScore
from commonrail.calibration.study import QuantityData, RateData, Role, Study
from commonrail.engine.plan import reference_density
from commonrail.injector.definition import Injector

__all__ = ["Fit", "best_gain", "best_shift", "fit_findings", "model_findings", "relative_error"]

Data = RateData | QuantityData
Floats = NDArray[np.float64]


class Fit(NamedTuple):
    """Result of a search: best values [SI], objective of start and best, scores of the best on every data set."""

    study: Study
    best: Mapping[str, float]
    start_cost: float
    cost: float
    scores: Sequence[DataScore]


class Change(NamedTuple):
    """A shift [s] or gain of the simulation, J as it is and J with the change."""

    amount: float
    before: float
    after: float

    @property
    def halves(self) -> bool:
        """True if it brings J below half."""
        return self.after < limits.HALF * self.before


def fit_findings(fit: Fit) -> Iterator[Finding]:
    """Findings about the search as a whole."""
    yield from _moved(fit)
    yield from _at_bounds(fit)


def model_findings(data: Data, score: DataScore, injector: Injector) -> Iterator[Finding]:
    """Findings about one model on one data set: a large error, and a shift or a gain that would explain it."""
    error = relative_error(data, score)
    if error > limits.LARGE_MISFIT:
        yield found(
            "misfit",
            data.name,
            f"the error of the model is {100.0 * error:.0f} % of the data beyond their noise, and less than "
            f"{100.0 * limits.LARGE_MISFIT:.0f} % is expected of a fit; check operating point and units, then which "
            "parameters are free.",
        )
    shift = best_shift(data, score) if isinstance(data, RateData) and isinstance(score, RateScore) else None
    gain = best_gain(data, score)
    if shift is not None and shift.halves and not (gain.halves and gain.after < shift.after):
        yield from _shift(data.name, shift)
    elif gain.halves:
        yield from _gain(data, gain, injector)


def relative_error(data: Data, score: DataScore) -> float:
    """Σ |error| over |Σ data|; of a curve, what its noise makes of that is subtracted. NaN for a failed simulation."""
    if isinstance(data, RateData) and isinstance(score, RateScore):
        error = np.sum(np.abs(score.rate - data.rate)) - _noise(data.rate)
        return _ratio(error, np.sum(data.rate))
    assert isinstance(data, QuantityData)
    assert isinstance(score, QuantityScore)
    judged = ~data.dead_time
    return _ratio(np.nansum(np.abs(score.quantity - data.quantity)[judged]), np.sum(data.quantity[judged]))


def best_shift(data: RateData, score: RateScore) -> Change:
    """Shift of the simulated curve in time that makes J least; positive: the data come later."""
    time = 0.5 * (data.bounds[1:] + data.bounds[:-1])

    def j(shift: float) -> float:
        return float(np.sum(np.abs(np.interp(time - shift, time, score.rate) - data.rate)) * MM3_PER_MS)

    steps = round(limits.LONGEST_SHIFT / limits.SHIFT_STEP)
    coarse = limits.SHIFT_STEP * np.arange(-steps, steps + 1)
    near = min(coarse, key=j)
    best = min(near + limits.SHIFT_STEP * np.linspace(-1.0, 1.0, 11), key=j)
    return Change(float(best), score.j, j(best) if abs(best) >= limits.LEAST_SHIFT else score.j)


def best_gain(data: Data, score: DataScore) -> Change:
    """Factor on the simulated values that makes J least; above 1: the data lie higher."""
    if isinstance(data, RateData) and isinstance(score, RateScore):
        gain = _median_ratio(data.rate, score.rate)
        before, after = score.j, float(np.sum(np.abs(gain * score.rate - data.rate)) * MM3_PER_MS)
    else:
        assert isinstance(data, QuantityData)
        assert isinstance(score, QuantityScore)
        low, high = np.log(limits.GAINS)
        gains = np.exp(np.linspace(low, high, round((high - low) / limits.GAIN_STEP) + 1))
        costs = _map_costs(data, score.quantity, np.append(gains, 1.0))
        gain, before, after = float(gains[np.argmin(costs[:-1])]), float(costs[-1]), float(np.min(costs[:-1]))
    return Change(gain, before, after if abs(gain - 1.0) >= limits.LEAST_GAIN else before)


def _map_costs(data: QuantityData, quantity: Floats, gains: Floats) -> Floats:
    """J of a map for each gain; points that failed, and dead times, which a gain does not move, do not count."""
    residuals = quantity_residuals(data, gains[:, None] * quantity)
    return soft_l1(np.where(np.isfinite(residuals) & ~data.dead_time, residuals, 0.0))


def _median_ratio(measured: Floats, simulated: Floats) -> float:
    """Gain that makes Σ |gain · simulated − measured| least: the median of the ratios, weighted by the simulated."""
    used = np.abs(simulated) > 0.0  # not where it is NaN
    if not used.any():
        return 1.0
    ratios, weights = measured[used] / simulated[used], np.abs(simulated[used])
    order = np.argsort(ratios, kind="stable")
    half = np.searchsorted(np.cumsum(weights[order]), 0.5 * np.sum(weights))
    return float(np.clip(ratios[order][half], *limits.GAINS))


def _noise(rate: Floats) -> float:
    """Σ |noise| of a sampled curve, from its second differences, which a smooth curve hardly has."""
    if len(rate) < 3:
        return 0.0
    deviation = np.median(np.abs(np.diff(rate, 2))) / (0.6745 * np.sqrt(6.0))  # white noise: σ √(1 + 4 + 1)
    return float(np.sqrt(2.0 / np.pi) * deviation * len(rate))


def _ratio(error: float, level: float) -> float:
    return float(max(error, 0.0) / level) if level > 0.0 else float("nan")


def _moved(fit: Fit) -> Iterator[Finding]:
    pairs = zip(fit.study.data, fit.scores, strict=True)
    good = all(relative_error(d, s) <= limits.GOOD_FIT for d, s in pairs if d.role is Role.FIT)
    if good or not fit.cost >= (1.0 - limits.BARELY) * fit.start_cost:
        return
    yield found(
        "moved",
        fit.study.title,
        f"{_fall(fit)}: the free parameters cannot explain the data; check the data's units and operating point, and "
        "free parameters that they depend on.",
    )


def _fall(fit: Fit) -> str:
    start, end = f"{fit.start_cost:.4g}", f"{fit.cost:.4g}"
    if start == end:
        return f"J is {start} at the start and at the end"
    return f"J fell only from {start} to {end}, by less than {100.0 * limits.BARELY:g} %"


def _at_bounds(fit: Fit) -> Iterator[Finding]:
    parameters = fit.study.space.parameters
    names = [p.name for p in parameters if p.is_at_bound(fit.best[p.name])]
    if len(names) > limits.AT_BOUNDS * len(parameters):
        yield found(
            "bounds",
            fit.study.title,
            f"{len(names)} of {len(parameters)} free parameters end at a bound ({', '.join(names)}): the data pull "
            "beyond what the bounds admit; check the data's units and operating point, then widen the bounds.",
        )


def _shift(name: str, shift: Change) -> Iterator[Finding]:
    late = "later" if shift.amount > 0.0 else "earlier"
    yield found(
        "shift",
        name,
        f"the data come {abs(shift.amount) * 1e6:.0f} us {late} than the simulation: without that shift J would be "
        f"{shift.after:.4g} instead of {shift.before:.4g}; check the trigger's zero and the delay of the meter.",
    )


def _gain(data: Data, gain: Change, injector: Injector) -> Iterator[Finding]:
    point = data.point if isinstance(data, RateData) else data.points[0]
    yield found(
        "gain",
        data.name,
        f"the data lie {gain.amount:.3g} times as high as the simulation: without that gain J would be "
        f"{gain.after:.4g} instead of {gain.before:.4g}; "
        f"{_density_slip(gain.amount, 1e-3 * reference_density(injector, point))}check unit and gain of the meter.",
    )


def _density_slip(gain: float, density: float) -> str:
    """The mistake between mass and volume that makes such a gain; `density` in g/cm³, which is mg/mm³."""
    for factor, words in ((1.0 / density, "volumes (mm3) labelled as masses (mg)"), (density, "masses (mg) as mm3")):
        if abs(gain / factor - 1.0) <= limits.DENSITY_MATCH:
            return f"{words} would do that, at the fuel's {density:.3g} mg/mm3; "
    return ""
