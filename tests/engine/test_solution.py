"""Channels of a solution: computed for all samples at once, to the bits that each has alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import coefficients_at
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import _discharge
from commonrail.physics.components import nozzle
from commonrail.physics.injector import Injector


@pytest.fixture
def shaped(regulated: Injector) -> nozzle.Coefficients:
    """Coefficients of a nozzle whose c_d is raised at one lift beyond 1, and lowered at another."""
    bent = regulated.with_values({"nozzle.shape_2": 0.5, "nozzle.shape_5": -0.3})
    found: nozzle.Coefficients = coefficients_at(bent, OperatingPoint(160e6, 700e-6), 1e-6).nozzle
    return found


@pytest.fixture
def samples(shaped: nozzle.Coefficients) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lifts over the whole range, at which the laws turn, and that a simulation which fails leaves; pressures [Pa]."""
    rng, turns = np.random.default_rng(1), [shaped.lift_transition, shaped.lift_maximum, *shaped.shape.knots]
    lift = np.concatenate((rng.uniform(0.0, 600e-6, 2000), turns, [0.0, -0.0, nozzle.RESIDUAL_LIFT, np.nan, np.inf]))
    return lift, rng.uniform(1e5, 160e6, len(lift)), np.full(len(lift), 5e6)


@pytest.mark.filterwarnings("ignore:invalid value")  # of the infinite lift
@pytest.mark.parametrize("law", [nozzle.discharge, nozzle.shaped_discharge])
def test_the_discharge_coefficients_have_the_bits_of_the_law(law: Any, shaped: Any, samples: Any) -> None:
    each = np.array([law(shaped, *sample) for sample in zip(*samples, strict=True)])
    assert _discharge(law, shaped, samples, False).tobytes() == each.tobytes()


def test_a_law_of_another_package_may_branch(shaped: Any, samples: Any) -> None:
    def halved(c: Any, lift: float, sac: float, cylinder: float) -> float:
        return 0.8 if sac > 2.0 * cylinder else 0.4

    _, sac, cylinder = samples
    assert np.array_equal(_discharge(halved, shaped, samples, True), np.where(sac > 2.0 * cylinder, 0.8, 0.4))


def test_the_rates_have_a_time_axis(regulated: Injector) -> None:
    """The mass injected up to each of these times lies half a sample's rate above that of the sample's start."""
    found = simulate(regulated, OperatingPoint(160e6, 700e-6))
    assert found.rate_time.shape == found.rate.shape == found.rate_mm3_per_ms.shape
    half = found.mass_rate * (found.rate_time - found.time[:-1])
    injected = np.interp(found.rate_time, found.time, found.injected)
    assert injected == pytest.approx(found.injected[:-1] + half, abs=1e-12)
