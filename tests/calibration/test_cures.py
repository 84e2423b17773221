"""Typical mistakes of a new user in the study of ``commonrail new``: each sentence names a cure that works."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.errors import CommonrailError
from commonrail.calibration.study_file import load_study
from commonrail.plugins.new.study import write_new
from commonrail.readers.injector import load_injector
from commonrail.report.page import write_report

STUDY, INJECTOR, DATA = "study.toml", "injector.toml", "data/evi.csv"
WINDOW = ('window = ["0 us", "1600 us"]', "")
HEADER = "time [us],rate [mm3/ms]"

Change = tuple[str, str, str]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_new(tmp_path / "new")
    return tmp_path / "new"


def change(folder: Path, *changes: Change) -> None:
    """Replace the first occurrence of a text in a file of the folder."""
    for file, old, new in changes:
        text = (folder / file).read_text(encoding="utf-8")
        assert old in text
        (folder / file).write_text(text.replace(old, new, 1), encoding="utf-8")


def in_milliseconds(folder: Path) -> None:
    """Times of the data in ms, below a header that says us."""
    path = folder / DATA
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines if line[0].isdigit()]
    head = [line for line in lines if not line[0].isdigit()]
    text = "\n".join([*head, *(f"{float(time) / 1000:g},{rate}" for time, rate in rows)])
    path.write_text(text, encoding="utf-8")


def sentence(call: Callable[[], object]) -> str:
    with pytest.raises(CommonrailError) as found:
        call()
    return str(found.value)


WRONG: dict[str, tuple[tuple[Change, ...], str]] = {
    "us labelled ms": (((DATA, "[us]", "[ms]"),), 'were recorded in us, correct the unit of the column "time"'),
    "us labelled s": (((DATA, "[us]", "[s]"),), "if they were recorded in us, correct the unit"),
    "us labelled ms, no window": (
        ((DATA, "[us]", "[ms]"), (STUDY, *WINDOW)),
        "or correct the unit if the times are wrong",
    ),
    "names exchanged": (
        ((DATA, HEADER, "rate [mm3/ms],time [us]"),),
        'as the column "rate" does: the two may be exchanged in the header',
    ),
    "no units": (((DATA, HEADER, "time,rate"),), 'write it in the header, as in "time [us]"'),
    "quantity for a rate": (((DATA, "mm3/ms]", "mg]"),), "a unit like mm3/ms or mg/ms is expected"),
    "file in another folder": (((STUDY, DATA, "evi.csv"),), 'did you mean "data/evi.csv"?'),
    "pressure in Pa": (
        ((STUDY, 'rail_pressure = "160 MPa"', 'rail_pressure = "160 Pa"'),),
        "data[1]: The rail pressure must lie between 100 kPa and 1 GPa, and 160 Pa was read; if 160 MPa is meant, "
        'write "160 MPa"',
    ),
    "energising in ms": (
        ((STUDY, 'energising_time = "700 us"', 'energising_time = "700 ms"'),),
        "data[1].energising_time: The duration of an energising must lie between 0 s and 100 ms, and 0.7 s was read; "
        'if 0.7 ms is meant, write "0.7 ms"',
    ),
    "table before a list of tables": (((STUDY, "[[parameter]]", "[parameter]"),), "of a list is written [[name]]"),
    "last part of a name": (
        ((STUDY, '"control_chamber.z_hole_diameter"\n', '"z_hole_diameter"\n'),),
        'did you mean "control_chamber.z_hole_diameter"?',
    ),
    "crossed bounds": (
        ((STUDY, "lower = 0.70", "lower = 0.99"),),
        "the lower bound lies above the upper; exchange them",
    ),
    "file without its end": (((STUDY, '"injector.toml"', '"injector"'),), 'did you mean the file "injector.toml"?'),
    "window of one time": (
        ((STUDY, 'window = ["0 us", "1600 us"]', 'window = "1600 us"'),),
        'this must be a list in brackets, such as ["0 us", "1600 us"]',
    ),
    "key of another tool": (
        ((STUDY, "members = 24", "population = 24"),),
        'no key "population" (it can have members, generations,',
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_the_sentence_has_the_cure(folder: Path, case: str) -> None:
    changes, cure = WRONG[case]
    change(folder, *changes)
    said = sentence(lambda: load_study(folder / STUDY))
    assert cure in said
    assert str(folder) in said or "study.toml" in said


def test_times_in_ms_under_a_header_that_says_us(folder: Path) -> None:
    in_milliseconds(folder)
    said = sentence(lambda: load_study(folder / STUDY))
    assert re.search(r"window .*0 s to 1\.6 ms, .*samples .*0 s to 1\.6 us", said)
    assert said.endswith(
        f'if they were recorded in ms, correct the unit of the column "time" of {folder / DATA} to "ms".'
    )
    change(folder, (DATA, "[us]", "[ms]"))  # the cure
    assert len(load_study(folder / STUDY).data) == 1


def test_a_window_that_fits_in_no_unit_is_told_what_the_file_covers(folder: Path) -> None:
    change(folder, (STUDY, '"0 us", "1600 us"', '"-300 us", "1600 us"'))
    said = sentence(lambda: load_study(folder / STUDY))
    assert said.endswith("being in us; choose a window within them, or correct the unit if the times are wrong.")


def test_a_file_of_another_kind_is_called_what_it_is(folder: Path) -> None:
    said = sentence(lambda: load_study(folder / INJECTOR))
    assert re.search(r"injector file \(.*study file", said)
    said = sentence(lambda: load_injector(folder / STUDY))
    assert re.search(r"study file \(.*injector file", said)


def test_a_report_of_a_file_asks_for_the_folder(folder: Path) -> None:
    assert "no folder" in sentence(lambda: write_report(folder / STUDY))
