"""Maps in files: what is written is read back digit for digit, by this program and by others."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from commonrail.base.errors import InputError, OutputError
from commonrail.plugins.maps.dcm import MOST_MAPS, number_text, read_dcm, write_into_dcm
from commonrail.plugins.maps.ecu_file import read_axes
from commonrail.plugins.maps.file import ENDINGS, write_map_file
from commonrail.plugins.maps.table import MapTable, convert_axes
from tests.plugins.maps.tables import table

GAP = [[0.0] * 7, [float("nan")] + [1.0] * 6, [2.0] * 7]


def written(tmp_path: Path, ending: str, tables: Sequence[MapTable]) -> Path:
    path = tmp_path / f"map{ending}"
    write_map_file(path, tables)
    return path


def test_dcm_comes_back_digit_for_digit(tmp_path: Path) -> None:
    first, second = table(), table(label="InjVlv_q")
    found = read_dcm(written(tmp_path, ".dcm", [first, second]))
    assert [m.label for m in found] == ["InjVlv_tiET_MAP", "InjVlv_q"]
    for read in found:
        assert np.array_equal(read.values, first.values)
        assert np.array_equal(read.x.values, first.x.values)
        assert np.array_equal(read.y.values, first.y.values)
        assert (read.x.unit, read.y.unit, read.unit) == ("hPa", "mm^3/inj", "us")


def test_dcm_has_the_form_of_the_format(tmp_path: Path) -> None:
    lines = written(tmp_path, ".dcm", [table(note="µ³ ü\n=1+1")]).read_bytes().decode("ascii").splitlines()
    content = [line for line in lines if line and not line.startswith("*")]
    assert content[0] == "KONSERVIERUNG_FORMAT 2.0"
    assert content[1] == "KENNFELD InjVlv_tiET_MAP 7 3"
    assert content[2] == "   LANGNAME \"Energising time, 'tested' over 3\""
    assert content[6:8] == [
        "   ST/X   100000.0   200000.0   400000.0   800000.0   1000000.0   1200000.0",
        "   ST/X   1800000.0",
    ]
    assert content[8:11] == [
        "   ST/Y   0.0",
        "   WERT   0.0   0.0   0.0   0.0   0.0   0.0",
        "   WERT   0.0",
    ]
    assert content[-1] == "END"


def test_numbers_have_a_point_and_no_exponent() -> None:
    assert [number_text(v) for v in (1e7, 0.1, -0.0, 1e-5, 123.456)] == [
        "10000000.0",
        "0.1",
        "0.0",
        "0.00001",
        "123.456",
    ]


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("KONSERVIERUNG_FORMAT 2.0", "KONSERVIERUNG 2", "KONSERVIERUNG_FORMAT 2.0"),
        ("InjVlv_tiET_MAP 7 3", "InjVlv_tiET_MAP 7", "KENNFELD NAME NX NY"),
        ("InjVlv_tiET_MAP 7 3", "InjVlv_tiET_MAP 7 4", "3 numbers"),
        ("InjVlv_tiET_MAP 7 3", "InjVlv_tiET_MAP 7 2", "7 × 2"),
        ("InjVlv_tiET_MAP 7 3", "InjVlv_tiET_MAP 999999 999999", "1000000"),
        ("ST/Y   0.75", "ST/Y   zero", '"zero"'),
        ("ST/Y   0.75", "ST/Y   0_75", '"0_75"'),
        ("ST/Y   0.75", "ST/Y   nan", "not finite"),
        ("\nEND", "\n", "has no END"),
    ],
)
def test_a_damaged_dcm_is_refused_with_its_line(tmp_path: Path, old: str, new: str, word: str) -> None:
    path = written(tmp_path, ".dcm", [table()])
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=re.escape(word)) as found:
        read_dcm(path)
    assert re.match(rf"{re.escape(str(path))}, line \d+: ", str(found.value))


def test_a_label_that_is_there_twice_gives_no_axes(tmp_path: Path) -> None:
    """The numbers of one map would be written into the other."""
    path = written(tmp_path, ".dcm", [table(), table()])
    assert read_dcm(path) == []
    with pytest.raises(InputError, match="InjVlv_tiET_MAP"):
        read_axes(path)


@pytest.mark.parametrize("end", [(b"\n", b"\r"), (b"END\n", b"END\n* a note\rWERT 1\n")])
def test_a_file_with_other_line_ends_is_not_said_to_be_written(tmp_path: Path, end: tuple[bytes, bytes]) -> None:
    path = written(tmp_path, ".dcm", [table()])
    path.write_bytes(path.read_bytes().replace(*end))
    out = tmp_path / "out.dcm"
    with pytest.raises(InputError, match="CR LF"):
        write_into_dcm(out, path, "InjVlv_tiET_MAP", table())
    assert not out.exists()


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8"])
def test_a_space_that_does_not_break_separates_words_of_a_dcm(tmp_path: Path, encoding: str) -> None:
    path, wanted = written(tmp_path, ".dcm", [table()]), table()
    text = path.read_text(encoding="ascii").replace("WERT   ", "WERT\u00a0\u00a0").replace("ST/X   ", "ST/X\u00a0")
    path.write_bytes(text.encode(encoding))
    np.testing.assert_array_equal(read_dcm(path)[0].values, wanted.values)
    out = tmp_path / "out.dcm"
    write_into_dcm(out, path, wanted.label, replace(wanted, values=2.0 * wanted.values, decimals=3))
    assert "WERT\u00a0\u00a0" in out.read_bytes().decode(encoding)
    np.testing.assert_allclose(read_dcm(out)[0].values, 2.0 * wanted.values, atol=5e-4)


def test_a_file_of_very_many_maps_is_refused_where_they_are_too_many(tmp_path: Path) -> None:
    """One of 8 MB took half a minute."""
    maps = [f"KENNFELD m{i} 1 1\nST/X 1\nST/Y 1\nWERT 1\nEND\n" for i in range(MOST_MAPS + 1)]
    path = tmp_path / "many.dcm"
    path.write_text("KONSERVIERUNG_FORMAT 2.0\n" + "".join(maps[:-1]))
    assert len(read_dcm(path)) == MOST_MAPS
    path.write_text("KONSERVIERUNG_FORMAT 2.0\n" + "".join(maps))
    with pytest.raises(InputError, match=f"line {2 + 5 * MOST_MAPS}: .*{MOST_MAPS}"):
        read_dcm(path)


def test_axes_come_from_a_dcm_file(tmp_path: Path) -> None:
    pressure, quantity = convert_axes(read_axes(written(tmp_path, ".dcm", [table()])), 800.0)
    assert pressure.tolist() == pytest.approx([1e7, 2e7, 4e7, 8e7, 1e8, 1.2e8, 1.8e8])
    assert quantity.tolist() == pytest.approx([0.0, 0.75e-9, 10e-9])


def test_axes_by_mass_are_divided_by_the_density(tmp_path: Path) -> None:
    by_mass = table()
    by_mass = replace(by_mass, y=by_mass.y._replace(unit="mg/inj"))
    _, quantity = convert_axes(read_axes(written(tmp_path, ".dcm", [by_mass])), 800.0)
    assert quantity.tolist() == pytest.approx([0.0, 0.75e-6 / 800.0, 10e-6 / 800.0])


def test_a_file_without_such_axes_is_refused(tmp_path: Path) -> None:
    other = table()
    other = replace(other, y=other.y._replace(unit="rpm"))
    with pytest.raises(InputError, match=r"map\.dcm: "):
        read_axes(written(tmp_path, ".dcm", [other]))


def test_cdfx_holds_axes_units_and_values(tmp_path: Path) -> None:
    own = table()
    tree = ElementTree.parse(written(tmp_path, ".cdfx", [own]))
    instance = tree.find("./SW-SYSTEMS/SW-SYSTEM/SW-INSTANCE-SPEC/SW-INSTANCE-TREE/SW-INSTANCE")
    assert instance is not None
    assert [instance.findtext(tag) for tag in ("SHORT-NAME", "CATEGORY")] == ["InjVlv_tiET_MAP", "MAP"]
    groups = instance.findall("./SW-VALUE-CONT/SW-VALUES-PHYS/VG")
    values = [[float(v.text or "") for v in group.findall("V")] for group in groups]
    assert np.array_equal(np.array(values), own.values)
    assert [float(group.findtext("LABEL", "")) for group in groups] == own.y.values.tolist()
    axes = instance.findall("./SW-AXIS-CONTS/SW-AXIS-CONT")
    assert [a.findtext("UNIT-DISPLAY-NAME") for a in axes] == ["hPa", "mm^3/inj"]
    places = [[float(v.text or "") for v in a.findall("./SW-VALUES-PHYS/V")] for a in axes]
    assert places == [own.x.values.tolist(), own.y.values.tolist()]


def test_texts_in_cdfx_are_escaped(tmp_path: Path) -> None:
    tree = ElementTree.parse(written(tmp_path, ".cdfx", [table(note="a < b & <!ENTITY x>")]))
    assert tree.findtext(".//SW-INSTANCE-TREE/LONG-NAME") == "a < b & <!ENTITY x>"


def test_a_table_of_tunerstudio_holds_axes_and_rows_in_its_order(tmp_path: Path) -> None:
    own = table(note="two -- hyphens & <")
    root = ElementTree.parse(written(tmp_path, ".table", [own])).getroot()
    (space,) = {element.tag.partition("}")[0] for element in root.iter()}
    assert space == "{http://www.EFIAnalytics.com/:table"
    found = {element.tag.partition("}")[2]: element for element in root.iter()}
    numbers = {
        name: [float(word) for word in (found[name].text or "").split()] for name in ("xAxis", "yAxis", "zValues")
    }
    assert (numbers["xAxis"], numbers["yAxis"]) == (own.x.values.tolist(), own.y.values.tolist())
    assert found["zValues"].attrib == {"cols": "7", "rows": "3"}
    assert np.array_equal(np.reshape(numbers["zValues"], (3, 7)), own.values)
    lines = (found["zValues"].text or "").strip().splitlines()
    assert [len(line.split()) for line in lines] == [7, 7, 7]  # a row a line: readers split there
    assert found["xAxis"].get("name") == "rail_pressure [hPa]"


@pytest.mark.parametrize("ending", [".dcm", ".cdfx", ".table"])
def test_a_format_without_gaps_refuses_a_cell_without_a_number(tmp_path: Path, ending: str) -> None:
    with pytest.raises(InputError, match=r"1 of 21 cells .*100000 hPa, 0\.75 mm\^3/inj"):
        written(tmp_path, ending, [table(GAP)])
    assert list(tmp_path.iterdir()) == []


def test_csv_is_a_row_for_each_cell_with_its_state(tmp_path: Path) -> None:
    path = written(tmp_path, ".csv", [table(GAP, note="=1+1")])
    lines = path.read_text(encoding="utf-8").splitlines()
    assert "# '=1+1" not in lines[0]
    rows = list(csv.reader(line for line in lines if not line.startswith("#")))
    assert rows[0] == ["rail_pressure [hPa]", "quantity [mm^3/inj]", "energising_time [us]", "state"]
    assert len(rows) == 1 + 21
    assert rows[2] == ["100000.0", "0.75", "", "reached"]


def test_csv_holds_one_map(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"map\.csv: .* 2;"):
        written(tmp_path, ".csv", [table(), table()])


def test_mat_is_read_by_scipy(tmp_path: Path) -> None:
    from scipy.io import loadmat

    own = table()
    found = loadmat(written(tmp_path, ".mat", [own]), simplify_cells=True)["InjVlv_tiET_MAP"]
    assert np.array_equal(found["values"], own.values)
    assert np.array_equal(found["x"], own.x.values)
    assert np.array_equal(found["y"], own.y.values)
    assert (found["x_unit"], found["y_unit"], found["unit"]) == ("hPa", "mm^3/inj", "us")
    assert found["states"].shape == own.values.shape


def test_a_label_that_matlab_cannot_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"MATLAB .*31"):
        written(tmp_path, ".mat", [table(label="a" * 32)])


def test_json_has_null_where_there_is_no_number(tmp_path: Path) -> None:
    path = written(tmp_path, ".json", [table(GAP)])
    (found,) = json.loads(path.read_text(encoding="utf-8"), parse_constant=pytest.fail)["maps"]
    assert found["values"][1] == [None] + [1.0] * 6
    assert found["x"]["unit"] == "hPa"


def test_xlsx_is_read_by_openpyxl_without_formulas(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl", reason="the extra [excel] is not installed")
    own = table(GAP, note="=1+1")
    book = openpyxl.load_workbook(written(tmp_path, ".xlsx", [own]))
    assert book.sheetnames == ["energising_time", "states", "notes"]
    rows = list(book["energising_time"].iter_rows(values_only=True))
    assert rows[1] == ("quantity [mm^3/inj] \\ rail_pressure [hPa]", *own.x.values.tolist())
    assert [row[0] for row in rows[2:]] == own.y.values.tolist()
    assert rows[3][1:] == (None, *[1.0] * 6)
    assert {cell.data_type for sheet in book for row in sheet.iter_rows() for cell in row} <= {"n", "s"}


def test_an_unknown_ending_is_refused_with_those_that_are_known(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape(", ".join(ENDINGS))):
        written(tmp_path, ".a2l", [table()])


@pytest.mark.parametrize("ending", [e for e in ENDINGS if e != ".xlsx"])
def test_a_link_in_the_place_of_a_file_is_not_followed(tmp_path: Path, ending: str) -> None:
    (tmp_path / f"map{ending}").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OutputError, match="symbolic link"):
        written(tmp_path, ending, [table()])
    assert not (tmp_path / "elsewhere").exists()
