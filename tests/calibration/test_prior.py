"""Priors of parameters: their residuals, what is refused, and draws from them."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError, ConfigurationError
from commonrail.calibration.parameter import Parameter, Prior, Priors
from commonrail.calibration.space import Space, sample_priors


def parameter(name: str, lower: float, upper: float, prior: Prior | None = None) -> Parameter:
    reference = 0.5 * (lower + upper)
    return Parameter(name, reference, lower, upper, "1", mark="E", source="test", prior=prior)


def test_residuals_are_distances_in_standard_deviations() -> None:
    priors = Priors([Prior(2.0, 0.5), None, Prior(-1.0, 4.0)])
    x = np.array([[3.0, 99.0, 7.0], [2.0, 0.0, -1.0]])
    assert priors.residuals(x).tolist() == [[2.0, 2.0], [0.0, 0.0]]
    assert priors.costs(x).tolist() == [8.0, 0.0]
    assert len(priors) == 2


@pytest.mark.parametrize("sigma", [0.0, -1.0, float("nan"), float("inf")])
def test_a_sigma_that_is_none_is_refused(sigma: float) -> None:
    with pytest.raises(CommonrailError, match="sigma"):
        Prior(1.0, sigma)


def test_a_prior_outside_the_bounds_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"\bprior.* 3 .*bounds"):
        parameter("a", 0.0, 2.0, Prior(3.0, 1.0))


def test_a_quantity_of_either_sign_may_have_a_negative_bound() -> None:
    slope = Parameter("nozzle.lift_maximum_slope", 1e-13, -8e-13, 8e-13, "m/Pa", mark="E", source="test")
    assert slope.lower < 0.0
    with pytest.raises(ConfigurationError, match=r"valve\.mass.*negative"):
        Parameter("valve.mass", 4e-3, -1e-3, 8e-3, "kg", mark="E", source="test")


def test_draws_follow_the_priors_within_the_bounds() -> None:
    space = Space([parameter("a", 0.0, 10.0, Prior(4.0, 0.5)), parameter("b", 0.0, 10.0), parameter("c", 0.0, 2.0)])
    x = sample_priors(space, 2000, np.random.default_rng(1))
    assert space.satisfies(x).all()
    assert np.array_equal(x[0], space.reference)
    # a Latin hypercube has one draw in each of n equal shares: mean and spread are exact to a few 1/n, the first
    # draw, which is the reference, included
    assert x[:, 0].mean() == pytest.approx(4.0, abs=0.005)
    assert x[:, 0].std() == pytest.approx(0.5, rel=0.01)
    assert x[:, 1].mean() == pytest.approx(5.0, abs=0.01)


def test_draws_are_cut_at_the_bounds_and_not_heaped_there() -> None:
    space = Space([parameter("a", 0.0, 1.0, Prior(0.0, 1.0))])
    x = sample_priors(space, 1000, np.random.default_rng(1))[1:, 0]
    assert (x > 0.0).all()
    # half a normal distribution cut at one sigma: its mean is (φ(0) − φ(1))/(Φ(1) − Φ(0)) = 0.4599
    assert x.mean() == pytest.approx(0.4599, abs=2e-3)


def test_draws_keep_to_constraints() -> None:
    space = Space([parameter("a", 0.0, 1.0, Prior(0.9, 0.3)), parameter("b", 0.0, 1.0, Prior(0.1, 0.3))], ["a < b"])
    x = sample_priors(space, 300, np.random.default_rng(1))
    assert space.satisfies(x).all()
