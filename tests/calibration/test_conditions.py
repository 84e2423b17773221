"""Conditions at operating points besides the fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.parameter import Condition, Wanted, broken, distances_past
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import OK, STILL_INJECTING
from commonrail.physics.injector import Injector

POINT = OperatingPoint(160e6, 200e-6)


def test_each_behaviour_is_recognised() -> None:
    conditions = [Condition(wanted, POINT) for wanted in (Wanted.SUCCEEDS, Wanted.SHUT, Wanted.INJECTS)]
    density = 800.0
    mass = density * 1e-9 * np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    status = np.array([[OK, OK, OK], [OK, OK, OK], [STILL_INJECTING, OK, STILL_INJECTING]])
    batch: Any = SimpleNamespace(status=status, injected_mass=mass, reference_density=np.full((3, 3), density))
    assert broken(conditions, batch).tolist() == [[False, True, False], [False, False, True], [True, False, True]]


def test_an_unknown_behaviour_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="wanted"):
        Condition("hovers", POINT)  # type: ignore[arg-type]


STOPS = (Wanted.NEEDLE_AT_STOP, Wanted.NEEDLE_OFF_STOP, Wanted.VALVE_AT_STOP, Wanted.VALVE_OFF_STOP)


def test_stops_are_those_that_the_lifts_of_a_simulation_reach(regulated: Injector) -> None:
    names = ("plunger_needle.stop_lift", "valve.lift")
    long, short = OperatingPoint(160e6, 1500e-6, horizon=3e-3), OperatingPoint(60e6, 70e-6, horizon=1e-3)
    own = np.array([regulated.values[name] for name in names])
    values = own * np.array([[1.0, 1.0], [0.3, 1.0], [1.0, 5.0]])
    for point in (long, short):
        conditions = [Condition(wanted, point) for wanted in STOPS]
        past = distances_past(conditions, Simulator(regulated, names, 1e-6, 1), values)
        assert past is not None
        for row, candidate in zip(past, values, strict=True):
            lifts = simulate(regulated.with_values(dict(zip(names, candidate.tolist(), strict=True))), point).channels
            needle, valve = (float(lifts[key].max()) for key in ("plunger_lift", "valve_lift"))
            # the same steps, in a trace of one injection and of several
            expected = [needle - candidate[0]] * 2 + [valve - candidate[1]] * 2
            assert row == pytest.approx(expected, rel=1e-9, abs=1e-15)
    # a lowered stop of the needle is met in a long injection, a farther one of the valve is not in a short one
    for point, row, expected in ((long, 1, [False, True, False, True]), (short, 2, [True, False, True, False])):
        conditions = [Condition(wanted, point) for wanted in STOPS]
        past = distances_past(conditions, Simulator(regulated, names, 1e-6, 1), values)
        ones = np.ones((3, 4))
        batch: Any = SimpleNamespace(status=OK * ones, injected_mass=ones, reference_density=800.0 * ones)
        assert broken(conditions, batch, past)[row].tolist() == expected


def test_conditions_without_a_stop_need_no_trace(regulated: Injector) -> None:
    conditions = [Condition(Wanted.SHUT, POINT)]
    assert distances_past(conditions, Simulator(regulated, (), 1e-6, 1), np.empty((1, 0))) is None
