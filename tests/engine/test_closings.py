"""Opening, first and last closing: bounces do not count, reopenings that inject do, in all engines alike."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate, simulate_batch
from commonrail.engine.solution import Solution
from commonrail.physics.connections import CLEAR_LIFT, REOPENED
from commonrail.physics.injector import Injector

TWICE = OperatingPoint(120e6, [(0.0, 250e-6), (500e-6, 300e-6)])


def closings(s: Solution) -> list[float]:
    """All that count, from the course of the lift: the definition, written out [s]."""
    lift, time = s.channels["needle_lift"], s.time
    found, left, is_open, opened = [], 0.0, False, False
    for k in range(1, len(lift)):
        old, new = lift[k - 1], lift[k]
        if old <= 0.0 < new:
            left = s.injected[k]
        if old <= CLEAR_LIFT < new:
            is_open = opened = True
        # the mass of the step in which it leaves or meets its seat: too little to matter
        if opened and new <= 0.0 < old and (is_open or s.injected[k] - left > REOPENED * s.injected[k]):
            found.append(time[k - 1] + (time[k] - time[k - 1]) * old / (old - new))
            is_open = False
    return found


POINTS = [OperatingPoint(p, et) for p in (40e6, 80e6, 120e6, 190e6) for et in (165e-6, 200e-6, 299e-6, 440e-6, 700e-6)]


@pytest.mark.parametrize("name", ["regulated", "pwm", "rigid"])
def test_closings_are_those_of_the_lift(name: str, request: pytest.FixtureRequest) -> None:
    injector = request.getfixturevalue(name)
    batch = simulate_batch(injector, [*POINTS, TWICE], stop_when_closed=False)
    reopened = 0
    for i, point in enumerate([*POINTS, TWICE]):
        single = simulate(injector, point)
        expected = closings(single) or [np.nan]
        assert [single.first_closing, single.closing] == pytest.approx(
            [expected[0], expected[-1]], abs=1e-9, nan_ok=True
        )
        assert [batch.first_closing[0, i], batch.closing[0, i]] == pytest.approx(
            [single.first_closing, single.closing], abs=1e-12, nan_ok=True
        )
        reopened += single.closing > single.first_closing
    assert reopened >= 2  # there are such among them: two injections, and needles that bounce open


def closing_times(s: Solution) -> list[float]:
    return [s.opening, s.first_closing, s.closing]


@pytest.mark.parametrize("method", ["lsoda", pytest.param("explicit", marks=pytest.mark.slow)])
def test_the_reference_notes_the_same(regulated: Injector, method: str) -> None:
    """A pilot whose needle bounces open by 4 um and injects 0.3 % anew, and two injections."""
    for point in (OperatingPoint(56e6, 441e-6, horizon=1.3e-3), TWICE):
        fast = simulate(regulated, point)
        slow = simulate_reference(regulated, point, 1e-6, Resolution((120, 60), method=method))
        assert fast.closing > fast.first_closing + 50e-6
        assert closing_times(slow) == pytest.approx(closing_times(fast), abs=1e-6)
        assert closings(slow) == pytest.approx([slow.first_closing, slow.closing], abs=0.2e-6)


def test_a_needle_that_is_open_at_the_end_has_closed_once_only(regulated: Injector) -> None:
    point = OperatingPoint(120e6, [(0.0, 250e-6), (500e-6, 300e-6)], horizon=1.0e-3)
    fast, slow = simulate(regulated, point), simulate_reference(regulated, point, 2e-6, Resolution((60, 30)))
    for found in (fast, slow):
        assert found.first_closing == pytest.approx(simulate(regulated, TWICE).first_closing, abs=1e-6)
        assert np.isnan(found.closing)
