"""Fit families of injectors to workshops' test plans, and judge them on parts that the fit has not seen.

    python -m studies.plan_families PLANS.csv [--family CRI20] [--draws 50] [--steps 8] [--parts] [--write DIR]
    python -m studies.plan_families PLANS.csv --types [--write DIR]

PLANS.csv has one row for each test with the columns part, family, armature_lift_um, residual_gap_um, needle_lift_um,
boost_V, peak_A, peak_us, hold_A, test, rail_pressure_MPa, energising_us, nominal_mm3 and half_band_percent; it is read
and not kept. Its source is github.com/SergeyTomp/DieselTestGUI at dcaa0c8, which carries no licence: whoever has
fetched it writes this table from its tables of injectors and test plans.

A part is an injector of its kind with its own lifts, gap and drive, hydraulics that all parts of its family share, and
two freedoms: the diameter of its nozzle holes, which meets its nominal full load, and its Z-hole's, which the
idle quantity draws away from the family's. A part has 5 to 7 tests; two of them set its freedoms. The shared hydraulics
are fitted to every second part with all its tests and judged on the others, and the reverse. Rows of a family: before
the fit; parts of the other half by their flow alone, idle being judged; by both freedoms, idle being used, so that mid
load, pilots and return alone judge.

Beside them stand regressions without a model, of log(mid load/full load) over the logarithms of the ratios of pressure
and energising time, and over those and the idle quantity, fitted to the same halves, and the median half band of the
mid loads: a wide band is easily met. With --write all parts of a family are fitted, and DIR has an injector file with
the dimensions of the part whose full load is the median. A needle lift below 100 um is read as ten times it: one plan
misprints 250.

With --types the catalogue's types are judged, and fitted further, as who knows no more than a part's full load has
them: with the dimensions of their file and a flow for each part. With --write DIR has their files with the values that
all parts of the family give.

Bench assumed: 1,000 strokes a minute, cylinder 0.5 MPa, return 0.1 MPa, the catalogue's fuel and temperature.
"""

from __future__ import annotations

import argparse
import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares

import commonrail as cr
from commonrail.base.units import to_text
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
ESTIMATE = "estimate"
# What a family's prior has besides the catalogue's injector of its kind.
GUIDES = dict.fromkeys(("plunger_needle.plunger_gap", "plunger_needle.needle_gap"), "3 um")
SPECIAL = {
    # returns of some 40 mm3 at 180 MPa
    "CRIN3": dict.fromkeys(("plunger_needle.plunger_gap", "plunger_needle.needle_gap"), "2.2 um"),
    # pilots of 160 us need a valve as fast as CRI2-16's and a stiff control chamber
    "CRIN1": {
        "valve.spring_preload": "60 N",
        "valve.mass": "4.2 g",
        "control_chamber.volume": "12 mm3",
        "needle_seat.diameter": "1.95 mm",
    },
}
# Parameters that the parts of a family share, and the standard deviation of the logarithm about the prior's value [E]:
# seats and holes to some percent, springs and volumes to about ten, values that no drawing states to a third and more.
SHARED = {
    "control_chamber.a_hole_diameter": 0.1,
    "control_chamber.z_hole_diameter": 0.1,
    "control_chamber.volume": 0.3,
    "plunger_needle.plunger_diameter": 0.02,
    "plunger_needle.spring_preload": 0.3,
    "plunger_needle.plunger_gap": 0.2,
    "needle_seat.diameter": 0.08,
    "needle_seat.contact_damping": 0.5,
    "valve.spring_preload": 0.14,
    "valve.seat_diameter": 0.07,
    "valve.mass": 0.2,
    "valve.contact_damping": 0.5,
    "solenoid.eddy_lag": 0.5,
    "solenoid.pole_area": 0.14,
    "nozzle.discharge_transition": 0.2,
    "nozzle.lift_transition_offset": 0.2,
    "nozzle.lift_maximum_offset": 0.14,
}
GAPS = ("plunger_needle.plunger_gap", "plunger_needle.needle_gap")  # of both guides
STOP = "plunger_needle.stop_lift"
FLOW, OPENING = "nozzle.hole_diameter", "control_chamber.z_hole_diameter"
NAMES = (*SHARED, GAPS[1], FLOW)
COUNT = len(SHARED)
SIGMA = np.array(list(SHARED.values()))
SPREAD = 0.08  # of the Z-hole within a family, and of the flow, as standard deviations of logarithms [E]
FLOW_SPREAD = 0.5
# Relative deviations from nominal quantities that count as one: full load and idle set a part's freedoms, bands of mid
# loads are some 20 %, of pilots 85 %, of returns 60 % [E].
TOLERANCES = {FULL: 0.02, RETURN: 0.2, IDLE: 0.15, PILOT: 0.3} | dict.fromkeys(MID, 0.08)
OTHERS = 0.3  # of second pilots and emission points
STEP = 0.02  # of the logarithm, for differences: below it bounces of needle and valve show
LARGEST = 12.0  # largest residual that counts, also for a failed simulation
FLOW_STEPS = 4  # secant steps to the flow; the last moves the full load by less than 1 %
LATER = 60e-6  # a pilot that injects nothing is judged by a line through the quantities so much, and twice, later [s]
NOTHING = 0.01  # share of the nominal quantity


class Part(NamedTuple):
    """A part: its plan, its full load and idle, its first pilot later, and the simulator that varies `NAMES`."""

    data: cr.parts.PlanData
    full: cr.parts.PlanData
    set_by: cr.parts.PlanData
    later: tuple[cr.parts.PlanData, ...]
    simulator: Simulator
    stated: tuple[str, ...]  # parameters that its plan states

    def rows(self, *names: str) -> list[int]:
        """Rows of tests whose name is one of these; second ones of a name repeat the first."""
        return [i for i, test in enumerate(self.data.tests) if test.name in names]


def prior_of(family: str) -> tuple[cr.Injector, dict[str, str]]:
    """Injector about which a family is sought, and sources of what it has besides the catalogue's."""
    values = GUIDES | SPECIAL.get(family, {})
    return cr.load_injector(base_of(family)).with_values(values), dict.fromkeys(values, ESTIMATE)


def base_of(family: str) -> str:
    """Injector of the catalogue of a family's kind."""
    return "crin" if family.startswith("CRIN") else "cri2-16"


def label_of(family: str) -> str:
    """Name of a family's type in the catalogue."""
    return f"crin{family[4]}" if family.startswith("CRIN") else f"cri{family[3]}-{family[4]}"


def read_parts(path: Path, *, types: bool = False) -> dict[str, list[Part]]:
    """Parts by family; with `types` each is the catalogue's type, whatever its plan states."""
    with path.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    families: dict[str, list[Part]] = {}
    for name in dict.fromkeys(row["part"] for row in rows):
        part_rows = [row for row in rows if row["part"] == name]
        stated = {q: float(part_rows[0][k]) * factor for k, (q, factor) in OWN.items() if part_rows[0][k]}
        misprints = {STOP: 10.0 * stated[STOP]} if stated[STOP] < 100e-6 else {}
        family = part_rows[0]["family"]
        injector = cr.load_injector(label_of(family)) if types else prior_of(family)[0].with_values(stated | misprints)
        tests = [_test(row) for row in part_rows]

        def data(
            tests: Sequence[cr.parts.PlanTest], name: str = name, injector: cr.Injector = injector
        ) -> cr.parts.PlanData:
            return cr.parts.PlanData.of(cr.parts.TestPlan(name, tuple(tests)), injector, ("0.5 MPa", "0.1 MPa"), name)

        specimen = Part(
            data(tests),
            data([t for t in tests if t.name == FULL]),
            data([t for t in tests if t.name in (FULL, IDLE)]),
            tuple(data([_later(t, n * LATER) for t in tests if t.name == PILOT]) for n in (1, 2)),
            Simulator(injector, NAMES, 1e-6, 1),
            tuple(name for name in stated if name not in misprints),
        )
        families.setdefault(part_rows[0]["family"], []).append(specimen)
    return families


def _test(row: dict[str, str]) -> cr.parts.PlanTest:
    nominal, half = float(row["nominal_mm3"]) * 1e-9, float(row["half_band_percent"]) / 100.0
    return cr.parts.PlanTest(
        row["test"],
        float(row["rail_pressure_MPa"]) * 1e6,
        (cr.Energising(0.0, float(row["energising_us"]) * 1e-6),),
        nominal,
        nominal * (1.0 - half),
        nominal * (1.0 + half),
        "return" if row["test"] == RETURN else "delivery",  # type: ignore[arg-type]  # read as a Measure
        1000.0 / 60.0,
    )


def _later(test: cr.parts.PlanTest, time: float) -> cr.parts.PlanTest:
    return replace(test, energisings=(cr.Energising(0.0, test.energisings[0].duration + time),))


def values_of(specimen: Part, shifts: Floats, flow: ArrayLike, opening: ArrayLike = 0.0) -> Floats:
    """Values (candidates, names) of shifts of `SHARED`, of the flow and of the Z-hole, all in logarithms."""
    nominal = np.array([specimen.simulator.injector.values[name] for name in NAMES])
    logarithms = np.column_stack([shifts, shifts[:, list(SHARED).index(GAPS[0])], np.broadcast_to(flow, len(shifts))])
    logarithms[:, NAMES.index(OPENING)] += opening
    return np.asarray(nominal * np.exp(logarithms))


def flow_of(specimen: Part, shifts: Floats) -> Floats:
    """Flow (candidates,) that meets the full load."""
    flow, slope = np.zeros(len(shifts)), np.full(len(shifts), 2.0)  # a quantity grows with the holes' section
    before = flow, np.full(len(shifts), np.nan)
    for _ in range(FLOW_STEPS):
        full_load = specimen.full.simulated(specimen.simulator, values_of(specimen, shifts, flow))[:, 0]
        error = np.log(np.maximum(full_load, 1e-12) / specimen.full.measured[0])
        moved = flow - before[0]
        steep = (error - before[1]) / np.where(np.abs(moved) > 1e-6, moved, np.nan)
        slope = np.where((steep > 0.3) & (steep < 4.0), steep, slope)
        before = flow, error
        flow = np.clip(flow - np.nan_to_num(error) / slope, -1.0, 1.0)
    return flow


def quantities(specimen: Part, shifts: Floats, flow: ArrayLike, opening: ArrayLike = 0.0) -> Floats:
    """Quantities of the tests (candidates, tests) [m³]."""
    return specimen.data.simulated(specimen.simulator, values_of(specimen, shifts, flow, opening))


def residuals(specimen: Part, shifts: Floats, flow: ArrayLike, opening: ArrayLike = 0.0) -> Floats:
    """Deviations (candidates, tests) in `TOLERANCES`."""
    values = values_of(specimen, shifts, flow, opening)
    simulated = specimen.data.simulated(specimen.simulator, values)
    pilot = specimen.rows(PILOT)[0]
    first, second = (data.simulated(specimen.simulator, values)[:, 0] for data in specimen.later)
    nothing = simulated[:, pilot] < NOTHING * specimen.data.measured[pilot]
    simulated[:, pilot] = np.where(nothing, np.minimum(simulated[:, pilot], 2.0 * first - second), simulated[:, pilot])
    return _deviations(specimen.data, simulated)


def _deviations(data: cr.parts.PlanData, simulated: Floats) -> Floats:
    tolerances = np.array([TOLERANCES.get(test.name, OTHERS) for test in data.tests])
    deviations = np.nan_to_num((simulated / data.measured - 1.0) / tolerances, nan=LARGEST)
    return np.asarray(np.clip(deviations, -LARGEST, LARGEST))


def fit(parts: Sequence[Part], draws: int, steps: int, spread: float = SPREAD) -> Floats:
    """Shifts of the shared parameters (names,), fitted with flow and Z-hole, which has a `spread`, of each part.

    The better of two descents: from the prior's middle, and from the best of draws from the prior.
    """
    individual = np.tile([FLOW_SPREAD, spread], len(parts))
    wide = np.concatenate([SIGMA, individual])

    def fun(x: Floats) -> Floats:
        of_parts = zip(parts, x[COUNT:].reshape(-1, 2), strict=True)
        return np.concatenate([*(residuals(p, x[None, :COUNT], *two)[0] for p, two in of_parts), x / wide])

    def jacobian(x: Floats) -> Floats:
        steps_ = STEP * np.eye(COUNT + 2)
        steps_ = np.vstack([steps_, -steps_])
        blocks = np.zeros((0, len(x)))
        for i, specimen in enumerate(parts):
            columns = [*range(COUNT), COUNT + 2 * i, COUNT + 2 * i + 1]
            at = x[columns] + steps_
            ends = residuals(specimen, at[:, :COUNT], at[:, COUNT], at[:, COUNT + 1])
            block = np.zeros((ends.shape[1], len(x)))
            block[:, columns] = (ends[: COUNT + 2] - ends[COUNT + 2 :]).T / (2.0 * STEP)
            blocks = np.vstack([blocks, block])
        return np.vstack([blocks, np.diag(1.0 / wide)])

    drawn = 0.7 * SIGMA * np.random.default_rng(0).standard_normal((draws, COUNT))
    starts = np.vstack([np.zeros(COUNT), drawn])
    flows = np.column_stack([flow_of(specimen, starts) for specimen in parts])
    deviations = np.hstack([residuals(specimen, starts, flows[:, i]) for i, specimen in enumerate(parts)])
    costs = np.sum(np.sqrt(1.0 + np.hstack([deviations, starts / SIGMA]) ** 2), axis=1)
    ends = []
    for i in dict.fromkeys((0, int(np.argmin(costs)))):
        x = np.concatenate([starts[i], np.column_stack([flows[i], np.zeros(len(parts))]).ravel()])
        ends.append(least_squares(fun, x, jacobian, bounds=(-2.0, 2.0), max_nfev=steps))
    return np.asarray(min(ends, key=lambda end: end.cost).x[:COUNT])


def fit_to_full_load_and_idle(specimen: Part, shifts: Floats) -> Floats:
    """Flow and Z-hole (2,) of a part of which full load and idle alone are known."""

    def fun(x: Floats) -> Floats:
        simulated = specimen.set_by.simulated(specimen.simulator, values_of(specimen, shifts[None], x[0], x[1]))[0]
        return np.append(_deviations(specimen.set_by, simulated), x[1] / SPREAD)

    def jacobian(x: Floats) -> Floats:
        return np.column_stack([(fun(x + h) - fun(x - h)) / STEP for h in 0.5 * STEP * np.eye(2)])

    start = np.array([flow_of(specimen, shifts[None])[0], 0.0])
    return np.asarray(least_squares(fun, start, jacobian, max_nfev=8).x)


def regression(train: Sequence[Part], judged: Sequence[Part], *, idle: bool) -> list[float]:
    """Relative errors of the mid loads of parts by a regression on others, with the idle quantity if `idle`."""

    def table(parts: Sequence[Part]) -> Floats:
        rows = []
        for specimen in parts:
            full, *low = specimen.set_by.tests if specimen.set_by.tests[0].name == FULL else specimen.set_by.tests[::-1]
            if idle and not low:
                continue
            for test in (specimen.data.tests[i] for i in specimen.rows(*MID)):
                ratios = [_rate(test, full), test.rail_pressure / full.rail_pressure, test.middle / full.middle]
                if idle:
                    root = (low[0].rail_pressure / full.rail_pressure) ** 0.5
                    ratios.insert(0, low[0].middle / full.middle / root / _rate(low[0], full))
                rows.append((1.0, *np.log(ratios)))
        return np.array(rows)

    train_table, judged_table = table(train), table(judged)
    coefficients = np.linalg.lstsq(train_table[:, :-1], train_table[:, -1], rcond=None)[0]
    return [float(error) for error in np.expm1(judged_table[:, :-1] @ coefficients - judged_table[:, -1])]


def _rate(test: cr.parts.PlanTest, full: cr.parts.PlanTest) -> float:
    return test.energisings[0].duration / full.energisings[0].duration


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


def halves(family: str, parts: Sequence[Part], draws: int, steps: int, *, each: bool) -> None:
    """Print the rows of a family; with `each` also errors of each part."""
    rows: dict[str, list[tuple[Part, Floats]]] = {"before the fit": [], "flow alone": [], "flow and Z-hole": []}
    plain: list[float] = []
    with_idle: list[float] = []
    for train, others in ((parts[::2], parts[1::2]), (parts[1::2], parts[::2])):
        plain += regression(train, others, idle=False)
        with_idle += regression(train, others, idle=True)
        shifts = fit(train, draws, steps)
        changes = zip(SHARED, 100.0 * np.expm1(shifts), strict=True)
        print("# fitted, %:", ", ".join(f"{name} {change:+.0f}" for name, change in changes), flush=True)
        for specimen in others:
            zero = np.zeros((1, COUNT))
            two = fit_to_full_load_and_idle(specimen, shifts)
            rows["before the fit"].append((specimen, quantities(specimen, zero, flow_of(specimen, zero))[0]))
            by_flow = quantities(specimen, shifts[None], flow_of(specimen, shifts[None]))[0]
            rows["flow alone"].append((specimen, by_flow))
            rows["flow and Z-hole"].append((specimen, quantities(specimen, shifts[None], *two)[0]))
            if each:
                errors = 100.0 * (rows["flow and Z-hole"][-1][1] / specimen.data.measured - 1.0)
                tests = zip(specimen.data.tests, errors, strict=True)
                print(f"# {specimen.data.name}:", ", ".join(f"{test.name} {error:+.0f}" for test, error in tests))
    for name, judged in rows.items():
        print(line(f"{family}, {name}", judged), flush=True)
    of_both = [100.0 * np.sqrt(np.mean(np.square(errors))) for errors in (plain, with_idle)]
    rms = f"rms {of_both[0]:.0f}, with idle {of_both[1]:.0f}"
    print(f"{family}, regression: {rms}; half bands {half_band(parts):.0f} %", flush=True)


ONE_FLOW = 0.003  # spread of the Z-hole where the flow alone is a part's own


def judge_types(family: str, parts: Sequence[Part], steps: int, folder: Path | None) -> None:
    """Print rows of a type with a flow for each part: as it is, fitted to the other half, and fitted to all parts."""

    def row(name: str, judged: Sequence[tuple[Part, Floats]]) -> None:
        of_flow = [(p, quantities(p, s[None], flow_of(p, s[None]))[0]) for p, s in judged]
        print(line(f"{family}, {name}", of_flow), flush=True)

    row("catalogue", [(specimen, np.zeros(COUNT)) for specimen in parts])
    halves_of = ((parts[::2], parts[1::2]), (parts[1::2], parts[::2]))
    row("other half", [(p, s) for train, others in halves_of for s in [fit(train, 0, steps, ONE_FLOW)] for p in others])
    shifts = fit(parts, 0, steps, ONE_FLOW)
    row("all parts", [(specimen, shifts) for specimen in parts])
    if folder is not None:
        write_type(folder, family, parts, shifts)


def write_type(folder: Path, family: str, parts: Sequence[Part], shifts: Floats) -> None:
    """Write the file of a type with values that are shifted, and the flow of its part."""
    import tomlkit

    source = resources.files("commonrail.physics.catalogue.injectors") / f"{label_of(family)}.toml"
    document = tomlkit.parse(source.read_text(encoding="utf-8"))
    specimen = next(specimen for specimen in parts if specimen.data.name in document["title"])
    values = values_of(specimen, shifts[None], flow_of(specimen, shifts[None]))[0].tolist()
    for name, value in zip(NAMES, values, strict=True):
        table, _, key = name.partition(".")
        unit = specimen.simulator.injector.quantities[name].unit
        document[table][key] = float(f"{value:.4g}") if unit == "1" else to_text(float(f"{value:.4g}"), unit)
    text = tomlkit.dumps(document).replace("12 parts, half", "12 parts, the last time by their flow alone, half")
    (folder / f"{label_of(family)}.toml").write_text(text, encoding="utf-8")


HEADER = """\
# Type of injectors {title}: dimensions and drive of one part as specified, hydraulics estimated from test plans of its
# family. Values to start from, no measured injector; docs/howto/test-plan.md says how far they are off.
# Marks: M specification of the part, E estimate. Written by studies/plan_families.py.
# Parts of the family: {parts}."""
SOURCE = "DieselTestGUI at dcaa0c8"


def write(folder: Path, family: str, parts: Sequence[Part], shifts: Floats) -> None:
    """Write an injector file that states what differs from the catalogue's injector of its kind."""
    candidates = sorted((p for p in parts if STOP in p.stated), key=lambda p: float(p.full.measured[0]))
    specimen = candidates[len(candidates) // 2]
    (prior, sources), stated = prior_of(family), specimen.simulator.injector.values
    freedoms = fit_to_full_load_and_idle(specimen, shifts)
    values = dict(zip(NAMES, values_of(specimen, shifts[None], *freedoms)[0].tolist(), strict=True))
    entries = {name: (prior.values[name], "E", source) for name, source in sources.items()}
    specified = f"specification of part {specimen.data.name}, {SOURCE}"
    entries |= {name: (stated[name], "M", specified) for name in specimen.stated}
    fitted = (
        f"estimated from test plans of {len(parts)} parts, half bands of mid loads {half_band(parts):.0f} %, {SOURCE}"
    )
    entries |= {name: (value, "E", fitted) for name, value in values.items()}
    title = f"CRIN{family[4]}" if family.startswith("CRIN") else f"CRI{family[3]}.{family[4]}"
    label = label_of(family)
    numbers = ", ".join(sorted(p.data.name for p in parts))
    lines = [
        HEADER.format(title=title, parts=numbers),
        "",
        'format = "commonrail-injector/1"',
        f'base = "{base_of(family)}"',
    ]
    lines += [f'name = "{label}"', f'title = "Bosch {title}, part {specimen.data.name}, estimated hydraulics"']
    for table in dict.fromkeys(name.partition(".")[0] for name in prior.quantities):
        within = {name: entries[name] for name in prior.quantities if name in entries and name.startswith(f"{table}.")}
        if not within:
            continue
        mark, source = Counter(entry[1:] for entry in within.values()).most_common(1)[0][0]
        lines += ["", f"[{table}]", f'mark = "{mark}"', f'source = "{source}"']
        for name, (value, *origin) in within.items():
            unit = prior.quantities[name].unit
            text = f"{value:.4g}" if unit == "1" else f'"{to_text(float(f"{value:.4g}"), unit)}"'
            inline_table = f'{{ value = {text}, mark = "{origin[0]}", source = "{origin[1]}" }}'
            lines.append(f"{name.partition('.')[2]} = {text if origin == [mark, source] else inline_table}")
    (folder / f"{label}.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def half_band(parts: Sequence[Part]) -> float:
    """Median half band of the mid loads [%]."""
    return float(np.median([100.0 * p.data.bands.above[i] / p.data.measured[i] for p in parts for i in p.rows(*MID)]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plans", type=Path)
    parser.add_argument("--family", action="append", help="only this family; repeatable")
    parser.add_argument("--draws", type=int, default=50, help="draws from the prior that are tried as starts")
    parser.add_argument("--steps", type=int, default=8, help="evaluations of each of two descents")
    parser.add_argument("--parts", action="store_true", help="errors of each part of the other half")
    parser.add_argument("--types", action="store_true", help="judge the catalogue's types by the flow of parts alone")
    parser.add_argument("--write", type=Path, help="judge nothing; folder for an injector of each family")
    args = parser.parse_args()
    if args.types or not args.write:
        print(HEAD, flush=True)
    for family, parts in read_parts(args.plans, types=args.types).items():
        if args.family and family not in args.family:
            continue
        if args.types:
            judge_types(family, parts, args.steps, args.write)
            continue
        if args.write:
            shifts = fit(parts, args.draws, args.steps)
            all_parts = [(p, quantities(p, shifts[None], *fit_to_full_load_and_idle(p, shifts))[0]) for p in parts]
            print(HEAD, line(f"{family}, fitted to all", all_parts), sep="\n", flush=True)
            write(args.write, family, parts, shifts)
        else:
            halves(family, parts, args.draws, args.steps, each=args.parts)


if __name__ == "__main__":
    main()
