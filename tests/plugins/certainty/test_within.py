"""Quantities that are uncertain about an end of what they can be: fitted as stated, and integrated out."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.physics.meters import Meter
from commonrail.plugins.certainty.estimate import estimate
from commonrail.plugins.certainty.lack_of_fit import beyond_stated
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.nuisance import one_sided, with_uncertain_free
from commonrail.plugins.certainty.one_sided import _density, _of_first, _Round, _weights, mixture_of
from commonrail.plugins.certainty.run import certify
from tests.plugins.certainty.linear import Floats, design, likelihood
from tools.coverage import BEDS, FRICTION, Bench, Benches

SIGMA = 0.5
WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE, sigma=SIGMA)


def with_friction(prior: float) -> Space:
    """Two parameters, and a third one that is uncertain about zero and never negative."""
    first = [Parameter(n, 4.0, 0.1, 10.0, "1", mark="E", source="test") for n in "ab"]
    last = Parameter("c", 0.0, 0.0, 6.0 * prior, "1", mark="E", source="test", prior=Prior(0.0, prior, "test"))
    return Space([*first, last])


def by_quadrature(x: Floats, y: Floats, prior: float, about: Floats) -> Floats:
    """Second moment (2, 2) of the first two parameters about given values, the third integrated out from zero on."""
    grid = np.linspace(0.0, 6.0 * prior, 2001)
    inverse = np.linalg.inv(x[:, :2].T @ x[:, :2])
    fits = (inverse @ x[:, :2].T @ (y[:, None] - np.outer(x[:, 2], grid))).T
    squares = np.sum((y[:, None] - x[:, :2] @ fits.T - np.outer(x[:, 2], grid)) ** 2, axis=0)
    logarithms = -0.5 * squares / SIGMA**2 - 0.5 * (grid / prior) ** 2
    share = np.exp(logarithms - logarithms.max())
    share /= share.sum()
    away = fits - about
    return np.asarray((share * away.T) @ away + SIGMA**2 * inverse)


@pytest.mark.parametrize("true", [0.0, 0.4, 1.5])
def test_the_second_moment_is_that_of_quadrature(true: float) -> None:
    """A third parameter that the others imitate, at its end, near it and away from it."""
    x = design(60)
    x[:, 2] = 0.8 * x[:, 0] + 0.5 * x[:, 1] + 0.3 * x[:, 2]
    prior = 1.0
    y = x @ [2.0, 3.0, true] + SIGMA * np.random.default_rng(11).standard_normal(60)
    found = estimate(likelihood([y], [x], [WHITE], room=with_friction(prior)), np.array([[0.2, 0.3, 0.1]]))
    over = mixture_of(found, 2)
    expected = by_quadrature(x, y, prior, found.point[:2])
    assert over.effective > 20.0
    # 64 draws, spread evenly, know a variance to some 12 %; the curvature is off by up to a factor of two
    np.testing.assert_allclose(np.diag(over.moment) * 9.9**2, np.diag(expected), rtol=0.15)
    assert over.moment[0, 1] * 9.9**2 == pytest.approx(expected[0, 1], rel=0.25)


def test_reflected_draws_have_a_density_of_one_in_sum() -> None:
    """About a bound, a third of the proposal lies beyond it."""
    grid = (np.arange(20_000) + 0.5) / 20_000
    for centre in (0.02, 0.5, 0.99):
        density = _density(grid[:, None], np.array([centre]), np.array([[0.05**2]]))
        assert density.mean() == pytest.approx(np.sqrt(2.0 * np.pi), rel=1e-3)


def test_a_fit_counts_by_the_volume_that_it_leaves_the_parameters() -> None:
    """Two draws of equal cost and density, the parameters twice as uncertain in both directions with the second."""
    covariances = np.array([np.eye(2), 4.0 * np.eye(2)])
    every = _Round(np.array([[0.4], [0.6]]), np.zeros((2, 2)), np.array([7.0, 7.0]), covariances)
    weights = _weights(every, [(np.array([0.5]), np.array([[0.01]]))])
    np.testing.assert_allclose(weights, [0.2, 0.8])


def test_draws_of_which_none_can_be_simulated_leave_the_curvature() -> None:
    x = design(60)
    y = x @ [2.0, 3.0, 0.5] + SIGMA * np.random.default_rng(11).standard_normal(60)
    found = estimate(likelihood([y], [x], [WHITE], room=with_friction(1.0)), np.array([[0.2, 0.3, 0.1]]))
    own = found.likelihood
    broken = own.with_space(own.space, lambda points: np.full((len(points), 60), np.nan)).with_noises(own.noises)
    over = mixture_of(replace(found, likelihood=broken), 2)
    assert (over.effective, over.believed) == (0.0, False)


@pytest.fixture(scope="module")
def benches() -> Benches:
    return Benches(BEDS["friction, stated as uncertain"])


@pytest.fixture(scope="module")
def bench(benches: Benches) -> Bench:
    return benches.bench(2)


def test_friction_about_zero_has_one_side_and_a_delay_has_two(bench: Bench) -> None:
    (curve,) = bench.study.data
    both = replace(bench.study, data=(curve.changed(noise=Noise(uncertain={"delay": 1e-6, **FRICTION})),))
    assert set(one_sided(both)) == set(FRICTION)
    with_some = both.injector.with_values({"plunger_needle.friction": 10.0})
    assert one_sided(replace(both, injector=with_some)) == ("plunger_needle.viscous",)
    free = with_uncertain_free(both, one_sided(both))
    assert free is not None
    assert free.space.names[3:] == tuple(free.space.names[3:5])
    assert dict(free.data[0].noise.deviations) == {"delay": 1e-6}


def test_a_value_near_an_end_has_one_side_as_far_as_that_end(bench: Bench) -> None:
    """Friction of 1 N ± 2 N is 0 to 13 N; 10 N ± 2 N has two sides."""
    (curve,) = bench.study.data
    stated = replace(bench.study, data=(curve.changed(noise=Noise(uncertain={"plunger_needle.friction": 2.0})),))
    values = {"plunger_needle.friction": 1.0}, {"plunger_needle.friction": 10.0}
    near, far = (replace(stated, injector=stated.injector.with_values(own)) for own in values)
    assert one_sided(near) == ("plunger_needle.friction",)
    assert one_sided(far) == ()
    for study, ends in ((near, (0.0, 13.0)), (far, (0.0, 22.0))):
        free = with_uncertain_free(study)
        assert free is not None
        parameter = free.space.parameters[-1]
        assert (parameter.lower, parameter.upper) == pytest.approx(ends, abs=1e-9)
        assert parameter.lower >= 0.0


def test_a_cutoff_is_uncertain_about_that_of_its_meter(bench: Bench) -> None:
    (curve,) = bench.study.data
    seen = curve.changed(meter=Meter("bench", {"cutoff": "10 kHz"})).changed(noise=Noise(uncertain={"cutoff": 1e3}))
    assert one_sided(replace(bench.study, data=(seen,))) == ()


def test_counted_pieces_stay_beside_the_fit(bench: Bench) -> None:
    (curve,) = bench.study.data
    counted = replace(bench.study, data=(curve.changed(noise=Noise(uncertain={"nozzle.holes": 0.1, "delay": 1e-6})),))
    free = with_uncertain_free(counted)
    assert free is not None
    assert dict(free.data[0].noise.deviations) == {"nozzle.holes": 0.1}


@pytest.mark.parametrize(("true", "is_found"), [(0.5, False), (8.0, True)])
def test_a_value_far_from_what_is_stated_is_found(true: float, is_found: bool) -> None:
    """A third parameter stated as 0 ± 1, which the others do not imitate."""
    x = design(60)
    y = x @ [2.0, 3.0, true] + SIGMA * np.random.default_rng(11).standard_normal(60)
    room = with_friction(1.0)
    room = Space([*room.parameters[:2], replace(room.parameters[2], upper=20.0)])
    found = estimate(likelihood([y], [x], [WHITE], room=room), np.array([[0.2, 0.3, 0.1]]))
    (test,) = beyond_stated(found, 2, 1e-3)
    assert (test.name, test.found) == ("c", is_found)
    assert test.score == pytest.approx(math.erfc(found.point[2] / math.sqrt(2.0)))
    assert is_found == ("standard deviations from what is stated" in test.sentence)
    assert beyond_stated(found, 3, 1e-3) == []


def test_a_parameter_without_effect_leaves_the_others_integrated_out() -> None:
    """The second of three parameters is not seen: that of the first one is the second moment nevertheless."""
    x = design(60)
    x[:, 1] = 0.0
    x[:, 2] = 0.8 * x[:, 0] + 0.3 * x[:, 2]
    y = x @ [2.0, 3.0, 0.4] + SIGMA * np.random.default_rng(11).standard_normal(60)
    whole = estimate(likelihood([y], [x], [WHITE], room=with_friction(1.0)), np.array([[0.2, 0.3, 0.1]]))
    over = mixture_of(whole, 2)
    assert over.believed
    noise = _of_first(whole, over, 2).noise
    assert noise[1, 1] == np.inf
    assert noise[0, 0] == over.moment[0, 0]


def test_stated_friction_is_found_and_no_longer_in_the_parameters(benches: Benches, bench: Bench) -> None:
    within = benches.within(bench)
    low, high = within.found.interval()
    assert ((low < bench.truth) & (bench.truth < high)).all()
    assert (0.5 * (high - low) < [0.002, 0.002, 0.1] * bench.truth).all()
    # without friction in the fit k7 is 12 % off, and half of a linear interval is 20 %
    own = Likelihood.of(bench.study, 1)
    plain = estimate(own, own.space.to_unit(bench.truth)[None])
    assert abs(plain.point[2] - bench.truth[2]) > 2.0 * abs(within.found.point[2] - bench.truth[2])
    assert plain.half_widths()[2] > 2.0 * within.found.half_widths()[2]
    np.testing.assert_allclose(within.found.covariance.noise, mixture_of(within.whole, 3).moment, rtol=1e-9)
    # the derivatives let the friction follow: they are those of the whole fit
    whole = within.whole
    shift = whole.slopes[3:4]  # a course that friction explains moves no parameter
    assert np.abs(within.found.value_shifts(shift)).max() < 0.2 * np.abs(plain.value_shifts(shift)).max() + 1e-12
    np.testing.assert_allclose(within.found.value_shifts(shift), whole.value_shifts(shift)[:, :3], rtol=1e-3, atol=1e-9)


def test_a_certainty_tells_of_the_friction_that_it_has_fitted(bench: Bench) -> None:
    best = dict(zip(bench.study.space.names, bench.truth.tolist(), strict=True))
    found = certify(bench.study, best, threads=1, profiles=["plunger_needle.k7"])
    local = found.estimate.interval()
    assert (found.low <= local[0]).all()  # a profile, which has the friction at its best, narrows nothing
    assert (found.high >= local[1]).all()
    assert found.estimate.likelihood.names == bench.study.space.names
    assert all("plunger_needle.friction and plunger_needle.viscous fitted as stated" in one for one in found.estimators)
    record = found.record()
    assert [one["name"] for one in record["fitted_as_stated"]] == list(FRICTION)
    assert record["fitted_as_stated"][1]["value"] == pytest.approx(2.0 * 1.63, abs=3.0)
    assert len(record["parameters"]) == len(record["sensitivity"][0]["percent"]) == 3
    assert not any(test.suspect == "friction" for test in found.tests)
    assert isinstance(found, cr.Certainty)


def test_a_delay_counts_with_the_larger_of_its_moves(benches: Benches, bench: Bench) -> None:
    """Friction that follows hides a part of what a delay moves, and makes more of it in another parameter."""
    (curve,) = bench.study.data
    both = replace(bench.study, data=(curve.changed(noise=Noise(uncertain={"delay": 1e-6, **FRICTION})),))
    within = benches.within(bench._replace(study=both))
    follow = within.whole.covariance.nuisances[:, :3]
    (largest,) = np.abs(within.found.covariance.nuisances)
    assert (largest >= np.abs(follow[0]) * (1.0 - 1e-9)).all()
    assert (largest > 1.2 * np.abs(follow[0])).any()
    assert [nuisance.key for nuisance in within.found.likelihood.nuisances] == ["delay"]
    # the delay's effect on the residuals, at the friction that was found
    shift = within.found.likelihood.nuisances[0].shift(within.found.point)
    np.testing.assert_allclose(shift, within.found.shifts[0], atol=1e-9 * np.abs(shift).max())
