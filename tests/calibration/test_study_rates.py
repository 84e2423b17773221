"""Injection curves of a study: samples, windows, operating points, masses and measured courses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateData
from commonrail.engine.operating_point import Energising, Trace
from tests.refused import refused

Edit = Callable[..., Path]

WINDOW = 'window = ["0 us", "1600 us"] # samples that count\n'
FILE = 'file = "data/evi.csv" # columns time [us] and rate [mm3/ms] (or mg/ms)\n'
RAIL = 'rail_pressure = "160 MPa" # or { file = "data/rail.csv", column = "pressure" } for a measured time series\n'
ENERGISING = 'energising_time = "700 us" # from time 0; or energisings = [{ start = "0 us", duration = "700 us" }]\n'
OWN = 'file = "own.csv"\n'
# Ten samples, 10 us apart, the rate counting up from 1.
SAMPLES = "".join(f"{10 * k},{k}\n" for k in range(1, 11))


@pytest.fixture
def curve(study_file: Edit, tmp_path: Path) -> Callable[..., RateData]:
    """The data set of a study with own samples and some parts replaced."""

    def load(*replacements: tuple[str, str], header: str = "time [us],rate [mm3/ms]") -> RateData:
        (tmp_path / "own.csv").write_text(f"{header}\n{SAMPLES}", encoding="utf-8")
        window = [] if any(old == WINDOW for old, _ in replacements) else [(WINDOW, "")]
        (data,) = load_study(study_file((FILE, OWN), *window, *replacements)).data
        assert isinstance(data, RateData)
        return data

    return load


def test_a_sample_is_the_mean_over_the_interval_that_ends_at_its_time(curve: Callable[..., RateData]) -> None:
    data = curve()
    np.testing.assert_allclose(data.bounds, 1e-5 * np.arange(11), rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(data.rate, 1e-6 * np.arange(1, 11), rtol=1e-15)


def test_first_bound_as_given(curve: Callable[..., RateData]) -> None:
    data = curve((OWN, OWN + 'first_bound = "4 us"\n'))
    np.testing.assert_allclose(data.bounds[:3], [4e-6, 10e-6, 20e-6], rtol=1e-12)


def test_centred_samples(curve: Callable[..., RateData]) -> None:
    data = curve((OWN, OWN + 'sampling = "centred"\n'))
    np.testing.assert_allclose(data.bounds, 1e-5 * np.arange(11) + 5e-6, rtol=1e-12)


def test_window_keeps_the_samples_inside(curve: Callable[..., RateData]) -> None:
    data = curve((WINDOW, 'window = ["15 us", "80 us"]\n'))
    np.testing.assert_allclose(data.bounds, 1e-5 * np.arange(2, 9), rtol=1e-12)
    np.testing.assert_allclose(data.rate, 1e-6 * np.arange(3, 9), rtol=1e-15)


def test_simulation_begins_with_energising_and_ends_in_whole_steps_after_the_last_bound(
    curve: Callable[..., RateData],
) -> None:
    data = curve((WINDOW, 'window = ["20 us", "90 us"]\n'), ('"auto"', '"4 us"'))
    assert data.point.start == 0.0
    # 90 us is 22.5 steps of 4 us
    assert data.point.horizon == pytest.approx(92e-6, rel=1e-12)


def test_simulation_begins_before_energising_where_samples_do(curve: Callable[..., RateData]) -> None:
    pulses = 'energisings = [{ start = "30 us", duration = "20 us" }, { start = "0.06 ms", duration = "9 us" }]\n'
    data = curve((ENERGISING, pulses))
    assert data.point.start == pytest.approx(0.0, abs=1e-20)
    expected = (Energising(30e-6, 20e-6), Energising(60e-6, 9e-6))
    assert data.point.pulses == expected


def test_mass_rate_is_divided_by_the_density_at_cylinder_pressure(curve: Callable[..., RateData]) -> None:
    data = curve(header="time [us],rate [mg/ms]")
    # iso4113 at 80 °C: 783.0 kg/m3 at 0 and 1050 MPa bulk modulus that rises by 12.5 (1 - e^(-p/20)) p^0.945 MPa:
    # at 5 MPa the mean modulus is some 1055 MPa, so 783.0 exp(5/1055) = 786.7; 0.1 covers that estimate
    assert 1e-3 / data.rate[0] == pytest.approx(786.7, abs=0.1)


def test_units_stated_by_the_study(curve: Callable[..., RateData]) -> None:
    data = curve((OWN, OWN + 'time_unit = "ms"\nrate_unit = "mm3/ms"\n'), header="time,rate")
    assert data.bounds[-1] == pytest.approx(0.1, rel=1e-12)


def test_columns_by_other_names(curve: Callable[..., RateData]) -> None:
    data = curve((OWN, OWN + 'time = "t"\nrate = "EVI"\n'), header="t [us],EVI [mm3/ms]")
    assert len(data.rate) == 10


def test_measured_courses(study_file: Edit, tmp_path: Path) -> None:
    rows = "".join(f"{10 * k},{k},{1600 - k}\n" for k in range(1, 11))
    (tmp_path / "own.csv").write_text(f"time [us],rate [mm3/ms],rail [bar]\n{rows}", encoding="utf-8")
    (tmp_path / "slow.csv").write_text("t,p\n0,4\n1,5\n2,6\n3,7\n", encoding="utf-8")
    slow = '{ file = "slow.csv", column = "p", time = "t", unit = "MPa", time_unit = "ms" }'
    path = study_file(
        (FILE, OWN),
        (WINDOW, ""),
        (RAIL, 'rail_pressure = { column = "rail" }\n'),
        ('cylinder_pressure = "5 MPa"', f"cylinder_pressure = {slow}"),
    )
    point = load_study(path).data[0].point  # type: ignore[union-attr]
    assert isinstance(point.rail_pressure, Trace)
    assert isinstance(point.cylinder_pressure, Trace)
    assert point.rail_pressure.value[:2] == pytest.approx((159.9e6, 159.8e6), rel=1e-15)
    assert point.cylinder_pressure.at(1.5e-3) == pytest.approx(5.5e6, rel=1e-12)


def test_a_measured_pressure_is_low_passed_and_said(study_file: Edit, tmp_path: Path) -> None:
    time, noise = 20.0 * np.arange(1, 301), np.random.default_rng(1).normal(0.0, 0.2, 300)
    rows = "".join(f"{t},1,{160.0 + p}\n" for t, p in zip(time, noise, strict=True))
    (tmp_path / "own.csv").write_text(f"time [us],rate [mm3/ms],rail [MPa]\n{rows}", encoding="utf-8")

    def scatter(key: str) -> float:
        path = study_file((FILE, OWN), (WINDOW, ""), (RAIL, f'rail_pressure = {{ column = "rail"{key} }}\n'))
        point = load_study(path).data[0].point  # type: ignore[union-attr]
        assert isinstance(point.rail_pressure, Trace)
        return float(np.std(point.rail_pressure.value))

    with pytest.warns(RuntimeWarning):
        assert scatter("") < 0.03e6
    with pytest.warns(RuntimeWarning):
        assert 0.05e6 < scatter(', low_pass = "5 kHz"') < 0.12e6
    assert scatter(', low_pass = "1 MHz"') == pytest.approx(1e6 * np.std(noise), rel=1e-9)
    with pytest.raises(InputError):
        scatter(', low_pass = "0 Hz"')


def test_a_courses_time_unit_is_that_of_the_data_set_only_within_its_file(study_file: Edit, tmp_path: Path) -> None:
    rows = "".join(f"{k},{k},160\n" for k in range(1, 11))
    for name in ("own.csv", "other.csv"):
        (tmp_path / name).write_text(f"time,rate,rail [MPa]\n{rows}", encoding="utf-8")
    units = 'time_unit = "ms"\nrate_unit = "mm3/ms"\n'
    parts = [(FILE, OWN + units), (WINDOW, "")]
    (data,) = load_study(study_file(*parts, (RAIL, 'rail_pressure = { column = "rail" }\n'))).data
    assert isinstance(data, RateData)
    assert isinstance(data.point.rail_pressure, Trace)
    assert data.point.rail_pressure.time[0] == 1e-3
    path = study_file(*parts, (RAIL, 'rail_pressure = { file = "other.csv", column = "rail" }\n'))
    with refused(InputError, 'no-unit column "time"', "other.csv"):
        load_study(path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            OWN,
            OWN + 'sheet = "rates"\n',
            "idle-key data[1].sheet",
        ),
        (
            RAIL,
            'rail_pressure = { file = "own.csv", sheet = "p", column = "p" }\n',
            "idle-key data[1].rail_pressure.sheet",
        ),
        (RAIL, 'rail_pressure = { encoding = "utf-8", column = "p" }\n', "missing-file-key data[1].rail_pressure"),
    ],
)
def test_a_form_that_is_not_read_is_refused(curve: Callable[..., RateData], old: str, new: str, words: str) -> None:
    with refused(InputError, words):
        curve((old, new))


def test_measured_drive(study_file: Edit, tmp_path: Path) -> None:
    rows = "".join(f"{10 * k},{k},{2 * k}\n" for k in range(1, 11))
    (tmp_path / "own.csv").write_text(f"time [us],rate [mm3/ms],current [A]\n{rows}", encoding="utf-8")
    path = study_file((FILE, OWN + 'drive = { column = "current" }\n'), (WINDOW, ""))
    injector = path.parent / "injector.toml"
    text = injector.read_text(encoding="utf-8")
    injector.write_text(text.replace('"regulated"', '"current trace"'), encoding="utf-8")
    (data,) = load_study(path).data
    assert isinstance(data, RateData)
    assert data.point.drive is not None
    assert data.point.drive.value == tuple(2.0 * k for k in range(1, 11))
    injector.write_text(text.replace('"regulated"', '"voltage trace"'), encoding="utf-8")
    with refused(InputError, 'wrong-unit column "current"', "own.csv"):
        load_study(path)


CONFLICTS = {
    "window crossed": (
        (WINDOW, 'window = ["90 us", "20 us"]\n'),
        r"data\[1\]\.window: the window must begin before it ends",
    ),
    "window before": (
        (WINDOW, 'window = ["-20 us", "50 us"]\n'),
        r"data\[1\]\.window: the window reaches from -20 us to 50 us, and the samples reach from 0 s to 100 us",
    ),
    "window behind": (
        (WINDOW, 'window = ["0 us", "111 us"]\n'),
        r"data\[1\]\.window: the window reaches from 0 s to 111 us",
    ),
    "window too small": (
        (WINDOW, 'window = ["0 us", "35 us"]\n'),
        r"data\[1\]\.window: only 3 samples lie in the window",
    ),
    "energising after the data": (
        (ENERGISING, 'energisings = [{ start = "1 ms", duration = "1 ms" }]\n'),
        r"data\[1\]: the samples that count end at 100 us, before the first energising at 1 ms",
    ),
    "energisings overlap": (
        (ENERGISING, 'energisings = [{ start = "0 s", duration = "9 us" }, { start = "5 us", duration = "9 us" }]\n'),
        r"data\[1\]: The energising at 5 us must start at or after 9 us",
    ),
    "negative pressure": ((RAIL, 'rail_pressure = "-1 MPa"\n'), r"data\[1\]: The rail pressure must lie between"),
    "longer than a simulation": (
        (ENERGISING, 'energisings = [{ start = "-2 s", duration = "1 us" }]\n'),
        r"data\[1\]: the samples that count reach over 2.0001 s, longer than a simulation may be, 1 s",
    ),
    "drive not asked for": (
        (OWN, OWN + 'drive = { column = "a" }\n'),
        r'data\[1\]\.drive: .*"regulated"',
    ),
}


FAULTS = {
    "no energising": ((ENERGISING, ""), r"data\[1\]: give either energising_time"),
    "two energisings": (
        (ENERGISING, ENERGISING + 'energisings = [{ start = "0 us", duration = "7 us" }]\n'),
        r"data\[1\]: give either",
    ),
    "pulse": (
        (ENERGISING, 'energisings = [{ start = "0 us", duration = "7 MPa" }]\n'),
        r'data\[1\]\.energisings\[1\]\.duration: "7 MPa" is a pressure; a time is expected',
    ),
    "pulse key": (
        (ENERGISING, 'energisings = [{ start = "0 us", length = "7 us" }]\n'),
        r'data\[1\]\.energisings\[1\]: there is no key "length"',
    ),
    "window of one": ((WINDOW, 'window = ["0 us"]\n'), r"data\[1\]\.window: this must be a list of at least 2"),
    "window unit": ((WINDOW, 'window = ["0 us", "1 mm"]\n'), r'data\[1\]\.window\[2\]: "1 mm" is a length; a time'),
    "rail pressure unit": (
        (RAIL, 'rail_pressure = "160"\n'),
        r'data\[1\]\.rail_pressure: "160" has no unit; a pressure',
    ),
    "course key": (
        (RAIL, 'rail_pressure = { colunm = "p" }\n'),
        r'data\[1\]\.rail_pressure: there is no key "colunm" \(did you mean "column"\?\)',
    ),
    "first bound late": ((OWN, OWN + 'first_bound = "10 us"\n'), r"data\[1\]\.first_bound: 10 us must lie before"),
    "first bound centred": (
        (OWN, OWN + 'first_bound = "1 us"\nsampling = "centred"\n'),
        r'data\[1\]\.first_bound: this key belongs to sampling = "mean"',
    ),
}


EXPECTED = {name: (ConfigurationError, *found) for name, found in CONFLICTS.items()}
EXPECTED |= {name: (InputError, *found) for name, found in FAULTS.items()}


@pytest.mark.parametrize(("error", "replacement", "message"), EXPECTED.values(), ids=EXPECTED)
def test_fault_is_named(
    curve: Callable[..., RateData], error: type[Exception], replacement: tuple[str, str], message: str
) -> None:
    with pytest.raises(error, match=r"study\.toml, " + message) as caught:
        curve(replacement)
    assert str(caught.value).count("study.toml") == 1


def test_course_without_its_column(curve: Callable[..., RateData]) -> None:
    with refused(InputError, 'missing-column column "rail"', "own.csv"):
        curve((RAIL, 'rail_pressure = { column = "rail" }\n'))


def test_missing_data_file(study_file: Edit) -> None:
    with refused(InputError, "missing-file data[1].file"):
        load_study(study_file((FILE, 'file = "data/evi.cvs"\n')))
