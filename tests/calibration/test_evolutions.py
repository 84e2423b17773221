"""L-SHADE, CMA-ES and Nelder–Mead on problems whose minimum is known."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.calibration.optimisers.base import Optimiser
from commonrail.calibration.optimisers.library import (
    CovarianceSettings,
    CovarianceStrategy,
    NelderMead,
    NelderMeadSettings,
    SuccessHistoryEvolution,
    SuccessHistorySettings,
)
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space

Floats = np.ndarray

D = 4
CENTRE = np.array([0.35, 0.45, 0.5, 0.7])
AXES = np.linalg.qr(np.random.default_rng(8).normal(size=(D, D)))[0]
CURVATURE = np.array([1.0, 10.0, 100.0, 1000.0])


def space(*constraints: str) -> Space:
    return Space(
        [Parameter(n, 0.2 + 0.1 * i, 0.0, 1.0, "1", mark="E", source="test") for i, n in enumerate("abcd")], constraints
    )


def slanted(x: Floats) -> Floats:
    """A valley of condition 1000 that lies along no axis; its minimum is 0 at `CENTRE`."""
    return np.sum(CURVATURE * ((x - CENTRE) @ AXES) ** 2, axis=1)


def run(search: Optimiser) -> Optimiser:
    while not search.finished:
        search.tell(slanted(search.ask().x))
    return search


def searches(box: Space, seed: int) -> list[Optimiser]:
    rng = np.random.default_rng(seed)
    return [
        SuccessHistoryEvolution(box, rng, SuccessHistorySettings(60, 150, 150)),
        CovarianceStrategy(box, rng, CovarianceSettings(12, 150)),
        NelderMead(box, rng, NelderMeadSettings(32, 250, 2)),
    ]


@pytest.mark.parametrize("number", range(3))
@pytest.mark.parametrize("seed", [1, 2])
def test_a_slanted_valley_is_followed_to_its_end(number: int, seed: int) -> None:
    search = run(searches(space(), seed)[number])
    # without adaptation to the valley what is left is above 1e-3: uniform draws in the box have a median near 100
    assert search.best.cost < 1e-6
    np.testing.assert_allclose(search.best.x, CENTRE, atol=1e-3)  # the flattest curvature is 1


@pytest.mark.parametrize("number", range(3))
def test_with_an_ordering_the_minimum_lies_on_it(number: int) -> None:
    box = space("d < a")  # which the free minimum breaks
    search = run(searches(box, 3)[number])
    # on d = a, by the normal equations of the quadratic in (a, b, c)
    basis = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 0]])
    hessian = AXES @ np.diag(CURVATURE) @ AXES.T
    x = basis @ np.linalg.solve(basis.T @ hessian @ basis, basis.T @ hessian @ CENTRE)
    least = slanted(x[None, :])[0]
    assert box.satisfies(search.best.x)
    assert least <= search.best.cost + 1e-9
    # Nelder–Mead may stall on a face: it is the baseline, and nothing more is claimed of it
    if number < 2:
        assert search.best.cost < 1.02 * least


def test_the_population_shrinks_as_stated_and_no_slower_where_more_is_wanted() -> None:
    search = SuccessHistoryEvolution(space(), np.random.default_rng(1), SuccessHistorySettings(20, 12, 8))
    sizes = []
    while not search.finished:
        trials = search.ask()
        sizes.append(len(trials.x))
        search.tell(slanted(trials.x))
    assert sizes == [20, 20, *(round(20 - 2 * k) for k in range(1, 8)), 4, 4, 4, 4]


def test_the_covariance_becomes_that_of_the_valley() -> None:
    search = CovarianceStrategy(space(), np.random.default_rng(2), CovarianceSettings(12, 80))
    run(search)
    covariance = search.state()["covariance"]
    spread = np.diag(AXES.T @ covariance @ AXES)
    # in the valley's axes the variances are as 1/curvature, 1000 to 1, up to the scatter of 12 draws a generation
    assert 200.0 < spread[0] / spread[3] < 5000.0
