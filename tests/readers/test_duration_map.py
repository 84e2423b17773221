"""Maps of energising times over pressure and quantity, in all forms that they come in, are points of a quantity map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.base.units import convert
from commonrail.data.quantities.reading import found_table
from commonrail.readers.columns import PLAIN
from commonrail.readers.quantity_matrix import FoundMap, GivenUnits, NearMap
from commonrail.readers.tables import read_found_map

PRESSURES, QUANTITIES = (20.0, 80.0, 160.0), (2.0, 10.0, 40.0)
TIMES = [[460.0, 280.0, 240.0], [930.0, 520.0, 400.0], [2700.0, 1400.0, 1030.0]]  # [us], a row for each quantity


def matrix(corner: str, times: list[list[float]] = TIMES, above: str = "", sign: str = "") -> str:
    head = ",".join([corner, *(f"{p:g}{sign}" for p in PRESSURES)])
    return (
        above
        + "\n".join([head, *(",".join(map(str, [q, *row])) for q, row in zip(QUANTITIES, times, strict=True))])
        + "\n"
    )


def rows(times: list[list[float]], state: str = "reached") -> str:
    lines = [
        f"{p:g},{q:g},{times[j][i]:g},{state if (i, j) == (0, 2) else 'reached'}"
        for i, p in enumerate(PRESSURES)
        for j, q in enumerate(QUANTITIES)
    ]
    return "\n".join(["p [MPa],q [mm3],et [us],state", *lines]) + "\n"


def read(tmp_path: Path, text: str, given: GivenUnits = GivenUnits()) -> FoundMap:
    path = tmp_path / "map.csv"
    path.write_text(text, encoding="utf-8")
    return read_found_map(path, PLAIN, given)


@pytest.mark.parametrize(
    ("text", "given"),
    [
        (matrix("quantity [mm3] / rail pressure [MPa]", above="# energising time [us]\n"), GivenUnits()),
        (matrix("mm3\\MPa"), GivenUnits(time="us")),
        (matrix("mm3/stroke", sign=" MPa"), GivenUnits(time="us")),
        (matrix("", sign=""), GivenUnits("MPa", "us", "mm3")),
        (rows(TIMES), GivenUnits()),
    ],
)
def test_each_cell_is_a_point(tmp_path: Path, text: str, given: GivenUnits) -> None:
    found = read(tmp_path, text, given)
    assert found.durations
    points = zip(found.rail_pressure.tolist(), found.quantity.tolist(), found.energising_time.tolist(), strict=True)
    assert {(p, q): t for p, q, t in points} == {
        (p, q): TIMES[j][i] for i, p in enumerate(PRESSURES) for j, q in enumerate(QUANTITIES)
    }


def test_a_table_of_quantities_stays_one(tmp_path: Path) -> None:
    quantities = [[1.0, 4.0, 8.0], [5.0, 20.0, 30.0], [20.0, 60.0, 80.0]]
    head = "p [MPa],et [us],q [mm3]"
    lines = [
        f"{p:g},{t:g},{quantities[j][i]:g}" for i, p in enumerate(PRESSURES) for j, t in enumerate((300, 600, 900))
    ]
    assert not read(tmp_path, "\n".join([head, *lines]) + "\n").durations
    text = "x,20,80,160\n300,1,4,8\n600,5,20,30\n900,20,60,80\n"
    assert not read(tmp_path, text, GivenUnits("MPa", "us", "mm3")).durations


def test_cells_without_a_quantity_of_their_own_are_omitted_and_told(tmp_path: Path) -> None:
    clipped = [[0.0, 280.0, 240.0], [1000.0, 520.0, 400.0], [1000.0, 1400.0, 1030.0]]
    for text in (matrix("mm3\\MPa", clipped), rows(clipped)):
        found = read(tmp_path, text, GivenUnits(time="us"))
        assert len(found.quantity) == 6
        assert sum("omitted" in said for said in found.said) == 2


def test_cells_that_the_product_extrapolated_are_omitted(tmp_path: Path) -> None:
    assert len(read(tmp_path, rows(TIMES, "unreachable")).quantity) == 8
    note = "# rules; longest simulated energising time: 2000 us\n# energising time [us]\n"
    assert read(tmp_path, matrix("q [mm3] / p [MPa]", above=note)).energising_time.max() == 1400.0


def test_a_crank_angle_is_a_time_at_its_engine_speed(tmp_path: Path) -> None:
    angles = (np.array(TIMES) * 12e-3).tolist()  # degrees at 2000 rpm
    text = matrix("mm3\\MPa", angles)
    path = tmp_path / "map.csv"
    with pytest.raises(InputError):
        read(tmp_path, text, GivenUnits(time="°CA"))
    with pytest.warns(RuntimeWarning):  # the note on what it was read as
        table = found_table(path, PLAIN, GivenUnits(time="°CA@2000rpm"), "quantity", matrix=True)
    np.testing.assert_allclose(sorted(table.columns["energising_time"]), sorted(np.ravel(TIMES) * 1e-6))


def test_units_in_capitals_are_read(tmp_path: Path) -> None:
    found = read(tmp_path, matrix("mm3\\PSI").replace(",20,80,160", ",2901,11603,23206"), GivenUnits(time="us"))
    assert sorted({*convert(found.rail_pressure, found.units["rail pressure"], "MPa").round(1).tolist()}) == [
        20,
        80,
        160,
    ]


def test_a_matrix_that_lacks_a_unit_alone_is_near_to_a_map(tmp_path: Path) -> None:
    with pytest.raises(NearMap):
        read(tmp_path, matrix("mm3\\MPa"))


def test_numbers_that_no_order_of_the_axes_explains_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read(tmp_path, matrix("", [[9e5] * 3] * 3), GivenUnits("MPa", "us", "mm3"))
