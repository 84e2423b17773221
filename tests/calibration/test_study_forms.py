"""Data of a study as they come: matrices, several curves of one file, records of shots, repeated strokes."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.base.hooks import quiet
from commonrail.calibration.study_file import load_study
from commonrail.data.base import DataSet, value_widths
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.plugins.certainty.noise_fit import row_weights
from commonrail.readers.columns import FileForm, Sheet
from commonrail.readers.tables import open_sheet
from tests.child_in_process import read_in_process
from tests.refused import refused

STUDY = """
format = "commonrail-study/1"
title = "forms"
injector = "virtual-lino-2016"

[[data]]
kind = "{kind}"
name = "d"
role = "fit"
file = "{file}"
cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"
{keys}

[[parameter]]
name = "valve.mass"
below = "50 %"
above = "50 %"
"""

Load = Callable[..., list[DataSet]]


@pytest.fixture(autouse=True)
def _in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read records in this process, which is faster than in one of their own."""
    read_in_process(monkeypatch)


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """The data sets of a block with some keys."""

    def run(file: str, keys: str, content: str | bytes | None = None, kind: str = "rate") -> list[DataSet]:
        if content is not None:
            (tmp_path / file).write_bytes(content.encode() if isinstance(content, str) else content)
        (tmp_path / "study.toml").write_text(STUDY.format(kind=kind, file=file, keys=keys), encoding="utf-8")
        with quiet():
            return list(load_study(tmp_path / "study.toml").data)

    return run


def place(data: DataSet) -> tuple[float, float]:
    """Rail pressure [MPa] and energising time [us] of a curve."""
    (point,) = data.points
    return round(point.initial_pressures()[0] * 1e-6, 6), round(point.pulses[0].duration * 1e6, 6)


MATRIX = "Menge [mm³]\nRaildruck [bar] \\ ET [µs];300;700\n800;1,5;26\n1600;5,5;52,25\n"


@pytest.mark.parametrize("encoding", ["cp1252", "utf-16"])
def test_a_matrix_of_a_german_spreadsheet(load: Load, encoding: str) -> None:
    (data,) = load("map.csv", 'layout = "matrix"', MATRIX.encode(encoding), "quantities")
    assert isinstance(data, QuantityData)
    np.testing.assert_allclose(data.quantity, [1.5e-9, 26e-9, 5.5e-9, 52.25e-9])
    assert [round(p.initial_pressures()[0]) for p in data.points] == [80e6, 80e6, 160e6, 160e6]


def test_rows_with_other_names_are_found_and_a_matrix_is_asked_for(load: Load) -> None:
    table = "p [MPa],ET [us],Q [mg]\n80,300,1\n80,700,20\n"
    (data,) = load("map.csv", 'layout = "found"', table, "quantities")
    assert isinstance(data, QuantityData)
    assert data.quantity[1] == pytest.approx(20e-6 / np.asarray(data.mass_density)[1])
    with refused(InputError, "no-matrix"):
        load("map.csv", 'layout = "matrix"', None, "quantities")
    np.testing.assert_array_equal(load("map.csv", "", None, "quantities")[0].measured, data.measured)


def test_a_negative_quantity_of_a_matrix_has_its_line(load: Load) -> None:
    with refused(InputError, 'out-of-range line 4, column "quantity"'):
        load("map.csv", 'layout = "matrix"', MATRIX.replace("5,5", "-5,5"), "quantities")


def test_repeated_strokes_become_means_with_their_standard_error(load: Load) -> None:
    rows = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n"
    table = rows + "80,300,1\n80,700,20\n80,300,3\n80,700,22\n"
    keys = 'absolute = "1 mm3"\nrelative = 0\n'
    (data,) = load("map.csv", keys + 'repeated = "mean"', table, "quantities")
    assert isinstance(data, QuantityData)
    np.testing.assert_allclose(data.quantity, [2e-9, 21e-9])
    assert data.noise.sigma == pytest.approx(1.0)  # of each stroke √2 tolerances, of a mean of two one
    assert data.noise.freedom == 2.0  # one of each pair
    assert data.source.endswith("means of 2 strokes")
    (each,) = load("map.csv", keys, None, "quantities")
    assert (len(each.points), each.noise.sigma) == (4, None)
    (stated,) = load("map.csv", keys + 'repeated = "mean"\nnoise = { sigma = 2 }', None, "quantities")
    assert (stated.noise.sigma, stated.noise.freedom) == (2.0, np.inf)


def test_dead_times_are_no_repeated_strokes(load: Load, tmp_path: Path) -> None:
    table = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n80,300,2\n80,700,20\n80,300,4\n80,700,22\n"
    (tmp_path / "dead.csv").write_text("rail_pressure [MPa],energising_time [us]\n80,250\n", encoding="utf-8")
    dead = 'dead_times = { file = "dead.csv", quantity = "1 mm3" }\n'
    keys = 'absolute = "2 mm3"\nrelative = 0\nrepeated = "mean"\n' + dead
    (data,) = load("map.csv", keys, table, "quantities")
    assert len(data.points) == 3
    assert data.noise.sigma == pytest.approx(0.5)  # of a stroke √½ tolerances, of a mean of two half a one
    # the dead time has no repeats, so that one tolerance counts as its standard deviation, as 0.5 does of the means
    np.testing.assert_allclose(data.residuals(np.zeros(3)), [-1.5, -10.5, -0.5])
    np.testing.assert_allclose(1.0 / np.sqrt(row_weights(data)), [1.0, 1.0, 0.5])


WIDE = "time [us];800bar_300us [mm3/ms];1600bar_700us [mm3/ms];T [degC]\n" + "".join(
    f"{5 * i};{i},5;{2 * i if i < 8 else ''};40\n" for i in range(10)
)


def test_columns_named_by_their_points_are_a_curve_each(load: Load) -> None:
    first, second = load("w.csv", 'columns = "{p}bar_{et}us"\ndecimal = ","', WIDE)
    assert [place(first), place(second)] == [(80.0, 300.0), (160.0, 700.0)]
    assert [first.name, second.name] == ["d, 80 MPa 300 us", "d, 160 MPa 700 us"]
    np.testing.assert_allclose(first.measured, 1e-6 * (np.arange(10) + 0.5))
    np.testing.assert_allclose(second.measured, 2e-6 * np.arange(8))  # it ends where its cells do


def test_traces_below_rows_with_their_points(load: Load) -> None:
    rows = "".join(f"{5 * i};{i},5;{2 * i}\n" for i in range(10))
    head = "Raildruck [bar];800;1600\nET [µs];300;700\nZeit [µs];Rate [mm³/ms];Rate [mm³/ms]\n"
    first, second = load("h.csv", 'layout = "header rows"', (head + rows).encode("cp1252"))
    assert [place(first), place(second)] == [(80.0, 300.0), (160.0, 700.0)]
    np.testing.assert_allclose(first.measured, 1e-6 * (np.arange(10) + 0.5))
    np.testing.assert_allclose(first.bounds, 5e-6 * np.arange(-1, 10), atol=1e-18)


def test_repeated_columns_become_their_mean(load: Load) -> None:
    table = "time [us],800bar_300us_1,800bar_300us_2\n" + "".join(f"{5 * i},{i},{i + 2}\n" for i in range(10))
    (data,) = load("w.csv", 'columns = "{p}bar_{et}us_{shot}"\nrate_unit = "mm3/ms"', table)
    np.testing.assert_allclose(data.measured, 1e-6 * (np.arange(10) + 1.0))
    # the mean m is i + 1, the shots m ± 1 are off as wholes by ± Σm/Σm² = ± 1/7, and what is left is ± (1 − m/7)
    left = 0.1 * (10.0 - 2.0 * 55.0 / 7.0 + 385.0 / 49.0)
    assert data.noise.sigma == pytest.approx(1e-6 * left**0.5)
    assert data.noise.scatter == pytest.approx((1.0 / 49.0 - left / 385.0) ** 0.5)
    assert data.source.endswith("mean of 2 shots")


def test_resampling_keeps_the_quantity_and_a_zero_moves_the_times(load: Load) -> None:
    table = "time [us],rate [mm3/ms]\n" + "".join(f"{3 * i + 100},{i}\n" for i in range(1, 41))
    point = 'rail_pressure = "80 MPa"\nenergising_time = "300 us"\ntime_zero = "100 us"\n'
    (own,) = load("r.csv", point + 'window = ["0 us", "120 us"]', table)
    assert isinstance(own, RateData)
    (coarse,) = load("r.csv", point + 'window = ["0 us", "120 us"]\nresample = "20 us"')
    (fine,) = load("r.csv", point + 'window = ["0 us", "120 us"]\nresample = "1 us"')
    np.testing.assert_allclose(coarse.bounds, 20e-6 * np.arange(7), atol=1e-15)
    volume = np.sum(own.measured * value_widths(own))
    for other in (coarse, fine):
        assert np.sum(other.measured * value_widths(other)) == pytest.approx(volume, rel=1e-12)
    # the table has the means of a rate of t/3 us + 0.5, and so has any finer raster
    np.testing.assert_allclose(fine.measured, 1e-6 * ((np.arange(120) + 0.5) / 3.0 + 0.5))


POINTS = ((800.0, 300.0), (1600.0, 700.0))
AHEAD = 42e-6  # time of the trigger before the energising [s], between two samples


@functools.cache
def _record(shots: int, noise: float) -> bytes:
    asammdf = pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    random = np.random.default_rng(1)
    time = 1e-5 * np.arange(1, int(shots * 500) + 1)
    flow, trigger = random.normal(0.0, noise, len(time)) if noise else np.zeros(len(time)), np.zeros(len(time))
    starts = 1e-3 + 5e-3 * np.arange(shots)
    for i, start in enumerate(starts):
        p, et = POINTS[i % 2]
        since = (time - start) / 1e-3
        flow += np.where((since > 0.0) & (since <= 1.0), p / 40.0 * np.sin(np.pi * np.clip(since, 0.0, 1.0)), 0.0)
        trigger[(time > start - AHEAD) & (time < start + et * 1e-6)] = 5.0
    sets = np.array([POINTS[i % 2] for i in range(shots)])
    one = asammdf.MDF()
    one.append([asammdf.Signal(flow, time, "mm3/ms", "ROI"), asammdf.Signal(trigger, time, "V", "TRIG")])
    slow = [
        asammdf.Signal(sets[:, k], starts - 1e-3, unit, name) for k, unit, name in ((0, "bar", "p"), (1, "us", "t"))
    ]
    one.append(slow)
    with tempfile.TemporaryDirectory() as folder:
        one.save(Path(folder, "a.mf4"))
        one.close()
        return Path(folder, "a.mf4").read_bytes()


def record(path: Path, *, shots: int = 8, noise: float = 0.0) -> None:
    """Shots of a half sine, 5 ms apart, by turns at two operating points, each with a trigger ahead of it.

    Parameters
    ----------
    path : Path
    shots : int
    noise : float
        Standard deviation of a sample [mm³/ms].
    """
    path.write_bytes(_record(shots, noise))


SHOTS = """
rate = "ROI"
window = ["-50 us", "1500 us"]
shots = { trigger = "TRIG", offset = "45 us", rail_pressure = "p", energising_time = "t" }
"""


def test_shots_are_cut_at_their_triggers_and_averaged_at_their_points(load: Load, tmp_path: Path) -> None:
    record(tmp_path / "r.mf4")
    first, second = load("r.mf4", SHOTS)
    assert [place(first), place(second)] == [(80.0, 300.0), (160.0, 700.0)]
    assert first.bounds is not None
    since = first.bounds[1:]
    true = np.where((since > 0.0) & (since < 1e-3), 20e-6 * np.sin(np.pi * since / 1e-3), 0.0)
    # The edge lies half way between the samples 40 and 50 us ahead. What remains is the rounding of the times.
    np.testing.assert_allclose(first.measured, true, atol=1e-14)
    np.testing.assert_allclose(second.measured, 2.0 * first.measured, atol=1e-14)
    assert first.source.endswith("mean of 4 shots")


def test_the_offset_is_the_time_from_the_trigger_to_the_energising(load: Load, tmp_path: Path) -> None:
    record(tmp_path / "r.mf4")
    right, _ = load("r.mf4", SHOTS)
    late, _ = load("r.mf4", SHOTS.replace("45 us", "5 us"))
    np.testing.assert_allclose(late.measured[4:], right.measured[:-4], atol=1e-12)


def test_the_scatter_of_shots_is_the_noise_of_their_mean(load: Load, tmp_path: Path) -> None:
    record(tmp_path / "r.mf4", shots=40, noise=0.4)
    first, _ = load("r.mf4", SHOTS)
    # 20 shots of 155 samples: the estimate scatters by 1.3 %, four times that is allowed.
    assert first.noise.sigma == pytest.approx(0.4e-6 / np.sqrt(20.0), rel=0.05)


def test_a_shot_that_the_record_cuts_is_omitted(load: Load, tmp_path: Path) -> None:
    record(tmp_path / "r.mf4")
    first, second = load("r.mf4", SHOTS.replace("1500 us", "4500 us"))
    assert (first.source[-7:], second.source[-7:]) == ("4 shots", "3 shots")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"TRIG"', '"TTL"', 'missing-column column "TTL"'),
        (
            '"TRIG"',
            '"TRIG", level = "9 V"',
            "no-trigger data[1].shots.trigger",
        ),
        ('"TRIG"', '"TRIG", level = "9 A"', "wrong-unit data[1].shots.level"),
        ('"ROI"', '"p"', 'wrong-unit column "p"'),
        ('window = ["-50 us", "1500 us"]', "", "missing-window data[1]"),
        ('"1500 us"', '"150 ms"', "no-whole-shot data[1].window"),
        ("window =", 'time_zero = "1 ms"\nwindow =', "idle-key data[1].time_zero"),
        ("window =", 'rail_pressure = "80 MPa"\nwindow =', "idle-key data[1].rail_pressure"),
        ("window =", 'columns = "{p}bar"\nwindow =', "conflict data[1]"),
        (', rail_pressure = "p"', "", "missing data[1].rail_pressure"),
        ("window =", 'resample = "1 ms"\nwindow =', "wrong-number data[1].resample"),
        (
            '"45 us"',
            '"10.045 ms"',
            "other-shot data[1].shots.offset",
        ),
    ],
)
def test_what_is_wrong_with_shots_is_one_sentence(load: Load, tmp_path: Path, old: str, new: str, words: str) -> None:
    record(tmp_path / "r.mf4")
    assert old in SHOTS
    with refused(CommonrailError, words):
        load("r.mf4", SHOTS.replace(old, new))


@pytest.mark.parametrize(
    ("file", "content", "keys", "words"),
    [
        (
            "w.csv",
            WIDE,
            'columns = "{p}MPa_{et}us"\ndecimal = ","',
            "no-columns data[1].columns",
        ),
        (
            "w.csv",
            WIDE.replace("1600bar_700us", "800,0bar_300us"),
            'columns = "{p}bar_{et}us"\ndecimal = ","',
            "repeated data[1].columns",
        ),
        (
            "w.csv",
            WIDE,
            'columns = "{p}bar_{et}us"\ndecimal = ","\nwindow = ["0 us", "20 ms"]',
            "window-outside data[1].window",
        ),
        ("w.csv", WIDE, 'encoding = "klingon"', "unknown-encoding data[1].encoding"),
        ("h.csv", "time [us];rate [mm3/ms]\n0;1\n5;2\n", 'layout = "header rows"', "no-points"),
    ],
)
def test_what_is_wrong_with_several_curves_is_one_sentence(
    load: Load, file: str, content: str, keys: str, words: str
) -> None:
    with refused(CommonrailError, words):
        load(file, keys, content)


def test_pressures_of_many_curves_are_read_from_their_file_once(load: Load, monkeypatch: pytest.MonkeyPatch) -> None:
    bars = (800, 1000, 1200, 1600)
    head = ["time [us]", *(f"r_{p}bar [mm3/ms]" for p in bars), *(f"p_{p}bar [bar]" for p in reversed(bars))]
    rows = [[10 * i, *(p / 100 + i for p in bars), *(p - 0.5 * i for p in reversed(bars))] for i in range(6)]
    text = "\n".join(",".join(map(str, row)) for row in [head, *rows])
    opened: list[Path] = []

    def counted(path: Path, form: FileForm) -> Sheet:
        opened.append(path)
        return open_sheet(path, form)

    monkeypatch.setattr("commonrail.data.study_block.open_sheet", counted)
    keys = 'columns = "r_{p}bar"\nenergising_time = "300 us"\nrail_pressure = { column = "p_{p}bar" }'
    curves = load("w.csv", keys, text)
    assert [round(curve.points[0].rail_pressure.value[0] * 1e-5) for curve in curves] == list(bars)
    assert len(opened) == 1  # for the rates and for the pressures


def test_a_drive_cannot_belong_to_several_curves(load: Load) -> None:
    keys = 'columns = "{p}bar_{et}us"\ndecimal = ","\ndrive = { column = "T" }'
    with refused((ConfigurationError, InputError), "shared-drive data[1].drive"):
        load("w.csv", keys, WIDE)
