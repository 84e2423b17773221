"""Maps of control units as they come: foreign maps beside the wanted one, three formats, and own files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.maps.ecu_file import read_axes, read_ecu_maps
from commonrail.plugins.maps.file import write_map_file
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.table import MapTable, arrange_like, complete_columns, find_simulated_columns
from commonrail.readers.columns import PLAIN
from commonrail.readers.overview import survey
from commonrail.readers.quantity_matrix import LONGEST_SIMULATED, GivenUnits
from commonrail.readers.tables import read_found_map
from tests.plugins.maps.tables import table

HEAD = '   LANGNAME "other"\n   EINHEIT_X "-"\n   EINHEIT_Y "-"\n   EINHEIT_W "-"\n'
FOREIGN = {
    "TextAxis": '   ST_TX/X   "OFF"   "ON"\n   ST_TX/Y   "A"\n   WERT   0.0   1.0\n',
    "Texts": '   ST/X   1.0   2.0\n   ST/Y   1.0\n   TEXT   "yes"   "no"\n',
    "Variant": "   VAR   Gear=Auto\n   ST/X   1.0   2.0\n   ST/Y   1.0\n   WERT   0.0   1.0\n",
    "Falling": "   ST/X   2.0   1.0\n   ST/Y   1.0\n   WERT   0.0   1.0\n",
    "Repeated": "   ST/X   2.0   2.0\n   ST/Y   1.0\n   WERT   0.0   1.0\n",
}
SIMULATED = replace(table(note="simulated by commonrail, not measured: x"))
SIMULATED = replace(SIMULATED, notes=(*SIMULATED.notes, f"rules; {LONGEST_SIMULATED.format(800.0)}"))


def written(path: Path, own: MapTable) -> Path:
    write_map_file(path, [own])
    return path


def test_foreign_maps_are_passed_over_and_named(tmp_path: Path) -> None:
    path = written(tmp_path / "et.dcm", table())
    maps = "".join(f"KENNFELD {label} 2 1\n{HEAD}{lines}END\n" for label, lines in FOREIGN.items())
    path.write_text(path.read_text() + maps)
    assert set(read_ecu_maps(path).foreign) == set(FOREIGN)
    assert read_axes(path).label == "InjVlv_tiET_MAP"
    facts = survey(path).facts
    assert all(facts[label].startswith("not read") for label in FOREIGN)


@pytest.mark.parametrize("ending", [".dcm", ".cdfx", ".table"])
def test_each_format_gives_back_the_axes_and_times_that_were_written(tmp_path: Path, ending: str) -> None:
    own = table()
    like = read_axes(written(tmp_path / f"a{ending}", own))
    for name in ("x", "y"):
        axis, other = getattr(like, name), getattr(own, name)
        assert axis.unit == other.unit
        np.testing.assert_array_equal(axis.values, other.values)
    np.testing.assert_array_equal(like.values, own.values)
    assert (like.label, like.unit, like.decimals) == (own.label, own.unit, own.decimals)


@pytest.mark.parametrize("ending", [".csv", ".dcm", ".cdfx", ".table", ".xlsx"])
def test_own_maps_come_back_as_simulated_without_what_was_extrapolated(tmp_path: Path, ending: str) -> None:
    path = written(tmp_path / f"a{ending}", SIMULATED)
    found = read_found_map(path, PLAIN)
    assert found.durations
    assert found.energising_time.max() < 800.0
    assert len(found.quantity) == 14 - np.count_nonzero(SIMULATED.values >= 800.0)
    assert survey(path).synthetic == SIMULATED.notes[0]


def test_a_crank_angle_of_a_control_unit_needs_the_engine_speed(tmp_path: Path) -> None:
    path = written(tmp_path / "a.dcm", replace(table(), unit="degCA"))
    with pytest.raises(InputError):
        read_found_map(path, PLAIN)
    assert read_found_map(path, PLAIN, GivenUnits(time="degCA@1000rpm")).units["energising time"] == "degCA@1000rpm"


def test_a_column_that_cannot_be_simulated_stays_as_it_was() -> None:
    like, conditions = table(), Conditions(cylinder_pressure=20e6)
    which = find_simulated_columns(like, conditions)
    assert which.tolist() == [False, False, True, True, True, True, True]
    part = replace(like, x=like.x._replace(values=like.x.values[which]), values=2.0 * like.values[:, which])
    part = replace(part, states=tuple(row[2:] for row in like.states))
    turned = replace(like, x=like.y, y=like.x, values=like.values.T)
    for source in (like, turned):
        new = arrange_like(complete_columns(part, source, conditions), source)
        values = new.values.T if source is turned else new.values
        np.testing.assert_array_equal(values[:, ~which], like.values[:, ~which])
        np.testing.assert_array_equal(values[:, which], 2.0 * like.values[:, which])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.cdfx", '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "bb">]><a>&b;</a>'),
        ("a.cdfx", "<MSRSW><SW-INSTANCE>"),
        ("a.table", "<tableData><table><xAxis>1 2</xAxis><yAxis>1</yAxis><zValues>1</zValues></table></tableData>"),
        ("a.table", "<tableData><table><xAxis>one</xAxis></table></tableData>"),
        ("a.table", "<tableData/>"),
        ("a.cdfx", "<MSRSW/>"),
    ],
)
def test_damaged_files_are_one_sentence(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=name):
        read_found_map(tmp_path / name, PLAIN)
