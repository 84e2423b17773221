"""Simulated injection as figures for the terminal, a JSON record and a CSV file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from commonrail.base import output
from commonrail.base.choices import Actuation, Body, Engine, Precision
from commonrail.base.errors import InputError, SimulationError
from commonrail.base.text import FieldUnit, field_unit, number
from commonrail.base.units import to_text
from commonrail.cli.console import SIMULATING, say
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate as simulated
from commonrail.engine.solution import Solution
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector

if TYPE_CHECKING:
    from commonrail.engine.solution import Metered


_UNITS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N"}  # of a solution's channels, by the end of a name


class Settings(NamedTuple):
    """Engine, and time step [s] and precision of the fast engines."""

    engine: Engine
    time_step: float
    precision: Precision = Precision.F64


class Run(NamedTuple):
    """Injector, operating point, solution, time step [s], wall time [s], precision, and what a meter shows of it."""

    injector: Injector
    point: OperatingPoint
    solution: Solution
    time_step: float
    seconds: float
    precision: Precision = Precision.F64
    shown: Metered | None = None


def with_body(injector: Injector, body: Body | None) -> Injector:
    """The injector with a flexible or rigid body, unchanged for None."""
    if body is None:
        return injector
    if injector.variant.actuation is Actuation.DIRECT and body is Body.FLEXIBLE:
        raise InputError("--variant flexible: a direct-acting injector has a rigid body; omit it.")
    return replace(injector, variant=injector.variant._replace(body=body))


def solve(injector: Injector, point: OperatingPoint, settings: Settings) -> Solution:
    """Simulate, and say on stderr if the injection has not ended.

    Raises `SimulationError` if the simulation failed.
    """
    if settings.engine is not Engine.REFERENCE:
        say(SIMULATING)
    engine, step, precision = settings
    solution = simulated(injector, point, engine, step, precision=precision)
    if solution.status.failed:
        raise SimulationError(f"{injector.name}: {solution.sentence}")
    if solution.status is Status.STILL_INJECTING:
        say(f"commonrail: {solution.sentence}")
    return solution


def heading(run: Run) -> str:
    """Injector and operating point in one line."""
    rail = to_text(run.point.at_start(run.point.rail_pressure), "Pa", 4)
    pulses = " + ".join(to_text(pulse.duration, "s", 4) for pulse in run.point.pulses)
    return f"{run.injector.name}: {rail}, energising time {pulses}"


def figures(run: Run) -> list[tuple[str, str]]:
    """Names and texts of the figures of one injection."""
    s, r = run.solution, record(run)
    injected, returned = s.injected_volume * 1e9, s.returned_volume * 1e9
    end = run.point.end_of_energising
    again = s.first_closing < s.closing
    return [
        ("injected quantity", f"{injected:.2f} mm3, {s.injected_mass * 1e6:.2f} mg"),
        ("return quantity", f"{returned:.2f} mm3, {s.returned_mass * 1e6:.2f} mg"),
        ("needle opens", _instant(r["opening"], r["opening_delay"], "start")),
        ("needle closes", _instant(r["closing"], r["closing_delay"], "end")),
        *([("for the first time", _instant(r["first_closing"], r["first_closing"] - end, "end"))] if again else []),
        ("largest rate", f"{r['peak_rate'] * 1e6:.2f} mm3/ms"),
        *_shown(run.shown),
        ("largest needle lift", f"{r['greatest_lift'] * 1e6:.1f} um"),
        ("reference density", f"{s.reference_density:.1f} kg/m3"),
        ("status", f"{s.status.name}: {s.sentence}"),
        ("mass balance", f"{s.balance:.1e} of the injected mass, of 1 mg if that is more"),
        ("engine", f"{s.engine}, {run.precision.value}, {run.seconds:.2f} s with loading or compiling"),
        ("injector", f"{run.injector.title} ({run.injector.variant.label})"),
        *([("synthetic", run.injector.synthetic)] if run.injector.synthetic else []),
    ]


def record(run: Run) -> dict[str, Any]:
    """Figures of one injection for ``--json`` [SI]; null where there is none."""
    s, point = run.solution, run.point
    first, last = point.pulses[0], point.pulses[-1]
    end = last.start + last.duration
    return {
        "schema": 1,
        "kind": "simulation",
        "injector": {
            "name": run.injector.name,
            "title": run.injector.title,
            "variant": run.injector.variant.label,
            "synthetic": run.injector.synthetic,
        },
        "operating_point": {
            "rail_pressure": point.at_start(point.rail_pressure),
            "cylinder_pressure": point.at_start(point.cylinder_pressure),
            "return_pressure": point.at_start(point.return_pressure),
            "energisings": [{"start": p.start, "duration": p.duration} for p in point.pulses],
            "horizon": point.duration,
        },
        "engine": s.engine,
        "time_step": None if s.engine == Engine.REFERENCE.value else run.time_step,
        "precision": run.precision.value,
        "status": s.status.name,
        "message": s.sentence,
        "injected_volume": number(s.injected_volume),
        "injected_mass": number(s.injected_mass),
        "returned_volume": number(s.returned_volume),
        "returned_mass": number(s.returned_mass),
        "reference_density": s.reference_density,
        "opening": number(s.opening),
        "closing": number(s.closing),
        "opening_delay": number(s.opening - first.start),
        "closing_delay": number(s.closing - end),
        "first_closing": number(s.first_closing),
        "peak_rate": number(np.max(s.rate)),
        **_shown_record(run.shown),
        "greatest_lift": number(np.max(s.channels["needle_lift"])),
        "balance": number(s.balance),
        "seconds": run.seconds,
    }


def _shown(shown: Metered | None) -> list[tuple[str, str]]:
    """Names and texts of what a meter shows."""
    if shown is None:
        return []
    peak, quantity = float(np.max(shown.rate)) * 1e6, shown.quantity * 1e9
    return [(f"by meter {shown.meter.name}", f"largest rate {peak:.2f} mm3/ms, quantity {quantity:.2f} mm3")]


def _shown_record(shown: Metered | None) -> dict[str, Any]:
    """Figures of what a meter shows [SI], under the key "meter"; empty without one."""
    if shown is None:
        return {}
    peak, quantity = number(np.max(shown.rate)), number(shown.quantity)
    return {"meter": {"name": shown.meter.name, "peak_rate": peak, "quantity": quantity}}


def write_csv(run: Run, path: Path) -> None:
    """Write rate and channels against time; the rate is the mean over the step that ends at the time."""
    s = run.solution
    names = [f"{name} [{_unit(name).name}]" for name in s.channels]
    columns = [s.time[1:] * 1e6, s.rate_mm3_per_ms, s.rate_mg_per_ms, s.injected[1:] * 1e6]
    if run.shown is not None:
        columns.append(run.shown.rate_mm3_per_ms)
    columns += [values[1:] * _unit(name).factor for name, values in s.channels.items()]
    notes = (
        f"simulated by commonrail, not measured: {heading(run)}",
        "rates are means over the interval that ends at the row's time; the rest is instantaneous",
    )
    seen = [] if run.shown is None else [f"rate by meter {run.shown.meter.name} [mm3/ms]"]
    head = ["time [us]", "rate [mm3/ms]", "mass rate [mg/ms]", "injected [mg]", *seen, *names]
    rows = ([f"{value:.9g}" for value in row] for row in np.column_stack(columns))
    output.write_csv(path, notes, head, rows)


def _unit(channel: str) -> FieldUnit:
    return field_unit(_UNITS.get(channel.rsplit("_", 1)[-1], "1"))


def _instant(at: float | None, delay: float | None, event: str) -> str:
    if at is None or delay is None:
        return "never"
    return f"at {at * 1e6:.1f} us, {delay * 1e6:.1f} us after the {event} of energising"
