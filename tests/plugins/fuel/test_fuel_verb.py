"""commonrail fuel: laws fitted to tables that CoolProp's n-dodecane and a known law fill."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from tests.cli.conftest import Command

TEMPERATURES = (293.15, 313.15, 333.15, 353.15, 373.15, 393.15)
PRESSURES = (0.1e6, 5e6, 20e6, 40e6, 80e6, 120e6, 160e6, 200e6)


def write_table(path: Path, row: Callable[[float, float], tuple[float, ...]], names: str) -> Path:
    """Table over pressures and temperatures with the columns of `names`, which `row` fills."""
    rows = [[p * 1e-6, t - 273.15, *row(p, t)] for t in TEMPERATURES for p in PRESSURES]
    lines = [",".join(f"{value:.8g}" for value in one) for one in rows]
    path.write_text(f"pressure [MPa],temperature [degC],{names}\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_fuel_comes_back_from_its_own_table(command: Command, tmp_path: Path) -> None:
    """Density and sound speed of a law of the same form: only the rounding of the table is between."""
    known = cr.load_fuel("n-dodecane")

    def row(p: float, t: float) -> tuple[float, ...]:
        return float(known.density(p, t)), float(known.sound_speed(p, t)), 1e6 * float(known.kinematic_viscosity(p, t))

    table = write_table(tmp_path / "t.csv", row, "density [kg/m3],sound_speed [m/s],viscosity [mm2/s]")
    done = command("fuel", table, "--out", tmp_path / "own.toml")
    assert done.status == 0, done.err
    written = (tmp_path / "own.toml").read_bytes()
    again = command("fuel", table, "--title", "another", "--out", tmp_path / "own.toml")
    assert again.status == 2
    assert "--out" in again.sentence
    assert (tmp_path / "own.toml").read_bytes() == written
    found = cr.load_fuel(tmp_path / "own.toml")
    p, t = np.meshgrid(np.linspace(1e6, 190e6, 12), np.linspace(295.0, 390.0, 7))
    assert found.density(p, t) == pytest.approx(known.density(p, t), rel=2e-5)
    assert found.bulk_modulus(p, t) == pytest.approx(known.bulk_modulus(p, t), rel=5e-3)
    assert found.sound_speed(p, t) == pytest.approx(known.sound_speed(p, t), rel=5e-4)
    assert found.kinematic_viscosity(p, t) == pytest.approx(known.kinematic_viscosity(p, t), rel=2e-2)
    for name, error in found.errors.items():
        assert 0.0 <= error < (0.03 if name != "vapour_pressure" else 1.1)


def test_the_stated_errors_hold_for_another_equation_of_state(command: Command, tmp_path: Path) -> None:
    coolprop = pytest.importorskip("CoolProp.CoolProp", reason="CoolProp is a development dependency")

    def of(p: float, t: float, name: str) -> float:
        return float(coolprop.PropsSI(name, "P", p, "T", t, "n-Dodecane"))

    def row(p: float, t: float) -> tuple[float, ...]:
        return of(p, t, "D"), 1e-6 / of(p, t, "ISOTHERMAL_COMPRESSIBILITY"), 1e3 * of(p, t, "V")

    table = write_table(tmp_path / "t.csv", row, "density [kg/m3],bulk_modulus [MPa],viscosity [mPa s]")
    assert command("fuel", table, "--out", tmp_path / "d.toml", "--json").status == 0
    found = cr.load_fuel(tmp_path / "d.toml")
    for t in TEMPERATURES:
        for p in PRESSURES:
            density = float(found.density(p, t))
            assert density == pytest.approx(of(p, t, "D"), rel=found.errors["density"] + 1e-6)
            modulus = 1.0 / of(p, t, "ISOTHERMAL_COMPRESSIBILITY")
            assert float(found.bulk_modulus(p, t)) == pytest.approx(modulus, rel=found.errors["bulk_modulus"] + 1e-6)
    assert found.errors["density"] < 1e-3
    assert found.errors["bulk_modulus"] < 0.03


def test_an_injector_runs_on_it_and_beyond_the_table_it_is_refused(command: Command, tmp_path: Path) -> None:
    known = cr.load_fuel("iso4113")

    def row(p: float, t: float) -> tuple[float, ...]:
        return float(known.density(p, t)), 1e6 * float(known.kinematic_viscosity(p, t))

    table = write_table(tmp_path / "t.csv", row, "density [kg/m3],viscosity [mm2/s]")
    assert command("fuel", table, "--out", tmp_path / "own.toml").status == 0
    own = tmp_path / "part.toml"
    own.write_text(
        'format = "commonrail-injector/1"\nname = "part"\ntitle = "part"\nbase = "virtual-lino-2016"\n'
        '[fuel]\nfile = "own.toml"\n',
        encoding="utf-8",
    )
    point = ("--rail-pressure", "160MPa", "--energising-time", "700us", "--json")
    found = command("simulate", own, *point)
    assert found.status == 0, found.err
    injected = command("simulate", "virtual-lino-2016", *point).record["injected_mass"]
    assert found.record["injected_mass"] == pytest.approx(injected, rel=1e-2)
    with pytest.raises(cr.errors.InputError, match=r"293\.15 to 393\.15 K"):
        cr.load_fuel(tmp_path / "own.toml").density(80e6, 400.0)


FALLING = "pressure [MPa],temperature [K],density [kg/m3],viscosity [mm2/s]\n" + "".join(
    f"{p},{t},{800 - 0.1 * p},2\n" for t in (300, 350, 400) for p in (0.1, 50, 100, 200)
)
TINY = "pressure [MPa],temperature [K],density [kg/m3],viscosity [mm2/s]\n" + "".join(
    f"{p},{t},{800 + 0.3 * p}e-300,2e-300\n" for t in (300, 350, 400) for p in (0.1, 50, 100, 200)
)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("pressure [MPa],temperature [K],density [kg/m3]\n" + "1,300,800\n" * 6, "viscosity"),
        (
            "pressure [MPa],temperature [K],density [kg/m3],viscosity [mm2/s]\n" + "1,300,800,2\n" * 6,
            "two temperatures",
        ),
        (FALLING, "from 0.1 to 200 MPa"),
        (FALLING + "50,350,800,2\n", "lines 7 and 14: "),
        (TINY, "the columns"),
    ],
)
def test_a_table_that_cannot_be_fitted_is_refused(command: Command, tmp_path: Path, text: str, word: str) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    done = command("fuel", tmp_path / "t.csv", "--out", tmp_path / "f.toml")
    assert done.status == 2
    assert word in done.sentence
    assert not (tmp_path / "f.toml").exists()
