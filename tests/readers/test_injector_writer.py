"""Injectors to TOML: what is written reads back bit by bit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.arguments import COUNTS
from commonrail.base.errors import OutputError
from commonrail.physics.fuel import Origin
from commonrail.physics.injector import FUEL_TEMPERATURE, Source
from commonrail.physics.law import Domain
from commonrail.readers.fuel import fuel_catalogue, load_fuel
from commonrail.readers.injector import injector_catalogue, load_injector
from commonrail.readers.injector_writer import dump_injector
from tests.refused import refused

Edit = Callable[..., Path]
BOUNDED = (Domain.UNIT, Domain.COEFFICIENT, Domain.CONE)


@pytest.mark.parametrize("name", injector_catalogue())
def test_catalogue_reads_back_equal(tmp_path: Path, name: str) -> None:
    injector = load_injector(name)
    dump_injector(injector, tmp_path / "copy.toml")
    copy = load_injector(tmp_path / "copy.toml")
    assert dict(copy.values) == dict(injector.values)
    assert copy == injector


def test_any_values_read_back_bit_by_bit(tmp_path: Path, injector_file: Edit) -> None:
    injector = load_injector(injector_file())
    rng = np.random.default_rng(4)
    for trial in range(20):
        values = {
            name: float(rng.uniform()) if q.domain in BOUNDED else float(10.0 ** rng.uniform(-15.0, 12.0))
            for name, q in injector.quantities.items()
            if name != FUEL_TEMPERATURE
        }
        knots = [name for name in values if name.startswith("nozzle.knot_")]
        values |= dict(zip(knots, sorted(values[name] for name in knots), strict=True))
        values |= {name: float(rng.integers(1, 1_000_000)) for name in COUNTS}
        values[FUEL_TEMPERATURE] = float(rng.uniform(300.0, 390.0))
        path = tmp_path / f"{trial}.toml"
        dump_injector(replace(injector, values={**injector.values, **values}), path)
        read = load_injector(path).values
        # Equality of floats is equality of bits here: none is zero or not a number.
        assert {name: read[name].hex() for name in values} == {name: values[name].hex() for name in values}


def test_numpy_floats_are_written_as_numbers(tmp_path: Path, injector_file: Edit) -> None:
    injector = load_injector(injector_file()).with_values(
        {"nozzle.holes": np.float64(6.0), "valve.mass": np.float64(4e-3)}
    )
    dump_injector(injector, tmp_path / "copy.toml")
    assert load_injector(tmp_path / "copy.toml").values["valve.mass"] == 4e-3


def test_notes_mark_fitted_values(tmp_path: Path, injector_file: Edit) -> None:
    path = tmp_path / "copy.toml"
    note = 'calibrated by "a \\ study"\n# with = signs'
    dump_injector(load_injector(injector_file()), path, {"valve.mass": note})
    sources = load_injector(path).sources
    assert sources["valve.mass"] == Source("F", note)
    assert sources["valve.lift"] == Source("E", "example")


def test_header_and_meanings_are_comments(tmp_path: Path, injector_file: Edit) -> None:
    path = tmp_path / "copy.toml"
    dump_injector(load_injector(injector_file()), path, {}, "first line\nsecond line")
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[:2] == ["# first line", "# second line"]
    (hole,) = [line for line in lines if line.startswith("z_hole_diameter")]
    assert '"0.000215 m"' in hole
    assert hole.endswith("# 215 um: diameter of the Z-hole (inlet throttle)")


@pytest.mark.parametrize("name", fuel_catalogue())
def test_fuel_that_is_not_of_the_catalogue_is_written_out(tmp_path: Path, injector_file: Edit, name: str) -> None:
    known = load_fuel(name)
    law = replace(known.viscosity_law, origin=Origin("M", "measured here", 0.01))
    injector = replace(load_injector(injector_file()), fuel=replace(known, name="own", viscosity_law=law))
    dump_injector(injector, tmp_path / "copy.toml")
    assert load_injector(tmp_path / "copy.toml").fuel == injector.fuel


def test_fuel_with_a_name_of_the_catalogue_but_other_laws_is_written_out(tmp_path: Path, injector_file: Edit) -> None:
    known = load_fuel("iso4113")
    injector = replace(load_injector(injector_file()), fuel=replace(known, title="another oil"))
    dump_injector(injector, tmp_path / "copy.toml")
    assert load_injector(tmp_path / "copy.toml").fuel.title == "another oil"


def test_unwritable(tmp_path: Path, injector_file: Edit) -> None:
    with refused(OutputError, "not-writable", "copy.toml"):
        dump_injector(load_injector(injector_file()), tmp_path / "absent" / "copy.toml")


@pytest.mark.parametrize("title", [None, "a fuel of its own"])
def test_how_volumes_compress_the_fuel_reads_back(tmp_path: Path, injector_file: Edit, title: str | None) -> None:
    known = load_fuel("n-dodecane")
    fuel = replace(known, adiabatic=True, title=title or known.title)
    dump_injector(replace(load_injector(injector_file()), fuel=fuel), tmp_path / "copy.toml")
    assert load_injector(tmp_path / "copy.toml").fuel == fuel
