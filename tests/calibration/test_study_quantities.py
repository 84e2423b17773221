"""Quantity maps of a study: filters, dead times, masses, tolerances."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.calibration.study_file import load_study
from commonrail.data.quantities.data import QuantityData
from tests.map_study import map_study
from tests.refused import refused

MAP = """# bench
rail_pressure [MPa],energising_time [us],quantity [mm3]
40,300,1.5
40,700,11
80,300,3
80,700,26
"""
DEAD = "rail_pressure [bar],energising_time [ms]\n400,0.28\n800,0.24\n"
VALVE = """
[[parameter]]
name = "valve.mass"
below = "50 %"
above = "50 %"
"""

Load = Callable[..., QuantityData]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """The data set of a study with some keys added."""

    def run(keys: str = "", table: str = MAP, injector: str = "cri2-16") -> QuantityData:
        (tmp_path / "map.csv").write_text(table, encoding="utf-8")
        (tmp_path / "dead.csv").write_text(DEAD, encoding="utf-8")
        path = tmp_path / "study.toml"
        path.write_text(map_study(keys, more=VALVE).replace("cri2-16", injector), encoding="utf-8")
        (data,) = load_study(path).data
        assert isinstance(data, QuantityData)
        return data

    return run


def places(data: QuantityData) -> list[tuple[float, float]]:
    """Rail pressure [MPa] and energising time [us] of each point."""
    return [(p.at_start(p.rail_pressure) * 1e-6, round(p.pulses[0].duration * 1e6, 9)) for p in data.points]


def test_every_row_is_a_point(load: Load) -> None:
    data = load()
    assert places(data) == [(40.0, 300.0), (40.0, 700.0), (80.0, 300.0), (80.0, 700.0)]
    np.testing.assert_allclose(data.quantity, [1.5e-9, 11e-9, 3e-9, 26e-9], rtol=1e-15)
    assert not data.dead_time.any()
    assert (data.absolute, data.relative, data.weight) == (0.15e-9, 0.03, 1.0)


def test_points_have_the_studys_pressures_and_end_3_ms_after_energising(load: Load) -> None:
    point = load().points[1]
    assert (point.cylinder_pressure, point.return_pressure) == (0.5e6, 0.1e6)
    assert point.horizon == pytest.approx(3.7e-3, rel=1e-12)


def test_rows_at_chosen_pressures(load: Load) -> None:
    data = load('rail_pressure = ["800 bar"]')
    assert places(data) == [(80.0, 300.0), (80.0, 700.0)]
    assert data.quantity[0] == pytest.approx(3e-9, rel=1e-15)


def test_rows_at_chosen_energising_times(load: Load) -> None:
    assert places(load('energising_time = ["0.7 ms"]')) == [(40.0, 700.0), (80.0, 700.0)]
    assert places(load('rail_pressure = ["40 MPa"]\nenergising_time = ["300 us"]')) == [(40.0, 300.0)]


def test_dead_times_are_further_rows(load: Load) -> None:
    data = load('dead_times = { file = "dead.csv", quantity = "0.5 mm3" }')
    assert places(data)[4:] == [(40.0, 280.0), (80.0, 240.0)]
    assert data.dead_time.tolist() == [False] * 4 + [True] * 2
    np.testing.assert_allclose(data.quantity[4:], 0.5e-9, rtol=1e-15)


def test_the_filter_of_pressures_holds_for_dead_times(load: Load) -> None:
    data = load('rail_pressure = ["40 MPa"]\ndead_times = { file = "dead.csv", quantity = "0.5 mm3" }')
    assert places(data) == [(40.0, 300.0), (40.0, 700.0), (40.0, 280.0)]


def test_masses_are_divided_by_the_density_at_cylinder_pressure(load: Load) -> None:
    dead = 'dead_times = { file = "dead.csv", quantity = "0.4 mg" }'
    data = load(dead, MAP.replace("[mm3]", "[mg]"))
    # iso4113 at 40 °C: 808.8 kg/m3 and 1416 MPa at 0 MPa, so 808.8 exp(0.5/1416) = 809.1; 0.1: rounding of the table
    assert 1.5e-6 / data.quantity[0] == pytest.approx(809.1, abs=0.1)
    assert 0.4e-6 / data.quantity[4] == pytest.approx(809.1, abs=0.1)
    assert data.mass_density == pytest.approx(809.1, abs=0.1)  # candidates are compared at it, by mass


def test_volumes_are_compared_at_each_candidates_own_density(load: Load) -> None:
    assert np.isnan(load("", MAP).mass_density)
    mixed = load('dead_times = { file = "dead.csv", quantity = "0.4 mg" }', MAP).mass_density
    assert np.isnan(mixed).tolist() == [True] * 4 + [False] * 2


def test_units_stated_by_the_study(load: Load) -> None:
    bare = MAP.replace(" [MPa]", "").replace(" [us]", "").replace(" [mm3]", "")
    keys = 'rail_pressure_unit = "bar"\nenergising_time_unit = "us"\nquantity_unit = "mm3"'
    assert places(load(keys, bare))[0] == (4.0, 300.0)


def test_tolerances_and_weight(load: Load) -> None:
    data = load('absolute = "0.2 mm3"\nrelative = "5 %"\nweight = 2')
    assert (data.absolute, data.relative, data.weight) == (0.2e-9, 0.05, 2.0)


FAULTS: dict[str, tuple[type[CommonrailError], str, str, str]] = {
    "filter finds nothing": (
        ConfigurationError,
        'rail_pressure = ["40 MPa", "120 MPa"]',
        MAP,
        "missing-row data[1].rail_pressure",
    ),
    "filters share no row": (
        ConfigurationError,
        'rail_pressure = ["40 MPa"]\nenergising_time = ["700 us"]',
        MAP.replace("40,700", "40,600"),
        "no-row data[1]",
    ),
    "dead times elsewhere": (
        ConfigurationError,
        'rail_pressure = ["100 MPa"]\ndead_times = { file = "dead.csv", quantity = "0.5 mm3" }',
        MAP.replace("80,", "100,"),
        "missing-row data[1].dead_times.rail_pressure",
    ),
    "filter unit": (InputError, 'rail_pressure = ["40"]', MAP, "no-unit data[1].rail_pressure[1]"),
    "dead quantity unit": (
        InputError,
        'dead_times = { file = "dead.csv", quantity = "0.5 mm" }',
        MAP,
        "wrong-unit data[1].dead_times.quantity",
    ),
    "dead quantity zero": (
        InputError,
        'dead_times = { file = "dead.csv", quantity = "0 mm3" }',
        MAP,
        "out-of-range data[1].dead_times.quantity",
    ),
    "dead times file": (
        InputError,
        'dead_times = { file = "deed.csv", quantity = "0.5 mm3" }',
        MAP,
        "missing-file data[1].dead_times.file",
    ),
    "negative quantity": (
        InputError,
        "",
        MAP.replace(",1.5", ",-1.5"),
        'out-of-range line 3, column "quantity"',
    ),
    "energising of zero": (
        InputError,
        "",
        MAP.replace("80,700", "80,0"),
        'out-of-range line 6, column "energising_time"',
    ),
    "pressure of zero": (
        InputError,
        "",
        MAP.replace("40,300", "0,300"),
        'out-of-range line 3, column "rail_pressure"',
    ),
    "pressure beyond": (
        ConfigurationError,
        "",
        MAP.replace("80,700", "8000,700"),
        "out-of-range line 6",
    ),
    "tolerance": (InputError, 'absolute = "0 mm3"', MAP, "out-of-range data[1]"),
    "tolerance beyond": (
        ConfigurationError,
        'absolute = "4e+24 m3"',
        MAP,
        "out-of-range data[1]",
    ),
    "missing column": (
        InputError,
        "",
        MAP.replace("quantity [mm3]", "Flow"),
        'missing-column column "quantity"',
    ),
    "no rows": (
        InputError,
        "",
        MAP[: MAP.index("40,300")],
        "too-few",
    ),
    "rate key": (
        InputError,
        'window = ["0 us", "1 us"]',
        MAP,
        "key-of-other-form data[1]",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(load: Load, fault: str) -> None:
    kind, keys, table, message = FAULTS[fault]
    with refused(kind, message):
        load(keys, table)


def test_an_injector_that_needs_a_measured_drive(
    load: Load, tmp_path: Path, injector_file: Callable[..., Path]
) -> None:
    injector_file(('"regulated"', '"voltage trace"'))
    with refused(ConfigurationError, "drive-kind data[1]"):
        load(injector="mine.toml")
