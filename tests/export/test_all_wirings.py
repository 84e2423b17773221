"""Libraries of all wirings against the lanes: random candidates, points, trains and measured courses, every channel."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.population import admissible
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.export.entries import channels
from commonrail.export.library import write_library
from commonrail.export.objects import target_named
from commonrail.files.injector_file import load_injector
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.injector.variants import Variant
from tests.conftest import DRAWN
from tests.export.native import BlockRun, Floats, Native, Run
from tests.export.test_library import ROUNDING, inputs_of

CANDIDATES, STEPS = 50, 1500
SPREAD = 0.05  # of the parameters around the injector's
# A needle or plunger that bounces amplifies rounding. Where a deviation is above `ROUNDING`, rail pressures that differ
# by some roundings show by how much until each step; the roundings of all steps add up like a random walk.
TWINS = (1.0, -1.0, 2.0, 3.0)
AMPLIFIED = STEPS**0.5
DIRECT_ROUNDING = 1e-10  # SAC pressure of direct-acting injectors: 1.5e-11 measured, more than such roundings explain
# Share of the candidates that must be within `ROUNDING` themselves: 46 % (rigid body, current trace, extended laws) to
# 100 % are, and the median of all wirings but three is below 1e-11 by ten times and more.
PLAIN = 0.4
# Peaks below these count as none, such as the lift of a needle that has not opened: 1e-4 of usual ones.
FLOORS = {"kg": 1e-9, "m": 1e-8, "Pa": 1e4, "A": 1e-3, "N": 1e-2, "1": 1e-4, "kg/s": 1e-6}
SERVO = [Variant(*choices) for choices in itertools.product(Body, Boundary, Drive, Laws)]
DIRECT = [Variant(drive=drive, laws=laws, actuation=Actuation.DIRECT) for drive in Drive for laws in Laws]
# Values at which the extended laws differ from the paper's.
EXTENDED = {"nozzle.shape_1": 0.02, "nozzle.shape_5": -0.03}
EXTENDED_SERVO = EXTENDED | {"plunger_needle.friction": 5.0, "valve.laminar_gap": 1e-6}


def wired(variant: Variant) -> Injector:
    """Injector of the catalogue with a wiring."""
    direct = variant.actuation is Actuation.DIRECT
    injector = load_injector("direct-acting-kr" if direct else DRAWN)
    if variant.laws is Laws.EXTENDED:
        injector = injector.with_values(EXTENDED if direct else EXTENDED_SERVO)
    return replace(injector, variant=variant)


def candidates_of(injector: Injector, rng: np.random.Generator) -> list[Injector]:
    """Random injectors around one, at its fuel temperature: at others the table of the fuel counts (4e-10 measured)."""
    fixed = ("nozzle.holes", FUEL_TEMPERATURE)
    names = [name for name, value in injector.values.items() if value != 0.0 and name not in fixed]
    own = np.array([injector.values[name] for name in names])
    values = own * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, (8 * CANDIDATES, len(own)))
    values = values[admissible(names, values, injector.fuel)][:CANDIDATES]
    return [injector.with_values(dict(zip(names, row.tolist(), strict=True))) for row in values]


def point_of(injector: Injector, rng: np.random.Generator) -> OperatingPoint:
    """Random operating point: every third has a measured rail pressure, every one of a traced drive its course."""
    direct = injector.variant.actuation is Actuation.DIRECT
    rail = float(rng.uniform(15e6, 35e6) if direct else rng.uniform(40e6, 180e6))
    pressure: float | Trace = rail
    if rng.integers(3) == 0 and injector.variant.boundary is Boundary.IDEAL:
        pressure = Trace.of(np.linspace(0.0, 1.5e-3, 7), rail * rng.uniform(0.9, 1.0, 7))
    if injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE):
        ends = np.sort(rng.uniform(200e-6, 900e-6, 2))
        course = Trace.of([0.0, 40e-6, *ends, 2e-3], [0.0, *rng.uniform(14.0, 20.0, 2), 0.0, 0.0])
        return OperatingPoint(pressure, [], drive=course, horizon=STEPS * 1e-6)
    edges = np.cumsum(rng.uniform(60e-6, 450e-6, 2 * int(rng.integers(1, 4))))
    train = [Energising(float(edges[i] - edges[0]), float(edges[i + 1] - edges[i])) for i in range(0, len(edges), 2)]
    return OperatingPoint(pressure, train, horizon=STEPS * 1e-6)


def courses_of(
    native: Native, injector: Injector, point: OperatingPoint, inputs: Floats, moved: float
) -> dict[str, Floats]:
    """Channels at the start and after every step, with the rail pressure times a factor."""
    at_rest = point.initial_pressures()
    values = {name: injector.values[name] for name in native.parameters}
    run = Run(native, (at_rest[0] * moved, *at_rest[1:], 0.0), values=values)
    given = inputs * np.array([moved, 1.0, 1.0, 1.0, 1.0, 1.0])
    rows = [run.observe()]
    for one in given:
        run.march_inputs(one[None])
        rows.append(run.observe())
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def deviations(courses: Mapping[str, Floats], expected: Mapping[str, Floats], floors: Mapping[str, float]) -> Floats:
    """Deviation of every step, of the channel that has most, relative to its peak or to what counts as none."""
    each = [
        np.abs(courses[name] - course) / max(np.max(np.abs(course)), floors[name]) for name, course in expected.items()
    ]
    return np.max(each, axis=0)


def compare(native: Native, injector: Injector, point: OperatingPoint, solution: Solution) -> tuple[Floats, Floats]:
    """Deviations from the lanes by the step, and the largest that may be until then."""
    floors = {one.name: FLOORS[one.unit] for one in channels(injector.variant.actuation)}
    inputs = inputs_of(injector, point)
    seen = courses_of(native, injector, point, inputs, 1.0)
    # a measured rail pressure is an input: the library has its mean in the last step, the lanes its value
    given = {"rail_pressure"} if isinstance(point.rail_pressure, Trace) else set()
    expected = {**solution.channels, "injected": solution.injected}
    expected = {name: course for name, course in expected.items() if name in seen and name not in given}
    assert len(expected) >= 6
    found = deviations(seen, expected, floors)
    rounding = DIRECT_ROUNDING if injector.variant.actuation is Actuation.DIRECT else ROUNDING
    if np.max(found) <= rounding:
        return found, np.full_like(found, rounding)
    own = {name: seen[name] for name in expected}
    twins = [courses_of(native, injector, point, inputs, 1.0 + roundings * 2.0**-52) for roundings in TWINS]
    amplified = np.max([deviations(twin, own, floors) for twin in twins], axis=0)
    return found, rounding + AMPLIFIED * np.maximum.accumulate(amplified)


@pytest.mark.slow
@pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=lambda one: one.label.replace(", ", "-").replace(" ", "-"))
def test_candidates_of_every_wiring_have_the_channels_of_the_lanes(variant: Variant, own: str, tmp_path: Path) -> None:
    injector, rng = wired(variant), np.random.default_rng([*variant.label.encode()])
    assert injector.wired() == variant
    native = Native(write_library(injector, tmp_path, [target_named(own)]), own)
    found, simulated = [], []
    for candidate in candidates_of(injector, rng):
        point = point_of(candidate, rng)
        solution = simulate(candidate, point)
        if solution.status.failed:
            continue
        simulated.append((candidate, point, solution))
        deviation, bound = compare(native, candidate, point, solution)
        assert np.all(deviation <= bound), (np.max(deviation / bound), candidate.values, point)
        found.append(np.max(deviation))
    assert len(found) > CANDIDATES // 2
    assert sum(one <= ROUNDING for one in found) >= PLAIN * len(found), found
    assert sum(solution.injected_mass > 1e-7 for *_, solution in simulated) > len(found) // 3
    several = simulated[:8]
    block = BlockRun(
        native,
        [(*point.initial_pressures(), 0.0) for _, point, _ in several],
        [{name: candidate.values[name] for name in native.parameters} for candidate, _, _ in several],
    )
    block.march_inputs(np.stack([inputs_of(candidate, point) for candidate, point, _ in several], axis=1))
    for i, (_, _, solution) in enumerate(several):
        # of a bouncing needle or plunger too: see `AMPLIFIED`
        assert block.figures(i).injected == pytest.approx(solution.injected_mass, rel=1e-7, abs=1e-18)
