"""Measured maps as they come: encodings, decimal signs, matrices either way round, units in several places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.maps.difference import in_si, read_measured_map
from commonrail.plugins.maps.file import write_map_file
from commonrail.readers.columns import FileForm
from commonrail.readers.grid import read_grid
from commonrail.readers.quantity_matrix import FoundMap, GivenUnits, find_map
from tests.plugins.maps.tables import table

# Quantities [mm³] at 30 and 50 MPa (rows) and 400, 800.5, 1200 us (columns).
DOWN = "p [MPa] \\ ET [us];400;800.5;1200\n30;1.5;10.25;20\n50;2.5;15;30.75\n"
ACROSS = "ET [us] \\ p [MPa];30;50\n400;1.5;2.5\n800.5;10.25;15\n1200;20;30.75\n"
QUANTITY = "quantity [mm3]\n"
LONG = "ET [us],p [MPa],Q [mm3]\n400,30,1.5\n800.5,30,10.25\n1200,30,20\n400,50,2.5\n800.5,50,15\n1200,50,30.75\n"


def found(tmp_path: Path, text: str, encoding: str = "utf-8", given: GivenUnits = GivenUnits()) -> FoundMap:
    path = tmp_path / "map.csv"
    path.write_bytes(text.encode(encoding))
    return find_map(read_grid(path), given)


def check(read: FoundMap) -> None:
    """The six quantities at their points, in whatever order they are read."""
    measured = in_si(read, 800.0)
    order = np.lexsort((measured.energising_time, measured.rail_pressure))
    assert measured.rail_pressure[order].tolist() == pytest.approx([30e6] * 3 + [50e6] * 3)
    assert measured.energising_time[order].tolist() == pytest.approx([400e-6, 800.5e-6, 1200e-6] * 2)
    assert measured.volume[order].tolist() == pytest.approx([1.5e-9, 10.25e-9, 20e-9, 2.5e-9, 15e-9, 30.75e-9])


@pytest.mark.parametrize("text", [QUANTITY + DOWN, QUANTITY + ACROSS, LONG, LONG.replace(",", "\t")])
def test_a_map_is_read_whichever_way_it_is_written(tmp_path: Path, text: str) -> None:
    check(found(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le", "utf-16-be"])
def test_encodings_are_detected_and_said(tmp_path: Path, encoding: str) -> None:
    read = found(tmp_path, "Menge [mm³], gemessen über µs\n" + DOWN.replace("us", "µs"), encoding)
    check(read)
    assert any("encoding" in said for said in read.said)
    if encoding == "cp1252":
        assert "encoding cp1252" in read.said


def test_decimal_commas_are_detected_and_said(tmp_path: Path) -> None:
    read = found(tmp_path, QUANTITY + DOWN.replace(".", ","))
    check(read)
    assert {"decimal comma", "separated by semicolons"} <= set(read.said)


def test_points_and_commas_together_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'"800\.5"'):
        found(tmp_path, QUANTITY + DOWN.replace("10.25", "10,25"))


def test_axes_without_names_are_told_by_what_makes_sense(tmp_path: Path) -> None:
    """30 and 50 are no energising times in microseconds of 5 or more only where the others are no pressures."""
    text = "quantity [mm3] over MPa and µs\n;400;800.5;1200\n30;1.5;10.25;20\n50;2.5;15;30.75\n"
    check(found(tmp_path, text, given=GivenUnits("MPa", "us")))


def test_axes_that_could_be_either_are_refused(tmp_path: Path) -> None:
    text = "quantity [mm3]\n;100;200\n100;1;2\n200;3;4\n"
    with pytest.raises(InputError, match="rail pressure"):
        found(tmp_path, text, given=GivenUnits("MPa", "us"))


def test_missing_units_are_named_and_can_be_given(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\bunit\b.*\bquantity\b"):
        found(tmp_path, DOWN)
    check(found(tmp_path, DOWN, given=GivenUnits(quantity="mm3")))


def test_empty_cells_are_omitted_and_said(tmp_path: Path) -> None:
    read = found(tmp_path, QUANTITY + DOWN.replace("10.25", ""))
    assert len(read.quantity) == 5
    assert "1 without" in read.said[-1]


def test_points_without_a_quantity_are_omitted_and_said(tmp_path: Path) -> None:
    read = found(tmp_path, LONG.replace("10.25", ""))
    assert len(read.quantity) == 5
    assert "1 without" in read.said[-1]


def test_masses_are_divided_by_the_density(tmp_path: Path) -> None:
    read = found(tmp_path, LONG.replace("mm3", "mg"))
    assert read.units["quantity"] == "mg"
    assert in_si(read, 800.0).volume[0] == pytest.approx(1.5e-6 / 800.0)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("a,b\nc,d\n", "no rows"),
        (QUANTITY + DOWN + "text;1;2;3\n", "line 5: "),
        (QUANTITY + DOWN + "60;1;2;3;4\n", "line 5: "),
        (LONG + "400,x,1\n", "line 8"),
        ("", "no rows"),
    ],
)
def test_what_is_no_map_is_refused_with_its_line(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(InputError, match=word):
        found(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("rail pressure in bar\n" + QUANTITY + DOWN, '"MPa" and "bar" of the rail pressure'),
        ("quantity [mg]\n" + QUANTITY + DOWN, '"mg" and "mm3" of the quantity'),
        ("energising time [ms]\n" + QUANTITY + ACROSS, '"us" and "ms" of the energising time'),
    ],
)
def test_units_that_contradict_each_other_are_refused_and_can_be_stated(tmp_path: Path, text: str, units: str) -> None:
    with pytest.raises(InputError, match=units):
        found(tmp_path, text)
    check(found(tmp_path, text, given=GivenUnits("MPa", "us", "mm3")))


@pytest.mark.parametrize("more", ["Menge in mm³\n", "# reference density 820 kg/m3\n", "quantity [mm^3]\n"])
def test_the_same_unit_twice_and_remarks_are_no_contradiction(tmp_path: Path, more: str) -> None:
    check(found(tmp_path, more + QUANTITY + DOWN))


@pytest.mark.parametrize(
    "text", ["p [bar] \\ ET [us];400;800\n500;1;2\n1.200;3;4\n", "ET [us] \\ p [bar];500;1.200\n400;1;3\n800;2;4\n"]
)
def test_points_that_separate_thousands_beside_hundreds_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(InputError, match=r'line \d: "1\.200" .*\b1200\b'):
        found(tmp_path, QUANTITY + text)
    assert 1.2e8 in in_si(found(tmp_path, QUANTITY + text.replace("1.200", "1200")), 1.0).rail_pressure


def test_three_decimals_throughout_are_read(tmp_path: Path) -> None:
    read = found(tmp_path, QUANTITY + "p [MPa] \\ ET [ms];1.250;2.500\n40.000;1.125;2.225\n")
    assert read.energising_time.tolist() == [1.25, 2.5]


def test_an_unknown_encoding_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.csv"
    path.write_text(LONG)
    with pytest.raises(InputError, match="utf-99"):
        read_grid(path, FileForm("utf-99"))
    path.write_bytes(b"\xff\xfe1")
    with pytest.raises(InputError, match=r"map\.csv: "):
        read_grid(path)


def test_a_workbook_is_read_as_a_map(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [excel] is not installed")
    book = openpyxl.Workbook()
    book.create_sheet("map")
    for row in (
        (QUANTITY.strip(),),
        ("p [MPa] \\ ET [us]", 400, 800.5, 1200),
        (30, 1.5, 10.25, 20),
        (50, 2.5, 15, 30.75),
    ):
        book["map"].append(row)
    path = tmp_path / "bench.xlsx"
    book.save(path)
    read = find_map(read_grid(path))
    check(read)
    assert 'sheet "map"' in read.said  # the first one is empty
    with pytest.raises(InputError, match=r'"mapp".*"map"'):
        read_grid(path, FileForm(sheet="mapp"))


def test_a_damaged_workbook_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl", reason="the extra [excel] is not installed")
    path = tmp_path / "bench.xlsx"
    path.write_bytes(b"PK\x03\x04 no workbook")
    with pytest.raises(InputError, match=r"bench\.xlsx: "):
        read_grid(path)


def test_what_the_program_writes_is_read_back_as_a_map(tmp_path: Path) -> None:
    """The long CSV of an inverse map has a pressure, a quantity and a time in each row."""
    own = table()
    write_map_file(tmp_path / "et.csv", [own])
    read = read_measured_map(tmp_path / "et.csv", 800.0)
    assert len(read.volume) == 2 * own.x.values.size  # the first quantity is zero
    assert read.energising_time.max() == pytest.approx(own.values.max() * 1e-6)
