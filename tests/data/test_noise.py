"""Noise models of data sets: what a study may state, and what it is told where it makes no sense."""

from __future__ import annotations

from pathlib import Path

import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.data.noise import Correlation, Law, Noise
from commonrail.plugins.new.study import write_new
from tests.map_study import map_study
from tests.refused import refused


def read(folder: Path, noise: str) -> cr.Study:
    write_new(folder / "own")
    study = folder / "own" / "study.toml"
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace('kind = "rate"', f'noise = {{ {noise} }}\nkind = "rate"'), encoding="utf-8")
    return cr.load_study(study)


def test_a_study_states_the_noise_of_a_curve(tmp_path: Path) -> None:
    noise = 'law = "student-t", sigma = "0.3 mm3/ms", uncertain = { delay = "1 us", gain = "0.5 %" }'
    found = read(tmp_path, noise).data[0].noise
    assert (found.law, found.correlation, found.sigma) == (Law.STUDENT, Correlation.AUTO, pytest.approx(3e-7))
    assert found.deviations == pytest.approx({"delay": 1e-6, "gain": 0.005})


def test_a_map_states_its_noise_in_tolerances(tmp_path: Path) -> None:
    rows = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n80,500,20\n160,700,60\n"
    (tmp_path / "map.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "study.toml").write_text(map_study("noise = { sigma = 0.5 }"), encoding="utf-8")
    assert cr.load_study(tmp_path / "study.toml").data[0].noise.sigma == 0.5
    (tmp_path / "study.toml").write_text(map_study("noise = { sigma = 0.5, freedom = 4 }"), encoding="utf-8")
    assert cr.load_study(tmp_path / "study.toml").data[0].noise.freedom == 4.0


def test_a_study_states_noise_that_grows_with_the_rate(tmp_path: Path) -> None:
    found = read(tmp_path, 'sigma = "0.02 mm3/ms + 1 %"').data[0].noise
    assert (found.sigma, found.relative) == (pytest.approx(2e-8), pytest.approx(0.01))


def test_a_map_has_its_relative_part_in_the_tolerance(tmp_path: Path) -> None:
    rows = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n80,500,20\n160,700,60\n"
    (tmp_path / "map.csv").write_text(rows, encoding="utf-8")
    (tmp_path / "study.toml").write_text(map_study('noise = { sigma = "1 + 1 %" }'), encoding="utf-8")
    with refused(InputError, "two-parts data[1].noise.sigma", "study.toml"):
        cr.load_study(tmp_path / "study.toml")
    (tmp_path / "study.toml").write_text(map_study("noise = { sigma = 0.5 }"), encoding="utf-8")
    data = cr.load_study(tmp_path / "study.toml").data[0]
    with pytest.raises(ConfigurationError, match=r"relative part.*\bcurves"):
        data.changed(noise=Noise(sigma=1.0, relative=0.01))


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        ('sigma = "0.02 mm3/ms + 1 mm3"', "be percent"),
        ('sigma = "0.02 MPa + 1 %"', "noise.sigma"),
        ('sigma = "0.02 mm3/ms + -1 %"', "relative part"),
        ('sigma = "0.02 mm3/ms + one %"', "noise.sigma"),
        ('sigma = "0.3 MPa"', "noise.sigma"),
        ('law = "cauchy"', "noise.law"),
        ('uncertain = { dealy = "1 us" }', "delay"),
        ('uncertain = { delay = "1 MPa" }', "deviation of delay"),
        ('uncertain = { fuel_temperature = "40 degC" }', "the difference"),
        ('sigma = "0.3 mm3/ms", shots = "a"', "sigma.*shots"),
        ("freedom = 4", "freedom.*sigma"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_place(tmp_path: Path, noise: str, words: str) -> None:
    with pytest.raises((InputError, ConfigurationError), match=words) as error:
        read(tmp_path, noise)
    assert "data[1]" in str(error.value)


@pytest.mark.parametrize(
    "settings",
    [
        {"sigma": 0.0},
        {"sigma": 1.0, "freedom": 0.0},
        {"discrepancy": -1.0},
        {"length": float("inf")},
        {"relative": 0.01},
        {"sigma": 1e-8, "relative": 2.0},
    ],
)
def test_numbers_out_of_range_are_refused(settings: dict[str, float]) -> None:
    with pytest.raises(ConfigurationError, match=rf"\b{[*settings][-1]}\b.* noise"):
        Noise(**settings)  # type: ignore[arg-type]
