"""commonrail fuel --coolprop: laws of three fuels against CoolProp at points of the test's own, and refusals."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from tests.cli.conftest import Command, Done

coolprop = pytest.importorskip("CoolProp.CoolProp", reason="CoolProp is an optional dependency")


def make(command: Command, name: str, pressure: str, temperature: str, out: Path) -> Done:
    return command("fuel", "--coolprop", name, "--pressure", pressure, "--temperature", temperature, "--out", out)


@pytest.mark.parametrize(
    ("name", "pressure", "temperature"),
    [
        ("n-Dodecane", (0.1, 200.0), (20.0, 120.0)),
        ("Methanol", (0.5, 200.0), (20.0, 80.0)),
        ("DME", (1.5, 50.0), (10.0, 50.0)),
    ],
)
def test_twenty_points(
    command: Command, tmp_path: Path, name: str, pressure: tuple[float, float], temperature: tuple[float, float]
) -> None:
    ends = (":".join(map(str, ends)) for ends in (pressure, temperature))
    pressures, temperatures = (f"{text}{unit}" for text, unit in zip(ends, ("MPa", "degC"), strict=True))
    done = make(command, name, pressures, temperatures, tmp_path / "f.toml")
    assert done.status == 0, done.err
    fuel, rng = cr.load_fuel(tmp_path / "f.toml"), np.random.default_rng(20)
    assert 0.0 < fuel.errors["kinematic_viscosity"] < 0.03
    for p, t in zip(rng.uniform(*pressure, 20) * 1e6, rng.uniform(*temperature, 20) + 273.15, strict=True):
        rho, sound, viscosity = (coolprop.PropsSI(key, "P", p, "T", t, name) for key in ("D", "A", "V"))
        assert fuel.density(p, t) == pytest.approx(rho, rel=1e-3)
        assert fuel.sound_speed(p, t) == pytest.approx(sound, rel=5e-3)
        assert fuel.kinematic_viscosity(p, t) == pytest.approx(viscosity / rho, rel=3e-2)
        boils = coolprop.PropsSI("P", "T", t, "Q", 0, name)
        assert fuel.vapour_pressure(t) == pytest.approx(boils, rel=1e-3)


@pytest.mark.parametrize(
    ("name", "pressure", "temperature", "word"),
    [
        ("DME", "3:50MPa", "20:80degC", "sound speed"),
        ("DME", "0.5:50MPa", "20:40degC", "889.7 kPa"),
        ("DME", "1:200MPa", "0:20degC", "up to 50 MPa"),
        ("DME", "6:50MPa", "20:140degC", "--temperature: .*DME"),
        ("Methanl", "1:50MPa", "20:40degC", 'did you mean "Methanol"'),
        ("Methanol&Water", "1:50MPa", "20:40degC", "Methanol&Water"),
        ("SES36", "1:2MPa", "1:20degC", "[Vv]iscosity"),
        ("Methanol", "50:1MPa", "20:40degC", "increase"),
        ("Methanol", "1MPa", "20:40degC", "LOW:HIGH"),
        ("Methanol", "1:50MPa", "20degC", "such as 20:80degC"),
    ],
)
def test_what_cannot_be_had_is_refused(
    command: Command, tmp_path: Path, name: str, pressure: str, temperature: str, word: str
) -> None:
    done = make(command, name, pressure, temperature, tmp_path / "f.toml")
    assert done.status == 2
    assert re.search(word, done.sentence)
    assert not (tmp_path / "f.toml").exists()


def test_without_coolprop_the_extra_is_named(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "CoolProp", None)
    done = make(command, "Methanol", "1:50MPa", "20:40degC", tmp_path / "f.toml")
    assert done.status == 2
    assert "commonrail[fuel]" in done.sentence


def test_a_logarithmic_viscosity_and_the_heat_capacity_are_written_and_read(command: Command, tmp_path: Path) -> None:
    """Within the file of an injector, law by law, as a calibration leaves them."""
    assert make(command, "n-Dodecane", "1:100MPa", "20:60degC", tmp_path / "f.toml").status == 0
    fuel = cr.load_fuel(tmp_path / "f.toml")
    assert fuel.viscosity_law.logarithmic  # by the other form CoolProp's cold n-dodecane is missed by more
    injector = replace(cr.load_injector("virtual-lino-2016"), fuel=fuel).with_values({"fuel.temperature": 313.15})
    cr.dump_injector(injector, tmp_path / "i.toml")
    assert cr.load_injector(tmp_path / "i.toml").fuel == fuel
