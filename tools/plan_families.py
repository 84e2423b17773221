"""Fit families of injectors to workshops' test plans, and judge them on parts that the fit has not seen.

    python -m tools.plan_families PLANS.csv [--family CRI20] [--catalogue] [--draws 200] [--steps 12] [--write DIR]

PLANS.csv has one row for each test with the columns part, family, armature_lift_um, residual_gap_um, needle_lift_um,
boost_V, peak_A, peak_us, hold_A, test, rail_pressure_MPa, energising_us, nominal_mm3 and half_band_percent; it is read
and not kept. A part is the catalogue's injector of its kind (crin for families CRIN…, else cri2-16) with its own lifts,
gap and drive, and one flow: the hole diameter that meets its nominal full load. Rows of a family: the catalogue as it
is; then hydraulics that its parts share, fitted to every second part and judged on the others, and the reverse.

Beside them stands a regression without a model, log(mid load/full load) over the logarithms of the ratios of pressure
and energising time, fitted to the same halves, and the median half band of the mid loads: a wide band is easily met.
With --write all parts of a family are fitted, and DIR has an injector file with the dimensions of its first part.
Bench assumed: 1,000 strokes a minute, cylinder 0.5 MPa, return 0.1 MPa, the catalogue's fuel and temperature.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import commonrail as cr
from commonrail.data.simulator import Simulator

Floats = NDArray[np.float64]

FULL, RETURN, IDLE, PILOT = "Maximum Load", "Back Flow", "Idle", "Pre-injection"
MID = ("Emission Point", "Part Load")
# Columns of a part's own dimensions, the parameter, and the factor to SI.
OWN = {
    "armature_lift_um": ("valve.lift", 1e-6),
    "residual_gap_um": ("solenoid.residual_gap", 1e-6),
    "needle_lift_um": ("plunger_needle.stop_lift", 1e-6),
    "boost_V": ("drive.boost_voltage", 1.0),
    "peak_A": ("drive.peak_current", 1.0),
    "peak_us": ("drive.peak_duration", 1e-6),
    "hold_A": ("drive.hold_current", 1.0),
}
# Parameters that the parts of a family share, and the standard deviation of the logarithm about the catalogue's value
# [E]: seats and holes to some percent, springs and volumes to some ten, what no drawing states to a third and more.
SHARED = {
    "control_chamber.a_hole_diameter": 0.1,
    "control_chamber.z_hole_diameter": 0.1,
    "control_chamber.volume": 0.3,
    "plunger_needle.plunger_diameter": 0.02,
    "plunger_needle.spring_preload": 0.3,
    "plunger_needle.plunger_gap": 0.3,
    "needle_seat.diameter": 0.1,
    "needle_seat.contact_damping": 0.7,
    "valve.spring_preload": 0.15,
    "valve.mass": 0.25,
    "valve.contact_damping": 0.7,
    "solenoid.eddy_lag": 0.5,
    "solenoid.pole_area": 0.15,
    "nozzle.discharge_transition": 0.3,
    "nozzle.lift_transition_offset": 0.3,
    "nozzle.lift_maximum_offset": 0.2,
}
GAPS = ("plunger_needle.plunger_gap", "plunger_needle.needle_gap")  # of both guides alike
FLOW = "nozzle.hole_diameter"
COUNT = len(SHARED)
SIGMA = np.array(list(SHARED.values()))
STEP = 0.01  # of the logarithm, for differences: below it bounces of needle and valve show
LARGEST = 12.0  # residual that counts at most, and that of a failed simulation
FLOW_STEPS = 3  # secant steps to the flow; the last moves the full load by less than 1 %
LATER = 60e-6  # a pilot that injects nothing is judged by a line through the quantities so much, and twice, later [s]
NOTHING = 0.01  # share of the nominal quantity


class Part(NamedTuple):
    """A part: its plan, its full load alone, its pilots later, and the simulator that varies `SHARED` and the flow."""

    data: cr.PlanData
    full: cr.PlanData
    later: tuple[cr.PlanData, ...]
    simulator: Simulator

    def rows(self, *names: str) -> list[int]:
        """Rows of tests whose name is one of these; second ones of a name repeat the first."""
        return [i for i, test in enumerate(self.data.tests) if test.name in names]


def read_parts(path: Path) -> dict[str, list[Part]]:
    """Parts by family."""
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    families: dict[str, list[Part]] = {}
    for name in dict.fromkeys(row["part"] for row in rows):
        own = [row for row in rows if row["part"] == name]
        family = own[0]["family"]
        base = cr.load_injector("crin" if family.startswith("CRIN") else "cri2-16")
        injector = base.with_values({q: float(own[0][k]) * factor for k, (q, factor) in OWN.items() if own[0][k]})
        tests = [_test(row) for row in own]

        def data(tests: Sequence[cr.PlanTest], name: str = name, injector: cr.Injector = injector) -> cr.PlanData:
            return cr.PlanData.of(cr.TestPlan(name, tuple(tests)), injector, ("0.5 MPa", "0.1 MPa"), name)

        later = (data([_later(test, n * LATER) if test.name == PILOT else test for test in tests]) for n in (1, 2))
        simulator = Simulator(injector, (*SHARED, GAPS[1], FLOW), 1e-6)
        part = Part(data(tests), data([t for t in tests if t.name == FULL]), tuple(later), simulator)
        families.setdefault(family, []).append(part)
    return families


def _test(row: dict[str, str]) -> cr.PlanTest:
    nominal, half = float(row["nominal_mm3"]) * 1e-9, float(row["half_band_percent"]) / 100.0
    return cr.PlanTest(
        row["test"],
        float(row["rail_pressure_MPa"]) * 1e6,
        (cr.Energising(0.0, float(row["energising_us"]) * 1e-6),),
        nominal,
        nominal * (1.0 - half),
        nominal * (1.0 + half),
        "return" if row["test"] == RETURN else "delivery",  # type: ignore[arg-type]  # read as a Measure
        1000.0 / 60.0,
    )


def _later(test: cr.PlanTest, time: float) -> cr.PlanTest:
    return replace(test, energisings=(cr.Energising(0.0, test.energisings[0].duration + time),))


def values_of(part: Part, shifts: Floats) -> Floats:
    """Values (candidates, parameters) of shifts of `SHARED` in logarithms, with the flow that meets the full load."""
    own = np.array([part.simulator.injector.values[name] for name in part.simulator.names])
    shifts = np.column_stack([shifts, shifts[:, list(SHARED).index(GAPS[0])]])
    flow, slope = np.zeros(len(shifts)), np.full(len(shifts), 2.0)  # a quantity grows with the holes' section
    before = flow, np.full(len(shifts), np.nan)
    for _ in range(FLOW_STEPS):
        values = own * np.exp(np.column_stack([shifts, flow]))
        off = np.log(np.maximum(part.full.simulated(part.simulator, values)[:, 0], 1e-12) / part.full.measured[0])
        moved = flow - before[0]
        found = (off - before[1]) / np.where(np.abs(moved) > 1e-6, moved, np.nan)
        slope = np.where((found > 0.3) & (found < 4.0), found, slope)
        before = flow, off
        flow = np.clip(flow - np.nan_to_num(off) / slope, -0.5, 0.5)
    return own * np.exp(np.column_stack([shifts, flow]))


def quantities(part: Part, shifts: Floats) -> Floats:
    """Quantities of the tests (candidates, tests) [m³]."""
    return part.data.simulated(part.simulator, values_of(part, shifts))


def residuals(parts: Sequence[Part], shifts: Floats) -> Floats:
    """Residuals (candidates, n) of parts, the prior of the shared parameters behind them."""
    columns = []
    for part in parts:
        values = values_of(part, shifts)
        found = part.data.simulated(part.simulator, values)
        first, second = (data.simulated(part.simulator, values) for data in part.later)
        nothing = found < NOTHING * part.data.measured
        found = np.where(nothing, np.minimum(found, 2.0 * first - second), found)
        columns.append(np.nan_to_num(part.data.errors(found), nan=LARGEST))
    return np.column_stack([np.clip(np.hstack(columns), -LARGEST, LARGEST), shifts / SIGMA])


def fit(parts: Sequence[Part], draws: int, steps: int) -> Floats:
    """Shifts of the shared parameters (names,): the best of the catalogue and of draws from the prior, improved."""

    def jacobian(x: Floats) -> Floats:
        ends = residuals(parts, np.vstack([x + STEP * np.eye(COUNT), x - STEP * np.eye(COUNT)]))
        return np.asarray((ends[:COUNT] - ends[COUNT:]).T / (2.0 * STEP))

    drawn = 0.7 * SIGMA * np.random.default_rng(0).standard_normal((draws, COUNT))
    starts = np.vstack([np.zeros(COUNT), drawn])
    costs = np.sum(np.sqrt(1.0 + residuals(parts, starts) ** 2), axis=1)
    ends = [
        least_squares(lambda x: residuals(parts, x[None])[0], start, jacobian, loss="soft_l1", max_nfev=steps)
        for start in dict.fromkeys(map(tuple, (starts[0], starts[np.argmin(costs)])))
    ]
    return np.asarray(min(ends, key=lambda end: end.cost).x)


def regression(train: Sequence[Part], judged: Sequence[Part]) -> list[float]:
    """Relative errors of the mid loads of parts by a regression on others."""

    def table(parts: Sequence[Part]) -> tuple[Floats, Floats]:
        rows = []
        for part in parts:
            full = part.full.tests[0]
            for test in (part.data.tests[i] for i in part.rows(*MID)):
                times = test.energisings[0].duration / full.energisings[0].duration
                ratios = test.rail_pressure / full.rail_pressure, times, test.middle / full.middle
                rows.append((1.0, *np.log(ratios)))
        found = np.array(rows)
        return found[:, :3], found[:, 3]

    x, y = table(train)
    coefficients = np.linalg.lstsq(x, y, rcond=None)[0]
    x, y = table(judged)
    return [float(error) for error in np.expm1(x @ coefficients - y)]


HEAD = """\
                         mid load, %           idle, %       pilots             return, %
                         median   rms  in band median in band nothing  in band median in band  failed"""


def line(name: str, judged: Sequence[tuple[Part, Floats]]) -> str:
    """Row of the table: errors of parts with their quantities (tests,)."""

    def errors(*tests: str) -> Floats:
        return np.array([100.0 * (q[i] / p.data.measured[i] - 1.0) for p, q in judged for i in p.rows(*tests)])

    def inside(*tests: str) -> str:
        states = [p.data.tests[i].state(float(q[i])) == "inside" for p, q in judged for i in p.rows(*tests)]
        return f"{sum(states):2d} of {len(states):2d}"

    mid, pilot = errors(*MID), errors(PILOT)
    failed = int(np.isnan(np.hstack([q for _, q in judged])).sum())
    return (
        f"{name:24} {np.nanmedian(mid):6.0f} {np.sqrt(np.nanmean(mid**2)):5.0f} {inside(*MID)} "
        f"{np.nanmedian(errors(IDLE)):6.0f} {inside(IDLE)} {int(np.sum(pilot < -99.0)):7d} {inside(PILOT)} "
        f"{np.nanmedian(errors(RETURN)):6.0f} {inside(RETURN)} {failed:6d}"
    )


def write(folder: Path, family: str, part: Part, shifts: Floats, source: str) -> None:
    """Write the fitted injector with the dimensions of a part; its values have the mark F and the source."""
    names, values = part.simulator.names, values_of(part, shifts[None])[0].tolist()
    rounded = {name: float(f"{value:.4g}") for name, value in zip(names, values, strict=True)}
    injector = part.simulator.injector.with_values(rounded)
    title = f"Bosch {family}, hydraulics fitted to test plans, dimensions of {part.data.name}"
    own = dict.fromkeys((name for name, _ in OWN.values()), f"{source}, {part.data.name}")
    notes = own | dict.fromkeys(names, f"fitted to test plans of {family}, {source}")
    cr.dump_injector(replace(injector, name=family.lower(), title=title), folder / f"{family.lower()}.toml", notes)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plans", type=Path)
    parser.add_argument("--family", action="append", help="only this family; repeatable")
    parser.add_argument("--catalogue", action="store_true", help="fit nothing")
    parser.add_argument("--draws", type=int, default=200, help="draws from the prior that are tried as starts")
    parser.add_argument("--steps", type=int, default=12, help="evaluations of each of two fits")
    parser.add_argument("--write", type=Path, help="folder for an injector of each family, fitted to all its parts")
    parser.add_argument("--source", default="source not stated", help="of the plans, for the files of --write")
    args = parser.parse_args()
    print(HEAD, flush=True)
    for family, parts in read_parts(args.plans).items():
        if args.family and family not in args.family:
            continue
        zero = np.zeros((1, COUNT))
        print(line(f"{family}, catalogue", [(p, quantities(p, zero)[0]) for p in parts]), flush=True)
        halves = parts[::2], parts[1::2]
        baseline: list[float] = []
        judged: list[tuple[Part, Floats]] = []
        for train, others in (halves, halves[::-1]):
            baseline += regression(train, others)
            if not args.catalogue:
                shifts = fit(train, args.draws, args.steps)
                judged += [(p, quantities(p, shifts[None])[0]) for p in others]
                changes = zip(SHARED, 100.0 * np.expm1(shifts), strict=True)
                print("# fitted, %:", ", ".join(f"{name} {change:+.0f}" for name, change in changes), flush=True)
        if judged:
            print(line(f"{family}, other half", judged), flush=True)
        bands = [100.0 * p.data.bands.above[i] / p.data.measured[i] for p in parts for i in p.rows(*MID)]
        rms = 100.0 * np.sqrt(np.mean(np.square(baseline)))
        name = f"{family}, regression"
        print(
            f"{name:24} {100.0 * np.median(baseline):6.0f} {rms:5.0f} half bands {np.median(bands):.0f} %", flush=True
        )
        if args.write:
            write(args.write, family, parts[0], fit(parts, args.draws, args.steps), args.source)


if __name__ == "__main__":
    main()
