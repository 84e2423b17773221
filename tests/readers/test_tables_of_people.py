"""Tables as people have them: one reader for every verb, formats by their first bytes, headings, heads and notes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.base.units import parse
from commonrail.data.quantities.reading import map_columns
from commonrail.physics.law import Domain
from commonrail.plugins.fleet.study import read_table
from commonrail.plugins.maps.difference import read_measured_map
from commonrail.plugins.observer.file import LogColumns, read_log
from commonrail.plugins.plans.study import load_plan
from commonrail.plugins.prediction.file import read_points
from commonrail.readers.columns import Column, name_and_unit
from commonrail.readers.formats import find_format
from commonrail.readers.grid import read_grid
from commonrail.readers.overview import survey
from commonrail.readers.quantity_matrix import GivenUnits, NearMap, find_map
from commonrail.readers.tables import open_sheet, read_columns, read_found_map
from tests.refused import refused

PLAN = "Prüfpunkt;Raildruck (bar);Ansteuerdauer [µs];Soll [mm³/Hub];Toleranz [mm³/H];Ist [mm³/Hub]\n"
PLAN += "VL;1600;900;60,5;5,5;58,2\nLL;300;650;3,4;1,8;3,1\n"
POINTS = "Raildruck [bar];Ansteuerdauer [µs];Menge [mm³/Hub]\n1600;1350;101,9\n600;700;27,6\n"
LOG = "Zeit [ms];Raildruck [bar];Ansteuerung [V]\n"
LOG += "0,00;1200,5;0\n0,02;1200,1;5\n0,04;1199,9;5\n0,06;1200,2;0\n0,08;1200;0\n"
HEAD = "ti (us);400 bar;800 bar;1200 bar\n"
MAP = HEAD + "200;0,5;1,2;2,0\n400;4,1;9,8;14,9\n600;11,2;20,3;28,1\n"
SI = [Column("rail_pressure", "Pa"), Column("energising_time", "s"), Column("quantity", ("m3", "kg"))]


def log_pressure(path: Path) -> float:
    return float(read_log(path, LogColumns()).pressure[0])


READERS: dict[str, tuple[str, Callable[[Path], Any], Any]] = {
    "plan": (PLAN, lambda path: load_plan(path).tests[0].nominal, 60.5e-9),
    "adapt": (POINTS, lambda path: map_columns(path, SI).columns["quantity"][0], 101.9e-9),
    "predict": (POINTS, lambda path: read_points(path)[0][1], 1.35e-3),
    "map": (POINTS, lambda path: read_measured_map(path, 800.0).volume[0], 101.9e-9),
    "a matrix for adapt": ("Menge [mm³]\n" + MAP, lambda path: map_columns(path, SI).columns["quantity"][-1], 28.1e-9),
    "observe": (LOG, log_pressure, 1200.5e5),
}


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-16"])
@pytest.mark.parametrize("verb", READERS)
def test_every_verb_reads_a_german_text(tmp_path: Path, verb: str, encoding: str) -> None:
    text, read, value = READERS[verb]
    path = tmp_path / "a.txt"
    path.write_bytes(text.encode(encoding))
    assert read(path) == pytest.approx(value)


def test_rows_of_a_fleet_are_passed_on_with_decimal_points(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("injector;p [bar];q [mm3]\n007;1200;1,5\n", encoding="utf-8")
    assert read_table(path).cells(np.array([0])) == [["007", "1200", "1.5"]]


FIRST_BYTES = {
    b"MDF     3.30": "mf4",
    b"LabVIEW Measurement\t": "lvm",
    b"PAR1": "parquet",
    b"MATLAB 5.0 MAT-file": "mat",
    b"time [us],rate\n": "dat",
}


@pytest.mark.parametrize("first", FIRST_BYTES)
def test_a_format_is_told_by_its_first_bytes(tmp_path: Path, first: bytes) -> None:
    (tmp_path / "rec.dat").write_bytes(first)
    assert find_format(tmp_path / "rec.dat") == FIRST_BYTES[first]


@pytest.mark.parametrize(
    "first",
    [
        b"\x89HDF\r\n\x1a\n\0\0",
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1\0",
        b"\x93NUMPY\x01\0",
        b"DIAEXTENDED  {@:ENGLISH\n",
        b"\0\x01\x02\x03" * 20,
        b"archive",
    ],
)
def test_what_is_not_read_says_so_whatever_its_name(tmp_path: Path, first: bytes) -> None:
    path = tmp_path / "rec.csv"
    path.write_bytes(first)
    if first == b"archive":
        with ZipFile(path, "w") as archive:
            archive.writestr("a.csv", "x,y\n")
    for read in (survey, open_sheet):
        with refused(InputError, "unknown-format"):
            read(path)


@pytest.mark.parametrize(
    ("cell", "expected"),
    [
        ("ROI (mm3/ms)", ("ROI", "mm3/ms")),
        ("Time(S)", ("Time", "s")),
        ("ET us", ("ET", "us")),
        ("p / Bar", ("p", "Bar")),
        ("p [bar(g)]", ("p", "bar(g)")),
        ("400 bar", ("400 bar", "")),
        ("Channel A", ("Channel A", "")),
        ("mm3/ms", ("mm3/ms", "")),
    ],
)
def test_units_of_headings(cell: str, expected: tuple[str, str]) -> None:
    assert name_and_unit(cell) == expected


def test_words_and_references_of_units() -> None:
    assert (parse("2 second", "s"), parse("3 Volt", "V"), parse("2 mm3/H", "m3")) == (2.0, 3.0, pytest.approx(2e-9))
    assert parse("10 bar abs", "Pa") == 1e6
    assert parse("10 bar(g)", "Pa") == pytest.approx(1e6 + 101325.0)


def test_two_header_rows_and_a_unit_row_are_one_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("bench 3\nstart;duration\n(ms);(ms)\n5,0;0,7\n6;0,8\n", encoding="utf-8")
    table = read_columns(path, [Column("start", "s"), Column("duration", "s", domain=Domain.POSITIVE)], 1)
    assert table.columns["duration"].tolist() == pytest.approx([0.7e-3, 0.8e-3])
    path.write_text(";rail;rail\nt;a;b\ns;bar;bar\n0;1;2\n1;3;4\n", encoding="utf-8")
    path.write_text("t;p;p\n;in;out\ns;bar;bar\n0;1;2\n1;3;4\n", encoding="utf-8")
    assert list(open_sheet(path).names) == ["t", "p in", "p out"]


def test_a_preamble_of_an_instrument_is_not_the_header(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{i}e-6,{i}.5\n" for i in range(20))
    path.write_text("Record Length,20\nHorizontal Units,s\nVertical Units,V\nTIME,CH1\n" + rows, encoding="utf-8")
    sheet = open_sheet(path)
    assert read_columns(path, [Column("time", "s"), Column("CH1", "V")]).columns["CH1"][-1] == 19.5
    assert list(sheet.names) == ["TIME", "CH1"]


def test_a_matrix_with_units_in_its_heads_takes_no_data_for_its_axis(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(MAP, encoding="utf-8")
    with pytest.raises(NearMap, match=r"\bunit\b.*\bquantity\b"):
        find_map(read_grid(path))
    assert re.search(r"\bunit\b.*\bquantity\b", survey(path).facts["reason"])
    found = read_found_map(path, given_units=GivenUnits("bar", "us", "mm3"))
    assert np.unique(found.rail_pressure).tolist() == [400, 800, 1200]
    assert np.unique(found.energising_time).tolist() == [200, 400, 600]
    path.write_text(MAP.replace(" bar", "x"), encoding="utf-8")
    with refused(InputError, "no-axis"):
        read_found_map(path, given_units=GivenUnits("bar", "us", "mm3"))


@pytest.mark.parametrize("change", [("600;", "Mittel;"), ("200;0,5;", "200;gut;")])
def test_a_mean_row_and_a_label_column_are_the_reason(tmp_path: Path, change: tuple[str, str]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Menge [mm3]\n" + MAP.replace(*change), encoding="utf-8")
    assert change[1].split(";")[-2] in survey(path).facts["reason"]
    path.write_text("Punkt;" + MAP.replace("\n", "\nP;", 3), encoding="utf-8")
    assert "Punkt" in survey(path).facts["reason"]


def test_merged_cells_are_filled_inside_their_range(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    book = openpyxl.Workbook()
    sheet = book.active
    rows = [
        ["Bericht"],
        ["Raildruck [bar]", "ET [µs]", "Menge [mm³]"],
        [400, 200, 1.5],
        [None, 300, 2.5],
        [800, 200, 3.5],
        [None, 300, 4.5],
    ]
    for row in rows:
        sheet.append(row)
    for place in ("A1:C1", "A3:A4", "A5:A6"):
        sheet.merge_cells(place)
    book.save(tmp_path / "a.xlsm")
    found = read_found_map(tmp_path / "a.xlsm")
    assert found.rail_pressure.tolist() == [400, 400, 800, 800]
    book = openpyxl.Workbook()
    for row in (["ET", "400 bar", None, "800 bar"], [None, "Menge", "Rücklauf", "Menge", "Rücklauf"]):
        book.active.append(row)
    for row in (["µs", *["mm³/Hub"] * 4], [200, 1, 7, 2, 7], [300, 3, 7, 4, 7]):
        book.active.append(row)
    book.active.merge_cells("B1:C1")
    book.active.merge_cells("D1:E1")
    book.save(tmp_path / "b.xlsx")
    assert read_found_map(tmp_path / "b.xlsx").quantity.tolist() == [1, 2, 3, 4]


def test_notes_of_the_bench_above_a_map_are_read_and_are_no_units_of_it(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    notes = "Gegendruck;50;bar\nRücklaufdruck [MPa]: 0,1\n# Kraftstofftemperatur 40 °C\nMenge [mm3]\n"
    path.write_text(notes + MAP, encoding="utf-8")
    found = read_found_map(path)
    read = {key: parse(text, "K" if "temp" in key else "Pa") for key, text in found.notes.items()}
    assert read == pytest.approx({"cylinder_pressure": 5e6, "return_pressure": 1e5, "fuel_temperature": 313.15})
    assert found.units["rail pressure"] == "bar"


def test_numbers_beside_the_settings_of_an_instrument_are_a_time_and_a_channel(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    settings = ["Record Length,2.4e1,", "Source,CH1,", "Vertical Units,V,", *[",,"] * 21]
    path.write_text("".join(f"{text}, {i}e-6, {i}.5,\n" for i, text in enumerate(settings)), encoding="utf-8")
    assert read_columns(path, [Column("CH1", "V")]).columns["CH1"][:2].tolist() == [0.5, 1.5]


def test_units_in_the_heads_of_the_rows_are_those_of_the_axis_down(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("Menge [mm3];400;800\n200 us;0,5;1,2\n400 us;4,1;9,8\n", encoding="utf-8")
    found = read_found_map(path, given_units=GivenUnits(pressure="bar"))
    assert found.values["energising time"].tolist() == [200, 200, 400, 400]
    assert found.rail_pressure.tolist() == [400, 800, 400, 800]
