"""Moves by uncertain quantities that derivatives misjudge are those of fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.nuisance import SIDES
from tests.plugins.certainty.linear import TRUTH, Floats, Uncertain, design, fitted, likelihood
from tools.coverage import BEDS, Benches

WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)


def with_sides(above: Floats, below: Floats, failing: Sequence[float] = ()) -> Likelihood:
    """Linear model with a quantity that changes the residuals to both sides; `failing` sides cannot be fitted."""
    x = design()
    y = x @ TRUTH + 0.2 * np.random.default_rng(4).standard_normal(len(x))

    def change(deviations: float, points: Floats) -> Floats:
        broken = deviations in failing and len(points) > 1
        return np.full(len(x), np.nan) if broken else {1.0: above, 0.0: 0.0 * above, -1.0: below}[deviations]

    return likelihood([y], [x], [WHITE], [Uncertain("delay", change, SIDES)])


def test_a_move_is_the_mean_square_of_those_to_both_sides() -> None:
    """Upwards the second parameter falls by 0.6 and downwards it rises by 0.2; the derivative promises 0.4."""
    wave = design()[:, 1]
    found = fitted(with_sides(0.6 * wave, -0.2 * wave))
    expected = [0.0, -np.sqrt((0.6**2 + 0.2**2) / 2.0) / 9.9, 0.0]
    np.testing.assert_allclose(found.covariance.nuisances[0], expected, atol=2e-4)  # the fits end within 0.05 of cost


def test_a_move_below_the_noise_is_not_fitted() -> None:
    wave = design()[:, 1]
    few = fitted(with_sides(0.601 * wave, 0.599 * wave))
    np.testing.assert_allclose(few.covariance.nuisances[0], [0.0, -1e-3 / 9.9, 0.0], atol=1e-9)


@pytest.mark.parametrize("failing", SIDES)
def test_a_side_that_cannot_be_simulated_leaves_the_other(failing: float) -> None:
    wave = design()[:, 1]
    found = fitted(with_sides(0.5 * wave, -0.5 * wave, [failing]))
    assert found.covariance.nuisances[0][1] == pytest.approx(-0.5 / 9.9, abs=2e-4)
    assert len(found.point) == len(TRUTH)


def test_sides_that_both_fail_leave_the_derivatives() -> None:
    wave = design()[:, 1]
    found = fitted(with_sides(0.3 * wave, -0.1 * wave, SIDES))
    np.testing.assert_allclose(found.covariance.nuisances[0], [0.0, -0.2 / 9.9, 0.0], atol=1e-9)


def test_fits_that_end_at_a_bound_do_not_shorten_a_move() -> None:
    """The second parameter, 3.0, would fall by 4.0 and has 2.9 to its bound; derivatives, never cut, say so."""
    wave = design()[:, 1]
    found = fitted(with_sides(4.0 * wave, -4.0 * wave))
    assert found.covariance.nuisances[0][1] == pytest.approx(-4.0 / 9.9, rel=1e-2)


def test_the_longer_move_gives_the_signs_where_both_sides_bend_alike() -> None:
    """Ends at (−0.4, −0.4) above and (−0.2, −0.2) below: what keeps the difference of the two in every fit."""
    both = design()[:, 0] + design()[:, 1]
    found = fitted(with_sides(0.4 * both, 0.2 * both))
    first, second, _ = found.covariance.nuisances[0]
    assert first == pytest.approx(-np.sqrt(0.1) / 9.9, rel=0.02)
    assert second == pytest.approx(first, rel=0.02)


def test_a_temperature_of_one_data_set_leaves_the_others_as_they_are() -> None:
    bench = Benches(BEDS["curve and map"]).bench(0)
    curve, quantities = bench.study.data
    uncertain = curve.changed(noise=Noise(uncertain={"fuel_temperature": 5.0}))
    own = Likelihood.of(replace(bench.study, data=(uncertain, quantities)), 1)
    plain = own.residuals(bench.truth[None])[0]
    of_curve, of_map = (block.rows for block in own.blocks)
    for side in own.nuisances[0].sides:
        moved = own.nuisances[0].residuals(side, bench.truth[None])[0]
        assert (moved[of_map] == plain[of_map]).all()
        assert np.abs(moved[of_curve] - plain[of_curve]).max() > 0.0


def test_a_delay_moves_k7_as_far_as_a_fit_with_it_does() -> None:
    """Benches whose derivatives promise less than what a delay of 1 µs moves k7 by: 6 to 8 %."""
    benches = Benches(BEDS["delay 1 us, autoregressive"])
    for seed in (10, 34):
        bench = benches.bench(seed)
        found = benches.fit(bench)
        low, high = found.interval()
        assert (low[2] < bench.truth[2]) & (bench.truth[2] < high[2])
        (move,) = found.value_shifts(found.shifts)
        moved = found.covariance.nuisances[0]
        fitted_move = abs(moved[2]) * found.likelihood.scaled(found.unit)[2]
        assert fitted_move > 1.1 * abs(move[2])
        assert 0.05 < fitted_move / bench.truth[2] < 0.1
