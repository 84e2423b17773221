"""commonrail simulate: one injection as figures, as a table of time series, as a plot."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from commonrail.base import registry
from commonrail.base.choices import Engine, Precision
from commonrail.base.errors import InputError, SimulationError
from commonrail.base.text import FieldUnit, field_unit, number, quantity
from commonrail.base.units import parse
from commonrail.cli.console import SIMULATING, print_json, print_pairs, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    CylinderPressure,
    Json,
    ReturnPressure,
    Settings,
    check_distinct,
    check_file,
    check_report,
    read_energisings,
    read_pressures,
    refuse_return_pressure,
    with_overrides,
)

if TYPE_CHECKING:
    from commonrail.cli.model_name import NamedModel
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.engine.solution import Metered, Solution
    from commonrail.physics.injector import Injector
    from commonrail.physics.meters import Meter


@table_verb
def simulate(
    injector: Annotated[
        str,
        Argument(help="Injector file, name of the catalogue or run folder; @VARIANT selects a variant: cri2-16@ideal."),
    ],
    *,
    rail_pressure: Annotated[str, Option(help="Rail pressure, e.g. 160MPa.")],
    energising_time: Annotated[
        str | None, Option(help="Energising time of a single injection from t = 0, e.g. 700us.")
    ] = None,
    energising: Annotated[
        tuple[str, ...],
        Option(
            metavar="START:DURATION",
            help="Start and energising time of one of several injections, e.g. 900us:600us; repeatable.",
        ),
    ] = (),
    cylinder_pressure: CylinderPressure = None,
    return_pressure: ReturnPressure = None,
    horizon: Annotated[
        str | None, Option(help="End of the simulation, e.g. 4ms. [default: 2.5ms after the last energising]")
    ] = None,
    set_: Settings = (),
    engine: Annotated[
        Engine,
        Option(
            help="Engine: lanes and cuda (NVIDIA GPU) are fast with a fixed step, reference is slow with error control."
        ),
    ] = Engine.LANES,
    time_step: Annotated[str | None, Option(help="Time step of lanes and cuda, e.g. 1us. [default: 1us]")] = None,
    precision: Annotated[
        Precision,
        Option(
            help="Precision of lanes and cuda. f32 is for large populations; for one injection it only adds "
            "rounding error."
        ),
    ] = Precision.F64,
    meter: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Meter through which the rate is shown beside the true one: a table [meters.NAME] of --study.",
        ),
    ] = None,
    study: Annotated[
        Path | None,
        Option(help="Study, or calibrated.toml of a run, that describes the meter. [default: the injector file]"),
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="CSV file of rate, lifts, pressures and current against time; .foam (OpenFOAM) or .dat (two columns): "
            "mass flow of one hole for CFD, with a band if curves were fitted.",
        ),
    ] = None,
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with plots of these values.")] = None,
    json: Json = False,
) -> None:
    """Simulate one injection, or several in a row.

    \b
    Examples:
      commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us
      commonrail simulate my.toml --rail-pressure 1200bar --energising 0us:200us \\
          --energising 900us:600us --set plunger_needle.k1=303N/um --out injection.csv
      commonrail simulate runs/first/calibrated.toml --rail-pressure 160MPa --energising-time 700us \\
          --meter bench --report seen.html
    """
    from commonrail.cli.model_name import read_model_name
    from commonrail.engine.operating_point import OperatingPoint

    if engine is Engine.REFERENCE and precision is not Precision.F64:
        raise InputError("--precision f32: the reference engine computes in f64 only; omit --precision or --engine.")
    if engine is Engine.REFERENCE and time_step is not None:
        raise InputError("--time-step: the reference engine chooses its steps by its errors; omit it or --engine.")
    check_file(out, "--out")
    _writer(out)
    check_report(report)
    check_distinct(out, report)
    model = read_model_name(injector)
    seen = _meter(model, meter, study)
    point = OperatingPoint(
        parse(rail_pressure, "Pa", "--rail-pressure"),
        read_energisings(energising_time, energising),
        *read_pressures(cylinder_pressure, return_pressure, model.folder),
        horizon=None if horizon is None else parse(horizon, "s", "--horizon"),
    )
    step = parse(time_step or "1us", "s", "--time-step")
    changed = with_overrides(model.injector, set_)
    refuse_return_pressure(changed)
    begin = time.perf_counter()
    solution = solve(changed, point, engine, step, precision)
    run = Run(changed, point, solution, step, time.perf_counter() - begin, precision)
    if seen is not None:
        from commonrail.engine.solution import metered

        run = run._replace(shown=metered(solution, seen, changed, point))
    fast = engine is Engine.LANES and precision is Precision.F64  # code is compiled: a second simulation is cheap
    if heating := registry.find("simulations", "heating"):
        run = run._replace(heating=heating.call(changed, point, solution, step if fast else None))
    files = _write(run, out, report, None if set_ else model.run)
    if json:
        print_json(record(run) | {"files": files})
    else:
        print_pairs(figures(run), heading(run))
    for path in files:
        say(f"wrote {path}")


def _meter(model: NamedModel, name: str | None, study: Path | None) -> Meter | None:
    """Meter that the options name, or None."""
    if name is None:
        if study is not None:
            raise InputError(f"--study {study}: name one of its meters with --meter, or omit --study.")
        return None
    if study is None:
        return _meter_of(model, name)
    from commonrail.calibration.study_file import load_meter

    return load_meter(study, name)


def _meter_of(model: NamedModel, name: str) -> Meter:
    """Meter that a calibration has left beside a model."""
    for meter in model.meters:
        if meter.name == name:
            return meter
    meters_text = f"has the meters {', '.join(m.name for m in model.meters)}" if model.meters else "has no meters"
    raise InputError(f"--meter {name}: {model.text} {meters_text}; name a study or a calibrated.toml with --study.")


def _writer(out: Path | None) -> registry.Entry | None:
    """Plug-in that writes a file of this ending, None for CSV; `InputError` if the ending tells no format."""
    suffix = "" if out is None else out.suffix.lower()
    if suffix in ("", ".csv"):
        return None
    if (writer := registry.find("simulations", suffix)) is None:
        endings = [".csv", *(name for name in registry.entries("simulations") if name.startswith("."))]
        raise InputError(f"--out {out}: a simulation is written as {', '.join(endings)}; name a file that ends so.")
    return writer


def _write(run: Run, out: Path | None, report: Path | None, fitted: Path | None) -> list[str]:
    """Write the files that are asked for; `fitted`: run folder of the injector, if it was simulated as calibrated."""
    files: list[Path] = []
    if out is None and report is None:
        return []
    from commonrail.base.output import write_text, writing

    if out is not None:
        writer = _writer(out)
        if writer is not None:
            files += writer.call(out, run, fitted)
        else:
            with writing(out, "--out"):
                write_rows(run, out)
            files.append(out)
    if report is not None:
        from commonrail.report.simulation import simulation_figure

        with writing(report, "--report"):
            shown = {} if run.shown is None else {run.shown.meter.name: run.shown.rate}
            sentences = (
                run.injector.synthetic,
                *(f"{name.capitalize()}: {text}." for name, text in run.heating.figures),
            )
            page = simulation_figure(run.solution, heading(run), shown, run.point, " ".join(filter(None, sentences)))
            write_text(report, page)
        files.append(report)
    return list(map(str, files))


# Simulated injection as figures for the terminal, a JSON record and a CSV file.

_UNITS = {"lift": "m", "pressure": "Pa", "current": "A", "force": "N"}  # of a solution's channels, by the end of a name


class Beside(NamedTuple):
    """Estimate that a plug-in adds to a simulation: figures with their texts, and its part of the record."""

    figures: tuple[tuple[str, str], ...] = ()
    record: Mapping[str, Any] = MappingProxyType({})


class Run(NamedTuple):
    """Injector, operating point, solution, time step and wall time [s], precision, meter's view, heating."""

    injector: Injector
    point: OperatingPoint
    solution: Solution
    time_step: float
    seconds: float
    precision: Precision = Precision.F64
    shown: Metered | None = None
    heating: Beside = Beside()


def solve(
    injector: Injector, point: OperatingPoint, engine: Engine, time_step: float, precision: Precision
) -> Solution:
    """Simulate, and say on stderr if the injection has not ended.

    Raises `SimulationError` if the simulation failed.
    """
    from commonrail.engine.simulate import simulate
    from commonrail.engine.status import Status

    if engine is not Engine.REFERENCE:
        say(SIMULATING)
    solution = simulate(injector, point, engine, time_step, precision=precision)
    if solution.status.failed:
        raise SimulationError(f"{injector.name}: {solution.sentence}")
    if solution.status is Status.STILL_INJECTING:
        say(f"commonrail: {solution.sentence}")
    return solution


def heading(run: Run) -> str:
    """Injector and operating point in one line."""
    rail = quantity(run.point.at_start(run.point.rail_pressure), "Pa")
    pulses = " + ".join(quantity(pulse.duration, "s") for pulse in run.point.pulses)
    return f"{run.injector.name}: {rail}, energising time {pulses}"


def figures(run: Run) -> list[tuple[str, str]]:
    """Names and texts of the figures of one injection."""
    s, r = run.solution, record(run)
    injected, returned = s.injected_volume * 1e9, s.returned_volume * 1e9
    end = run.point.end_of_energising
    again = s.first_closing < s.closing
    return [
        ("injected quantity", f"{injected:.2f} mm³, {s.injected_mass * 1e6:.2f} mg"),
        ("return quantity", f"{returned:.2f} mm³, {s.returned_mass * 1e6:.2f} mg"),
        ("needle opens", _instant(r["opening"], r["opening_delay"], "start")),
        ("needle closes", _instant(r["closing"], r["closing_delay"], "end")),
        *([("for the first time", _instant(r["first_closing"], r["first_closing"] - end, "end"))] if again else []),
        ("largest rate", f"{r['peak_rate'] * 1e6:.2f} mm³/ms"),
        *_meter_figures(run.shown),
        ("largest needle lift", f"{r['greatest_lift'] * 1e6:.1f} µm"),
        ("status", f"{s.status.name}: {s.sentence}"),
        *([("synthetic", run.injector.synthetic)] if run.injector.synthetic else []),
        ("reference density", f"{s.reference_density:.1f} kg/m³"),
        *run.heating.figures,
        ("mass balance", f"relative error {s.balance:.1e}"),
        ("engine", f"{s.engine}, {run.precision.value}, {run.seconds:.2f} s with loading or compiling"),
        ("injector", f"{run.injector.title} ({run.injector.variant.label})"),
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
        "peak_rate": number(s.rate.max()),
        **_meter_record(run.shown),
        "greatest_lift": number(s.channels["needle_lift"].max()),
        "balance": number(s.balance),
        **run.heating.record,
        "seconds": run.seconds,
    }


def _meter_figures(shown: Metered | None) -> list[tuple[str, str]]:
    """Names and texts of what a meter shows."""
    if shown is None:
        return []
    peak, volume = float(shown.rate.max()) * 1e6, shown.quantity * 1e9
    return [(f"by meter {shown.meter.name}", f"largest rate {peak:.2f} mm³/ms, quantity {volume:.2f} mm³")]


def _meter_record(shown: Metered | None) -> dict[str, Any]:
    """Figures of what a meter shows [SI], under the key "meter"; empty without one."""
    if shown is None:
        return {}
    peak, volume = number(shown.rate.max()), number(shown.quantity)
    return {"meter": {"name": shown.meter.name, "peak_rate": peak, "quantity": volume}}


def write_rows(run: Run, path: Path) -> None:
    """Write rate and channels against time; the rate is the mean over the step that ends at the time."""
    from commonrail.base.csv_output import write_csv

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
    rows = ([f"{value:.9g}" for value in row] for row in zip(*columns, strict=True))
    write_csv(path, notes, head, rows)


def _unit(channel: str) -> FieldUnit:
    return field_unit(_UNITS.get(channel.rsplit("_", 1)[-1], "1"))


def _instant(at: float | None, delay: float | None, event: str) -> str:
    if at is None or delay is None:
        return "never"
    return f"at {at * 1e6:.1f} µs, {delay * 1e6:.1f} µs after the {event} of energising"
