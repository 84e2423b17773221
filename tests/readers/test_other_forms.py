"""Columns of workbooks, Parquet and texts in other forms than UTF-8 with decimal points."""

from __future__ import annotations

import random
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.data.quantities.reading import found_table
from commonrail.readers.columns import PLAIN, Column, FileForm, Table
from commonrail.readers.grid import read_grid
from commonrail.readers.overview import survey
from commonrail.readers.quantity_matrix import GivenUnits, find_map
from commonrail.readers.tables import read_columns
from tests.refused import refused

WANTED = [Column("time", "s", increasing=True), Column("rate", ("m3/s", "kg/s"))]
GERMAN = "time [µs];rate [mm³/ms]\r\n" + "".join(f"{3 * i};{i},5\r\n" for i in range(5))


def check(found: Table) -> None:
    np.testing.assert_allclose(found.columns["time"], 3e-6 * np.arange(5))
    np.testing.assert_allclose(found.columns["rate"], 1e-6 * (np.arange(5) + 0.5))


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-8"])
def test_stated_encoding_and_decimal_comma(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(GERMAN.encode(encoding))
    check(read_columns(path, WANTED, form=FileForm(encoding, ",")))


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16", "utf-16-le", "utf-8"])
def test_an_unstated_form_is_detected(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(GERMAN.encode(encoding))
    check(read_columns(path, WANTED))
    with refused(InputError, "wrong-encoding"):
        read_columns(path, WANTED, form=FileForm("ascii", ","))


def test_a_point_among_decimal_commas_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(GERMAN.replace("3,5", "3.5"), encoding="utf-8")
    with refused(InputError, "mixed-decimals"):
        read_columns(path, WANTED, form=FileForm(decimal=","))


MAP_COLUMNS = [Column("p", "Pa"), Column("t", "s"), Column("q", "m3")]
MAP_HEAD = "p [bar];t [us];q [mm3]\n"


def test_a_point_that_may_separate_thousands_is_refused_until_the_sign_is_stated(tmp_path: Path) -> None:
    """A German bench writes 1.200 for twelve hundred, which would be read as 1.2."""
    path = tmp_path / "a.csv"
    path.write_text(MAP_HEAD + "1.200;350;35\n1.400;350;41\n", encoding="utf-8")
    for read in (lambda: read_columns(path, MAP_COLUMNS, 1), lambda: read_grid(path)):
        with refused(InputError, "open-decimal line 2"):
            read()
    point = FileForm(decimal=".")
    assert read_columns(path, MAP_COLUMNS, 1, form=point).columns["p"] == pytest.approx([1.2e5, 1.4e5])
    assert read_grid(path, point).rows[1][0] == 1.2


@pytest.mark.parametrize("rows", ["120.000;350.000;35.125\n", "120.500;350;35.125\n9.000;350;0.125\n", "1.20;350;35\n"])
def test_decimals_that_are_surely_decimals_are_read(tmp_path: Path, rows: str) -> None:
    """All numbers have three, one is below 1, or they are not three."""
    path = tmp_path / "a.csv"
    path.write_text(MAP_HEAD + rows, encoding="utf-8")
    first = [float(cell) for cell in rows.splitlines()[0].split(";")]
    assert read_columns(path, MAP_COLUMNS, 1).columns["q"][0] == pytest.approx(1e-9 * first[2])
    assert list(read_grid(path).rows[1]) == first


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_spaces_that_do_not_break_are_spaces(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes("p [bar],t\u00a0[us],q [mm3]\n\u00a01200,350\u00a0,35.5\n".encode(encoding))
    form = FileForm(encoding)
    found = read_columns(path, MAP_COLUMNS, 1, form=form).columns
    assert (found["p"][0], found["t"][0], found["q"][0]) == pytest.approx((1.2e8, 350e-6, 35.5e-9))
    path.write_bytes("p [bar],t [us],q [mm3]\n1\u00a0200,350,35.5\n".encode(encoding))
    with refused(InputError, 'space line 2, column "p"'):
        read_columns(path, MAP_COLUMNS, 1, form=form)


@pytest.mark.parametrize("units", ["header", "row below"])
def test_a_sheet_has_its_header_below_other_texts(tmp_path: Path, units: str) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    book = openpyxl.Workbook()
    sheet = book.create_sheet("run 2")
    sheet.append(["Injector 17"])
    sheet.append(["time [us]", "rate [mm3/ms]"] if units == "header" else ["time", "rate"])
    if units != "header":
        sheet.append(["us", "mm3/ms"])
    for i in range(5):
        sheet.append([3 * i, i + 0.5])
    book.save(tmp_path / "a.xlsx")
    check(read_columns(tmp_path / "a.xlsx", WANTED))
    assert read_columns(tmp_path / "a.xlsx", WANTED).comments == ("Injector 17",)
    with pytest.raises(InputError, match='sheet "run 3"'):
        read_columns(tmp_path / "a.xlsx", WANTED, form=FileForm(sheet="run 3"))
    sheet.append([20, "n/a"])
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r'row \d, column "rate": "n/a"'):
        read_columns(tmp_path / "a.xlsx", WANTED)


def spoilt_book(path: Path, change: Callable[[bytes], bytes]) -> Path:
    """A workbook whose sheet, as XML, was changed."""
    openpyxl = pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    book = openpyxl.Workbook()
    for row in (["time [us]", "rate [mm3/ms]"], *([3 * i, i + 0.5] for i in range(5))):
        book.active.append(row)
    book.save(path.with_name("whole.xlsx"))
    with ZipFile(path.with_name("whole.xlsx")) as whole, ZipFile(path, "w") as spoilt:
        for name in whole.namelist():
            data = whole.read(name)
            spoilt.writestr(name, change(data) if name.endswith("sheet1.xml") else data)
    return path


def test_a_sheet_that_understates_its_size_is_read_whole(tmp_path: Path) -> None:
    check(read_columns(spoilt_book(tmp_path / "a.xlsx", lambda xml: xml.replace(b"A1:B6", b"A1:A3")), WANTED))


def test_what_openpyxl_says_of_a_book_is_not_said_to_the_user(tmp_path: Path) -> None:
    extended = b'<extLst><ext uri="{x}"/></extLst></worksheet>'
    path = spoilt_book(tmp_path / "a.xlsx", lambda xml: xml.replace(b"</worksheet>", extended))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        check(read_columns(path, WANTED))
    assert [str(one.message) for one in told] == []


@pytest.mark.parametrize(
    ("was", "becomes", "sentence"),
    [
        (b"<v>9</v>", b"<v>x</v>", r'"Sheet" .*\(ValueError\)'),
        (b"<v>9</v>", b"<v>1" + 400 * b"0" + b"</v>", r'"Sheet" .*\(OverflowError\)'),
        (b"<v>9</v>", b"<v>1e999</v>", r'row 5, column "time": "inf"'),
        (b"</sheetData>", b"", r'"Sheet" .*\(ParseError\)'),
        (b'"B6"', b'"AMX6"', "1038 columns, .*1000"),
        (b'<row r="6"', b'<row r="9999999"', "1048576 rows"),
    ],
)
def test_a_spoilt_sheet_is_one_sentence(tmp_path: Path, was: bytes, becomes: bytes, sentence: str) -> None:
    path = spoilt_book(tmp_path / "a.xlsx", lambda xml: xml.replace(was, becomes))
    with pytest.raises(InputError, match=sentence):
        read_columns(path, WANTED)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("rate [mm3/ms],time [us]\n0," + "9" * 200_000, "line-too-long line 2"),
        ("mm3\nrail pressure [bar] \\ energising time [us],300,500\n800,,\n1200,,\n", "empty"),
    ],
)
def test_a_grid_that_cannot_be_used_is_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    with refused(InputError, sentence):
        find_map(read_grid(tmp_path / "a.csv"))


def test_parquet_has_its_units_in_the_names(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="the extra fleet is not installed")
    from pyarrow import parquet

    columns = {"time [us]": 3.0 * np.arange(5), "rate [mm3/ms]": np.arange(5) + 0.5}
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    check(read_columns(tmp_path / "a.parquet", WANTED))
    columns["rate [mm3/ms]"][2] = np.nan
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    with refused(InputError, 'not-finite row 3, column "rate"'):
        read_columns(tmp_path / "a.parquet", WANTED)


def test_a_map_in_parquet_is_found_by_its_units(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="the extra fleet is not installed")
    from pyarrow import parquet

    path = tmp_path / "map.parquet"
    columns = {"p [bar]": [400, 800], "T [K]": [300.0, 300.0], "ET [us]": [300.0, 300.0], "q [mm3]": [1.5, None]}
    parquet.write_table(pyarrow.table(columns), path)
    found = survey(path)
    assert re.match("a quantity map: .*row", found.taken_for)
    assert found.block["layout"] == "found"
    assert "1 without" in found.said
    table = found_table(path, PLAIN, GivenUnits(), "quantity", matrix=False)
    assert table.columns["rail_pressure"].tolist() == pytest.approx([40e6])
    assert table.columns["quantity"].tolist() == pytest.approx([1.5e-9])
    with refused(InputError, "no-matrix"):
        found_table(path, PLAIN, GivenUnits(), "quantity", matrix=True)
    columns["q1 [mm3]"] = columns.pop("q [mm3]")
    parquet.write_table(pyarrow.table({**columns, "q2 [mg]": [1.0, 2.0]}), path)
    assert '"q1" and "q2"' in survey(path).facts["no map"]


def test_numbers_that_a_workbook_has_as_texts_with_commas_are_read_and_names_stay_texts(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    book = openpyxl.Workbook()
    for row in (["part", "rate [mg/ms]"], ["0012", "0,17"], ["0013", 12], ["0014", "3"], ["0015", "-1,5"]):
        book.active.append(row)
    book.save(tmp_path / "a.xlsx")
    table = read_columns(tmp_path / "a.xlsx", [Column("part"), Column("rate", "kg/s")])
    assert table.texts["part"] == ["0012", "0013", "0014", "0015"]
    np.testing.assert_allclose(table.columns["rate"], [0.17e-3, 12e-3, 3e-3, -1.5e-3])
    book.active.append(["0016", "1.5"])
    book.save(tmp_path / "a.xlsx")
    with refused(InputError, "mixed-decimals"):
        read_columns(tmp_path / "a.xlsx", [Column("part"), Column("rate", "kg/s")])


def test_comments_and_empty_lines_are_passed_over_and_lines_keep_their_numbers(tmp_path: Path) -> None:
    rng = random.Random(1)
    kinds = [
        "",
        "  ",
        "\x0c",
        "\u2003\t",
        "# note",
        " \t# note",
        "\x1c#",
        "1,2",
        "  3,4",
        "\u20035,#6",
        "7,8 # no note",
    ]
    lines = ["time [us],rate [mm3/ms]", *(rng.choice(kinds) for _ in range(3000))]
    path = tmp_path / "notes.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    grid = read_grid(path)
    expected = [number for number, line in enumerate(lines, 1) if line.strip() and line.strip()[0] != "#"]
    assert list(grid.lines) == expected
    notes = [line.strip()[1:].strip() for line in lines if line.strip().startswith("#")]
    assert list(grid.comments) == notes[:1000]


POINTS, TRACE = "rail_pressure [bar],energising_time [us],quantity [mm3]\n", "time [us],rate [mm3/ms]\n"


@pytest.mark.parametrize(
    "text",
    [
        POINTS + "400,300,1.5\n400,500,1,77\n",
        "p,t,q,,\nbar,us,mm3,,\n400,300,1.5,,\n400,500,1,77,\n",
        TRACE + "0,1\n1,1.5\n2,1,77\n",
    ],
)
def test_a_decimal_comma_between_commas_is_refused_with_its_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8")
    line = len(text.splitlines())
    with refused(InputError, f"row-too-long line {line}", "a.csv"):
        survey(path)
    if text.startswith(("rail", "p")):
        with refused(InputError, f"row-too-long line {line}"):
            found_table(path, PLAIN, GivenUnits(), "quantity", matrix=False)


@pytest.mark.parametrize("head", [POINTS, "p,t,q,remark\nbar,us,mm3,\n"])
def test_empty_cells_behind_the_last_column_and_remarks_below_a_name_are_no_fault(tmp_path: Path, head: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(head + "400,300,1.5,,\n400,500,1.77,\n", encoding="utf-8")
    assert find_map(read_grid(path)).quantity.tolist() == [1.5, 1.77]
    if "remark" in head:
        path.write_text(head + "400,300,1.5,good\n400,500,1.77\n", encoding="utf-8")
        assert find_map(read_grid(path)).quantity.tolist() == [1.5, 1.77]
