"""R-hat and effective sizes against ArviZ, and on chains whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.analysis.posterior.convergence import effective_size, r_hat


def autoregressive(phi: float, chains: int = 6, steps: int = 500, seed: int = 1) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal((chains, steps))
    found = np.zeros_like(noise)
    found[:, 0] = noise[:, 0]
    for t in range(1, steps):
        found[:, t] = phi * found[:, t - 1] + np.sqrt(1.0 - phi**2) * noise[:, t]
    return found


@pytest.mark.parametrize("phi", [-0.3, 0.0, 0.5, 0.95])
def test_figures_are_those_of_arviz(phi: float) -> None:
    from arviz_stats.base import array_stats

    draws = autoregressive(phi)
    assert r_hat(draws) == pytest.approx(float(array_stats.rhat(draws)), rel=1e-9)
    theirs = min(float(array_stats.ess(draws, method=m, prob=p)) for m, p in (("bulk", None), ("tail", (0.05, 0.95))))
    # of the many ways to end Geyer's sequence of pairs theirs adds the last even correlation
    assert effective_size(draws) == pytest.approx(theirs, rel=0.03)


def test_effective_size_of_an_autoregression() -> None:
    """n (1 − φ)/(1 + φ) of n draws, in its bulk."""
    draws = autoregressive(0.5, 8, 4000)
    assert effective_size(draws) == pytest.approx(draws.size / 3.0, rel=0.15)


def test_chains_that_disagree_are_seen() -> None:
    draws = autoregressive(0.0)
    assert r_hat(draws) < 1.01
    draws[0] += 3.0  # another place
    assert r_hat(draws) > 1.05
    wide = autoregressive(0.0)
    wide[0] *= 10.0  # the same place, another spread
    assert r_hat(wide) > 1.05
    assert r_hat(np.ones((4, 100))) == np.inf
    assert r_hat(draws[:, :5]) == np.inf
