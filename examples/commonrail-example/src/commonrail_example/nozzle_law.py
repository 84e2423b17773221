"""Nozzle law ``nozzle_law = "gradual"`` of an injector's file: c_d rises without a knee, and falls at small drops.

A law is a plain function of numbers: no classes, lists or texts, for kernels compile it. Functions of this module that
it calls need ``@physics`` (`commonrail.physics.law`); of `math` take sqrt, exp of what is not positive, sin and cos.
"""

from __future__ import annotations

import math
from typing import Any

SHARPNESS = 3.0  # lifts of the transition z0 in which c_d comes within exp(-3) of its maximum [1], chosen
SLOW_DROP = 0.5e6  # pressure drop at which friction takes half of c_d [Pa], chosen


def discharge(c: Any, lift_reached: float, sac: float, cylinder: float) -> float:
    """Discharge coefficient of the nozzle [1].

    Parameters
    ----------
    c : nozzle.Coefficients
        Of the nozzle, with those of Eq. (9) at the rail pressure (`commonrail.physics.components.nozzle`).
    lift_reached : float
        Largest lift that the nozzle remembers, which is the lift itself while the needle rises [m], ≥ 0.
    sac, cylinder : float
        Pressures before and behind the holes [Pa]; the fast step takes those at its start.
    """
    largest = c.discharge_transition + c.discharge_slope * (c.lift_maximum - c.lift_transition)
    drop = max(sac - cylinder, 0.0)
    opening = 1.0 - math.exp(-SHARPNESS * max(lift_reached, 1e-6) * c.per_lift_transition)
    return largest * opening * drop / (drop + SLOW_DROP)
