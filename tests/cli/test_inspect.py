"""The verb inspect."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commonrail.plugins.maps.file import write_map_file
from commonrail.readers.columns import Column
from commonrail.readers.tables import read_columns
from tests.cli.conftest import Command
from tests.plugins.maps.tables import table

MATRIX = "quantity [mm3]\nET [us] \\ p [bar];300;500\n400;1,5;2,5\n800;10,25;15\n"


def test_a_matrix_is_listed_and_written_as_a_study_reads_it(command: Command, tmp_path: Path) -> None:
    data, out = tmp_path / "bench.csv", tmp_path / "quantity.csv"
    data.write_text(MATRIX, encoding="utf-16")
    done = command("inspect", data, "--out", out)
    assert done.status == 0, done.err
    assert "pressures across" in done.out
    assert re.search(r"utf-16; .*semicolons; .*comma", done.out)
    wanted = [
        Column("rail_pressure", "Pa"),
        Column("energising_time", "s"),
        Column("quantity", "m3"),
    ]
    read = read_columns(out, wanted)
    assert read.columns["rail_pressure"].tolist() == [30e6, 50e6, 30e6, 50e6]
    assert read.columns["quantity"].round(15).tolist() == [1.5e-9, 2.5e-9, 10.25e-9, 15e-9]


def test_a_table_that_is_no_map_is_described_with_the_reason(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "rate.csv"
    data.write_text("bench,part\nthree,seventeen\n", encoding="utf-8")
    record = command("inspect", data, "--json").record
    assert record["taken for"].startswith("a table")
    assert record["first row"] == "bench, part"
    assert "no rows" in record["reason"]
    assert command("inspect", data, "--out", tmp_path / "x.csv").status == 2


def test_the_maps_of_a_dcm_file_are_listed(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "et.dcm"
    write_map_file(path, [table()])
    assert re.search(r"7 × 3 .*hPa × mm\^3/inj, .* us", command("inspect", path).out)


@pytest.mark.parametrize(
    ("rows", "options"),
    [
        ("0,0.5\n3,1.5\n", ["--decimal", ","]),
        ("0,5\n3,15\n", ["--decimal", ","]),
        ("0,5\n3,15\n", ["--sheet", "Foo"]),
    ],
)
def test_a_stated_form_that_does_not_fit_is_refused(
    rows: str, options: list[str], command: Command, tmp_path: Path
) -> None:
    data = tmp_path / "rate.csv"
    data.write_text("time [us],rate [mm3/ms]\n" + rows, encoding="utf-8")
    assert command("inspect", data).status == 0
    assert command("inspect", data, *options).status == 2


def test_a_stated_decimal_comma_counts_between_columns_that_commas_separate(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "rate.csv"
    data.write_text('time [us],rate [mm3/ms]\n0,"1,234"\n3,"2,5"\n', encoding="utf-8")
    record = command("inspect", data, "--decimal", ",", "--json").record
    assert record["rate"].startswith("2 values, 1.234 to 2.5 mm3/ms")


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("bench.xlsx", ["--encoding", "utf-16"]),
        ("bench.mat", ["--decimal", ","]),
        ("bench.lvm", ["--sheet", "Foo"]),
        ("et.dcm", ["--sheet", "Foo"]),
    ],
)
def test_a_form_that_a_format_does_not_read_is_refused(
    name: str, options: list[str], command: Command, tmp_path: Path
) -> None:
    (tmp_path / name).touch()
    done = command("inspect", tmp_path / name, *options)
    assert done.status == 2
    assert options[0] in done.err


@pytest.mark.parametrize("options", [["--encoding", "utf-16"], ["--decimal", ","], ["--sheet", "Foo"]])
def test_a_run_folder_has_no_form(options: list[str], command: Command, tmp_path: Path) -> None:
    done = command("features", tmp_path, *options)
    assert done.status == 2
    assert options[0] in done.err


def test_channels_are_listed_with_units_ranges_and_meanings(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "rate.csv"
    data.write_text("time [us];rate [mm3/ms];I [A]\n0;0,5;1\n3;1,5;2\n6;2,5;3\n", encoding="utf-8")
    record = command("inspect", data, "--json").record
    assert record["taken for"] == "a trace"
    assert re.search(r"^3 values, 0\.5 to 2\.5 mm3/ms; .*rate.*volume", record["rate"])
    assert record["I"] == "3 values, 1 to 3 A; current"
    assert re.search(r"utf-8; .*semicolons; .*comma", record["read as"])


def test_several_channels_that_fit_are_named(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "rate.csv"
    data.write_text("time [us],a [mm3/ms],b [mg/ms]\n0,0,1\n3,1,2\n", encoding="utf-8")
    taken = command("inspect", data, "--json").record["taken for"]
    assert taken.endswith('"a" and "b"')
    new = command("new", tmp_path / "s", "--injector", "cri2-16", "--from", data)
    assert "data[1].rate," in new.out  # which of them, is asked for
    assert 'rate = "?" # STATE IT' in (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")


def test_a_column_that_cannot_be_read_says_why(command: Command, tmp_path: Path) -> None:
    rows = "".join(f"{i},{i},{i}\n" for i in range(5))
    (tmp_path / "a.csv").write_text("time [us],rate [mm3/ms],rate [mm3/ms]\n" + rows, encoding="utf-8")
    done = command("inspect", tmp_path / "a.csv")
    assert '2 columns "rate"' in done.out


def test_names_in_a_file_do_not_steer_the_terminal(command: Command, tmp_path: Path) -> None:
    rows = "".join(f"{i},{i}\n" for i in range(5))
    (tmp_path / "a.csv").write_text("time [us],\x1b]0;x\x07\u202erate [mm3/ms]\n" + rows, encoding="utf-8")
    assert "?]0;x??rate" in command("inspect", tmp_path / "a.csv").out


def test_the_decimal_sign_of_a_text_that_does_not_tell_it_is_asked(command: Command, tmp_path: Path) -> None:
    file = tmp_path / "map.csv"
    file.write_text("p [MPa];ET [us];Q [mm3]\n40;300;1.200\n80;300;1.400\n", encoding="utf-8")
    assert command("inspect", file).status == 2
    assert "1.2 to 1.4 mm3" in command("inspect", file, "--decimal", ".").out
    assert "--decimal x: " in command("inspect", file, "--decimal", "x").err


@pytest.mark.parametrize("name", ["punycode", "idna", "unicode_escape", "undefined", "rot13"])
def test_an_encoding_that_no_file_has_is_refused(command: Command, tmp_path: Path, name: str) -> None:
    data = tmp_path / "bench.csv"
    data.write_text(MATRIX, encoding="utf-8")
    done = command("inspect", data, "--encoding", name)
    assert done.status == 2
    assert f'--encoding: "{name}" is no encoding of texts; write utf-8, utf-16 or cp1252' in " ".join(done.err.split())


def test_a_size_of_thousands_of_digits_in_a_dcm_is_refused(command: Command, tmp_path: Path) -> None:
    data = tmp_path / "big.dcm"
    data.write_text(f"KONSERVIERUNG_FORMAT 2.0\nKENNFELD A {'9' * 5000} 2\nEND\n", encoding="ascii")
    done = command("inspect", data)
    assert done.status == 2
    assert re.search(r"line 2: .*5000 digits", done.err)


def test_columns_that_are_not_read_are_listed_with_the_reason(command: Command, tmp_path: Path) -> None:
    """A column of texts, one without a value, and a time that runs backwards."""
    data = tmp_path / "rate.csv"
    data.write_text("time [us],rate [mm3/ms],note,spare\n0,0,a,\n3,1,b,\n2,2,c,\n5,3,d,\n", encoding="utf-8")
    record = command("inspect", data, "--json").record
    assert "value 3" in record["time"]
    assert all(record[name].startswith("not read") for name in ("note", "spare"))


def test_a_formula_that_was_never_computed_is_no_gap(command: Command, tmp_path: Path) -> None:
    """openpyxl and other programs write formulas without their values."""
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [excel] is not installed")
    book = openpyxl.Workbook()
    book.active.append(["p [bar]", "et [us]", "q [mm3]"])
    for i in range(2, 6):
        book.active.append([400.0 + 100.0 * i, 300.0, f"=A{i}/B{i}"])
    book.save(tmp_path / "a.xlsx")
    record = command("inspect", tmp_path / "a.xlsx", "--json").record
    assert "formula" in record["q"]
    assert command("inspect", tmp_path / "a.xlsx", "--out", tmp_path / "b.csv").status == 2
