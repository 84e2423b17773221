"""Files of the virtual bench: what they say of themselves, and that they hold the bench's signals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.paper.bench import ENERGISING_TIME, Truth, bench_curve
from commonrail.plugins.paper.bench_file import load_truth, virtual_bench
from commonrail.readers.columns import Column
from commonrail.readers.injector import load_injector
from commonrail.readers.tables import read_columns

SEED = 7


@pytest.fixture(scope="module")
def truth() -> Truth:
    """The default truth on coarse pipes, under a title of two lines."""
    truth = load_truth("virtual-lino-2016")
    return replace(truth, name="mine", title="one\ntwo", resolution=truth.resolution._replace(cells=(60, 30)))


@pytest.fixture(scope="module")
def written(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return virtual_bench(tmp_path_factory.mktemp("case"), SEED, truth)


def test_a_case_has_three_curves(written: list[Path]) -> None:
    assert [f"{path.parent.name}/{path.name}" for path in written] == [
        f"data/evi_{rail}MPa.csv" for rail in (160, 120, 80)
    ]


def test_the_files_say_what_they_are(written: list[Path]) -> None:
    for path, rail in zip(written, (160, 120, 80), strict=True):
        head = [line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
        assert head[0].startswith("# SYNTHETIC: ")
        assert head[1] == "# truth mine (one two), seed 7"
        assert head[2] == f"# asked for: rail pressure {rail} MPa, energising time 700 us"


def test_the_files_hold_the_benchs_signals(written: list[Path], truth: Truth) -> None:
    curve = bench_curve(truth, load_injector(truth.injector), 120e6, ENERGISING_TIME, SEED)
    columns = read_columns(
        written[1], [Column("time", "s"), Column("rate", "m3/s"), Column("rail pressure", "Pa")]
    ).columns
    np.testing.assert_allclose(columns["time"], curve.time, rtol=0, atol=0.5e-9)  # three decimals of a microsecond
    # nine digits
    np.testing.assert_allclose(columns["rate"], curve.rate, rtol=1e-8)
    np.testing.assert_allclose(columns["rail pressure"], curve.rail, rtol=1e-8)


def test_signals_are_written_in_steps_of_their_resolution(written: list[Path]) -> None:
    rows = [line.split(",") for line in written[0].read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    assert rows[0] == ["time [us]", "rate [mm3/ms]", "rail pressure [MPa]"]
    for _, rate, rail in rows[1:]:
        assert len(rate.partition(".")[2]) <= 2
        assert len(rail.partition(".")[2]) <= 2


def test_a_place_that_cannot_be_written_is_refused(
    truth: Truth, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = bench_curve(truth, load_injector(truth.injector), 80e6, ENERGISING_TIME, SEED)
    monkeypatch.setattr("commonrail.plugins.paper.bench_file.bench_curve", lambda *_: curve)
    (tmp_path / "data").write_text("a file")
    with pytest.raises(InputError, match=rf"/{tmp_path.name}: .*written \("):
        virtual_bench(tmp_path, SEED, truth)


def test_a_file_that_the_bench_has_not_made_stays(tmp_path: Path) -> None:
    own = tmp_path / "data" / "evi_120MPa.csv"
    own.parent.mkdir()
    own.write_text("my measurement")
    with pytest.raises(InputError, match=r"evi_120MPa\.csv: .*\bbench\b"):
        virtual_bench(tmp_path, 1)
    assert own.read_text() == "my measurement"
    assert len(list(own.parent.iterdir())) == 1
