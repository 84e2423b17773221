"""A law of the A-hole from another package takes the place of the paper's, in both engines."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.engine.plan import coefficients_at
from commonrail.engine.reference import Model, Resolution
from commonrail.physics.injector import Injector
from commonrail.physics.model import Inputs, Setting, Waves
from commonrail.physics.variants import Variant, connections_of

POINT = cr.OperatingPoint("160 MPa", "300 us", horizon="1 ms")
DT = 1e-6  # [s]
SHARE = 0.8  # of (c_d A)² and (C_c A)²
LAW = f"""
from commonrail.physics.connections import Hole

def smaller(hole, pressure, behind):
    return Hole({SHARE} * hole.a_cda2, {SHARE} * hole.a_cda2_choked)
"""


@pytest.fixture
def smaller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rigid: Injector) -> Injector:
    """Injector with a law of an installed package, whose files pip would write."""
    (tmp_path / "smaller_a_hole.py").write_text(LAW, encoding="utf-8")
    info = tmp_path / "smaller_a_hole-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: smaller-a-hole\nVersion: 1.0\n", encoding="utf-8")
    entry = "[commonrail.a_hole_laws]\nsmaller = smaller_a_hole:smaller\n"
    (info / "entry_points.txt").write_text(entry, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    return replace(rigid, variant=rigid.variant._replace(a_hole_law="smaller"))


@pytest.fixture
def expected(rigid: Injector) -> Injector:
    """Injector of the paper's law whose A-hole has so much smaller coefficients."""
    names = ("control_chamber.a_hole_discharge", "control_chamber.a_hole_contraction")
    return rigid.with_values({name: math.sqrt(SHARE) * rigid.values[name] for name in names})


def course(injector: Injector) -> list[float]:
    """Pressure in the control chamber and on the way to the return, step by step, uncompiled [Pa], [kg]."""
    step, rest = connections_of(injector.wired())[:2]
    c = coefficients_at(injector, POINT, DT)
    s, values = rest(c, Setting(160e6, 5e6, 0.5e6, DT)), []
    for k in range(200):
        inputs = Inputs(160e6, 5e6, 0.5e6, 0.0, k * DT, k * DT - 300e-6)
        s, _ = step(c, s, inputs, Waves(160e6, 160e6, 0.5e6), DT)
        values += [s.control_chamber.fuel.pressure, s.cumulative_flows.returned]
    return values


def test_the_step_takes_the_law(smaller: Injector, expected: Injector, rigid: Injector) -> None:
    found = course(smaller)
    assert found == pytest.approx(course(expected), rel=1e-9)
    assert found[-1] < 0.98 * course(rigid)[-1]  # or the law would not count


def test_the_equations_of_the_reference_take_the_law(
    smaller: Injector, expected: Injector, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")  # the right-hand side as plain Python
    slopes = []
    for injector in (smaller, expected):
        model = Model(injector, POINT, Resolution((4, 2)), None)
        y = model.start.copy()
        y[model.at.core + model.core.row("valve.lift")] = 20e-6
        slopes.append(model.slopes(0.0, y))
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-9)


@pytest.mark.slow  # compiles one more kernel
def test_the_compiled_step_takes_the_law(smaller: Injector, expected: Injector) -> None:
    masses = [cr.simulate(injector, POINT).injected_mass for injector in (smaller, expected)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-9)


def test_the_law_is_kept_in_the_file_of_the_injector(smaller: Injector, tmp_path: Path) -> None:
    file = tmp_path / "smaller.toml"
    cr.dump_injector(smaller, file)
    assert cr.load_injector(file).variant.a_hole_law == "smaller"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('a_hole_law = "smaller"', 'a_hole_law = "smaler"'), encoding="utf-8")
    with pytest.raises(cr.errors.ConfigurationError, match=r"a_hole_law: .*mean .smaller\b"):
        cr.load_injector(file)


def test_an_injector_without_an_a_hole_takes_no_law_of_it() -> None:
    with pytest.raises(cr.errors.ConfigurationError):
        Variant(actuation="direct", a_hole_law="any")
