"""Crossings of the needle's seat that a reference engine has recorded, and the instants that follow from them."""

from __future__ import annotations

import math
from typing import NamedTuple

from commonrail.engine.explicit import Instants
from commonrail.injector.joints import REOPENED


class Crossings(NamedTuple):
    """Times [s] at which the tip rises above `CLEAR_LIFT`, meets its seat, leaves it, each with the mass injected."""

    clears: list[tuple[float, float]]
    meets: list[tuple[float, float]]
    lifts: list[tuple[float, float]]


def instants(crossings: Crossings) -> Instants:
    """Opening, last and first closing, as `Solution` defines them."""
    clears = [t for t, _ in crossings.clears]
    if not clears:
        return Instants()
    left, is_open, closings = 0.0, True, []
    events = [(*at, kind) for kind, row in crossings._asdict().items() for at in row if at[0] >= clears[0]]
    for t, injected, kind in sorted(events):
        if kind == "lifts":
            left, is_open = injected, False
        elif kind == "clears":
            is_open = True
        elif is_open or injected - left > REOPENED * injected:
            closings.append(t)
            is_open = False
    last = [t for t in closings if t > clears[-1]]
    return Instants(clears[0], last[-1] if last else math.nan, closings[0] if closings else math.nan)
