"""A calibrated run of a small bench whose truth is an injector of this engine, and files of later measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import commonrail as cr

FREE = "control_chamber.a_hole_diameter"
TRUTH = {FREE: 206e-6}
STUDY = """
format = "commonrail-study/1"
title = "small bench"
injector = "cri2-16"
cylinder_pressure = "0.5 MPa"
return_pressure = "0.1 MPa"

# the user's comment
[[data]]
kind = "quantities"
name = "march"
role = "fit"
file = "march.csv"
absolute = "0.3 mm3"

[[data]]
kind = "quantities"
name = "check"
role = "validation"
file = "check.csv"

[[parameter]]
name = "control_chamber.a_hole_diameter"
below = "10 %"
above = "10 %"

[[parameter]]
name = "nozzle.discharge_maximum"
lower = 0.7
upper = 0.95
prior = { value = 0.8, sigma = 0.05, source = "flow bench" }

[optimiser]
members = 8
generations = 3
polish = 2
"""


def write_map(
    path: Path, rails: Sequence[float], times: Sequence[float], seed: int, noise: float = 0.01, **values: float
) -> Path:
    """Write the quantities that an injector with the true values, and others, has at pairs [MPa], [us]."""
    injector = cr.load_injector("cri2-16")
    truth = injector.with_values({**TRUTH, **{name.replace("__", "."): value for name, value in values.items()}})
    pairs = [(rail, time) for rail in rails for time in times]
    points = [cr.OperatingPoint(1e6 * rail, 1e-6 * time, 0.5e6, 0.1e6) for rail, time in pairs]
    rng = np.random.default_rng(seed)
    rows = ["rail_pressure [MPa],energising_time [us],quantity [mm3]"]
    for (rail, time), point in zip(pairs, points, strict=True):
        quantity = 1e9 * cr.simulate(truth, point).injected_volume * (1.0 + noise * rng.normal())
        rows.append(f"{rail},{time},{quantity:.5f}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


class Bench(NamedTuple):
    """Folder with the user's study and data files, and the run of it."""

    folder: Path
    study: Path
    run: Path


@pytest.fixture(scope="package")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A bench whose study is calibrated once; tests that change the run take a copy."""
    folder = tmp_path_factory.mktemp("bench")
    study = folder / "small.toml"
    study.write_text(STUDY, encoding="utf-8")
    write_map(folder / "march.csv", (40, 100, 160), (400, 700, 1000), 1)
    write_map(folder / "check.csv", (60, 120), (500, 900), 2)
    write_map(folder / "april.csv", (50, 90, 140), (450, 800, 1100), 3)
    # a nozzle with a tenth less flow: what another part, or a coked one, would show
    write_map(folder / "other-part.csv", (50, 90, 140), (450, 800, 1100), 3, nozzle__hole_diameter=0.93 * HOLE)
    cr.runs.calibrate_into(folder / "run", cr.load_study(study), threads=1)
    return Bench(folder, study, folder / "run")


HOLE = cr.load_injector("cri2-16").values["nozzle.hole_diameter"]
