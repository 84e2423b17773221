"""Libraries of all wirings against the lanes: random candidates, points, trains and measured courses, every channel.

Both are compiled with nothing fused and nothing reordered (`compiler.laws.FASTMATH`), and so nothing may differ.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.arguments import COUNTS
from commonrail.base.choices import Actuation, Body, Boundary, Drive, Laws
from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
from commonrail.engine.plan import admissible
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import Variant
from commonrail.plugins.export.description import AT_REST
from commonrail.plugins.export.fmu import write_fmu
from commonrail.plugins.export.library import write_library
from commonrail.plugins.export.object_files import find_target
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN
from tests.plugins.export.native import BlockRun, Floats, Native, Run
from tests.plugins.export.test_library import ROUNDING, inputs_of
from tests.plugins.page.wasm import MISSING, STEP, simulated

CANDIDATES, STEPS = 50, 1500
SPREAD = 0.05  # of the parameters around the injector's
# Of the peak: the pressure of an ideal rail is given to the lanes, and the library takes it from the density. What it
# computes with has the same bits.
FROM_DENSITY = 1e-13
DRIVEN, ENERGISED = 18.0, 600e-6  # [A] or [V], [s]
SERVO = [Variant(*choices) for choices in itertools.product(Body, Boundary, Drive, Laws)]
DIRECT = [Variant(drive=drive, laws=laws, actuation=Actuation.DIRECT) for drive in Drive for laws in Laws]
# Values at which the extended laws differ from the paper's.
EXTENDED = {"nozzle.shape_1": 0.02, "nozzle.shape_5": -0.03}
EXTENDED_SERVO = EXTENDED | {
    "plunger_needle.friction": 5.0,
    "valve.seat_land": 50e-6,
    "plunger_needle.gap_widening": 2e-14,
    "valve.stop_disc": 6e-3,
}


def label_of(variant: Variant) -> str:
    """Name of a wiring without spaces."""
    return variant.label.replace(", ", "-").replace(" ", "-")


def wired(variant: Variant) -> Injector:
    """Injector of the catalogue with a wiring."""
    direct = variant.actuation is Actuation.DIRECT
    injector = load_injector("direct-acting-kr" if direct else DRAWN)
    if variant.laws is Laws.EXTENDED:
        injector = injector.with_values(EXTENDED if direct else EXTENDED_SERVO)
    return replace(injector, variant=variant)


def candidates_of(injector: Injector, rng: np.random.Generator) -> list[Injector]:
    """Random injectors around one, at its fuel temperature: at others the table of the fuel counts (4e-10 measured)."""
    fixed = (*COUNTS, FUEL_TEMPERATURE)
    names = [name for name, value in injector.values.items() if value != 0.0 and name not in fixed]
    own = np.array([injector.values[name] for name in names])
    values = own * rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, (8 * CANDIDATES, len(own)))
    values = values[admissible(names, values, injector.fuel)][:CANDIDATES]
    rows = [dict(zip(names, row.tolist(), strict=True)) for row in values]
    return [replace(injector, values={**injector.values, **row}) for row in rows]  # some of which the wiring reads


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


def given_of(injector: Injector) -> str:
    """Channel of a rail whose pressure is given; "" where none is."""
    return "rail_pressure" if injector.variant.boundary is Boundary.IDEAL else ""


def expected_of(injector: Injector, point: OperatingPoint, solution: Solution) -> tuple[dict[str, Floats], str]:
    """Channels of the lanes by name, and that of a rail whose pressure is given; "" where none is."""
    given, expected = given_of(injector), {**solution.channels, "injected": solution.injected}
    if isinstance(point.rail_pressure, Trace):
        del expected[given]  # an input: the library has its mean in the last step, the lanes its value
    return expected, given


def compare(found: Mapping[str, Floats], expected: Mapping[str, Floats], given: str, rounding: float = 0.0) -> None:
    """Assert that channels have the same bits, but for that of a given rail pressure.

    Parameters
    ----------
    found, expected : mapping of str to (steps,)
    given : str
        As of `given_of`.
    rounding : float
        Largest deviation of the other channels relative to their peaks.
    """
    compared = set(found) & set(expected)
    assert {"injected", "needle_lift", "accumulation_pressure", "sac_pressure", "coil_current"} <= compared
    for name in compared - {given}:
        peak = np.max(np.abs(expected[name]))
        np.testing.assert_allclose(found[name], expected[name], rtol=0.0, atol=rounding * peak, err_msg=name)
    if given in compared:
        np.testing.assert_allclose(found[given], expected[given], rtol=FROM_DENSITY)


@pytest.mark.slow
@pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=label_of)
def test_candidates_of_every_wiring_have_the_bits_of_the_lanes(variant: Variant, own: str, tmp_path: Path) -> None:
    """Bouncing needles and plungers too, which would magnify one rounding to 1e-5 of a peak."""
    injector, rng = wired(variant), np.random.default_rng([*variant.label.encode()])
    assert injector.wired() == variant
    native = Native(write_library(injector, tmp_path, [find_target(own)]), own)
    simulated = []
    for candidate in candidates_of(injector, rng):
        point = point_of(candidate, rng)
        solution = simulate(candidate, point, same_bits=True)
        if not solution.status.failed:
            simulated.append((candidate, point, solution))
            run = run_of(native, candidate, point)
            found = [run.observe()]
            for one in inputs_of(candidate, point):
                run.march_inputs(one[None])
                found.append(run.observe())
            courses = {name: np.array([row[name] for row in found]) for name in found[0]}
            compare(courses, *expected_of(candidate, point, solution))
    assert len(simulated) > CANDIDATES // 2
    assert sum(solution.injected_mass > 1e-7 for *_, solution in simulated) > len(simulated) // 3
    several = simulated[:8]
    block = BlockRun(
        native,
        [(*point.initial_pressures(), 0.0) for _, point, _ in several],
        [values_of(native, candidate) for candidate, _, _ in several],
    )
    block.march_inputs(np.stack([inputs_of(candidate, point) for candidate, point, _ in several], axis=1))
    for i, (_, _, solution) in enumerate(several):
        assert block.figures(i).injected == solution.injected_mass


def run_of(native: Native, injector: Injector, point: OperatingPoint) -> Run:
    """Injector at rest at a point."""
    return Run(native, (*point.initial_pressures(), 0.0), values=values_of(native, injector))


def values_of(native: Native, injector: Injector) -> dict[str, float]:
    """Parameters that a library has."""
    return {name: injector.values[name] for name in native.parameters}


def steady_of(injector: Injector, end: float = STEPS * 1e-6) -> OperatingPoint:
    """One injection that needs no measured course but a constant one of current or voltage."""
    rail = 30e6 if injector.variant.actuation is Actuation.DIRECT else 120e6
    if injector.variant.drive in (Drive.CURRENT, Drive.VOLTAGE):
        return OperatingPoint(rail, [], drive=Trace.of([0.0, end], [DRIVEN, DRIVEN]), horizon=end)
    return OperatingPoint(rail, ENERGISED, horizon=end)


@pytest.mark.slow
@pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=label_of)
def test_fmus_of_every_wiring_have_the_bits_of_the_lanes(variant: Variant, own: str, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'commonrail[fmi]'")
    injector = wired(variant)
    point = steady_of(injector)
    solution = simulate(injector, point, same_bits=True)
    assert solution.injected_mass > 1e-7
    expected = {**solution.channels, "injected": solution.injected}
    write_fmu(injector, tmp_path / "injector.fmu", [find_target(own)])
    rail, cylinder, low = point.initial_pressures()
    found = fmpy.simulate_fmu(
        str(tmp_path / "injector.fmu"),
        stop_time=STEPS * 1e-6,
        step_size=1e-6,
        output_interval=1e-6,
        start_values={
            AT_REST if variant.boundary is Boundary.VOLUME else "boundary.rail_pressure": rail,
            "boundary.cylinder_pressure": cylinder,
            **({"boundary.return_pressure": low} if variant.actuation is Actuation.SERVO else {}),
            **({"energising[1].duration": ENERGISED} if point.drive is None else {"boundary.drive": DRIVEN}),
        },
        output=[*expected],
    )
    # the lanes take a constant course's means from its integral, and so with roundings
    rounding = 0.0 if point.drive is None else ROUNDING
    compare({name: found[name] for name in found.dtype.names[1:]}, expected, given_of(injector), rounding)


@pytest.mark.slow
@pytest.mark.parametrize("variant", [*SERVO, *DIRECT], ids=label_of)
def test_modules_of_every_wiring_have_the_bits_of_the_lanes(variant: Variant, tmp_path: Path) -> None:
    """The module of a page, in a WebAssembly engine."""
    if MISSING:
        pytest.skip(MISSING)
    injector = wired(variant)
    point = steady_of(injector)
    solution = simulate(injector, point, same_bits=True)
    figures, injected, courses = simulated(injector, point, STEPS, tmp_path)
    compare(courses | {"injected": injected}, {**solution.channels, "injected": solution.injected}, given_of(injector))
    assert figures["injected"] == solution.injected_mass > 1e-7
    for name in ("opening", "closing"):  # counted in steps; NaN: still open
        assert figures[name] * STEP == pytest.approx(getattr(solution, name), rel=1e-15, nan_ok=True)
