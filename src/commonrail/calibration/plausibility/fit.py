"""Checks of a fitted model: fall of J, values at bounds, size of the error, and shifts or gains that explain it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from commonrail.calibration.plausibility import finding
from commonrail.calibration.plausibility.finding import Finding, found
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role, Score
from commonrail.engine.plan import reference_density
from commonrail.physics.elementary import exp, log
from commonrail.physics.injector import Injector


class Fit(NamedTuple):
    """Result of a search: best values [SI], objective of start and best, scores of the best on every data set."""

    study: Study
    best: Mapping[str, float]
    start_cost: float
    cost: float
    scores: Sequence[Score]


class Change(NamedTuple):
    """A shift [s] or gain of the simulation, J as it is and J with the change."""

    amount: float
    before: float
    after: float

    @property
    def halves(self) -> bool:
        """True if it brings J below half."""
        return self.after < finding.HALF * self.before


def fit_findings(fit: Fit) -> Iterator[Finding]:
    """Findings about the search as a whole."""
    yield from _moved(fit)
    yield from _at_bounds(fit)


def model_findings(data: DataSet, score: Score, injector: Injector) -> Iterator[Finding]:
    """Findings about one model on one data set: a large error, and a shift or a gain that would explain it.

    `score`: of the model on these data; `injector`: the model.
    """
    error = score.relative_error()
    if error > finding.LARGE_MISFIT:
        yield found(
            "misfit",
            data.name,
            f"the error of the model is {100.0 * error:.0f} % of the data beyond their noise, and less than "
            f"{100.0 * finding.LARGE_MISFIT:.0f} % is expected of a fit; check operating point and units, then which "
            "parameters are free.",
        )
    shift, gain = best_shift(data, score), best_gain(data, score)
    if shift is not None and shift.halves and not (gain.halves and gain.after < shift.after):
        yield from _shift(data.name, shift)
    elif gain.halves:
        yield from _gain(data, gain, injector)


def best_shift(data: DataSet, score: Score) -> Change | None:
    """Shift of a simulated course in time that makes J least; positive: the data come later. None of other data."""
    if data.bounds is None:
        return None
    time = 0.5 * (data.bounds[1:] + data.bounds[:-1])

    def j(shift: float) -> float:
        return float(data.misfit(np.interp(time - shift, time, score.values)))

    steps = round(finding.LONGEST_SHIFT / finding.SHIFT_STEP)
    coarse = finding.SHIFT_STEP * np.arange(-steps, steps + 1)
    near = min(coarse, key=j)
    best = min(near + finding.SHIFT_STEP * np.linspace(-1.0, 1.0, 11), key=j)
    before = float(data.misfit(score.values))
    return Change(float(best), before, j(best) if abs(best) >= finding.LEAST_SHIFT else before)


def best_gain(data: DataSet, score: Score) -> Change:
    """Factor on the simulated values that makes J least; above 1: the data lie higher."""
    low, high = log(finding.GAINS)
    gains = exp(np.linspace(low, high, round((high - low) / finding.GAIN_STEP) + 1))
    gain = score.best_gain(gains)
    before, after = map(float, data.misfit(score.scaled(np.array([1.0, gain]))))
    return Change(gain, before, after if abs(gain - 1.0) >= finding.LEAST_GAIN else before)


def _moved(fit: Fit) -> Iterator[Finding]:
    pairs = zip(fit.study.data, fit.scores, strict=True)
    good = all(s.relative_error() <= finding.GOOD_FIT for d, s in pairs if d.role is Role.FIT)
    if good or not fit.cost >= (1.0 - finding.BARELY) * fit.start_cost:
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
    return f"J fell only from {start} to {end}, by less than {100.0 * finding.BARELY:g} %"


def _at_bounds(fit: Fit) -> Iterator[Finding]:
    parameters = fit.study.space.parameters
    names = [p.name for p in parameters if p.is_at_bound(fit.best[p.name])]
    if len(names) > finding.AT_BOUNDS * len(parameters):
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


def _gain(data: DataSet, gain: Change, injector: Injector) -> Iterator[Finding]:
    density = 1e-3 * reference_density(injector, data.points[0])
    yield found(
        "gain",
        data.name,
        f"the data lie {gain.amount:.3g} times as high as the simulation: without that gain J would be "
        f"{gain.after:.4g} instead of {gain.before:.4g}; "
        f"{_density_slip(gain.amount, density)}check unit and gain of the meter.",
    )


def _density_slip(gain: float, density: float) -> str:
    """The mistake between mass and volume that makes such a gain; `density` in g/cm³, which is mg/mm³."""
    for factor, words in ((1.0 / density, "volumes (mm3) labelled as masses (mg)"), (density, "masses (mg) as mm3")):
        if abs(gain / factor - 1.0) <= finding.DENSITY_MATCH:
            return f"{words} would do that, at the fuel's {density:.3g} mg/mm³; "
    return ""
