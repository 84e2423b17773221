"""Sensitivity of the estimates to what the bench may be off by, whether a study states it or not."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from commonrail.analysis.certainty.estimate import Estimate
from commonrail.arrays import Floats
from commonrail.observation.quantities import is_of_meter, parts_of

__all__ = ["ASSUMED", "Assumed", "moves_of", "sensitivity_records", "unstated"]


class Assumed(NamedTuple):
    """Change of the bench that is tried on the estimates: quantity, size [SI] and unit, and the size in words."""

    key: str
    change: float
    unit: str
    size: str

    @property
    def text(self) -> str:
        """Size and quantity in words."""
        return f"{self.size} of {self.key}"

    @property
    def owner(self) -> str:
        """Quantity in words."""
        return "discrepancy of the model" if self.key == "discrepancy" else f"{self.key} of the meter"


# Engineering estimates of what bench and model leave open where a study states nothing. The delay of a meter is seldom
# known to better than a fraction of a sample, its gain to better than a calibration; the discrepancy is a share of the
# largest rate over the time that a needle's motion takes.
ASSUMED = (Assumed("delay", 1e-6, "s", "1 us"), Assumed("gain", 0.01, "1", "1 %"))
DISCREPANCY = Assumed("discrepancy", 0.01, "1", "1 %")
LENGTH = 50e-6  # over which the assumed discrepancy is correlated [s]


def moves_of(estimate: Estimate) -> list[tuple[Assumed, Floats]]:
    """Changes (1, d) of the estimates [SI] by each assumed change of the bench that has any effect.

    All data sets that see the quantity change together. It takes no simulation: a delay moves the model's course, a
    gain stretches it.
    """
    own = estimate.likelihood
    found = []
    for assumed in ASSUMED:
        shift = np.zeros((1, own.size))
        for block in own.blocks:
            shown = estimate.errors[block.rows] - block.at_zero
            if assumed.key == "gain":
                shift[0, block.rows] = assumed.change * shown
            elif block.ordered:
                shift[0, block.rows] = -assumed.change * np.gradient(shown, block.places[:, 0])
        if shift.any():
            found.append((assumed, estimate.moved(shift)))
    return found


def unstated(estimate: Estimate) -> list[tuple[Assumed, Floats]]:
    """Assumed quantities that a study does not state, and the moves (k, d) [SI] of the estimates that add up to each.

    Delay and gain count where they are neither uncertain nor free, a discrepancy where a course in time states none.
    """
    own = estimate.likelihood
    known = {nuisance.key for nuisance in own.nuisances}
    known |= {parts_of(name)[1] for name in own.names if is_of_meter(name)}
    found = [(assumed, move) for assumed, move in moves_of(estimate) if assumed.key not in known]
    rows = []
    for block in own.blocks:
        if block.ordered and not block.noise.discrepancy:
            largest = float(np.abs(estimate.errors[block.rows] - block.at_zero).max())
            courses = block.courses(DISCREPANCY.change * largest, LENGTH)
            shifts = np.zeros((len(courses), own.size))
            shifts[:, block.rows] = courses
            rows.append(estimate.moved(shifts))
    return [*found, (DISCREPANCY, np.vstack(rows))] if rows else found


def sensitivity_records(estimate: Estimate) -> list[dict[str, Any]]:
    """JSON-able forms: quantity, change, unit, and the change of each parameter in percent of its value."""
    values = np.abs(estimate.point)
    return [
        {
            "quantity": assumed.key,
            "change": assumed.change,
            "unit": assumed.unit,
            "text": assumed.text,
            "percent": [float(100.0 * m / v) if v > 0.0 else None for m, v in zip(move[0], values, strict=True)],
        }
        for assumed, move in moves_of(estimate)
    ]
