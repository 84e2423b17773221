"""Refinements whose starts cannot be simulated: they begin nearer the best, where they can say something of it."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.optimisers.evolution import DifferentialEvolution, EvolutionSettings
from commonrail.calibration.optimisers.polish import Refinement, RefinementSettings
from commonrail.calibration.space import Space
from tests.calibration import conformance
from tests.calibration.conformance import SPACES, answer

REACH = 0.01  # around the best [share of a range] that can be simulated; a hop is 0.06 times a normal deviate


def ends(space: Space, reach: float) -> np.ndarray:
    """Costs at the ends of four refinements of an evolution, where no more than a reach around its best can be run."""
    before = DifferentialEvolution(space, np.random.default_rng(3), EvolutionSettings(12, 40))
    conformance.run(before)
    middle = space.to_unit(before.best.x)

    def told(trials):
        far = (np.abs(space.to_unit(trials.x) - middle) > reach).any(axis=1)
        found = answer(trials)
        found[far] = np.nan
        return found

    refinement = Refinement(space, 1, RefinementSettings(4, 8), before)
    conformance.run(refinement, told)
    return refinement.end_costs


@pytest.mark.parametrize("name", ["a box", "logarithms"])
def test_a_refinement_whose_start_fails_begins_nearer_the_best(name):
    assert np.isfinite(ends(SPACES[name], REACH)).all()


def test_a_refinement_ends_although_nothing_near_the_best_can_be_simulated():
    # the best itself starts the first; the others begin elsewhere and give up after some halvings
    assert np.isfinite(ends(SPACES["a box"], 1e-9)).tolist() == [True, False, False, False]
