"""Rate of one hole for flow simulations: exact in mass, with its band, read back by a program of others."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from commonrail.calibration.study_file import load_study
from commonrail.runs.fit import calibrate_into
from tests.cli.conftest import Command, small_study

INJECTOR, HOLES = "virtual-lino-2016", 7
POINT = ("--rail-pressure", "130MPa", "--energising-time", "500us")


def read_plain(path: Path) -> np.ndarray:
    """Points (n, 2) of a table."""
    lines = [line.strip(" ()") for line in path.read_text(encoding="utf-8").splitlines()]
    return np.array([line.split() for line in lines if re.fullmatch(r"[-+.\de]+ [-+.\de]+", line)], float)


@pytest.mark.parametrize("ending", [".foam", ".dat"])
@pytest.mark.parametrize(
    ("more", "holes"),
    [
        (("--energising-time", "500us"), 7),
        (("--energising-time", "500us", "--time-step", "0.7us"), 7),
        (("--energising", "0us:200us", "--energising", "900us:500us"), 7),
        (("--energising-time", "500us", "--set", "nozzle.holes=14"), 14),
    ],
)
def test_the_table_carries_the_mass_of_one_hole(
    ending: str, more: tuple[str, ...], holes: int, tmp_path: Path, command: Command
) -> None:
    point = (*POINT[:2], *more)
    done = command("simulate", INJECTOR, *point, "--out", tmp_path / f"rate{ending}", "--json")
    assert done.status == 0, done.err
    table = read_plain(tmp_path / f"rate{ending}")
    mass = np.trapezoid(table[:, 1], table[:, 0])
    assert holes * mass == pytest.approx(done.record["injected_mass"], rel=1e-9)
    assert (np.diff(table[:, 0]) > 0.0).all()
    assert (table[:, 1] >= 0.0).all()
    assert table[0, 1] == table[-1, 1] == 0.0


def test_the_course_is_that_of_the_simulation(tmp_path: Path, command: Command) -> None:
    command("simulate", INJECTOR, *POINT, "--out", tmp_path / "all.csv")
    assert command("simulate", INJECTOR, *POINT, "--out", tmp_path / "rate.dat").status == 0
    rows = [line.split(",") for line in (tmp_path / "all.csv").read_text("utf-8").splitlines() if line[0].isdigit()]
    end, rate = np.array([[float(row[0]), float(row[2])] for row in rows]).T  # [us], [mg/ms], mean of the us before
    table = read_plain(tmp_path / "rate.dat")
    at_middle = np.interp(1e-6 * (end - 0.5), table[:, 0], table[:, 1])
    away = np.abs(HOLES * at_middle - 1e-3 * rate) / (1e-3 * rate.max())
    assert np.quantile(away, 0.99) < 1e-3
    assert away.max() < 0.05  # where the needle lands, within a sample


def test_the_head_tells_model_fuel_and_holes(tmp_path: Path, command: Command) -> None:
    command("simulate", INJECTOR, *POINT, "--out", tmp_path / "rate.dat")
    head = [line for line in (tmp_path / "rate.dat").read_text("utf-8").splitlines() if line.startswith("#")]
    assert all(any(text in line for line in head) for text in (INJECTOR, "130 MPa", "iso4113", "7 holes", "synthetic"))


def test_foamlib_reads_the_same_points(tmp_path: Path, command: Command) -> None:
    foamlib = pytest.importorskip("foamlib", reason="foamlib is not installed")
    command("simulate", INJECTOR, *POINT, "--out", tmp_path / "rate.foam")
    lines = (tmp_path / "rate.foam").read_text("utf-8").splitlines()
    short = tmp_path / "short.foam"  # of 900 points foamlib takes two minutes
    short.write_text("\n".join([*lines[:40], lines[-1]]), encoding="utf-8")
    found = np.array(foamlib.FoamFile(short)[()], float)
    assert np.array_equal(found, read_plain(short))
    assert len(found) > 30


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of a study that fits an injection curve."""
    folder = tmp_path_factory.mktemp("cfd")
    calibrate_into(folder / "run", load_study(small_study(folder / "small")), threads=1)
    return folder / "run"


def test_the_rate_of_a_fit_has_its_band_beside_it(run: Path, tmp_path: Path, command: Command) -> None:
    done = command("simulate", run, *POINT, "--out", tmp_path / "rate.foam", "--json")
    names = ["rate.foam", "rate_lower.foam", "rate_upper.foam"]
    assert [Path(path).name for path in done.record["files"]] == names, done.err
    rate, lower, upper = (read_plain(tmp_path / name) for name in names)
    times = rate[rate[:, 1] > 0.1 * rate[:, 1].max(), 0]
    low, middle, high = (np.interp(times, table[:, 0], table[:, 1]) for table in (lower, rate, upper))
    assert (low <= middle * (1.0 + 1e-6)).all()
    assert (middle <= high * (1.0 + 1e-6)).all()
    assert (high > low).any()


def test_a_changed_injector_has_no_band(run: Path, tmp_path: Path, command: Command) -> None:
    changed = ("--set", "valve.lift=60um")
    done = command("simulate", run, *POINT, *changed, "--out", tmp_path / "rate.dat", "--json")
    assert len(done.record["files"]) == 1


def test_a_band_that_cannot_be_told_is_a_note(
    run: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("commonrail.plugins.prediction.run.RateData", int)  # as if no curve were fitted
    done = command("simulate", run, *POINT, "--out", tmp_path / "rate.dat", "--json")
    assert (done.status, len(done.record["files"])) == (0, 1)
    assert "no band: " in done.err


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (("--energising-time", "50us"), "injects nothing"),
        (("--energising-time", "2ms", "--horizon", "1.5ms"), "longer --horizon"),
    ],
)
def test_what_is_no_whole_injection_is_refused(
    point: tuple[str, ...], words: str, tmp_path: Path, command: Command
) -> None:
    done = command("simulate", INJECTOR, *POINT[:2], *point, "--out", tmp_path / "rate.foam")
    assert done.status == 2
    assert words in done.err
    assert list(tmp_path.iterdir()) == []
