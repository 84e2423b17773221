"""The fast engine against the reference, which shares its laws and none of its scheme."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.choices import Drive
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, simulate_reference
from commonrail.engine.simulate import simulate
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.plugins.paper.bench import PAPER_OPTIMUM
from commonrail.plugins.verification.run import Compared, check_groups, compare, difference, verify
from commonrail.plugins.verification.study import ENERGISING, HORIZON, RateLimits, Task, comparisons
from commonrail.readers.injector import load_injector

QUICK = range(16)  # two stiffnesses × two pressures, rigid body, rail volume, four random, four traces, two short
# Kernels that no other test needs: measured current, the explicit method with regulated drive. The rigid body's stays:
# nothing else here compares it with the reference.
ALONE = (12, 13, 15)
KEPT = 0.25  # margin that every check leaves to its limit

Found = Callable[[int], tuple[Task, Compared]]


@pytest.fixture(scope="module")
def found(pwm: Injector) -> Found:
    """A comparison of the quick study and what it found, made once."""
    tasks = comparisons(pwm, quick=True)
    assert len(tasks) == len(QUICK)
    return functools.cache(lambda index: (tasks[index], compare(tasks[index])))


@pytest.mark.parametrize("index", [pytest.param(i, marks=pytest.mark.slow) if i in ALONE else i for i in QUICK])
def test_engines_agree(found: Found, index: int) -> None:
    task, one = found(index)
    checks = check_groups([task], [one])
    course = isinstance(task.limits, RateLimits)
    assert len(checks) == (1 + len(task.limits) if not course else 9 if task.single else 5)
    for line in checks:
        assert line.margin >= KEPT, f"{line.name}: {line.value:g} {line.unit}, limit {line.limit:g}; {line.detail}"


def test_single_precision_is_compared_in_single_precision(found: Found) -> None:
    _, one = found(0)
    assert one.single is not None
    assert one.single != one.double
    # rounding hides in the error of the step: 0.003 % of the rate was the most seen at these pressures
    assert one.single.rate == pytest.approx(one.double.rate, abs=0.01)


def test_engines_differ_where_the_injector_does(pwm: Injector) -> None:
    """The comparison can see a stiffness: the paper's optimum is no rounding away from its theory."""
    point = OperatingPoint(160e6, ENERGISING, horizon=HORIZON)
    one, other = (simulate(i, point, sample_interval=3e-6) for i in (pwm, pwm.with_values(PAPER_OPTIMUM)))
    assert difference(one, other).rate > 1.0  # [%]
    assert difference(one, one) == (0.0, 0.0, 0.0, 0.0)


def test_engines_agree_where_the_return_line_cavitates() -> None:
    """The wave of the first injection comes back to the valve while the second one is injected."""
    injector = load_injector("crin")
    point = OperatingPoint(160e6, ((0.0, 250e-6), (1150e-6, 500e-6)))
    fast = simulate(injector, point, time_step=2.5e-7)
    exact = simulate_reference(injector, point, 3e-6, Resolution(method="explicit"))
    assert fast.channels["return_pressure"].min() < 1e3  # [Pa]
    # 0.01 % at this step; the limit is that of two injections in `commonrail lab verify`
    assert fast.injected_volume == pytest.approx(exact.injected_volume, rel=3e-3)


def test_a_solution_that_failed_agrees_with_nothing(pwm: Injector) -> None:
    solution = simulate(pwm, OperatingPoint(160e6, 250e-6, horizon=900e-6), sample_interval=3e-6)
    for status in (Status.STEP_UNSTABLE, Status.STILL_INJECTING):
        spoilt = replace(solution, status=status)
        assert np.isnan(difference(spoilt, solution)).all()
        assert np.isnan(difference(solution, spoilt)).all()


@pytest.mark.slow  # both engines compile this wiring for it alone
def test_engines_agree_where_the_current_free_wheels(regulated: Injector) -> None:
    wheeling = replace(regulated, variant=regulated.variant._replace(drive=Drive.FREE_WHEEL))
    point = OperatingPoint(60e6, 700e-6, horizon=2.7e-3)
    lanes, reference = (simulate(wheeling, point, engine, sample_interval=3e-6) for engine in ("lanes", "reference"))
    found = difference(lanes, reference)
    # the limits of main injections in `commonrail lab verify`
    assert abs(found.rate) < 0.1  # L1 [%]
    assert abs(found.volume) < 0.05  # [%]
    assert abs(found.opening) < 0.5  # [us]
    # twice the limit there: the current decays slowly, and the needle closes a millisecond later than a quenched one;
    # 0.71 us were seen, which do not fall with the step of the lanes
    assert abs(found.closing) < 1.0  # [us]
    assert lanes.closing - simulate(regulated, point).closing > 100e-6


@pytest.mark.slow
def test_the_whole_verification_study_passes(pwm: Injector) -> None:
    checks = verify(pwm)
    failed = [one for one in checks if not one.passed]
    assert not failed, "\n".join(f"{one.name}: {one.value:g} {one.unit}, limit {one.limit:g}" for one in failed)
    assert len(checks) > 20
    assert all(np.isfinite(one.value) for one in checks)
