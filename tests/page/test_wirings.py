"""Module of a page against the lanes, for every choice of wiring, in a WebAssembly engine without a browser."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.choices import Actuation, Body, Boundary, Drive
from commonrail.engine.notes import Outcome
from commonrail.engine.population import candidate_matrix
from commonrail.export.entries import channels
from commonrail.page.module import wasm_module
from commonrail.stepper.course import CoursePlan
from tests.conftest import DRAWN

NODE = shutil.which("node")
STEP = 1e-6
ROUNDING = 1e-9  # of a channel's peak: products and sums are contracted in another order, and the needle bounces

pytestmark = [
    pytest.mark.slow,  # each wiring is compiled
    pytest.mark.skipif(NODE is None, reason="there is no node on this machine, which runs WebAssembly"),
    pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed"),
]

WIRINGS: dict[str, tuple[str, dict[str, Any], dict[str, float]]] = {
    "flexible, PWM": (DRAWN, {}, {}),
    "rigid, rail volume, regulated": (
        DRAWN,
        {"body": Body.RIGID, "boundary": Boundary.VOLUME, "drive": Drive.REGULATED},
        {},
    ),
    "current trace": (DRAWN, {"drive": Drive.CURRENT}, {}),
    "voltage trace, rigid": (DRAWN, {"drive": Drive.VOLTAGE, "body": Body.RIGID}, {}),
    "free-wheel": (DRAWN, {"drive": Drive.FREE_WHEEL}, {}),
    "extended laws": (DRAWN, {}, {"plunger_needle.friction": 5.0, "valve.laminar_gap": 1e-6}),
    "direct-acting": ("direct-acting-kr", {}, {}),
}


@pytest.mark.parametrize("wiring", sorted(WIRINGS))
def test_every_choice_of_wiring_has_the_channels_of_the_lanes(wiring: str, tmp_path: Path) -> None:
    name, choices, values = WIRINGS[wiring]
    injector = cr.load_injector(name).with_values(values)
    injector = replace(injector, variant=injector.variant._replace(**choices))
    traced = injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE)
    drive = cr.Trace.of([0.0, 50e-6, 400e-6, 450e-6, 2e-3], [0.0, 18.0, 14.0, 0.0, 0.0]) if traced else None
    rail = 30e6 if injector.variant.actuation is Actuation.DIRECT else 120e6
    point = cr.OperatingPoint(rail, [] if traced else 600e-6, drive=drive, horizon=1.5e-3)
    solution = cr.simulate(injector, point, time_step=STEP)
    figures, injected, courses = simulated(injector, point, len(solution.time) - 1, tmp_path)
    assert solution.injected_mass > 1e-7
    assert np.max(np.abs(injected - solution.injected)) <= ROUNDING * solution.injected_mass
    assert figures["opening"] * STEP == pytest.approx(solution.opening, rel=ROUNDING)
    assert figures["closing"] * STEP == pytest.approx(solution.closing, rel=ROUNDING, nan_ok=True)  # NaN: still open
    compared = set(courses) & set(solution.channels)
    assert {"needle_lift", "accumulation_pressure", "sac_pressure", "coil_current", "magnetic_force"} <= compared
    for channel in compared - ({"rail_pressure"} if injector.variant.boundary is Boundary.IDEAL else set()):
        own, lanes = courses[channel], solution.channels[channel]
        assert np.max(np.abs(own - lanes)) <= ROUNDING * np.max(np.abs(lanes)), channel


def simulated(
    injector: cr.Injector, point: cr.OperatingPoint, steps: int, folder: Path
) -> tuple[dict[str, float], np.ndarray, dict[str, np.ndarray]]:
    """Figures, mass injected after every step, and channels by name, of the module in node.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    steps : int
    folder : Path
        For the files between.
    """
    plan = CoursePlan(injector, point, STEP)
    theta = candidate_matrix(injector, (), np.empty((1, 0)))[0]
    names = [channel.name for channel in channels(injector.variant.actuation)]
    rail, cylinder, low = point.initial_pressures()
    settings = {"columns": len(theta), "steps": steps, "ring": plan.ring, "dt": STEP, "rail": rail}
    settings |= {"cylinder": cylinder, "low": low, "figures": len(Outcome._fields), "channels": len(names)}
    (folder / "settings.json").write_text(json.dumps(settings), encoding="utf-8")
    (folder / "page.wasm").write_bytes(wasm_module(injector.wired()))
    (folder / "numbers.bin").write_bytes(np.concatenate([theta, plan.inputs(0, steps).ravel()]).astype("<f8").tobytes())
    files = ("page.wasm", "settings.json", "numbers.bin", "out.bin")
    script = Path(__file__).with_name("run_module.mjs")
    done = subprocess.run(
        [str(NODE), str(script), *(str(folder / file) for file in files)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    numbers = np.frombuffer((folder / "out.bin").read_bytes(), "<f8")
    figures, injected, rest = np.split(numbers, [len(Outcome._fields), len(Outcome._fields) + steps + 1])
    courses = rest.reshape(steps + 1, len(names)).T
    return (
        dict(zip(Outcome._fields, figures.tolist(), strict=True)),
        injected,
        dict(zip(names, courses, strict=True)),
    )
