"""TDMS files: times of waveforms and of groups, scales, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.formats.records import TdmsFile
from commonrail.readers.columns import Column, Table
from commonrail.readers.overview import survey
from commonrail.readers.tables import read_columns
from tests.child_in_process import read_in_process

nptdms = pytest.importorskip("nptdms", reason="the extra tdms is not installed")

RATE = 20.0 * np.sin(np.arange(100) / 30.0)
WAVE = {"wf_increment": 1e-5, "wf_start_offset": -2e-4, "unit_string": "mm3/ms"}
START = np.datetime64("2026-03-01T08:00:00.000000")


@pytest.fixture(autouse=True)
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    read_in_process(monkeypatch)


def written(path: Path, **groups: list[tuple[str, Any, dict[str, Any]]]) -> Path:
    with nptdms.TdmsWriter(path) as writer:
        for group, channels in groups.items():
            writer.write_segment([nptdms.ChannelObject(group, name, data, more) for name, data, more in channels])
    return path


def read(path: Path, name: str, kind: str = "m3/s") -> Table:
    return read_columns(path, [Column("time", "s", increasing=True), Column(name, kind)])


def test_times_are_those_of_the_waveform_and_of_the_channel_of_times(tmp_path: Path) -> None:
    """Of two waveforms in a group the one that starts later is later."""
    late = WAVE | {"wf_start_time": START + np.timedelta64(1, "ms"), "unit_string": "bar"}
    evi = [("ROI", RATE, WAVE | {"wf_start_time": START}), ("p", RATE + 1200.0, late)]
    slow = [("Zeit", np.arange(100) * 2.0, {"unit_string": "ms"}), ("T", RATE + 40.0, {"unit_string": "degC"})]
    path = written(tmp_path / "a.tdms", EVI=evi, slow=slow)
    rate = read(path, "ROI")
    np.testing.assert_allclose(rate.columns["ROI"], RATE * 1e-6)
    np.testing.assert_allclose(rate.columns["time"], -2e-4 + 1e-5 * np.arange(100), atol=1e-12)
    np.testing.assert_allclose(read(path, "p", "Pa").columns["time"] - rate.columns["time"], 1e-3, atol=1e-12)
    np.testing.assert_allclose(read(path, "T", "K").columns["time"], 2e-3 * np.arange(100))


def test_scales_of_the_file_are_applied(tmp_path: Path) -> None:
    scale = {"NI_Number_Of_Scales": 1, "NI_Scaling_Status": "unscaled", "NI_Scale[0]_Scale_Type": "Linear"}
    scale |= {"NI_Scale[0]_Linear_Slope": 0.5, "NI_Scale[0]_Linear_Y_Intercept": 1.0}
    raw = np.arange(100, dtype=np.int16)
    path = written(tmp_path / "a.tdms", g=[("ROI", raw, WAVE | scale)])
    np.testing.assert_allclose(read(path, "ROI").columns["ROI"], (0.5 * raw + 1.0) * 1e-6)


def test_channels_that_cannot_be_read_are_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    g = [("ROI", RATE[:50], WAVE), ("note", ["a", "b"], {}), ("bare", RATE[:50], {}), ("long", RATE, WAVE)]
    g.append(("still", RATE[:50], WAVE | {"wf_increment": 0.0}))
    monkeypatch.setattr("commonrail.plugins.formats.records.MOST_SAMPLES", 50)
    facts = survey(written(tmp_path / "a.tdms", g=g)).facts
    assert [name for name, fact in facts.items() if fact.startswith("not read")] == ["note", "bare", "long", "still"]


def test_a_damaged_file_is_one_sentence(tmp_path: Path) -> None:
    good = written(tmp_path / "a.tdms", g=[("ROI", RATE, WAVE)]).read_bytes()
    for data in (good[:40], b"TDSm" + b"\xff" * 200, b""):
        (tmp_path / "b.tdms").write_bytes(data)
        with pytest.raises(InputError, match=r"b\.tdms"):
            TdmsFile(tmp_path / "b.tdms")
