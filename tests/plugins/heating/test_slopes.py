"""Heating by throttling and compression against CoolProp's n-dodecane, by hand and by its enthalpy and entropy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.heating import compress, density_and_expansivity, heat_capacity, throttle
from commonrail.readers.fuel import load_fuel

# CoolProp 8.0.0: p [MPa], T [K], rho [kg/m3], alpha [1/K], c_p [J/(kg K)].
BY_HAND = [
    (10.0, 293.15, 756.25, 9.318e-4, 2191.3),
    (100.0, 313.15, 790.34, 6.484e-4, 2245.9),
    (100.0, 353.15, 770.50, 6.246e-4, 2375.5),
]
WAYS = [(160e6, 0.5e6, 313.15), (100e6, 0.5e6, 313.15), (160e6, 5e6, 353.15)]  # from, to [Pa], temperature before [K]


@pytest.mark.parametrize(("p", "temperature", "rho", "alpha", "capacity"), BY_HAND)
def test_rise_by_hand(p: float, temperature: float, rho: float, alpha: float, capacity: float) -> None:
    """(1 - alpha T)/(rho c_p) per pascal, over 1 MPa about the state."""
    fuel, ends = load_fuel("n-dodecane"), np.array([p + 0.5, p - 0.5]) * 1e6
    rise = np.ptp(throttle(fuel, temperature, ends))
    by_hand = 1e6 * (1.0 - alpha * temperature) / (rho * capacity)
    assert by_hand == pytest.approx(rise, rel=0.015)  # the error of c_p is 1.2 %, 1 - alpha T hardly adds to it
    assert density_and_expansivity(fuel, p * 1e6, temperature)[1] == pytest.approx(alpha, rel=0.01)
    assert heat_capacity(fuel, temperature) == pytest.approx(capacity, rel=0.012)


@pytest.mark.parametrize(("high", "low", "temperature"), WAYS)
def test_rise_and_fall_by_enthalpy_and_entropy(high: float, low: float, temperature: float) -> None:
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="the development extra has CoolProp")
    fuel, state = load_fuel("n-dodecane"), coolprop.AbstractState("HEOS", "n-Dodecane")
    state.update(coolprop.PT_INPUTS, high, temperature)
    enthalpy, entropy = state.hmass(), state.smass()
    state.update(coolprop.HmassP_INPUTS, enthalpy, low)
    pressures = np.linspace(high, low, 17)
    rise = throttle(fuel, temperature, pressures)[-1] - temperature
    assert rise == pytest.approx(state.T() - temperature, rel=0.01)
    assert 0.35 < 1e6 * rise / (high - low) < 0.5
    state.update(coolprop.PSmass_INPUTS, low, entropy)
    assert compress(fuel, temperature, pressures)[-1] - temperature == pytest.approx(state.T() - temperature, rel=0.015)


def test_the_rise_needs_no_finer_steps() -> None:
    fuel = load_fuel("iso4113")
    ends = [throttle(fuel, 313.15, np.linspace(160e6, 0.5e6, n))[-1] for n in (17, 129)]
    assert ends[0] == pytest.approx(ends[1], abs=0.01)
    assert 1e6 * (ends[0] - 313.15) / 159.5e6 == pytest.approx(0.46, abs=0.02)  # 0.4 to 0.6 K/MPa for such oils


def test_above_the_range_properties_are_held_and_compression_does_not_decide_over_temperatures() -> None:
    fuel, way = load_fuel("n-dodecane"), np.linspace(160e6, 0.5e6, 17)
    assert throttle(fuel, 390.0, way)[-1] > fuel.temperature_range[1] + 40.0
    assert density_and_expansivity(fuel, 1e6, 450.0) == density_and_expansivity(fuel, 1e6, 393.15)
    assert heat_capacity(fuel, 450.0) == heat_capacity(fuel, 393.15)
    np.testing.assert_array_equal(throttle(replace(fuel, adiabatic=True), 313.15, way), throttle(fuel, 313.15, way))


def test_a_fuel_without_heat_capacity_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"n-dodecane-eq2 .*heat capacity"):
        throttle(load_fuel("n-dodecane-eq2"), 313.15, np.array([1e8, 1e6]))
