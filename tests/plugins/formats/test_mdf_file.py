"""MDF records: channels with their own times, records of two libraries, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.formats.records import MdfFile
from commonrail.readers.columns import Column, Table
from commonrail.readers.overview import read_channels
from commonrail.readers.tables import read_columns
from tests.child_in_process import read_in_process
from tests.refused import refused

asammdf = pytest.importorskip("asammdf", reason="the extra mdf is not installed")


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    read_in_process(monkeypatch)


TIME = np.arange(0.0, 1e-3, 1e-5)
RATE = 20.0 * np.sin(3000.0 * TIME)


def signal(values: Any, name: str = "ROI", unit: str = "mm3/ms", time: Any = TIME, **more: Any) -> Any:
    """A channel as asammdf writes it."""
    return asammdf.Signal(np.asarray(values, float), time, unit, name, **more)


def written(path: Path, *groups: tuple[str, list[Any]], compression: int = 0) -> Path:
    """A record with groups of channels."""
    record = asammdf.MDF()
    for name, signals in groups:
        record.append(signals, acq_name=name)
    record.save(path, overwrite=True, compression=compression)
    record.close()
    return path


def read(path: Path, rate: str = "ROI", time: str = "time") -> Table:
    return read_columns(path, [Column(time, "s", increasing=True), Column(rate, "m3/s")])


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("compression", [0, 1, 2])
def test_a_channel_comes_with_the_times_of_its_own_group(tmp_path: Path, compression: int) -> None:
    slow = signal([800.0, 1200.0], "p", "bar", np.array([0.0, 5e-4]))
    path = written(tmp_path / "a.mf4", ("fast", [signal(RATE)]), ("slow", [slow]), compression=compression)
    table = read(path)
    np.testing.assert_allclose(table.columns["ROI"], RATE * 1e-6, rtol=1e-12)
    np.testing.assert_allclose(table.columns["time"], TIME, atol=1e-15)
    pressure = read_columns(path, [Column("time", "s", increasing=True), Column("p", "Pa")], least=2)
    assert pressure.columns["p"].tolist() == [800e5, 1200e5]
    assert MdfFile(path).names == ["ROI", "p"]


@pytest.mark.usefixtures("in_process")
def test_two_libraries_write_records_that_are_read_alike(tmp_path: Path) -> None:
    mdfreader = pytest.importorskip("mdfreader", reason="mdfreader is not installed")
    other = mdfreader.Mdf()
    other.MDFVersionNumber = 410
    other.add_channel("t", TIME, "t", master_type=1, unit="s")
    other.add_channel("ROI", RATE, "t", unit="mm3/ms")
    other.write(file_name=str(tmp_path / "other.mf4"))
    own, foreign = read(written(tmp_path / "own.mf4", ("g", [signal(RATE)]))), read(tmp_path / "other.mf4")
    for name in ("time", "ROI"):
        np.testing.assert_array_equal(own.columns[name], foreign.columns[name])
    assert own.written_units == foreign.written_units == {"time": "s", "ROI": "mm3/ms"}
    assert read(tmp_path / "other.mf4", time="t").columns["t"].tolist() == foreign.columns["time"].tolist()


@pytest.mark.usefixtures("in_process")
def test_channels_of_one_name_are_told_apart_by_their_groups(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mf4", ("800bar 300us", [signal(RATE)]), ("800bar 700us", [signal(2.0 * RATE)]))
    assert MdfFile(path).names == ["800bar 300us/ROI", "800bar 700us/ROI"]
    np.testing.assert_allclose(read(path, "800bar 700us/ROI").columns["800bar 700us/ROI"], 2e-6 * RATE)


@pytest.mark.usefixtures("in_process")
def test_linear_rules_are_applied_and_formulas_are_not_evaluated(tmp_path: Path) -> None:
    raw = np.arange(100, dtype=float)
    linear = written(tmp_path / "a.mf4", ("g", [signal(raw, conversion={"a": 0.5, "b": 1.0})]))
    np.testing.assert_allclose(read(linear).columns["ROI"], (0.5 * raw + 1.0) * 1e-6, rtol=1e-12)
    formula = written(tmp_path / "b.mf4", ("g", [signal(raw, conversion={"formula": "X1*2"})]))
    with pytest.raises(InputError, match=r'"ROI": .*formula'):
        read(formula)


CODES = np.array([0] * 40 + [1] * 60, np.uint8)
GAPS = np.array([12000] * 99 + [65535], np.uint16)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_codes_of_texts_are_numbers_of_a_switch_or_gaps(tmp_path: Path, version: str) -> None:
    """A trigger that is off or on, a number with one code for none, gears, and raw frames of a bus."""
    from asammdf.blocks.conversion_utils import from_dict

    switch = from_dict({"val_0": 0, "text_0": "off", "val_1": 1, "text_1": "on"})
    gear = from_dict(
        {f"{key}_{i}": value for i, name in enumerate("PND") for key, value in (("val", i), ("text", name))}
    )
    none = {"val_0": 65535, "text_0": "SNA"} | ({"default_addr": {"a": 0.1, "b": 0.0}} if version > "4" else {})
    channels = [("TTL", CODES, switch), ("p", GAPS, from_dict(none)), ("gear", CODES % 3 + CODES // 1, gear)]
    record = asammdf.MDF(version=version)
    record.append([asammdf.Signal(values, TIME, "bar", name, conversion=rule) for name, values, rule in channels])
    if version > "4":
        frames = np.core.records.fromarrays(
            [np.zeros((100, 8), np.uint8)], dtype=[("CAN_DataFrame.DataBytes", "u1", (8,))]
        )
        record.append([asammdf.Signal(frames, TIME, name="CAN_DataFrame")])
    path = record.save(tmp_path / "a", overwrite=True)
    record.close()
    found, unread = read_channels(MdfFile(Path(path)))
    assert {c.name: (c.size, c.low, c.high) for c in found if not c.name.startswith("CAN")} == {
        "TTL": (100, 0.0, 1.0),
        "p": (99, *(2 * (1200.0 if version > "4" else 12000.0,))),
    }
    assert set(unread) >= {"gear"} | ({"CAN_DataFrame"} if version > "4" else set())


@pytest.mark.usefixtures("in_process")
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mf4", ("g", [signal(RATE), signal(RATE, "TRIG", "V")]))
    with refused(InputError, 'missing-column column "RIO"', "a.mf4"):
        read(path, "RIO")
    with pytest.raises(InputError, match=r'"ROI" .*"time", .*"t"'):
        read(path, time="t")
    with refused(InputError, "several-times", "a.mf4"):
        read_columns(path, [Column("ROI", "m3/s"), Column("TRIG", "V")])
    with pytest.raises(InputError, match=r'"TRIG": .*mm3/ms .*"V"'):
        read(path, "TRIG")


def test_a_damaged_record_is_one_sentence(tmp_path: Path) -> None:
    """In a process of its own: what is left of asammdf's objects complains when it is collected."""
    path = written(tmp_path / "a.mf4", ("g", [signal(RATE), signal(RATE, "TRIG", "V")]))
    (tmp_path / "b.mf4").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(InputError, match=r"b\.mf4"):
        read(tmp_path / "b.mf4")
    (tmp_path / "c.mf4").write_bytes(b"no record at all")
    with pytest.raises(InputError, match=r"c\.mf4: .*MDF .*\(\w"):
        read(tmp_path / "c.mf4")


@pytest.mark.usefixtures("in_process")
def test_a_channel_beyond_the_limit_is_refused_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    long, short = signal(RATE), signal(RATE[:5], "p", "bar", TIME[:5])
    path = written(tmp_path / "a.mf4", ("fast", [long]), ("slow", [short]))
    monkeypatch.setattr("commonrail.plugins.formats.records.MOST_SAMPLES", 50)
    with pytest.raises(InputError, match=r'"ROI": .*\b100 samples.*\b50 '):
        read(path)
    pressure = read_columns(path, [Column("time", "s", increasing=True), Column("p", "Pa")])
    assert len(pressure.columns["p"]) == 5


@pytest.mark.usefixtures("in_process")
def test_a_sample_that_is_no_number_has_its_place(tmp_path: Path) -> None:
    values = RATE.copy()
    values[7] = np.nan
    with pytest.raises(InputError, match=r'sample 8, column "ROI": .*finite'):
        read(written(tmp_path / "a.mf4", ("g", [signal(values)])))


@pytest.mark.usefixtures("in_process")
def test_channels_of_version_3_without_a_rule_are_read(tmp_path: Path) -> None:
    record = asammdf.MDF(version="3.30")
    record.append([signal(RATE)])
    record.save(tmp_path / "a.mdf")
    record.close()
    np.testing.assert_allclose(read(tmp_path / "a.mdf").columns["ROI"], RATE * 1e-6, rtol=1e-12)


def test_the_reason_of_a_damaged_record_names_no_object(tmp_path: Path) -> None:
    (tmp_path / "a.mf4").write_bytes(b"")
    with pytest.raises(InputError, match=r"MDF .*\(\w+\)\.$"):
        MdfFile(tmp_path / "a.mf4")
