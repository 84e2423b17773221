"""Maps smoothed, made monotone, rounded and interpolated, against laws of which all is known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.plugins.maps.adjust import monotone, smooth
from commonrail.plugins.maps.ecu_file import read_ecu_maps
from commonrail.plugins.maps.file import write_map_file
from commonrail.plugins.maps.response import Response
from commonrail.plugins.maps.run import InjectionMap
from commonrail.plugins.maps.table import MapUnits, inverse_table, quantity_table

US, MM3 = 1e-6, 1e-9
SLOPE = 0.05 * MM3 / US
PRESSURES, TIMES, QUANTITIES = (80e6, 100e6, 120e6), (250e-6, 300e-6, 350e-6, 400e-6, 1e-3), (0.0, 1e-9, 3.3e-9, 7e-9)


def line(rail: Floats, time: Floats) -> Floats:
    """0.05 mm³ for each microsecond beyond 200 us at 100 MPa, in proportion to the rail pressure."""
    return np.asarray(rail / 100e6 * SLOPE * np.maximum(time - 200 * US, 0.0))


def folded(rail: Floats, time: Floats) -> Floats:
    """Rises to 4 mm³ at 300 us, falls to 2 mm³ at 350 us, rises by 0.04 mm³/us."""
    return np.asarray(np.interp(time / US, [200.0, 300.0, 350.0, 1000.0], [0.0, 4.0, 2.0, 28.0])) * MM3 + 0.0 * rail


Made = Callable[..., InjectionMap]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    """Map of a law of rail pressure and energising time in place of an injector."""

    def build(law: Callable[[Floats, Floats], Floats], **options: Any) -> InjectionMap:
        respond = lambda injector, rail, time, conditions: Response(law(rail, time), np.ones(len(time)))  # noqa: E731
        monkeypatch.setattr("commonrail.plugins.maps.response.respond", respond)
        axes: Any = {"pressures": PRESSURES, "times": TIMES, "quantities": QUANTITIES}
        return cr.maps.quantity_map(cr.load_injector("virtual-lino-2016"), **axes | options)

    return build


def test_neighbours_that_fall_are_pooled_to_their_mean() -> None:
    rows = np.array([[0.0, 1.0, 4.0, 2.0, 3.0, 6.0], [0.0, 2.0, np.nan, 1.0, 1.0, 5.0]])
    third = 4.0 / 3.0
    assert monotone(rows)[0] == pytest.approx([0.0, 1.0, 3.0, 3.0, 3.0, 6.0])
    assert monotone(rows)[1] == pytest.approx([0.0, third, np.nan, third, third, 5.0], nan_ok=True)


def test_a_map_that_is_made_monotone_states_what_it_costs(made: Made) -> None:
    before, after = made(folded), made(folded, monotone=True)
    assert np.all(np.diff(after.curves.volume, axis=1) >= 0.0)
    cost = next(cost for cost in after.costs if not cost.inverse)
    change = after.volume - before.volume
    assert cost.rms == pytest.approx(float(np.sqrt(np.mean(change**2))))
    assert abs(cost.largest) == pytest.approx(np.abs(change).max()) != 0.0
    assert cost.at in (pytest.approx(300 * US), pytest.approx(350 * US))  # top and trough of the fold
    assert {cost.step for cost in made(line, monotone=True).costs if cost.rms < 1e-15} == {"monotone"}


def test_rounding_times_costs_the_slope_times_the_change(made: Made) -> None:
    plain, rounded = made(line), made(line, resolution=("0.4 us", None))
    steps = rounded.inverse.energising_time / (0.4 * US)
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    change = rounded.inverse.energising_time - plain.inverse.energising_time
    assert np.abs(change).max() <= 0.2000001 * US
    expected = np.outer(np.array(PRESSURES) / 100e6 * SLOPE, np.ones(4)) * change
    (cost,) = rounded.costs
    assert (cost.step, cost.inverse) == ("resolution", True)
    assert cost.rms == pytest.approx(float(np.sqrt(np.mean(expected[:, 1:] ** 2))), rel=1e-6)
    i, j = np.unravel_index(int(np.argmax(np.abs(expected))), expected.shape)
    assert (cost.largest, cost.rail_pressure, cost.at) == pytest.approx((expected[i, j], PRESSURES[i], QUANTITIES[j]))


def test_a_time_behind_a_jump_is_rounded_up(made: Made) -> None:
    jumping = lambda rail, time: np.where(time < 233.3 * US, 0.0, 2.0 * MM3 + SLOPE * (time - 233.3 * US))  # noqa: E731
    rounded = made(jumping, resolution=("1 us", None))
    assert rounded.inverse.energising_time[:, 1] == pytest.approx(234.0 * US)
    assert np.all(rounded.inverse.delivered[:, 1] > 2.0 * MM3)


def test_smoothing_keeps_planes_and_does_not_exceed_its_cost() -> None:
    x, y = np.array([1.0, 2.0, 4.0, 7.0, 9.0]), np.array([1.0, 1.5, 3.0, 6.0])
    plane = 2.0 * x[:, None] - 0.7 * y
    noise = 0.1 * np.random.default_rng(1).standard_normal(plane.shape)

    def smoothed(values: Floats, largest: float) -> Floats:
        def cost(found: Floats) -> float:
            return float(np.sqrt(np.mean((found - values) ** 2)))

        return smooth(values, (x, y), np.ones(values.shape), lambda found: found, cost, largest)

    assert smoothed(plane, 1e-3) == pytest.approx(plane, abs=1e-6)
    found = smoothed(plane + noise, 0.04)
    assert 0.039 < np.sqrt(np.mean((found - plane - noise) ** 2)) <= 0.04
    assert np.sqrt(np.mean((found - plane) ** 2)) < 0.9 * np.sqrt(np.mean(noise**2))


def test_smoothing_costs_what_is_stated_in_both_maps(made: Made) -> None:
    bent = lambda rail, time: line(rail, time) * (1.0 + 0.3 * np.sin(time / (60 * US)))  # noqa: E731
    costs = made(bent, smooth="0.1 mm3").costs
    assert [cost.inverse for cost in costs] == [False, True]
    assert all(0.05 * MM3 < cost.rms <= 0.1 * MM3 for cost in costs)


@pytest.mark.parametrize("ending", [".dcm", ".cdfx", ".table"])
def test_files_hold_the_rounded_values(made: Made, tmp_path: Path, ending: str) -> None:
    """Also in a unit in which three decimals are too few."""
    found = made(line, resolution=("0.4 us", "0.07 mm3"))
    tables = inverse_table(found, "ET", MapUnits(time="ms")), quantity_table(found, "Q")
    for table, finest in zip(tables, (0.0004, 0.07), strict=True):
        write_map_file(tmp_path / f"map{ending}", [table])
        (read,) = read_ecu_maps(tmp_path / f"map{ending}").tables.values()
        steps = read.values / finest
        assert np.array_equal(read.values, table.values)
        assert steps == pytest.approx(np.round(steps), abs=1e-9)
        assert len(np.unique(steps)) > 5
        assert len([note for note in table.notes if "rounded" in note]) == 2


@pytest.mark.parametrize("law", [line, folded])
def test_the_time_for_a_quantity_delivers_it(made: Made, law: Callable[[Floats, Floats], Floats]) -> None:
    found = made(law)
    rail, wanted = np.linspace(80e6, 120e6, 7)[:, None], np.linspace(0.0, 20.0, 41) * MM3
    time = found.energising_time(rail, wanted)
    assert time.shape == (7, 41)
    assert found.quantity(rail, time) == pytest.approx(wanted + 0.0 * rail, abs=1e-18)
    assert np.all(np.diff(time, axis=1) > 0.0)


def test_quantities_are_interpolated_and_nothing_is_extrapolated(made: Made) -> None:
    """The law is linear in the pressure, and in the time but for its foot, which lies on a simulated time."""
    found = made(line)
    assert found.quantity("90 MPa", "310 us") == pytest.approx(float(line(np.array(90e6), np.array(310e-6))), rel=1e-9)
    reference = RegularGridInterpolator((PRESSURES, found.curves.time), found.curves.volume)
    assert found.quantity(111e6, 777e-6) == pytest.approx(float(reference([111e6, 777e-6])[0]))
    assert np.isnan(found.quantity([70e6, 130e6, 100e6, 100e6], [5e-4, 5e-4, 1.1e-3, -1e-6])).all()
    assert np.isnan(found.energising_time([70e6, 100e6, 100e6], [1e-9, 1e-6, -1e-9])).all()
    assert found.energising_time(100e6, 0.0) == 0.0
    with pytest.raises(cr.errors.ConfigurationError):
        found.quantity([80e6, 90e6], [1e-4, 2e-4, 3e-4])
