"""Limits of an adapted model: reference quantities that it misses, and points where it injects nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.text import listed, signed
from commonrail.calibration.run import Calibration
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.status import OK
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.evidence import RESOLUTION
from commonrail.plugins.family.drawn import at_point


def missed_references(points: QuantityData, adapted: Floats) -> list[str]:
    """Sentence on reference quantities that the adapted model (points,) [m³] misses by more than their tolerance."""
    off = adapted - points.quantity
    texts = [
        f"{points.quantity[i] * 1e9:.4g} mm³ at {at_point(points.points[i])} by {signed(off[i] * 1e9, 2)} mm³"
        for i in np.flatnonzero(np.abs(off) > points.discrepancy(points.quantity)).tolist()
    ]
    return [f"the adapted model misses reference quantities beyond their tolerance: {listed(texts)}"] if texts else []


def shut_points(
    fit: Calibration, adapted: Injector, points: Sequence[OperatingPoint], threads: int | None = None
) -> list[str]:
    """Sentences on points where the adapted model injects nothing, with the reason; of the type's model beside it."""
    space = fit.study.space
    values = np.array([space.reference, [fit.best[name] for name in space.names]])
    batch = simulate_batch(
        fit.study.injector, points, space.names, values, time_step=fit.study.time_step, threads=threads
    )
    of_type, injected = batch.injected_volume
    shut = (batch.status[1] == OK) & (injected < RESOLUTION)
    sentences = []
    for which, words in ((of_type >= RESOLUTION, "where the type injects"), (of_type < RESOLUTION, "as the type")):
        at = [points[i] for i in np.flatnonzero(shut & which).tolist()]
        if at:
            places = listed(list(dict.fromkeys(map(at_point, at))))
            reason = _why_shut(adapted, at[0])
            sentences.append(f"the adapted model injects nothing at {places}, {words}: {reason}")
    return sentences


def _why_shut(injector: Injector, point: OperatingPoint) -> str:
    """The part that does not move where an injector injects nothing."""
    lift = simulate(injector, point).channels.get("valve_lift")
    if lift is None:
        return "the needle stays shut"
    return "the valve opens, and the needle stays shut" if lift.max() > 0.0 else "the coil does not lift the valve"
