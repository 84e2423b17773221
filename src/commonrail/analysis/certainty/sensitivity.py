"""Sensitivity of the estimates to what the bench may be off by, whether a study states it or not."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.estimate import Estimate

__all__ = ["ASSUMED", "Assumed", "moves_of", "sensitivity_records"]

Floats = NDArray[np.float64]


class Assumed(NamedTuple):
    """Change of the bench that is tried on the estimates: quantity, size [SI], unit."""

    key: str
    change: float
    unit: str


ASSUMED = (Assumed("delay", 1e-6, "s"), Assumed("gain", 0.01, "1"))


def moves_of(estimate: Estimate) -> list[tuple[Assumed, Floats]]:
    """Changes (d,) of the estimates [SI] by each assumed change of the bench that has any effect.

    All data sets that see the quantity change together. It takes no simulation: a delay moves the model's course, a
    gain stretches it.
    """
    own = estimate.likelihood
    found = []
    for assumed in ASSUMED:
        shift = np.zeros(own.size)
        for block in own.blocks:
            shown = estimate.errors[block.rows] - block.at_zero
            if assumed.key == "gain":
                shift[block.rows] = assumed.change * shown
            elif block.ordered:
                shift[block.rows] = -assumed.change * np.gradient(shown, block.places[:, 0])
        if shift.any():
            found.append((assumed, estimate.moved(shift)))
    return found


def sensitivity_records(estimate: Estimate) -> list[dict[str, Any]]:
    """JSON-able forms: quantity, change, unit, and the change of each parameter in percent of its value."""
    values = np.abs(estimate.point)
    return [
        {
            "quantity": assumed.key,
            "change": assumed.change,
            "unit": assumed.unit,
            "percent": [float(100.0 * m / v) if v > 0.0 else None for m, v in zip(move, values, strict=True)],
        }
        for assumed, move in moves_of(estimate)
    ]
