"""Rows of methods: time beside error, and ratios that follow the times."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy import Errors, Truth
from benchmarks.methods import Counted, Method, measure_methods, own_methods, peer_methods
from benchmarks.timing import Effort
from tests.benchmarks.conftest import HandClock
from tests.benchmarks.test_accuracy import course

EFFORT = Effort(2, 100.0)
TRUTH = Truth(course([0.0, 3.0, 4.0, 1.0]), Errors(0.0, 0.0))


def fake(clock: HandClock, name: str, seconds: float, simulations: int = 1) -> Method:
    """A method that lasts as told and is five per cent wrong."""
    found = replace(TRUTH.solution, mass_rate=1.05 * TRUTH.solution.mass_rate)
    timed = (lambda: clock.pass_by(seconds)) if simulations > 1 else None

    def run() -> Counted:
        clock.pass_by(seconds)
        return Counted(found, 7)

    return Method(name, "fake", run, timed, simulations)


def test_a_slower_method_is_reported_slower(clock: HandClock) -> None:
    methods = [fake(clock, "fast", 1.0), fake(clock, "slow", 40.0)]
    fast, slow = measure_methods(methods, TRUTH, EFFORT, clock.clocks)
    assert (fast["times_the_first"], slow["times_the_first"]) == (1.0, 40.0)
    assert (slow["seconds"], slow["cpu_seconds"], slow["runs"], slow["evaluations"]) == (40.0, 20.0, 2, 7)


def test_a_population_is_shared_among_its_simulations(clock: HandClock) -> None:
    rows = list(measure_methods([fake(clock, "many", 8.0, 4), fake(clock, "one", 8.0)], TRUTH, EFFORT, clock.clocks))
    assert [row["seconds"] for row in rows] == [2.0, 8.0]
    assert rows[1]["times_the_first"] == 4.0


def test_errors_stand_beside_times(clock: HandClock) -> None:
    (row,) = measure_methods([fake(clock, "one", 1.0)], TRUTH, EFFORT, clock.clocks)
    assert row["L1_percent"] == pytest.approx(5.0)


def test_the_lanes_come_first_and_every_name_is_another() -> None:
    methods = own_methods(quick=False) + peer_methods()
    assert methods[0].timed is not None
    assert methods[0].simulations > 1
    assert len({method.name for method in methods}) == len(methods)


def test_both_parts_of_the_lanes_solve_the_same_problem() -> None:
    full = own_methods(quick=True)[0]
    assert np.all(np.isfinite(full.run().solution.mass_rate))
