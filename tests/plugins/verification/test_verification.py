"""Verdicts of the verification study on its comparisons, and the cases that it compares."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from commonrail.base.arguments import COUNTS
from commonrail.base.choices import Drive
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.plugins.verification import external
from commonrail.plugins.verification.external import objective_and_scores
from commonrail.plugins.verification.run import Compared, Difference, check_groups
from commonrail.plugins.verification.study import (
    AROUND,
    DWELLS,
    HORIZON,
    IDLE,
    INJECTORS,
    PAIR,
    SHORT,
    SHORT_AT,
    SHORT_TIMES,
    RateLimits,
    Task,
    VolumeLimit,
    comparisons,
)

POINT = OperatingPoint(160e6, 700e-6)
NEAR = Difference(0.05, -0.02, 0.1, -0.4)


def seen(double: Difference = NEAR, volume: float = 50e-9, gap: float = 1e-12, batch: float = 0.0) -> Compared:
    return Compared(double, None, volume, gap, batch, 1.0)


def course(injector: Injector, group: str = "group", single: str = "") -> Task:
    return Task(group, injector, POINT, single=single)


def test_a_course_is_judged_by_the_worst_of_each_figure(pwm: Injector) -> None:
    far = Difference(0.2, 0.01, -0.3, 0.1)
    checks = check_groups([course(pwm)] * 2, [seen(), seen(far)])
    assert [c.name for c in checks[:4]] == [f"group: {n}" for n in ("rate, L1", "volume", "opening", "closing")]
    assert [c.value for c in checks[:4]] == [0.2, 0.02, 0.3, 0.4]
    assert [c.limit for c in checks[:4]] == list(RateLimits())
    assert [c.passed for c in checks[:4]] == [False, True, True, True]


def test_a_needle_that_does_not_close_fails_its_group(pwm: Injector) -> None:
    checks = check_groups([course(pwm)] * 2, [seen(NEAR._replace(closing=math.nan)), seen()])
    assert [c.passed for c in checks[:4]] == [True, True, True, False]


def test_single_precision_has_a_group_of_its_own(pwm: Injector) -> None:
    far = NEAR._replace(rate=0.3)
    tasks = [course(pwm, single="f32"), course(pwm, "other")]
    checks = {c.name: c for c in check_groups(tasks, [seen()._replace(single=far), seen()])}
    assert checks["group: rate, L1"].passed
    assert not checks["f32: rate, L1"].passed
    assert len(checks) == 3 * 4 + 1


def test_a_volume_is_judged_by_the_larger_of_a_share_and_a_quantity(pwm: Injector) -> None:
    limit = VolumeLimit(0.003, 1e-11)
    assert limit.of(1e-9) == 1e-11
    assert limit.of(100e-9) == pytest.approx(3e-10)
    small = Task("short", pwm, POINT, PAIR)
    found = [seen(volume=1e-9, gap=5e-12), seen(volume=100e-9, gap=-6e-11), seen(volume=0.0, gap=0.0)]
    worst = check_groups([small] * 3, found)[0]
    assert (worst.value, worst.limit) == (pytest.approx(50.0), 100.0)
    assert re.search(r"2 inject; .*0\.005 of 1 mm³ at 160 MPa, pwm", worst.detail)


def test_nine_of_ten_short_injections_keep_the_first_limit_and_all_the_second(pwm: Injector) -> None:
    small = Task("short", pwm, POINT, SHORT)
    good, far, beyond = (seen(volume=1e-9, gap=gap) for gap in (5e-12, 2e-11, 4e-11))
    for found, passed in (([*[good] * 9, far], (True, True)), ([*[good] * 8, far, far], (False, True))):
        assert tuple(c.passed for c in check_groups([small] * 10, found)[:2]) == passed
    assert [c.passed for c in check_groups([small] * 10, [*[good] * 9, beyond])[:2]] == [True, False]
    assert [c.passed for c in check_groups([small] * 10, [*[good] * 9, seen(gap=math.nan)])[:2]] == [True, False]


@pytest.mark.parametrize("spoilt", [seen(gap=math.nan), seen(volume=math.nan)])
def test_a_failed_simulation_fails_its_group(pwm: Injector, spoilt: Compared) -> None:
    small = Task("short", pwm, POINT, SHORT)
    assert not check_groups([small] * 3, [seen(), spoilt, seen()])[0].passed


def test_a_batch_that_ends_early_is_found(pwm: Injector) -> None:
    tasks = [course(pwm, "one"), course(pwm, "other")]
    assert check_groups(tasks, [seen(), seen(batch=-5e-14)])[-1].passed
    lost = check_groups(tasks, [seen(), seen(batch=-2e-13)])[-1]
    assert not lost.passed
    assert lost.value == pytest.approx(2e-4)  # [mm³]
    assert "worst: other" in lost.detail
    assert not check_groups(tasks, [seen(), seen(batch=math.nan)])[-1].passed


@pytest.fixture(scope="module")
def tasks(pwm: Injector) -> list[Task]:
    """The whole study."""
    return comparisons(pwm)


def test_the_study_has_every_energising_time_pressure_and_drive(tasks: list[Task]) -> None:
    short = [t for t in tasks if t.group.startswith("energising time")]
    points = {(t.point.energisings, t.point.rail_pressure, t.injector.variant.drive) for t in short}
    assert points == {(e, p, d) for e in SHORT_TIMES for p in SHORT_AT for d in (Drive.PWM, Drive.REGULATED)}
    pairs = [t.point.pulses for t in tasks if t.group.startswith("pilot and main")]
    dwells = [second.start - first.start - first.duration for first, second in pairs]
    assert sorted(set(np.round(dwells, 9))) == list(DWELLS)


def test_the_study_has_traces_of_rail_inlet_and_current(tasks: list[Task]) -> None:
    rails = [t.point.rail_pressure for t in tasks if isinstance(t.point.rail_pressure, Trace)]
    assert len(rails) == 4
    assert all(max(rail.value) - min(rail.value) > 5e6 for rail in rails)  # [Pa]
    ends = [t.point.drive.time[-1] for t in tasks if t.point.drive is not None]
    assert sorted(end > HORIZON for end in ends) == [False, False, True, True]
    assert all(t.injector.variant.drive is Drive.CURRENT for t in tasks if t.point.drive is not None)


def test_the_study_has_hot_and_cold_fuel(tasks: list[Task]) -> None:
    fuels = sorted({t.injector.values[FUEL_TEMPERATURE] for t in tasks if t.group.startswith("fuel at")})
    assert fuels == [298.15, 388.15]


def test_random_injectors_differ_in_every_parameter(tasks: list[Task], pwm: Injector) -> None:
    drawn = [t.injector for t in tasks if "random injectors" in t.group]
    assert len(drawn) == INJECTORS
    for injector in drawn:
        for name, own in pwm.values.items():
            if own and not name.startswith((*IDLE, *COUNTS)):
                assert injector.values[name] != own
                assert 1.0 - AROUND <= injector.values[name] / own <= 1.0 + AROUND
            else:
                assert injector.values[name] == own


def test_the_objective_agrees_with_the_scores(pwm: Injector) -> None:
    assert [c.passed for c in objective_and_scores(pwm)] == [True, True]


def test_a_score_at_the_density_of_another_temperature_is_found(pwm: Injector, monkeypatch: pytest.MonkeyPatch) -> None:
    """Volumes of hot and cold fuel by the density of the injector's own: what a fixed density does to the search."""
    own = pwm.values[FUEL_TEMPERATURE]
    monkeypatch.setattr(
        external, "Simulator", lambda i, *rest: Simulator(i.with_values({FUEL_TEMPERATURE: own}), *rest)
    )
    assert [c.passed for c in objective_and_scores(pwm)] == [True, False]
