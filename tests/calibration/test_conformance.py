"""Every optimiser keeps what all promise, and the checks notice each broken promise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from commonrail.calibration.optimisers import registry
from commonrail.calibration.optimisers.base import Best, Optimiser, Registered, Trials
from commonrail.calibration.optimisers.evolution import DifferentialEvolution, EvolutionSettings, Treatment
from commonrail.calibration.optimisers.polish import Refinement, RefinementSettings
from commonrail.calibration.optimisers.registry import REGISTERED
from commonrail.calibration.optimisers.staged import REGISTERED as STAGED
from commonrail.calibration.space import Space
from tests.calibration import conformance
from tests.calibration.conformance import CHECKS, SPACES, Case
from tests.calibration.guessing import GUESSING, Guessing, GuessingSettings


def named(entry: Registered, space: Space, **settings: Any) -> Case:
    """A registered optimiser, with settings that are not its own."""

    def make(seed: int, steps: int) -> Optimiser:
        chosen = entry.settings(members=6, generations=steps, **settings)
        return entry.begin(space, np.random.default_rng(seed), chosen)  # type: ignore[no-any-return]

    return Case(" ".join([entry.name, *map(str, settings.values())]), space, make)


def refinement(space: Space) -> Case:
    """Refinements after a short evolution."""
    before = DifferentialEvolution(space, np.random.default_rng(3), EvolutionSettings(8, 1))
    conformance.run(before)
    return Case("refinement", space, lambda seed, steps: Refinement(space, seed, RefinementSettings(steps, 3), before))


SHIPPED = [entry for name in registry.shipped_methods() if (entry := registry.find_optimiser(name))]
CASES = [
    case
    for space in SPACES.values()
    for case in (
        *(named(entry, space) for entry in (*SHIPPED, GUESSING)),
        named(STAGED, space, inversions=2, starts=3, trial_iterations=1, finalists=2),
        *(named(REGISTERED[0], space, treatment=treatment) for treatment in (Treatment.REJECT, Treatment.RESAMPLE)),
        refinement(space),
    )
]
NAMES = [f"{case.name} in {name}" for name in SPACES for case in CASES[: len(CASES) // len(SPACES)]]
# a study does not ask for more refinements of a finished run, only for more generations
NOT_PROMISED = {("refinement", conformance.more_steps_make_a_longer_search)}


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize("case", CASES, ids=NAMES)
def test_an_optimiser_keeps_its_promises(case: Case, check: Callable[[Case], None]) -> None:
    if (case.name, check) not in NOT_PROMISED:
        check(case)


class Outside(Guessing):
    """Proposes points beyond the bounds."""

    def guesses(self) -> np.ndarray:
        return super().guesses() + self.space.upper


class Common(Guessing):
    """Draws from the generator that the whole process shares."""

    def guesses(self) -> np.ndarray:
        x = super().guesses()
        share = np.random.random((len(x), 1))  # noqa: NPY002
        return x + share * (self.space.centre - x)


class Reseeded(Guessing):
    """Draws anew what was drawn before it was restored."""

    def _restore(self, state: Mapping[str, Any]) -> None:
        super()._restore(state)
        self._rng = np.random.default_rng(1)


class Forgetful(Guessing):
    """Does not keep its best."""

    def _restore(self, state: Mapping[str, Any]) -> None:
        super()._restore(state)
        self.best = Best(self.space.centre, np.inf)


class Credulous(Guessing):
    """Takes a failure for the best there is."""

    def take(self, x: np.ndarray, costs: np.ndarray) -> None:
        super().take(x, np.where(np.isfinite(costs), costs, 0.0))


class Stubborn(Guessing):
    """Stays finished."""

    def _restore(self, state: Mapping[str, Any]) -> None:
        super()._restore(state)
        self.settings = GuessingSettings(self.settings.members, self.steps - 1)


class Fickle(Guessing):
    """Takes the last step's best for the best of all."""

    def take(self, x: np.ndarray, costs: np.ndarray) -> None:
        self.best = Best(self.best.x, np.inf)
        super().take(x, costs)


class Silent(Guessing):
    """Does not say why it has ended."""

    ended = ""


class Impatient(Guessing):
    """Asks something else before it is answered."""

    def ask(self) -> Trials:
        self._asked = None
        return super().ask()


class Trusting(Guessing):
    """Takes any state for its own."""

    def _origin(self) -> dict[str, Any]:
        return {}


BROKEN = {
    Outside: conformance.what_is_simulated_keeps_to_the_space,
    Common: conformance.the_seed_decides,
    Reseeded: conformance.it_goes_on_from_any_step,
    Forgetful: conformance.it_goes_on_from_any_step,
    Credulous: conformance.it_survives_failures,
    Stubborn: conformance.more_steps_make_a_longer_search,
    Fickle: conformance.the_best_never_rises,
    Silent: conformance.it_says_why_it_has_ended,
    Impatient: conformance.a_question_stands_until_it_is_answered,
    Trusting: conformance.another_search_s_state_is_refused,
}


@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_promise_is_noticed(broken: type[Guessing]) -> None:
    case = named(Registered(broken, GuessingSettings), SPACES["an ordering"])
    with pytest.raises((AssertionError, pytest.fail.Exception, KeyError)):
        BROKEN[broken](case)
