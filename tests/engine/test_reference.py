"""The reference engine on its own: books, resolution, crossing instants, guide friction."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.analysis.verification import difference
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.injector.definition import Injector
from commonrail.injector.joints import CLEAR_LIFT

POINT = OperatingPoint(120e6, 400e-6, horizon=1.3e-3)


@pytest.fixture(scope="module")
def fine(regulated: Injector) -> Solution:
    return simulate_reference(regulated, POINT)


def test_books_balance(fine: Solution) -> None:
    assert fine.status is Status.OK
    # LSODA at 1e-8 on each mass, of which some 100 times the injected are in the pipe; the return line is left out
    assert abs(fine.balance) < 1e-5


def test_instants_are_where_the_needle_clears_and_meets_its_seat(fine: Solution) -> None:
    lift, time = fine.channels["needle_lift"], fine.time
    clear = np.flatnonzero((lift[:-1] <= CLEAR_LIFT) & (lift[1:] > CLEAR_LIFT))[0]
    assert time[clear] <= fine.opening <= time[clear + 1]
    last = np.flatnonzero(lift > CLEAR_LIFT)[-1]
    meets = last + np.flatnonzero(lift[last:] <= 0.0)[0]
    # between two samples, or in the one before if the needle bounced within it
    assert time[meets - 1] <= fine.closing <= time[meets]


def test_it_has_converged(regulated: Injector, fine: Solution) -> None:
    coarse = simulate_reference(regulated, POINT, resolution=Resolution((160, 80), 1e-7))
    found = difference(coarse, fine)
    # a tenth of what the lanes are judged by
    assert found.rate < 0.02  # [%]
    assert abs(found.volume) < 0.01  # [%]


def test_guide_friction_delays_the_needle(regulated: Injector, fine: Solution) -> None:
    friction = np.full((9, 2), (2.0, 1.0))
    rubbed = simulate_reference(regulated, POINT, friction=friction)
    assert rubbed.opening > fine.opening
    assert rubbed.injected_mass < fine.injected_mass
