"""Other solvers find the same injection on the same equations."""

from __future__ import annotations

from typing import get_args

import pytest

from benchmarks.accuracy import errors
from benchmarks.case import INTERVAL, injector
from benchmarks.methods import COARSE, Counted
from benchmarks.solvers import CvodeModel, PeerModel, ScipyMethod, ScipyModel, solve_with
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status

# A short injection with the PWM's switchings, an opening and a closing.
SHORT = OperatingPoint(160e6, 300e-6, horizon=1.2e-3)
# [%] Wider than what any of them does at rtol 1e-5 here, 0.3; switchings that are missed cost 8.
ROOM = 1.0


@pytest.fixture(scope="module")
def truth() -> Solution:
    """By the explicit march, which none of the peers is."""
    return simulate_reference(injector(), SHORT, INTERVAL, Resolution((60, 30), method="explicit"))


def judge(model: PeerModel, truth: Solution) -> Counted:
    """Simulate and compare."""
    found = solve_with(model, INTERVAL)
    wrong = errors(found.solution, truth)
    assert wrong.L1_percent < ROOM
    assert abs(wrong.volume_percent) < ROOM
    assert truth.status is found.solution.status is Status.OK
    assert found.solution.opening == pytest.approx(truth.opening, abs=2e-6)
    assert found.solution.closing == pytest.approx(truth.closing, abs=2e-6)
    return found


FIRST, *OTHERS = get_args(ScipyMethod)


@pytest.mark.parametrize("method", [FIRST, *(pytest.param(other, marks=pytest.mark.slow) for other in OTHERS)])
def test_scipy_finds_the_same_injection(method: ScipyMethod, truth: Solution) -> None:
    found = judge(ScipyModel(injector(), SHORT, COARSE._replace(relative=1e-5), method), truth)
    assert found.evaluations > 1000  # 1.2 ms with waves in sixty cells


def test_sundials_finds_the_same_injection(truth: Solution) -> None:
    pytest.importorskip("sksundae", reason="scikit-sundae is an extra")
    assert judge(CvodeModel(injector(), SHORT, COARSE._replace(relative=1e-5)), truth).evaluations > 1000
