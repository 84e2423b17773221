"""Promises of every optimiser, as checks to which any can be put; each fails if one is broken."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.calibration.constraints import parse_products
from commonrail.calibration.optimisers.base import Optimiser, Question, Trials
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.runs.tables import pack, unpack

__all__ = ["CHECKS", "SPACES", "Case", "answer"]

STEPS = 5

Scale = Literal["linear", "log"]


def _space(start: float, upper: float, names: str, *constraints: str, scale: Scale = "linear") -> Space:
    parameters = [
        Parameter(name, start + 0.1 * i, 0.1, upper, "1", mark="E", source="test", scale=scale)
        for i, name in enumerate(names)
    ]
    return Space(parameters, constraints)


SPACES = {
    "a box": _space(0.5, 2.0, "abc"),
    "an ordering": _space(0.5, 2.0, "ab", "a < b"),
    "logarithms": _space(1.0, 50.0, "ab", scale="log"),
    "a product": replace(_space(0.5, 2.0, "ab"), products=parse_products(["a >= 1.4 * b^2"], "ab", {})),
}


class Case(NamedTuple):
    """An optimiser to be put to the checks: its name, its space, and one anew from a seed and a number of steps."""

    name: str
    space: Space
    make: Callable[[int, int], Optimiser]


Answer = Callable[[Trials], np.ndarray]


def residuals(x: np.ndarray) -> np.ndarray:
    """Residuals (n, 2 d) with their minimum at 0.7 of everything."""
    return np.hstack([x - 0.7, 0.3 * (x - 0.7) ** 2])


def costs(x: np.ndarray) -> np.ndarray:
    """Half the sum of their squares (n,)."""
    return np.asarray(0.5 * (residuals(x) ** 2).sum(axis=1))


def answer(trials: Trials) -> np.ndarray:
    """Usual answers; those for trials that are not simulated would win if they counted."""
    if trials.question in (Question.RESIDUALS, Question.SCREENED):
        return residuals(trials.x)
    return np.where(trials.simulate, costs(trials.x), -1.0)


def all_fail(trials: Trials) -> np.ndarray:
    """Answers to trials of which none can be simulated."""
    return np.full_like(answer(trials), np.nan)


def best_fail(trials: Trials) -> np.ndarray:
    """Answers where the simulation fails around the minimum."""
    told = answer(trials)
    told[np.abs(trials.x[:, 0] - 0.7) < 0.1] = -np.inf
    return told


def conversation(optimiser: Optimiser, told: Answer = answer, steps: int = 10**6) -> Iterator[Trials]:
    """Questions of an optimiser until so many steps are done."""
    until = optimiser.steps + steps
    while optimiser.steps < until and not optimiser.finished:
        trials = optimiser.ask()
        optimiser.tell(told(trials))
        yield trials


def run(optimiser: Optimiser, told: Answer = answer, steps: int = 10**6) -> list[tuple[bytes, bytes, Question]]:
    """Bits of all questions of an optimiser until so many steps are done."""
    return [(t.x.tobytes(), t.simulate.tobytes(), t.question) for t in conversation(optimiser, told, steps)]


def kept(state: dict[str, Any]) -> dict[str, Any]:
    """A state after its way through the journal."""
    return unpack(*pack(state))


def what_is_simulated_keeps_to_the_space(case: Case) -> None:
    """Bounds and constraints hold."""
    for told in (answer, best_fail):
        for trials in conversation(case.make(1, STEPS), told):
            inside = case.space.satisfies(trials.x)
            if trials.question is Question.RESIDUALS:  # a solver may look beyond a constraint, never beyond a bound
                slack = 1e-12 * (case.space.upper - case.space.lower)
                inside = ((trials.x >= case.space.lower - slack) & (trials.x <= case.space.upper + slack)).all(axis=1)
            assert inside[trials.simulate].all()


def the_seed_decides(case: Case) -> None:
    """The same seed gives the same bits, another one others, whatever else draws random numbers."""
    first = run(case.make(1, STEPS))
    assert first == run(case.make(1, STEPS))
    assert first != run(case.make(2, STEPS))


def it_goes_on_from_any_step(case: Case) -> None:
    """Kept and restored after any step, and in the midst of the next one, it asks for what it would have asked for."""
    whole, asked = case.make(1, STEPS), []
    while not whole.finished:
        asked.append(run(whole, steps=1))
    assert len(asked) == whole.total
    walker = case.make(1, STEPS)
    for done in range(whole.total):
        counted = (walker.steps, walker.counts)
        for midway in (False, True):
            if midway:
                walker.ask()
            second = case.make(2, STEPS)
            second.restore(kept(walker.state()))
            assert (second.steps, second.counts) == counted
            assert run(second) == [question for step in asked[done:] for question in step]
            assert second.best.x.tobytes() == whole.best.x.tobytes()
            assert second.best.cost == whole.best.cost
        assert run(walker, steps=1) == asked[done]


def it_survives_failures(case: Case) -> None:
    """It comes to its end though nothing can be simulated, or not where it is best, and no failure is its best."""
    hopeless = case.make(1, STEPS)
    was = hopeless.best.cost
    run(hopeless, all_fail)
    assert hopeless.finished
    assert hopeless.best.cost == was
    assert case.space.satisfies(hopeless.best.x)
    patchy = case.make(1, STEPS)
    was = patchy.best.cost
    run(patchy, best_fail)
    found = patchy.best
    assert np.isfinite(found.cost)
    assert found.cost == pytest.approx(costs(found.x[None, :])[0])
    assert found.cost == was or abs(found.x[0] - 0.7) >= 0.1
    assert not np.isnan(patchy.costs).any()


def more_steps_make_a_longer_search(case: Case) -> None:
    """A finished search that is given more steps ends as one that had them from the beginning."""
    short, longer, whole = case.make(1, STEPS), case.make(1, STEPS + 3), case.make(1, STEPS + 3)
    run(short)
    longer.restore(kept(short.state()))
    if short.steps < 1 + STEPS:  # it had come to its end by itself
        assert (longer.finished, longer.reason) == (True, short.reason)
        return
    assert not longer.finished
    assert longer.reason == ""
    asked = run(longer)
    assert asked
    assert run(whole)[-len(asked) :] == asked
    assert longer.best.x.tobytes() == whole.best.x.tobytes()


def the_best_never_rises(case: Case) -> None:
    """The best is feasible, its cost is its own, and the next one costs less or as much."""
    optimiser = case.make(1, STEPS)
    before = np.inf
    while not optimiser.finished:
        run(optimiser, steps=1)
        best = optimiser.best
        assert best.cost <= before
        assert case.space.satisfies(best.x)
        assert best.cost == pytest.approx(costs(best.x[None, :])[0], rel=1e-9)
        assert len(optimiser.population) == len(optimiser.costs)
        before = best.cost
    assert np.isfinite(before)


def it_says_why_it_has_ended(case: Case) -> None:
    """A reason is there at the end and no sooner, and nothing can be asked for any more."""
    optimiser = case.make(1, STEPS)
    assert optimiser.phase
    while not optimiser.finished:
        assert optimiser.reason == ""
        before = optimiser.steps
        run(optimiser, steps=1)
        assert optimiser.steps == before + 1
    assert optimiser.reason
    assert optimiser.steps == optimiser.total
    with pytest.raises(StudyError, match="finished"):
        optimiser.ask()


def a_question_stands_until_it_is_answered(case: Case) -> None:
    """Whoever asks may change the trials; the next question is the same until it is answered, once."""
    optimiser = case.make(1, STEPS)
    with pytest.raises(StudyError, match="ask first"):
        optimiser.tell([])
    trials = optimiser.ask()
    x = trials.x.copy()
    trials.x[:] = np.nan
    assert optimiser.ask().x.tobytes() == x.tobytes()
    with pytest.raises(StudyError, match="expected one"):
        optimiser.tell(answer(trials)[:-1])
    assert optimiser.ask().x.tobytes() == x.tobytes()


def another_search_s_state_is_refused(case: Case) -> None:
    """A state of other bounds, of another optimiser, or one that is not whole."""
    optimiser = case.make(1, STEPS)
    run(optimiser, steps=2)
    state = kept(optimiser.state())
    for change in ({"upper": state["upper"] * 2.0}, {"method": "none of these"}, {"names": ["x"]}, {"steps": -1}):
        with pytest.raises(ConfigurationError, match="state: "):
            case.make(1, STEPS).restore(state | change)
    for key in set(state):
        with pytest.raises((ConfigurationError, LookupError)):
            case.make(1, STEPS).restore({name: value for name, value in state.items() if name != key})


CHECKS = (
    what_is_simulated_keeps_to_the_space,
    the_seed_decides,
    it_goes_on_from_any_step,
    it_survives_failures,
    more_steps_make_a_longer_search,
    the_best_never_rises,
    it_says_why_it_has_ended,
    a_question_stands_until_it_is_answered,
    another_search_s_state_is_refused,
)
