"""Checks of the data against a simulation, as a rule of the start values: quantity, onset, shares of J."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.text import quantity
from commonrail.calibration.plausibility import finding
from commonrail.calibration.plausibility.finding import Finding, found
from commonrail.data.base import DataSet, Role, Score

MM3 = 1e9  # of 1 m³

_SLIPS = (  # factor between the number and what it should be, by the units that are mistaken
    (1e-3 / 60.0 / 1e-6, "mm3/ms read as L/min"),
    (1e-6 / (1e-3 / 60.0), "L/min read as mm3/ms"),
    (1e3, "a factor of 1000 between units"),
    (1e-3, "a factor of 1000 between units"),
)
_SLIP_MATCH = 1.5  # start values know the quantity no better


def start_findings(data: DataSet, score: Score) -> Iterator[Finding]:
    """Findings about one data set beside its simulation."""
    if not np.any(np.isfinite(score.values)):
        yield found(
            "start",
            data.name,
            "the simulation fails, so that quantity and onset cannot be compared; check the injector with "
            "`commonrail simulate`.",
        )
        return
    yield from _quantities(data.name, *score.quantities())
    if data.bounds is not None:
        yield from _onset(data, onset(data.measured, data.bounds), onset(score.values, data.bounds))


def share_findings(data: Sequence[DataSet], scores: Sequence[Score], of: str) -> Iterator[Finding]:
    """Fitted sets that make nearly all of J, or nearly nothing of it.

    `scores`: one for each data set; `of`: what the scored model is called.
    """
    fitted = [(d, s) for d, s in zip(data, scores, strict=True) if d.role is Role.FIT]
    costs = np.array([set_cost(d, s) for d, s in fitted])
    total = float(np.sum(costs))
    if len(fitted) < 2 or not np.isfinite(total) or total <= 0.0:
        return
    shares = costs / total
    light = min(finding.LIGHT, 0.1 / len(fitted))
    alone = bool(shares.max() > finding.HEAVY)
    for (d, _), share in zip(fitted, shares, strict=True):
        if share > finding.HEAVY or (share < light and not alone):
            yield found(
                "share",
                d.name,
                f"it makes {100.0 * share:.3g} % of J with the {of}: the fit will follow "
                f"{'it alone' if alone else 'the other sets'}; set the weights of the data so that each counts.",
            )


def set_cost(data: DataSet, score: Score) -> float:
    """Weight · J of one data set; NaN for a failed simulation."""
    return data.weight * float(data.misfit(score.values))


def onset(rate: Floats, bounds: Floats) -> float | None:
    """Time after which all but a small share of the quantity is injected [s]; None if nothing is injected in sum."""
    cumulated = np.cumsum(rate * np.diff(bounds))
    if not cumulated[-1] > 0.0:
        return None
    before = np.flatnonzero(cumulated < finding.ONSET_SHARE * cumulated[-1])
    return float(bounds[before[-1] + 1]) if len(before) else float(bounds[0])


def _quantities(name: str, measured: Floats, simulated: Floats) -> Iterator[Finding]:
    """Quantities beyond a factor of the simulated ones [m³]; nothing is said if they are negative in sum."""
    total, expected = float(np.sum(measured)), float(np.sum(simulated))
    apart = np.abs(measured - simulated) > finding.QUANTITY_APART
    odd = apart & ~_is_near(measured, simulated)
    if not odd.any() or total <= 0.0:
        return
    all_of_it = not _is_near(np.array(total), np.array(expected))
    first = int(np.argmax(odd))
    m, s = (total, expected) if all_of_it else (float(measured[first]), float(simulated[first]))
    where = "" if all_of_it else f" at {np.count_nonzero(odd)} of {len(measured)} points, first at number {first + 1}"
    yield found(
        "quantity",
        name,
        f"the measured quantity is {m * MM3:.4g} mm³, and the simulated one {s * MM3:.4g} mm³{where}: "
        f"more than a factor of {finding.QUANTITY_TIMES:g} apart{_slip(m, s)}; check the unit of the data, the "
        "pressures and the holes of the nozzle.",
    )


def _is_near(measured: Floats, simulated: Floats) -> Bools:
    times = finding.QUANTITY_TIMES
    return np.asarray((measured <= times * simulated) & (simulated <= times * measured))


def _slip(measured: float, simulated: float) -> str:
    if simulated <= 0.0:
        return ""
    times = measured / simulated
    likely = [words for factor, words in _SLIPS if 1.0 / _SLIP_MATCH < times / factor < _SLIP_MATCH]
    return f" ({times:.3g} times; {likely[0]} would do that)" if likely else f" ({times:.3g} times)"


def _onset(data: DataSet, measured: float | None, simulated: float | None) -> Iterator[Finding]:
    pulses = data.points[0].pulses
    if measured is None or not pulses:
        return
    at = f"the measured injection begins at {quantity(measured, 's', 4)}"
    cure = "check the energising time and the trigger's zero"
    first, last = pulses[0].start, pulses[-1].start
    if measured < first + finding.EARLIEST:
        begins = f"energising begins at {quantity(first, 's', 4)}"
        yield found("onset", data.name, f"{at}, and {begins}: no injector opens that soon; {cure}.")
    elif measured > last + finding.LATEST:
        ago = quantity(measured - last, "s", 4)
        yield found("onset", data.name, f"{at}, {ago} after the last energising begins: that is too late; {cure}.")
    elif simulated is not None and abs(measured - simulated) > finding.ONSET_APART:
        begins = f"the simulated one at {quantity(simulated, 's', 4)}"
        most = quantity(finding.ONSET_APART, "s", 4)
        yield found("onset", data.name, f"{at}, and {begins}, more than {most} apart; {cure}.")
