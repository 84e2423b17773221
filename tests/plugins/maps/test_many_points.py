"""Many points at once: each set of pressures and each energising is worked out once, and batches run side by side."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

import commonrail as cr
from commonrail.engine.plan import prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.plugins.maps.response import Conditions, prepare_shared, simulate_many

INJECTOR = cr.load_injector("virtual-lino-2016")
TIMES = ([(0.0, 3e-4)], [(0.0, 2e-4), (1.2e-3, 3e-4)], [])
POINTS = [
    cr.OperatingPoint(rail, its, cylinder, horizon=2.5e-3 + 0.02 * cylinder / 1e9)
    for rail in (60e6, 160e6, 90e6)
    for its in TIMES
    for cylinder in (3e6, 5e6)
]


def test_what_is_worked_out_once_is_what_each_point_has_of_its_own() -> None:
    shared, own = prepare_shared(INJECTOR, POINTS, 1e-6), prepare(INJECTOR, POINTS, 1e-6)
    assert np.array_equal(shared.courses.inputs, own.courses.inputs)
    for name in ("settings", "steps", "earliest_end", "times", "clock", "trace", "traces"):
        assert np.array_equal(getattr(shared.courses, name), getattr(own.courses, name)), name
    for name in ("row", "begin", "densities", "highest"):
        assert np.array_equal(getattr(shared, name), getattr(own, name)), name
    assert shared.medium == own.medium
    assert shared.points is POINTS
    assert len(shared.courses.turns) < len(own.courses.turns)  # or nothing was shared


@pytest.mark.parametrize(("size", "threads"), [(5, 2), (1, 1), (2, 2)], ids=["in turn", "one thread", "side by side"])
def test_batches_have_the_bits_of_one(size: int, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.plugins.maps.response.AT_A_TIME", size)
    names, values = ["nozzle.hole_diameter"], np.array([[120e-6], [130e-6]])
    many = simulate_many(INJECTOR, POINTS, Conditions(threads=threads), names, values)
    whole = simulate_batch(INJECTOR, POINTS, names, values, time_step=1e-6, threads=1)
    for field in fields(Batch):
        assert getattr(many, field.name).tobytes() == getattr(whole, field.name).tobytes(), field.name
    assert len(np.unique(many.injected_volume)) > len(POINTS)


@pytest.mark.parametrize("threads", [1, 9])
def test_a_point_that_the_fuel_does_not_cover_is_refused_wherever_it_is(
    threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commonrail.plugins.maps.response.AT_A_TIME", 1)
    points = [*POINTS[:5], cr.OperatingPoint(900e6, 3e-4)]
    with pytest.raises(cr.errors.ConfigurationError, match="900 MPa"):
        simulate_many(INJECTOR, points, Conditions(threads=threads))
