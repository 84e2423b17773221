"""Tables hold nothing that a spreadsheet computes, and are read back to the same texts."""

from __future__ import annotations

import ast
import csv
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from commonrail.base.csv_output import comment_line, neutralise, restore, restore_note, write_csv
from commonrail.plugins.cfd import Course, _dat_lines, _foam_lines
from commonrail.readers.columns import Column
from commonrail.readers.table_sheet import WrittenTable

SRC = Path(__file__).resolve().parents[2] / "src" / "commonrail"
LINK = '=HYPERLINK("http://example.org","open")'
COMPUTED = [LINK, "+1+1", "-2+3", "@SUM(A1)", "=", " =1", "\t=1", "\r=1", "＝1", '"=1', "'=1", "+cmd|' /C calc'!A0"]
HARMLESS = ["", "160 MPa", "a=b", "'quoted'", "-1.5e-3", "+2", "-.5", "0", "nan", "x@y", "'-1"]

texts = st.text(alphabet="=+-@' \"\t,;.e1a＝\u00a0", max_size=8)


@pytest.mark.parametrize("text", COMPUTED)
def test_a_text_that_would_be_computed_begins_as_a_text(text: str) -> None:
    assert neutralise(text) == "'" + text


@pytest.mark.parametrize("text", HARMLESS)
def test_numbers_and_plain_texts_stay_as_they_are(text: str) -> None:
    assert neutralise(text) == text == restore(text)


@given(texts)
def test_the_same_text_comes_back(text: str) -> None:
    assert restore(neutralise(text)) == text
    assert restore_note(comment_line(text).removeprefix("# ")) == text


@given(texts)
def test_no_cell_begins_as_a_formula(text: str) -> None:
    cell = neutralise(text).strip()
    assert cell[:1] not in "=@＝" or not cell
    assert cell[:1] not in "+-" or not cell or float(cell) == float(cell)


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_a_note_has_no_formula_behind_a_separator(sign: str) -> None:
    assert comment_line(f"title{sign} =1+1{sign}-5") == f"# title{sign}' =1+1{sign}-5"


def test_a_table_is_written_and_read_back(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    write_csv(path, [f"curves of a,{LINK}"], ["name", LINK], [[text, "-1.5"] for text in COMPUTED if "\r" not in text])
    with path.open(encoding="utf-8", newline="") as stream:
        for row in csv.reader(stream):
            assert not any(cell.lstrip()[:1] in ("=", "@") for cell in row), row
    table = WrittenTable(path).take([Column("name"), Column(LINK, "1")])
    assert table.texts["name"] == [text for text in COMPUTED if "\r" not in text]
    assert set(table.columns[LINK]) == {-1.5}
    assert table.comments == (f"curves of a,{LINK}",)


def test_tables_are_written_in_one_place() -> None:
    """All but the rows that a fleet copies from the user's table into a file of an injector."""
    found = {
        path.relative_to(SRC).as_posix()
        for path in SRC.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in ("writer", "DictWriter", "to_csv", "savetxt")
    }
    assert found == {"base/csv_output.py", "plugins/fleet/study.py"}


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x85", "\u2028"])
def test_a_line_end_in_a_text_begins_no_line(tmp_path: Path, end: str) -> None:
    """In a file that states nothing of its own but a table of one row."""
    hostile = f"measured{end}=1+1"
    write_csv(tmp_path / "t.csv", [hostile], ["name", hostile], [["a", hostile]])
    assert len((tmp_path / "t.csv").read_text(encoding="utf-8").splitlines()) == 3
    for lines in (_foam_lines, _dat_lines):
        course = Course(np.array([0.0, 1e-4, 2e-4]), np.array([0.0, 1.0, 0.0]), hostile)
        written = "\n".join(lines([hostile], course)).splitlines()
        assert [line[:1] for line in written if "=" in line] in (["/"], ["#"])
