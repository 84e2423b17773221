"""LabVIEW measurement files: three layouts of x, two decimal signs, and what cannot be read."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.formats.lvm import LvmFile
from commonrail.readers.columns import Column
from commonrail.readers.overview import survey
from commonrail.readers.tables import read_columns

HEAD = """LabVIEW Measurement\t
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
Operator\tbench
Date\t2026/11/20
Time\t14:41:45.511132
***End_of_Header***\t
\t
"""
ONE = """Channels\t2\t\t\t
Samples\t5\t5\t\t
Date\t2026/11/20\t2026/11/20\t\t
Time\t14:41:45.511132\t14:41:45.511132\t\t
Y_Unit_Label\tmm3/ms\tVolts\t\t
X_Dimension\tTime\tTime\t\t
X0\t-1.0000000000000000E-6\t0.0000000000000000E+0\t\t
Delta_X\t1.000000E-6\t1.000000E-6\t\t
***End_of_Header***\t\t\t\t
X_Value\tROI\tTRIG\tComment
-0.000001\t0.5\t0.0\tfirst
0.000000\t1.5\t5.0
0.000001\t2.5\t5.0
0.000002\t3.5\t0.0
0.000003\t4.5\t0.0
"""
# The same channels with a column of x before each, of which the second is shorter.
MULTI = """Channels\t2\t\t\t\t
Samples\t5\t\t4\t\t
Y_Unit_Label\tmm3/ms\t\tVolts\t\t
X_Dimension\tTime\t\tTime\t\t
X0\t-1.0E-6\t\t0.0E+0\t\t
Delta_X\t1.0E-6\t\t2.0E-6\t\t
***End_of_Header***\t\t\t\t\t
X_Value\tROI\tX_Value\tTRIG\tComment
0\t0.5\t0\t0.0\t
0\t1.5\t0\t5.0\t
0\t2.5\t0\t5.0\t
0\t3.5\t0\t0.0\t
0\t4.5\t\t\t
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "rates.lvm"
    path.write_bytes(text.replace("\n", "\r\n").encode())  # as LabVIEW ends lines
    return path


def channel(path: Path, name: str) -> tuple[list[float], list[float], str]:
    """Times, values and unit of a channel."""
    sheet = LvmFile(path)
    table = sheet.take([Column("time", "s", increasing=True), Column(name, "1")])
    return table.columns["time"].tolist(), table.columns[name].tolist(), sheet.unit(name)


BLANK = "\n".join("\t" + row.partition("\t")[2] for row in ONE.splitlines()[10:])


@pytest.mark.parametrize(
    "text",
    [
        HEAD + ONE,
        HEAD.replace("\tOne", "\tNo") + "\n".join(ONE.splitlines()[:10]) + "\n" + BLANK,  # no x: a blank column
        (HEAD + ONE).replace(".", ",").replace("Separator\t,", "Separator\t,"),
        (HEAD + ONE).replace("\t", ",").replace("Tab", "Comma"),
    ],
)
def test_times_are_start_and_spacing_of_the_header_whatever_x_is_written(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    times, values, unit = channel(path, "ROI")
    assert times == pytest.approx([-1e-6, 0.0, 1e-6, 2e-6, 3e-6], abs=1e-20)
    assert (values, unit) == ([0.5, 1.5, 2.5, 3.5, 4.5], "mm3/ms")
    assert channel(path, "TRIG")[2] == "Volts"
    assert LvmFile(path).names == ["ROI", "TRIG"]


def test_channels_with_columns_of_x_of_their_own_may_differ_in_length_and_spacing(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD.replace("\tOne", "\tMulti") + MULTI)
    assert channel(path, "ROI")[1] == [0.5, 1.5, 2.5, 3.5, 4.5]
    times, values, _ = channel(path, "TRIG")
    assert times == pytest.approx([0.0, 2e-6, 4e-6, 6e-6], abs=1e-20)
    assert values == [0.0, 5.0, 5.0, 0.0]


def test_columns_are_read_in_si_units_and_the_file_is_surveyed(tmp_path: Path) -> None:
    path = written(tmp_path, HEAD + ONE)
    table = read_columns(path, [Column("time", "s", increasing=True), Column("ROI", "m3/s")])
    np.testing.assert_allclose(table.columns["ROI"], 1e-6 * np.array([0.5, 1.5, 2.5, 3.5, 4.5]), rtol=1e-15)
    found = survey(path)
    assert re.search('shots, .*"TRIG"$', found.taken_for)
    assert found.block["shots"] == {"trigger": "TRIG", "offset": "?"}


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("LabVIEW Measurement", "Measurement", "no LabVIEW"),
        ("***End_of_Header***\t\t\t\t\n", "", "ends before"),
        ("Channels\t2", "Channels\t3", r"\b3 channels, .*\b2 "),
        ("Samples\t5\t5", "Samples\t6\t5", r'"ROI": .*\b6 samples, .*\b5 '),
        ("Delta_X\t1.000000E-6", "Delta_X\t0", '"ROI": .*no X0 and Delta_X'),
        ("X0\t-1.0000000000000000E-6", "X0\t3.8E+9", "X0 .*3.8e.09 s.*1e-06 s"),
        ("X0\t", "X_Unit_Label\tmm\tmm\t\t\nX0\t", 'channel "ROI": X_Unit_Label is "mm"'),
        ("Delta_X\t1.0", "Delta_X\t1,0", "X0 and Delta_X .*decimal sign"),
        ("X_Dimension\tTime\tTime", "X_Dimension\tTime\tFrequency", '"TRIG": .*Frequency'),
        ("0.000003\t4.5\t0.0\n", "0.000003\t4.5\t0.0\n\nChannels\t2\n", "line 30: .*segment"),
        ("Separator\tTab", "Separator\tSpace", "header .*LabVIEW"),
        ("0.000001\t2.5", "0.000001\tx", "sample 3.*finite"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = HEAD + ONE
    assert old in text
    path = written(tmp_path, text.replace(old, new, 1))
    with pytest.raises(InputError, match=words):
        read_columns(path, [Column("time", "s", increasing=True), Column("ROI", "m3/s")])


def test_commas_that_separate_cells_and_decimals_are_refused(tmp_path: Path) -> None:
    text = (HEAD + ONE).replace("Tab", "Comma").replace(".", ",").replace("\t", ",")
    with pytest.raises(InputError, match=r"\bheader\b.*LabVIEW"):
        LvmFile(written(tmp_path, text))


def test_a_file_that_windows_wrote_is_read(tmp_path: Path) -> None:
    path = tmp_path / "rates.lvm"
    path.write_bytes((HEAD + ONE).replace("mm3/ms", "mm³/ms").encode("cp1252"))
    found = survey(path)
    assert (found.block["rate"], found.said) == ("ROI", "encoding cp1252")
    assert "encoding" not in survey(written(tmp_path, HEAD + ONE)).block
