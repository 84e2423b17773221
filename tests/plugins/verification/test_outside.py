"""Figures of a program outside the project."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import Status
from commonrail.plugins.paper.bench import PAPER_OPTIMUM
from commonrail.plugins.verification.external import (
    INTERVAL,
    Gaps,
    Run,
    by_lanes,
    by_reference,
    check_gaps,
    gaps,
    load_outside,
)

RUNS = load_outside()
NEAR = Gaps(0.01, None, 0.01)


def test_the_table_is_whole() -> None:
    assert len(RUNS) == 11
    assert sum(run.rate is not None for run in RUNS) == 3
    stiff = [run.injector.values["plunger_needle.k1"] == PAPER_OPTIMUM["plunger_needle.k1"] for run in RUNS]
    assert sum(stiff) == 6
    assert [run.point.duration for run in RUNS] == pytest.approx([1.56e-3] * 11)


@pytest.mark.parametrize("run", [run for run in RUNS if run.rate is not None])
def test_a_rate_adds_up_to_the_volume_beside_it(run: Run) -> None:
    assert run.rate is not None
    # six digits of volume, six of each of 520 samples
    assert np.sum(run.rate) * INTERVAL == pytest.approx(run.volume, rel=1e-4)


def test_the_limits_are_those_of_the_energising_time() -> None:
    injector, point = RUNS[0].injector, RUNS[0].point
    long, edge, short = (
        replace(RUNS[0], injector=injector, point=replace(point, energisings=time)) for time in (700e-6, 400e-6, 320e-6)
    )
    wide = Gaps(0.2, 0.9, 0.01)
    checks = {c.name.split("lanes, ")[1]: c for c in check_gaps("lanes", (long, edge, short), (NEAR, wide, wide))}
    assert {name: (c.value, c.limit, c.passed) for name, c in checks.items()} == {
        "volume, from 400 us": (0.2, 0.1, False),
        "rate, L1, from 400 us": (0.9, 0.4, False),
        "volume, short injections": (0.2, 0.3, True),
        "rate, L1, short injections": (0.9, 1.0, True),
        "opening": (0.01, 0.3, True),
    }


def test_a_simulation_that_failed_is_no_agreement() -> None:
    run = RUNS[0]
    solution = simulate(run.injector, run.point, sample_interval=INTERVAL)
    near, failed = gaps(run, solution), gaps(run, replace(solution, status=Status.STEP_UNSTABLE))
    other = by_lanes(RUNS[6])
    assert all(c.passed for c in check_gaps("lanes", [run, RUNS[6]], [near, other]))
    passed = [c.passed for c in check_gaps("lanes", [run, RUNS[6]], [failed, other])]
    assert passed == [False, False, True, True, False]


@pytest.mark.parametrize("engine", [by_lanes, by_reference])
def test_engines_reproduce_the_figures(engine: object) -> None:
    """The fast engine all eleven; the reference, slow, one of each length."""
    assert callable(engine)
    runs = RUNS if engine is by_lanes else (RUNS[0], RUNS[6])
    for one in check_gaps("engine", runs, [engine(run) for run in runs]):
        assert one.passed, f"{one.name}: {one.value:g} {one.unit}, limit {one.limit:g}"


def test_another_injector_would_not_reproduce_them() -> None:
    """The limits tell the paper's two sets of stiffness apart."""
    run = RUNS[0]
    swapped = replace(run, injector=RUNS[3].injector, point=OperatingPoint(160e6, 700e-6, horizon=1.56e-3))
    assert abs(by_lanes(swapped).volume) > 1.0  # [%]
