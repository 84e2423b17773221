"""Relief by one more free value or a wider bound, compared with least squares on linear models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.space import Space
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.certainty.relief import Relief
from tests.plugins.certainty.linear import TRUTH, Floats, N, design, fitted, likelihood, space

WHITE = Noise(law=Law.GAUSSIAN, correlation=Correlation.WHITE)
T = np.linspace(0.0, 1.0, N)


def measured(more: Floats | float, seed: int) -> Floats:
    return np.asarray(design() @ TRUTH + more + 0.2 * np.random.default_rng(seed).standard_normal(N))


def rms_of_least_squares(columns: Floats, y: Floats) -> float:
    return float(np.sqrt(np.mean((y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]) ** 2)))


def test_the_relief_is_that_of_a_refit_by_least_squares() -> None:
    wave = np.sin(40.0 * T)
    y = measured(wave, 1)
    relief = Relief(fitted(likelihood([y], [design()], [WHITE])))
    refit = rms_of_least_squares(np.column_stack([design(), wave]), y) / rms_of_least_squares(design(), y)
    assert relief.of_values(0.01 * wave[None]) == pytest.approx(1.0 - refit, abs=2e-3)  # a search ends near its optimum
    assert relief.of_values(np.sin(70.0 * T)[None]) < 0.02
    assert relief.of_bounds(3) == 0.0


def test_a_bound_that_holds_a_parameter_off_has_the_relief_of_a_wider_one() -> None:
    """The truth of the second parameter is 3, and its bound is 2."""
    ranges = [(0.1, 10.0), (0.1, 2.0), (0.1, 10.0)]
    room = Space([
        Parameter(name, 1.5, low, high, "1", mark="E", source="test")
        for name, (low, high) in zip("abc", ranges, strict=True)
    ])  # fmt: skip
    y = measured(0.0, 2)
    found = fitted(likelihood([y], [design()], [WHITE], room))
    after = rms_of_least_squares(design(), y) / float(np.sqrt(np.mean(found.errors**2)))
    assert after < 0.4
    assert Relief(found).of_bounds(1) == 0.0  # the second is a quantity of the bench, which no study widens
    assert Relief(found).of_bounds(3) == pytest.approx(1.0 - after, abs=5e-2)  # weights are those of the first fit


def test_curves_count_as_much_as_maps() -> None:
    """A curve of 300 samples, and a map of 12 values that alone has the error: half of the mean square goes."""
    x, rows = design(), np.linspace(0, N - 1, 12).astype(int)
    wave = np.cos(np.pi * np.arange(12))
    map_values = x[rows] @ TRUTH + 2.0 * wave
    found = fitted(likelihood([measured(0.0, 3), map_values], [x, x[rows]], [WHITE, WHITE]))
    change = np.append(np.zeros(N), wave)
    assert Relief(found).of_values(change[None]) == pytest.approx(1.0 - np.sqrt(0.5), abs=0.05)


def test_a_prior_that_holds_a_value_at_its_end_has_the_relief_of_the_value_without_it() -> None:
    """The truth is 3, and the prior and its bounds end at 2."""
    parameters = list(space().parameters)
    parameters[1] = replace(parameters[1], reference=1.0, lower=0.1, upper=2.0, prior=Prior(1.0, 0.15, "test"))
    y = measured(0.0, 4)
    found = fitted(likelihood([y], [design()], [WHITE], Space(parameters)))
    after = rms_of_least_squares(design(), y) / float(np.sqrt(np.mean(found.errors**2)))
    assert after < 0.4
    assert Relief(found).of_prior(1) == pytest.approx(1.0 - after, abs=0.1)  # the first refit takes the others along
