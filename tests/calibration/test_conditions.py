"""Conditions at operating points besides the fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from commonrail.calibration.conditions import Condition, Wanted, broken
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import OK, STILL_INJECTING
from commonrail.errors import ConfigurationError

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
