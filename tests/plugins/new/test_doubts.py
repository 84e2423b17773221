"""`new` asks about what files of a bench leave open: delay of the meter, unit of the rate, operating point."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from tests.cli.conftest import run_command

INJECTOR = "virtual-lino-2016"
POINTS = ((500, 600), (1000, 700), (1600, 900))  # bar, us
DENSITY = 0.83  # mg/mm³


def simulated(rail: int, time: int) -> tuple[np.ndarray, np.ndarray]:
    """Times [us] from -200 to 3000 and rates [mm³/ms] of the injector itself."""
    point = cr.OperatingPoint(1e5 * rail, 1e-6 * time, "5 MPa", "0.5 MPa", horizon=3e-3)
    found = cr.simulate(cr.load_injector(INJECTOR), point)
    times = np.arange(-200.0, 3000.0, 5.0)
    volume = 1e9 * np.interp(1e-6 * times, found.time, found.injected / found.reference_density)
    return times, np.diff(volume, prepend=0.0) / 5e-3


@pytest.fixture(scope="module")
def rates() -> dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]:
    return {point: simulated(*point) for point in POINTS}


Rates = Mapping[tuple[int, int], tuple[np.ndarray, np.ndarray]]


def write(folder: Path, rates: Rates, late: Callable[[int], float], gain: float = 1.0, head: str = "rate") -> list[str]:
    """Files of curves that come later by a time [us] of the rail pressure [bar]; the words that name them."""
    words = []
    for (rail, time), (times, rate) in rates.items():
        shown = gain * np.interp(times - late(rail), times, rate)
        rows = "".join(f"{t:g},{value:.5g}\n" for t, value in zip(times, shown, strict=True))
        path = folder / f"{rail}bar_{time}us.csv"
        path.write_text(f"time [us],{head} [mm3/ms]\n{rows}", encoding="utf-8")
        words += ["--from", str(path)]
    return words


def new(folder: Path, words: list[str], *more: str) -> dict[str, object]:
    common = ("--injector", INJECTOR, "--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa")
    done = run_command("new", folder / "s", *common, "--free", "valve.lift", *words, *more, "--json")
    assert done.status == 0, done.err
    return done.record


@pytest.mark.parametrize("delay", [310.0, -250.0])
def test_a_delay_that_all_curves_share_is_one_free_meter(delay: float, rates: Rates, tmp_path: Path) -> None:
    record = new(tmp_path, write(tmp_path, rates, lambda _: delay))
    study = cr.load_study(tmp_path / "s" / "study.toml")
    meters = {data.meter for data in study.data}
    assert len(meters) == 1
    free = next(p for p in study.space.parameters if p.name == "meter.bench.delay")
    assert free.reference == pytest.approx(1e-6 * delay, abs=15e-6)  # three samples of a curve
    assert free.lower < 1e-6 * delay < free.upper
    assert "meters.bench.delay" in record["assumed"]
    assert cr.fit.check_study(study) == ()


@pytest.mark.parametrize("late", [lambda rail: 0.0, lambda rail: 500.0 - 0.3 * rail, lambda rail: 60.0])
def test_onsets_of_the_injector_are_no_delay_of_a_meter(
    late: Callable[[int], float], rates: Rates, tmp_path: Path
) -> None:
    """None at all, one that depends on the pressure, and one that a drawing misses."""
    record = new(tmp_path, write(tmp_path, rates, late))
    assert "\n[meters." not in (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    assert "meters.bench.delay" not in record["assumed"]


def write_map(folder: Path, rates: Rates) -> list[str]:
    """File of a map that holds the points of the curves among others."""
    rows = []
    for (rail, time), (_, rate) in rates.items():
        quantity = 5e-3 * rate.sum()
        rows += [f"{rail},{t},{quantity * t / time:.4g}\n" for _, t in POINTS]
    (folder / "map.csv").write_text(f"p [bar],ET [us],q [mm3]\n{''.join(rows)}", encoding="utf-8")
    return ["--from", str(folder / "map.csv")]


@pytest.mark.parametrize(
    ("gain", "head", "with_map", "doubted"),
    [
        (DENSITY, "rate", True, True),  # the map says so
        (1.0, "rate", True, False),
        (0.95, "rate", True, False),  # a meter that is calibrated badly
        (DENSITY, "rate", False, False),  # nothing says so
        (1.0, "ROI_mg", False, True),  # the name says so
    ],
)
def test_a_rate_is_doubted_to_be_a_volume_where_something_says_so(
    gain: float, head: str, with_map: bool, doubted: bool, rates: Rates, tmp_path: Path
) -> None:
    words = write(tmp_path, rates, lambda _: 0.0, gain, head) + (write_map(tmp_path, rates) if with_map else [])
    record = new(tmp_path, words)
    assert ("data[1].rate_unit" in record["assumed"]) is doubted
    codes = [finding.code for finding in cr.fit.check_study(cr.load_study(tmp_path / "s" / "study.toml"))]
    assert ("unit" in codes) is (doubted and with_map)


@pytest.mark.parametrize("option", ["--rail-pressure", "--energising-time"])
def test_one_operating_point_is_not_taken_for_curves_that_state_others(
    option: str, rates: Rates, tmp_path: Path
) -> None:
    value = {"--rail-pressure": "50MPa", "--energising-time": "600us"}[option]
    words = write(tmp_path, rates, lambda _: 0.0)
    common = ("--injector", INJECTOR, "--free", "valve.lift", option, value)
    assert run_command("new", tmp_path / "s", *common, *words).status == 2
    assert run_command("new", tmp_path / "s", *common, *write_map(tmp_path, rates)).status == 2  # which has its points
    assert not (tmp_path / "s").exists()
    for path, text in ((tmp_path / "a.csv", "1600bar_900us"), (tmp_path / "b.csv", "rate")):  # a column states one
        path.write_text((tmp_path / "500bar_600us.csv").read_text().replace("rate", text), encoding="utf-8")
    assert run_command("new", tmp_path / "s", *common, "--from", tmp_path / "a.csv").status == 2
    assert run_command("new", tmp_path / "s", *common, "--from", tmp_path / "b.csv").status == 0


@pytest.mark.parametrize(
    ("line", "other"),
    [
        ('base = "cri2-16"', 'base = "cri2-99"'),
        ('base = "cri2-16"', ""),
        ("holes = 7", "holes = 7 7"),
        ("holes = 7", 'hole_diameter = "7 kg"'),
        ("holes = 7", 'holes = 7\n[fuel]\nfile = "fuel.toml"'),
    ],
)
def test_a_broken_drawing_leaves_no_folder(line: str, other: str, rates: Rates, tmp_path: Path) -> None:
    """The same drawing without a fault, which has no table `[fuel]`, is enough."""
    text = 'format = "commonrail-injector/1"\nname = "half"\nbase = "cri2-16"\n[nozzle]\nmark = "M"\nholes = 7\n'
    words = ("--free", "valve.lift", *write_map(tmp_path, rates))
    for name, content in (("broken", text.replace(line, other)), ("sound", text)):
        (tmp_path / f"{name}.toml").write_text(content, encoding="utf-8")
    assert run_command("new", tmp_path / "a", "--injector", tmp_path / "broken.toml", *words).status == 2
    assert not (tmp_path / "a").exists()
    assert run_command("new", tmp_path / "a", "--injector", tmp_path / "sound.toml", *words).status == 0


def test_a_map_in_another_unit_of_time_is_refused_by_its_file(tmp_path: Path) -> None:
    """Milliseconds written as they are, where microseconds are usual: no study would read them."""
    path = tmp_path / "map.csv"
    path.write_text("p [bar],ET [ms],q [mm3]\n800,250,10\n1200,700,40\n", encoding="utf-8")
    done = run_command("new", tmp_path / "s", "--injector", INJECTOR, "--from", path)
    assert done.status == 2
    assert f"{path}, line 2" in done.err
    assert not (tmp_path / "s").exists()
