"""Tables of a fleet: CSV and Parquet give the same rows."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.fleet.study import Table, check_name, find_column, read_table
from commonrail.readers.columns import name_and_unit
from tests.child_in_process import read_in_process
from tests.refused import refused

HEADER = ["injector", "data", "quantity [mm3]"]
ROWS = [("B", "x", 1.5), ("A", "x", 0.1), ("B", "y", 2.0), ("A", "x", 1e-20)]


def csv_table(folder: Path) -> Path:
    path = folder / "rows.csv"
    lines = ["# a comment", ",".join(HEADER), *(f"{a},{b},{c!r}" for a, b, c in ROWS)]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def parquet_table(folder: Path) -> Path:
    pyarrow = pytest.importorskip("pyarrow")
    path = folder / "rows.parquet"
    columns = [list(column) for column in zip(*ROWS, strict=True)]
    pyarrow.parquet.write_table(pyarrow.table(dict(zip(HEADER, columns, strict=True))), path)
    return path


@pytest.fixture(params=["csv", "parquet"])
def table(request: pytest.FixtureRequest, tmp_path: Path) -> Table:
    if request.param == "parquet":
        pytest.importorskip("pyarrow.parquet")
    make = {"csv": csv_table, "parquet": parquet_table}[request.param]
    return read_table(make(tmp_path))


def test_rows_are_grouped_in_the_order_in_which_they_first_come(table: Table) -> None:
    groups = {key: rows.tolist() for key, rows in table.groups([0, 1]).items()}
    assert groups == {("B", "x"): [0], ("A", "x"): [1, 3], ("B", "y"): [2]}
    assert list(groups) == [("B", "x"), ("A", "x"), ("B", "y")]


def test_cells_are_exact(table: Table) -> None:
    rows = table.groups([0])[("A",)]
    cells = table.cells(rows)
    assert table.header == HEADER
    assert [cell[:2] for cell in cells] == [["A", "x"], ["A", "x"]]
    assert [float(cell[2]) for cell in cells] == [0.1, 1e-20]


def test_a_row_is_named_by_its_place(table: Table) -> None:
    assert table.place(0).endswith("row 1" if table.path.suffix == ".parquet" else "line 3")


def test_numbers_as_serial_numbers_and_gaps_in_parquet(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet")
    import pyarrow
    from pyarrow import parquet

    columns = {"injector": pyarrow.array([12, 7, 12, None]), "file": pyarrow.array(["a", None, "b", "c"])}
    parquet.write_table(pyarrow.table(columns), tmp_path / "t.parquet")
    table = read_table(tmp_path / "t.parquet")
    assert {key: rows.tolist() for key, rows in table.groups([0]).items()} == {("12",): [0, 2], ("7",): [1], ("",): [3]}
    assert table.cells(table.groups([0])[("7",)]) == [["7", ""]]


@pytest.mark.parametrize(("cell", "name"), [("rate [mm3/ms]", "rate"), ("rate", "rate"), ("a [b", "a [b")])
def test_names_without_units(cell: str, name: str) -> None:
    assert name_and_unit(cell)[0] == name


def test_a_missing_column_is_named_with_the_nearest(table: Table) -> None:
    with pytest.raises(InputError, match=r'"quantty", volumes .*"quantity".*"in'):
        find_column(table, "quantty", "volumes")


def test_a_column_twice(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a,a [m]\n1,2\n", encoding="utf-8")
    with refused(InputError, 'repeated column "a"', path.name):
        find_column(read_table(path), "a", "")


def test_broken_parquet(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "t.parquet"
    with pytest.raises(InputError, match=r"t\.parquet: "):
        read_table(path)
    path.write_bytes(b"no Parquet")
    with pytest.raises(InputError, match=r"t\.parquet: .* \(") as caught:
        read_table(path)
    assert "\n" not in str(caught.value)


def test_without_pyarrow_the_cure_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    with pytest.raises(InputError, match=r'"commonrail\[fleet\]"'):
        read_table(tmp_path / "t.parquet")


def test_nested_values_in_parquet_are_refused(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "rows.parquet"
    pyarrow.parquet.write_table(pyarrow.table({"injector": [["A", "B"], ["C"]], "Q": [1.0, 2.0]}), path)
    with pytest.raises(InputError, match=r'"injector" .*list<.*>'):
        read_table(path).groups([0])


# What a hostile table holds, and what its refusal says.
TOO_MUCH = {
    "rows": (lambda n: {"injector": n.zeros(10_000_001)}, "10000001 .*10000000"),
    "cells": (lambda n: dict.fromkeys(map(str, range(300)), n.zeros(400_000)), "400000 .*300 "),
    "columns": (lambda n: dict.fromkeys(map(str, range(1001)), n.zeros(1)), "1001 .*1000"),
    "a long text": (lambda n: {"injector": ["A", "B" * 1001]}, '1001 .*"injector"'),
    "a long name": (lambda n: {"A" * 201: [0.0]}, "name"),
}


@pytest.mark.parametrize("kind", TOO_MUCH)
def test_a_parquet_table_beyond_a_limit_is_refused(kind: str, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    pytest.importorskip("pyarrow.parquet")
    columns, sentence = TOO_MUCH[kind]
    path = tmp_path / "rows.parquet"
    pyarrow.parquet.write_table(pyarrow.table(columns(np)), path, compression="zstd")
    with pytest.raises(InputError, match=rf"rows\.parquet: .*{sentence}"):
        read_table(path)


def test_the_size_of_a_parquet_table_is_checked_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow.parquet")
    read_in_process(monkeypatch)
    reader = "commonrail.plugins.formats.parquet_child"
    monkeypatch.setattr(f"{reader}.LARGEST_CONTENT", 100)  # its pages have some hundred bytes
    monkeypatch.setattr(f"{reader}._save_column", None)  # to read is a fault
    with pytest.raises(InputError, match="GB"):
        read_table(parquet_table(tmp_path))


def test_a_huge_description_of_a_parquet_table_is_not_read(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "t.parquet"
    path.write_bytes(b"PAR1" + (3_000_000).to_bytes(4, "little") + b"PAR1")
    with pytest.raises(InputError, match=r"3 MB.* 2 MB"):
        read_table(path)


def test_a_pipe_in_place_of_a_parquet_table(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet")
    os.mkfifo(tmp_path / "t.parquet")
    with pytest.raises(InputError, match="pipe"):
        read_table(tmp_path / "t.parquet")


def test_a_name_like_a_formula_is_refused() -> None:
    class Place:
        def place(self, row: int) -> str:
            return f"table.csv, line {row}"

    for name in ("=cmd|calc", "+1", "-1", "@sum"):
        with pytest.raises(InputError, match=r"table\.csv, line 2: "):
            check_name(name, Place(), 2)  # type: ignore[arg-type]
    check_name("A=1", Place(), 2)  # type: ignore[arg-type]
