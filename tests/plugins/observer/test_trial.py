"""Truths of the observer's trial: fuel with air in it."""

from __future__ import annotations

import numpy as np
import pytest

from commonrail.readers.fuel import load_fuel
from studies.observer_trial import SOFT, AeratedFuel


@pytest.mark.parametrize("air", [0.005, 0.05])
def test_a_fuel_with_air_has_the_modulus_of_its_density_and_the_volume_of_both(air: float) -> None:
    plain, p, warm = load_fuel("iso4113"), np.linspace(2e6, 160e6, 1581), 313.15
    mixed = AeratedFuel.of(plain, air)
    density = mixed.density(p, warm)
    modulus = density[1:-1] * (p[2:] - p[:-2]) / (density[2:] - density[:-2])
    assert mixed.bulk_modulus(p, warm)[1:-1] == pytest.approx(modulus, rel=1e-4)
    high = p >= SOFT
    liquid = (1.0 - air) * plain.density(1e5, warm) / plain.density(p, warm)
    gas = air * (1e5 / p) ** (1.0 / 1.4)
    ratio = plain.density(p, warm) / density  # volume of the mixture over that of its liquid
    assert ratio[high] == pytest.approx((1.0 + gas / liquid)[high], rel=1e-9)
    assert mixed.sound_speed(60e6, warm) < plain.sound_speed(60e6, warm)


@pytest.mark.parametrize("name", ["iso4113", "n-dodecane"])
def test_sound_in_a_fuel_with_air_is_that_of_wood(name: str) -> None:
    """1/(ρ a²) = Σ α/(ρ a²) over liquid and air, whose modulus is 1.4 p; with and without a modulus for sound."""
    plain, p, warm, air = load_fuel(name), np.linspace(SOFT, 160e6, 15), 313.15, 0.05
    mixed = AeratedFuel.of(plain, air)
    gas = air * (1e5 / p) ** (1.0 / 1.4)
    liquid = (1.0 - air) * plain.density(1e5, warm) / plain.density(p, warm)
    share = gas / (gas + liquid)
    stiff = plain.density(p, warm) * plain.sound_speed(p, warm) ** 2
    compliance = (1.0 - share) / stiff + share / (1.4 * p)
    expected = 1.0 / np.sqrt(mixed.density(p, warm) * compliance)
    assert mixed.sound_speed(p, warm) == pytest.approx(expected, rel=1e-9)
