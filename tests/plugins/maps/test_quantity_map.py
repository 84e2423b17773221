"""Map of the virtual injector: the inverse delivers what it states, checked by another way of simulating."""

from __future__ import annotations

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.maps.axes import MapAxes, increasing
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.run import InjectionMap, injection_map, usual_axes
from commonrail.plugins.maps.table import MapUnits, check_label, inverse_table, quantity_table

AXES = MapAxes(np.array([80e6, 160e6]), np.array([0.0, 1e-9, 5e-9, 500e-9]), np.array([200e-6, 300e-6, 500e-6]))


@pytest.fixture(scope="module")
def found() -> InjectionMap:
    return injection_map(cr.load_injector("virtual-lino-2016"), AXES, Conditions(threads=1))


def test_a_traced_simulation_delivers_the_quantity_of_each_cell(found: InjectionMap) -> None:
    """`simulate` keeps all states and has its own horizon; 0.02 mm³ is what a map must hold."""
    for i, rail in enumerate(AXES.rail_pressure.tolist()):
        for j in (1, 2):
            assert found.inverse.state[i, j] == CellState.REACHED
            time = float(found.inverse.energising_time[i, j])
            delivered = cr.simulate(found.injector, cr.OperatingPoint(rail, time)).injected_volume
            assert delivered == pytest.approx(AXES.quantity[j], abs=0.02e-9)


def test_what_is_not_reached_is_named_and_extrapolated_beyond_the_longest_time(found: InjectionMap) -> None:
    assert found.inverse.state[:, 3].tolist() == [CellState.BEYOND] * 2
    assert np.all(found.inverse.energising_time[:, 3] > AXES.energising_time[-1])
    assert found.inverse.state[:, 0].tolist() == [CellState.ZERO] * 2


def test_the_quantity_map_is_that_of_single_simulations(found: InjectionMap) -> None:
    point = cr.OperatingPoint(160e6, 500e-6)
    assert found.volume[1, 2] == pytest.approx(cr.simulate(found.injector, point).injected_volume, rel=1e-6)
    assert found.volume[0, 0] <= found.volume[0, 1] <= found.volume[0, 2]


def test_a_needle_that_turns_round_early_is_ballistic(found: InjectionMap) -> None:
    lifts = [line.at(AXES.energising_time).lift for line in found.lines]
    full = np.array([line.lift.max() for line in found.lines])
    assert np.array_equal(found.ballistic, np.array(lifts) < 0.98 * full[:, None])
    assert found.ballistic[:, 0].all()  # 200 us


def test_tables_have_the_units_that_are_asked_for(found: InjectionMap) -> None:
    table = inverse_table(found, "ET", MapUnits("bar", "mg/inj", "ms"))
    assert table.x.values.tolist() == [800.0, 1600.0]
    assert table.y.values[1] == pytest.approx(1e-9 * found.density * 1e6, rel=1e-9)
    assert table.values.shape == (4, 2)
    assert table.values[1, 0] == pytest.approx(found.inverse.energising_time[0, 1] * 1e3, abs=6e-4)
    assert table.states[3] == ("unreachable", "unreachable")
    quantities = quantity_table(found, "Q", MapUnits("hPa", "mg", "us"))
    assert quantities.values[2, 1] == pytest.approx(found.volume[1, 2] * found.density * 1e6, abs=6e-4)


def test_units_of_another_kind_are_refused(found: InjectionMap) -> None:
    with pytest.raises(cr.errors.InputError):
        inverse_table(found, "ET", MapUnits("mm", "mm3", "us"))


@pytest.mark.parametrize("label", ["", "1st", "a b", "a;b", "Übung", "a" * 129, "a..b"])
def test_labels_that_a_control_unit_cannot_have_are_refused(label: str) -> None:
    with pytest.raises(cr.errors.InputError, match="InjVlv_tiET_MAP"):
        check_label(label)


def test_labels_of_control_units_are_accepted() -> None:
    assert [check_label(label) for label in ("InjVlv_tiET_MAP", "A.B[3].c_4")] == ["InjVlv_tiET_MAP", "A.B[3].c_4"]


def test_the_usual_axes_are_those_of_a_control_unit() -> None:
    axes = usual_axes(cr.load_injector("cri2-16"))
    assert (len(axes.rail_pressure), len(axes.quantity)) == (16, 18)
    assert np.count_nonzero((axes.quantity >= 0.5e-9) & (axes.quantity <= 10e-9)) >= 10


@pytest.mark.parametrize(
    ("values", "word"),
    [([], "rail pressures .* 200"), ([1e6, 1e6], "rail pressures .* 1 MPa"), ([2e6, 1e6], "1 MPa .* 2 MPa")],
)
def test_an_axis_that_does_not_increase_is_refused(values: list[float], word: str) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=word):
        increasing(values, "Pa", "rail pressures")


def test_an_injector_that_cannot_be_simulated_is_refused_with_the_reason() -> None:
    with pytest.raises(cr.errors.SimulationError, match="virtual-lino-2016"):
        injection_map(cr.load_injector("virtual-lino-2016"), AXES, Conditions(time_step=50e-6, threads=1))
