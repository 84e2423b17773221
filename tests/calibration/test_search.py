"""The loop of a search: what may be simulated is, and every trial is answered in its place."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from commonrail.base import hooks
from commonrail.base.hooks import StopRequest
from commonrail.calibration import search
from commonrail.calibration.objective import Objective, Scores
from commonrail.calibration.optimisers.evolution import (
    DifferentialEvolution,
    EvolutionSettings,
    InitialSampling,
    Treatment,
)
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.search import NOT_SIMULATED, Listeners, Progress, Search, steps
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method
from commonrail.engine.status import Status

SPACE = Space(
    [Parameter(n, x, 0.0, 1.0, "1", mark="E", source="test") for n, x in {"a": 0.3, "b": 0.6}.items()], ["a < b"]
)


class Feasible:
    """An objective that refuses points outside the space; some of the others fail."""

    def costs(self, values: np.ndarray) -> Scores:
        assert SPACE.satisfies(values).all()
        failed = values[:, 0] > 0.4
        costs = np.where(failed, np.inf, values.sum(axis=1))
        return Scores(costs, np.where(failed, Status.RAN_AWAY, Status.OK).astype(np.int8), 3 * len(values))


@pytest.mark.parametrize("initial", list(InitialSampling))
@pytest.mark.parametrize("treatment", [Treatment.REJECT, Treatment.REPAIR])
def test_every_trial_is_answered_in_its_place(treatment: Treatment, initial: InitialSampling) -> None:
    settings = EvolutionSettings(12, 8, treatment=treatment, initial=initial)
    optimiser = DifferentialEvolution(SPACE, np.random.default_rng(4), settings)
    some, seen = False, 0
    for evolved in steps(optimiser, cast(Objective, Feasible())):
        inside = SPACE.satisfies(evolved.x)
        some = some or not inside.all()
        seen += evolved.simulations
        assert evolved.simulations == 3 * inside.sum()
        expected = np.where(evolved.x[:, 0] > 0.4, Status.RAN_AWAY, Status.OK)
        np.testing.assert_array_equal(evolved.statuses, np.where(inside, expected, NOT_SIMULATED))
        good = evolved.statuses == Status.OK
        np.testing.assert_array_equal(evolved.costs, np.where(good, evolved.x.sum(axis=1), np.inf))
    assert some == (treatment is Treatment.REJECT)
    assert optimiser.counts.slots == 12 * 9
    assert 3 * optimiser.counts.simulated == seen


def test_the_time_of_a_search_is_without_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rates of simulation are taken to it: a first generation of one second would seem to take a hundred."""
    clock = SimpleNamespace(now=0.0, perf_counter=lambda: clock.now)
    monkeypatch.setattr(search, "time", clock)
    monkeypatch.setattr(hooks, "time", clock)

    class Compiled(Feasible):
        statuses = Status

        def costs(self, values: np.ndarray) -> Scores:
            if clock.now == 0.0:
                with hooks.compiling():
                    clock.now += 99.0
            clock.now += 1.0
            return super().costs(values)

    told: list[Progress] = []
    method = Method(EvolutionSettings(12, 3, treatment=Treatment.REPAIR), polish=0, stop_when_converged=False)
    study = SimpleNamespace(space=SPACE, method=method, seed=4, title="a search")
    listeners = Listeners(told.append, None, StopRequest())
    Search(cast(Any, study), cast(Any, Compiled()), None, listeners)._run()
    assert [p.seconds for p in told] == [1.0, 2.0, 3.0, 4.0]
