"""Columns of workbooks, Parquet and texts in other forms than UTF-8 with decimal points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.errors import InputError
from commonrail.reading.file_form import FileForm
from commonrail.reading.tables import Column, Table, read_columns

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


def test_an_unstated_form_names_its_cure(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(GERMAN.encode("utf-16"))
    with pytest.raises(InputError, match='this is UTF-16 text; state encoding = "utf-16"'):
        read_columns(path, WANTED)
    path.write_bytes(GERMAN.encode("cp1252"))
    with pytest.raises(InputError, match="line 1: byte 0xb5 is not UTF-8 text; save the file as UTF-8, or state"):
        read_columns(path, WANTED)
    path.write_bytes(GERMAN.encode())
    with pytest.raises(InputError, match='"0,5" has a decimal comma; write the decimal sign as a point, or state'):
        read_columns(path, WANTED)
    with pytest.raises(InputError, match="this is no text in ascii; correct the encoding"):
        read_columns(path, WANTED, form=FileForm("ascii", ","))


def test_a_point_among_decimal_commas_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text(GERMAN.replace("3,5", "3.5"), encoding="utf-8")
    with pytest.raises(InputError, match=r'"3\.5" is not a finite number with a decimal comma'):
        read_columns(path, WANTED, form=FileForm(decimal=","))


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
    with pytest.raises(InputError, match='there is no sheet "run 3"'):
        read_columns(tmp_path / "a.xlsx", WANTED, form=FileForm(sheet="run 3"))
    sheet.append([20, "n/a"])
    book.save(tmp_path / "a.xlsx")
    with pytest.raises(InputError, match=r'row \d, column "rate": "n/a" is a text, and a number is expected'):
        read_columns(tmp_path / "a.xlsx", WANTED)


def test_parquet_has_its_units_in_the_names(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="the extra fleet is not installed")
    from pyarrow import parquet

    columns = {"time [us]": 3.0 * np.arange(5), "rate [mm3/ms]": np.arange(5) + 0.5}
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    check(read_columns(tmp_path / "a.parquet", WANTED))
    columns["rate [mm3/ms]"][2] = np.nan
    parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
    with pytest.raises(InputError, match='row 3, column "rate": there is no finite number'):
        read_columns(tmp_path / "a.parquet", WANTED)
