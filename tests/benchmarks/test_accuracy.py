"""Errors are those against the truth, and nothing is judged by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy import errors
from benchmarks.case import INTERVAL
from commonrail.base.errors import ConfigurationError
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status

TIME = INTERVAL * np.arange(5)


def course(rate: list[float]) -> Solution:
    """A simulation that had this rate [kg/s]."""
    injected = np.concatenate(([0.0], np.cumsum(rate) * INTERVAL))
    nan = float("nan")
    return Solution(
        TIME, np.array(rate), injected, {}, float(injected[-1]), 0.0, nan, nan, nan, 800.0, Status.OK, "by hand", 0.0
    )


def test_errors_by_hand() -> None:
    found = errors(course([0.0, 2.0, 5.0, 1.0]), course([0.0, 3.0, 4.0, 1.0]))
    assert found.L1_percent == pytest.approx(100.0 * 2.0 / 8.0)
    assert found.volume_percent == pytest.approx(0.0, abs=1e-12)  # too late by a sample, and complete


def test_too_much_volume_is_positive() -> None:
    assert errors(course([0.0, 3.3, 4.4, 1.1]), course([0.0, 3.0, 4.0, 1.0])).volume_percent == pytest.approx(10.0)


def test_nothing_is_judged_by_itself() -> None:
    truth = course([0.0, 1.0, 1.0, 0.0])
    with pytest.raises(ConfigurationError, match="by itself"):
        errors(truth, truth)


def test_other_times_are_refused() -> None:
    truth = course([0.0, 1.0, 1.0, 0.0])
    with pytest.raises(ConfigurationError, match="same times"):
        errors(replace(truth, time=TIME + 1e-6), truth)
