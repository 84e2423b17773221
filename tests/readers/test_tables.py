"""Columns from CSV: units, delimiters, and one sentence with line and column for each fault."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from commonrail.base import registry
from commonrail.base.errors import InputError
from commonrail.physics.law import Domain
from commonrail.readers import grid, table_sheet, tables
from commonrail.readers.columns import Column, FileForm, Table
from commonrail.readers.tables import read_columns
from tests.refused import refused

Write = Callable[[str | bytes], Path]

GOOD = "time [us],rate [mm3/ms]\n0,1\n3,2\n6,4\n9,8\n"


def read(path: Path, **stated: str) -> Table:
    time = Column("time", "s", stated.get("time"), increasing=True)
    return read_columns(path, [time, Column("rate", ("m3/s", "kg/s"), stated.get("rate"))])


def test_units_become_si(table_file: Write) -> None:
    table = read(table_file(GOOD))
    np.testing.assert_allclose(table.columns["time"], [0.0, 3e-6, 6e-6, 9e-6], rtol=1e-15)
    np.testing.assert_allclose(table.columns["rate"], [1e-6, 2e-6, 4e-6, 8e-6], rtol=1e-15)
    assert table.units == {"time": "s", "rate": "m3/s"}


def test_a_mass_rate_keeps_its_kind(table_file: Write) -> None:
    table = read(table_file(GOOD.replace("mm3/ms", "mg/ms")))
    np.testing.assert_allclose(table.columns["rate"], [1e-3, 2e-3, 4e-3, 8e-3], rtol=1e-15)
    assert table.units["rate"] == "kg/s"


@pytest.mark.parametrize("delimiter", [",", ";", "\t", ", "])
def test_delimiters(table_file: Write, delimiter: str) -> None:
    table = read(table_file(GOOD.replace(",", delimiter)))
    np.testing.assert_allclose(table.columns["rate"], [1e-6, 2e-6, 4e-6, 8e-6], rtol=1e-15)


def test_comments_blank_lines_quotes_and_other_columns_are_passed_over(table_file: Write) -> None:
    text = '# bench 3\n\n"rate [mm3/ms]","a, b",time [us]\n1,x,0\n# pause\n2,,3\n\n4,y,6\n8,z,9\n'
    table = read(table_file(text))
    np.testing.assert_allclose(table.columns["rate"], [1e-6, 2e-6, 4e-6, 8e-6], rtol=1e-15)
    assert table.rows.tolist() == [4, 6, 8, 9]
    assert table.comments == ("bench 3", "pause")


@pytest.mark.parametrize("row", ["us,mm3/ms", "[us],[mm3/ms]", " us , mm3/ms "])
def test_a_row_of_units(table_file: Write, row: str) -> None:
    table = read(table_file(f"time,rate\n{row}\n0,1\n3,2\n6,4\n9,8\n"))
    np.testing.assert_allclose(table.columns["time"], [0.0, 3e-6, 6e-6, 9e-6], rtol=1e-15)
    assert table.rows.tolist() == [3, 4, 5, 6]


def test_units_from_whoever_reads(table_file: Write) -> None:
    path = table_file("time,rate\n0,1\n3,2\n6,4\n9,8\n")
    table = read(path, time="ms", rate="mg/ms")
    np.testing.assert_allclose(table.columns["time"], [0.0, 3e-3, 6e-3, 9e-3], rtol=1e-15)


FAULTS = {
    "no such column": (
        GOOD.replace("rate [mm3/ms]", "rates"),
        'missing-column column "rate"',
    ),
    "column twice": (
        "time [us],rate [mm3/ms],time [ms]\n0,1,0\n3,2,0\n6,4,0\n9,8,0\n",
        'repeated column "time"',
    ),
    "no unit": (GOOD.replace(" [us]", ""), 'no-unit column "time"'),
    "unit guessed from the name": (GOOD.replace("time [us]", "time_us"), 'missing-column column "time"'),
    "unknown unit": (GOOD.replace("[us]", "[ticks]"), 'unknown-unit column "time"'),
    "unit of another kind": (GOOD.replace("[us]", "[mm]"), 'wrong-unit column "time"'),
    "neither volume nor mass": (
        GOOD.replace("[mm3/ms]", "[MPa]"),
        'wrong-unit column "rate"',
    ),
    "text": (GOOD.replace("3,2", "3,two"), 'not-a-number line 3, column "rate"'),
    "not a number": (GOOD.replace("6,4", "6,nan"), 'not-a-number line 4, column "rate"'),
    "infinite": (GOOD.replace("6,4", "inf,4"), 'not-a-number line 4, column "time"'),
    "empty cell": (GOOD.replace("9,8", "9,"), 'empty-cell line 5, column "rate"'),
    "underscore": (GOOD.replace("9,8", "9,8_0"), 'not-a-number line 5, column "rate"'),
    "decimal comma": (
        GOOD.replace("3,2", '3,"2,5"'),
        'decimal-comma line 3, column "rate"',
    ),
    "decimal comma between commas": (
        GOOD.replace("3,2", "3,2,5"),
        "row-too-long line 3",
    ),
    "short row": (GOOD.replace("6,4", "6"), 'empty-cell line 4, column "rate"'),
    "open quote": (GOOD.replace("6,4", '6,"4'), "bad-row line 4"),
    "time repeats": (GOOD.replace("6,4", "3,4"), 'order line 4, column "time"'),
    "time runs back": (
        GOOD.replace("6,4", "2,4"),
        'order line 4, column "time"',
    ),
    "too few rows": (GOOD.replace("9,8\n", ""), "too-few"),
    "header alone": (GOOD[:24], "too-few"),
    "empty": ("", "empty"),
    "comments alone": ("# a\n# b\n", "empty"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(table_file: Write, fault: str) -> None:
    text, message = FAULTS[fault]
    with refused(InputError, message, "data.csv"):
        read(table_file(text))


def test_two_units_for_one_column(table_file: Write) -> None:
    with refused(InputError, 'conflict column "time"', "data.csv"):
        read(table_file(GOOD), time="ms")
    assert read(table_file(GOOD), time="us").units["time"] == "s"


def test_size_limit(table_file: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grid, "LARGEST_FILE", 20)
    with refused(InputError, "too-large"):
        read(table_file(GOOD))


def test_row_limit(table_file: Write) -> None:
    assert len(list(table_sheet.TableSheet(grid.read_grid(table_file(GOOD)), most=4).rows)) == 4
    with refused(InputError, "too-many"):
        list(table_sheet.TableSheet(grid.read_grid(table_file(GOOD + "12,9\n")), most=4).rows)


HEADERS = {
    "many columns": (
        GOOD.replace("rate [mm3/ms]", "rate [mm3/ms]" + ",x" * 999),
        "too-many",
    ),
    "long name": (GOOD.replace("rate", "rate" * 51), "bad-name"),
    "control character": (GOOD.replace("rate", "ra\x1bte"), "bad-name"),
    "line end": (GOOD.replace("rate [mm3/ms]", '"rate\n [mm3/ms]"'), "bad-name"),
    "long line": ("x" * 100_001 + GOOD, "line-too-long line 1"),
    "digits without end": (GOOD.replace("3,2", "3," + "2" * 5000), 'not-a-number line 3, column "rate"'),
    "beyond a float": (GOOD.replace("3,2", "3,1e400"), 'not-a-number line 3, column "rate"'),
    "beyond all that is measured": (
        GOOD.replace("[mm3/ms]", "[m3/us]").replace("3,2", "3,1e305"),
        'out-of-range line 3, column "rate"',
    ),
    "quote without end": (GOOD.replace("3,2", '3,"2'), "bad-row line 3"),
}


@pytest.mark.parametrize("fault", HEADERS)
def test_hostile_table_is_one_sentence(table_file: Write, fault: str) -> None:
    text, message = HEADERS[fault]
    with refused(InputError, message) as caught:
        read(table_file(text))
    assert str(caught.value).isprintable()


def test_header_of_many_columns_is_not_shown_whole(table_file: Write) -> None:
    with pytest.raises(InputError, match=r'"x0", .*"x11", …\.$'):
        read(table_file(",".join(f"x{i}" for i in range(50)) + "\n"))


@pytest.mark.parametrize("name", ["a.nc", "a.XLS"])
def test_other_formats(tmp_path: Path, name: str) -> None:
    with refused(InputError, "unknown-format", name):
        read(tmp_path / name)


class Counted:
    """A format of two samples, in other units than SI."""

    independent_columns = False
    names = ("time", "rate")

    def __init__(self, path: Path, form: FileForm) -> None:
        self.path = path

    def take(self, columns: Sequence[Column]) -> Table:
        values = {"time": [0.0, 1.0], "rate": [-1.0, 2.0]}
        units = {"time": "ms", "rate": ""}
        wanted = [column.name for column in columns]
        numbers = {name: np.array(values[name]) for name in wanted}
        return Table(self.path, numbers, {}, {name: units[name] for name in wanted}, np.array([7, 8]), row="sample")


def test_another_format_is_a_source_of_the_same_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    entry = registry.Entry("readers", "counted", f"{__name__}:Counted")
    monkeypatch.setattr(tables, "_format", {"counted": entry}.get)
    path, time = Path("a.counted"), Column("time", "s", increasing=True)
    table = read_columns(path, [time, Column("rate", ("m3/s", "kg/s"), "mg/ms")], least=2)
    assert (table.columns["time"].tolist(), table.columns["rate"].tolist()) == ([0.0, 1e-3], [-1e-3, 2e-3])
    assert (table.units["rate"], table.written_units["time"]) == ("kg/s", "ms")
    with refused(InputError, 'no-unit column "rate"', "a.counted"):
        read_columns(path, [Column("rate", "m3/s")], least=2)
    with refused(InputError, 'out-of-range sample 7, column "rate"', "a.counted"):
        read_columns(path, [Column("rate", "m3/s", "mm3/ms", domain=Domain.NON_NEGATIVE)], least=2)


def test_texts_and_gaps(table_file: Write) -> None:
    path = table_file("name,rate [mm3/ms]\na,1\nb,\n")
    table = read_columns(path, [Column("name"), Column("rate", "m3/s", required=False)], least=2)
    assert table.texts["name"] == ["a", "b"]
    np.testing.assert_array_equal(table.columns["rate"], [1e-6, np.nan])
