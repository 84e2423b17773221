"""Verdicts on searches that do not judge themselves, and the stop that a study may ask for."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.objective import Loss
from commonrail.calibration.search import LATEST, Generation, judge_population, judge_restarts, noise_in

NOISE = 2.0
COLLAPSED = 100.0 + NOISE * np.array([0.0, 0.1, 0.2, 0.4])


def history(gain: float, generations: int = 2 * LATEST) -> list[Generation]:
    """Objectives that fall to 100 by the same gain in each generation."""
    bests = 100.0 + gain * np.arange(generations, -1, -1)
    return [Generation(i, best, best) for i, best in enumerate(bests.tolist())]


def test_a_collapsed_population_that_no_longer_gains_has_converged() -> None:
    verdict = judge_population(COLLAPSED, history(0.005 * NOISE), NOISE)
    assert verdict.converged
    assert verdict.figures["spread"] == pytest.approx(0.4)
    assert verdict.figures["gain_per_generation"] == pytest.approx(0.005)
    assert verdict.sentence.startswith("converged: ")


@pytest.mark.parametrize(
    ("costs", "past"),
    [
        (COLLAPSED, history(0.02 * NOISE)),  # still gaining
        (np.append(COLLAPSED, 100.0 + 0.6 * NOISE), history(0.0)),  # not collapsed
        (COLLAPSED, history(0.0, LATEST - 1)),  # too short to tell
        (np.array([100.0, np.inf]), history(0.0)),  # one member alone
    ],
)
def test_anything_less_has_not(costs: np.ndarray, past: list[Generation]) -> None:
    verdict = judge_population(costs, past, NOISE)
    assert not verdict.converged
    assert verdict.sentence.startswith("not converged: ")


def test_a_search_that_ends_with_one_point_is_told_so() -> None:
    """Not that its members failed: a staged search ends with its finalists, of which there may be one."""
    verdict = judge_population(np.array([100.0]), history(0.0), NOISE)
    assert not verdict.converged
    assert "one point" in verdict.sentence
    assert "simulated" in judge_population(np.array([100.0, np.inf]), history(0.0), NOISE).sentence


def test_three_refinements_within_half_a_unit_agree() -> None:
    ends = 100.0 + NOISE * np.array([0.0, 5.0, 0.3, 0.4])
    assert judge_restarts(ends, NOISE).converged
    assert not judge_restarts(ends[:3], NOISE).converged


def test_a_unit_of_2_ln_l_is_a_share_of_the_objective() -> None:
    # n Gaussian errors of unknown size: 2 ln L changes by n dS/S; Laplacian ones: by 2 n dJ/J
    assert noise_in(50.0, 105, 5, (Loss.SQUARES, ())) == pytest.approx(0.5)
