"""Module of a page in a WebAssembly engine without a browser: node."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np

import commonrail as cr
from commonrail.engine.job import Outcome
from commonrail.engine.loop import CoursePlan
from commonrail.engine.plan import candidate_matrix
from commonrail.plugins.export.entry_points import channels
from commonrail.plugins.page.module import wasm_module

NODE = shutil.which("node")
STEP = 1e-6
_ZIG = importlib.util.find_spec("ziglang")
MISSING = (
    "there is no node on this machine, which runs WebAssembly"
    if NODE is None
    else "ziglang is not installed"
    if _ZIG is None
    else ""
)


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
