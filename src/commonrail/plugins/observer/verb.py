"""commonrail observe: injected quantities of a log from its pressure and the command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from commonrail.base.errors import CommonrailError, InputError, nearest
from commonrail.base.units import parse, parse_difference
from commonrail.cli import options
from commonrail.cli.console import Bar, Stage, print_json, print_result, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.guard import INTERRUPTED

if TYPE_CHECKING:
    from commonrail.physics.injector import Injector
    from commonrail.plugins.observer.file import Observation
    from commonrail.plugins.observer.study import InjectionTrain, ObserverSettings


# Options of a log, which a design does not take.
OF_LOG = (
    "current current_noise current_unit return_flow return_deviation return_shots return_unit time pressure command "
    "energisings time_unit pressure_unit encoding decimal sheet sensor noise learning horizon wanted out online"
)


@table_verb
def observe(
    log: Annotated[
        Path | None,
        Argument(metavar="LOG", help="File with time, pressure and command, evenly sampled; none with --design."),
    ] = None,
    *,
    model: Annotated[
        str, Option(metavar="MODEL", help="Injector file, name of the catalogue or run folder, with a rail volume.")
    ],
    time: Annotated[str, Option(help="Column of the time.")] = "time",
    pressure: Annotated[str, Option(help="Column of the pressure.")] = "pressure",
    command: Annotated[str, Option(help="Column of the command, or of a coil current.")] = "command",
    current: Annotated[str | None, Option(help="Column of the coil's current, as a further measurement.")] = None,
    current_noise: Annotated[
        str | None, Option(help="Standard deviation of a sample of it, e.g. 0.1A. [default: from it before shots]")
    ] = None,
    current_unit: Annotated[str | None, Option(help="Unit of the current, if the file has none.")] = None,
    return_flow: Annotated[
        str | None, Option(help="Column of the return flow, in a unit such as kg/h or l/h; each cycle's mean counts.")
    ] = None,
    return_unit: Annotated[str | None, Option(help="Unit of the return flow, if the file has none.")] = None,
    return_deviation: Annotated[
        str | None, Option(help="Standard deviation of a return quantity. [default: 2%]")
    ] = None,
    return_shots: Annotated[int, Option(min=1, help="Cycles over which the return flow's meter averages.")] = 1,
    energisings: Annotated[
        Path | None, Option(metavar="FILE", help="File with columns start and duration, instead of --command.")
    ] = None,
    time_unit: Annotated[str | None, Option(help="Unit of the time, if the file has none.")] = None,
    pressure_unit: Annotated[str | None, Option(help="Unit of the pressure, if the file has none.")] = None,
    encoding: options.Encoding = None,
    decimal: options.DecimalSign = None,
    sheet: options.SheetName = None,
    sensor: Annotated[str, Option(help="Place of the sensor: rail, or line for the injector's end of it.")] = "rail",
    cylinder_pressure: options.CylinderPressure = None,
    return_pressure: options.ReturnPressure = None,
    set_: options.Settings = (),
    noise: Annotated[
        str | None,
        Option(help="Standard deviation of a sample, e.g. 0.1MPa. [default: from the pressure before shots]"),
    ] = None,
    uncertain: Annotated[
        tuple[str, ...],
        Option(
            metavar="STATE=VALUE",
            help='Standard deviation of a state before the first shot, e.g. "fuel temperature=2K"; 0 fixes it; '
            "repeatable.",
        ),
    ] = (),
    learning: Annotated[int, Option(min=0, help="Shots without alarms at the beginning.")] = 10,
    horizon: Annotated[
        int, Option(min=1, help="Shots estimated together, in which later ones correct earlier ones; 1: plain filter.")
    ] = 10,
    wanted: Annotated[
        str | None,
        Option(help="Quantities of a train, e.g. 2.4,24mm3 or 2,20mg: finds energising times by the estimated states."),
    ] = None,
    dwells: Annotated[
        str | None, Option(help="Dwells for --wanted, e.g. 0.3:2:0.1ms, from end to start of energisings.")
    ] = None,
    rail_pressures: Annotated[
        str | None, Option(help="Rail pressures for --wanted, e.g. 60,140MPa. [default: the median before the shots]")
    ] = None,
    out: Annotated[
        Path | None, Option(metavar="DIR", help="New folder for report.html, observer.json and observer.csv.")
    ] = None,
    online: Annotated[
        Path | None,
        Option(
            metavar="PLACE",
            help="Also write the observer, with the disturbance of the log: a new folder for a C library, or FILE.fmu.",
        ),
    ] = None,
    design: Annotated[
        bool, Option("--design", help="Table of the accuracy of sensors by rate and noise, without a log.")
    ] = False,
    threads: options.Threads = None,
    json: options.Json = False,
) -> None:
    """Estimate injected quantities from a measured pressure.

    Estimates quantity, opening and closing of every shot with their standard deviations, and the drift of the injector,
    from the pressure around the shots and the model. Ctrl-C ends with the finished shots; the exit status is 130.

    \b
    Examples:
      commonrail observe log.csv --model runs/first --out runs/observed
      commonrail observe log.mf4 --model cri2-16 --pressure p_rail --command I_inj1 --noise 0.1MPa
      commonrail observe log.csv --model runs/first --current I_coil --return-flow q_return
      commonrail observe log.csv --model runs/first --wanted 2.4,24mm3 --dwells 0.3:2:0.1ms
      commonrail observe --design --model cri2-16 --uncertain "fuel temperature=2K"
    """
    from dataclasses import replace
    from functools import partial

    from commonrail.base.hooks import hold_interrupts
    from commonrail.base.text import quantity
    from commonrail.cli.model_name import read_model_name
    from commonrail.physics.injector import FUEL_TEMPERATURE
    from commonrail.plugins.observer.file import LogColumns, Origin, read_log
    from commonrail.plugins.observer.page import (
        alarm_lines,
        observer_lines,
        observer_notes,
        observer_tables,
        warning_lines,
    )
    from commonrail.plugins.observer.run import observe as run
    from commonrail.plugins.observer.study import CURRENT_DELAY, FURTHER, ObserverSettings, check_model
    from commonrail.readers.location import Place, locate_errors
    from commonrail.readers.toml import UNSTATED
    from commonrail.report.analysis import run_into

    if design == (log is not None):
        raise InputError("Name a LOG, or give --design for a table without a log; give one of the two.")
    if design:
        options.refuse_unused({name: (False, "a LOG") for name in OF_LOG.split()})
    options.refuse_unused({f"current_{name}": (current is not None, "--current") for name in ("noise", "unit")})
    of_return = ("return_deviation", "return_shots", "return_unit")
    options.refuse_unused(dict.fromkeys(of_return, (return_flow is not None, "--return-flow")))
    headings = {"current": current, "return": return_flow}
    further = {name: heading for name, heading in headings.items() if heading is not None}
    if online is not None and further:
        raise InputError("--online: an observer without Python reads one pressure; omit the columns of other sensors.")
    options.refuse_unused({name: (wanted is not None, "--wanted") for name in ("dwells", "rail_pressures")})
    asked = _Wanted.parse(wanted, dwells, rail_pressures)
    if energisings is not None and options.is_given("command"):
        raise InputError("--command: --energisings already gives the energisings; keep one of the two.")
    if online is not None:
        from commonrail.plugins.observer.online import check_online

        check_online(online)
        if out is not None and out.resolve() == online.resolve():
            raise InputError("--online: the folder of --out is the same; name another.")
    source_model = read_model_name(model)
    injector = options.with_overrides(source_model.injector, set_)
    check_model(injector, tuple(further))
    cylinder, back = options.read_pressures(cylinder_pressure, return_pressure, source_model.folder)
    settings = ObserverSettings(
        sensor=sensor,
        further=tuple(further),
        current_noise=None if current_noise is None else parse(current_noise, "A", "--current-noise"),
        return_deviation=0.02 if return_deviation is None else parse(return_deviation, "1", "--return-deviation"),
        return_shots=return_shots,
        cylinder_pressure=cylinder,
        return_pressure=back,
        noise=None if noise is None else parse(noise, "Pa", "--noise"),
        learning=learning,
        horizon=horizon,
        deviations=_deviations(uncertain, tuple(FURTHER if design else further)),
    )
    asked.trains(asked.rail_pressures or [100e6], asked.density(injector, settings))  # refuses before the log is read
    if log is None:
        from commonrail.plugins.observer.design import design_tables, sensor_designs

        rows = sensor_designs(injector, settings)
        shown = partial(print_text, [], design_tables(rows))
        print_result(json, lambda: {"rows": [row._asdict() for row in rows]}, shown, [])
        return
    files = [log] if energisings is None else [log, energisings]
    columns = LogColumns(
        time,
        pressure,
        command,
        energisings,
        time_unit,
        pressure_unit,
        options.read_form(encoding, decimal, sheet, files),
        further,
        {"current": current_unit, "return": return_unit},
    )
    read = read_log(log, columns)
    if energisings is None:  # edges of a command are exact to a sample, those of a current less so
        spacing = float(read.time[1] - read.time[0])
        known_errors = [error for error in read.errors if error < float("inf")]
        settings = replace(
            settings, current_timing=0.5 * max(known_errors) if known_errors else max(spacing / 12**0.5, 1e-6)
        )
        if "current" in further and not any(text.startswith(CURRENT_DELAY) for text in uncertain):
            settings = replace(settings, deviations={CURRENT_DELAY: settings.current_timing})  # shared by all shots
    if read.volume:  # at return pressure and fuel temperature, as in a map of return quantities
        density = float(injector.fuel.density(back, injector.values[FUEL_TEMPERATURE]))
        read = read._replace(further={**read.further, "return": density * read.further["return"]})
    source = injector.sources.get("rail.volume", UNSTATED)
    origin = Origin(
        log.name,
        options.command_again("online", out="again"),
        "--set" if "rail.volume" in " ".join(set_) else f"{model}: {source.mark}, {source.text}",
        tuple(read.errors),
    )
    refused: list[str] = []

    def run_and_compensate() -> Observation:
        with locate_errors(Place(log.name)), Bar("shots") as bar:
            observation = run(
                injector,
                *read[:3],
                settings,
                errors=read.errors,
                further=read.further,
                threads=threads,
                progress=lambda p: bar.show(Stage("observing", p.done, p.total, injector.name)),
            )
        observation = replace(observation, origin=origin)
        try:
            return asked.add_compensation(observation, threads)
        except (CommonrailError, KeyboardInterrupt) as error:  # the shots are written nevertheless
            refused.append(str(error))
            return observation

    with hold_interrupts():  # finish writing despite further Ctrl-C
        observation = run_into(out, "observer.csv", run_and_compensate)
    record, summary = observation.record(), observation.summary
    if json:
        print_json(record)
    else:
        print_synthetic(summary.synthetic)
        verdict, *lines = observer_lines(summary)
        print_text([verdict, *alarm_lines(summary), *lines], observer_tables(summary), observer_notes(summary))
    for line in warning_lines(summary):
        say(f"warning: {line}")
    if out is not None and not json:
        print_text([f"report: {out / 'report.html'}"])
    if online is not None:
        from commonrail.plugins.observer.online import Online, write_online

        sampling = float(f"{(read.time[-1] - read.time[0]) / (len(read.time) - 1):.9g}")
        write_online(Online.after(observation, sampling), online)
        say(f"{online}: observer for one sample every {quantity(sampling, 's', 4)}, with the disturbance of the log")
    if summary.status == "interrupted" or refused == [""]:
        then = " Energising times were not computed." if refused else ""
        say(f"commonrail: interrupted after {len(observation.shots)} of {observation.asked} shots.{then}")
        raise SystemExit(INTERRUPTED)
    if refused:
        raise InputError(f"--wanted: {refused[0]} The shots are complete, but energising times are missing.")


class _Wanted(NamedTuple):
    """Values of --wanted, --dwells and --rail-pressures [m³ or kg, s, Pa]; no quantities without --wanted."""

    quantities: list[float]
    dwells: list[float]
    rail_pressures: list[float]
    unit: str

    @classmethod
    def parse(cls, wanted: str | None, dwells: str | None, rail_pressures: str | None) -> _Wanted:
        unit = "kg" if "g" in (wanted or "") else "m3"  # a mass or a volume
        axes = [(wanted, unit, "--wanted"), (dwells, "s", "--dwells"), (rail_pressures, "Pa", "--rail-pressures")]
        values = [[] if text is None else options.read_axis(text, kind, name).tolist() for text, kind, name in axes]
        read = cls(values[0], values[1], values[2], unit)
        if unit == "kg" and (beyond := [text for text in read.quantities if not 1e-8 <= text <= 5e-4]):
            raise InputError(
                f"--wanted: a mass must lie between 0.01 and 500 mg, and {1e6 * beyond[0]:.6g} mg was read; check "
                "its unit."
            )
        if wanted is not None and (len(read.quantities) > 1) != bool(read.dwells):
            raise InputError(
                "--wanted: one quantity has no dwell; omit --dwells."
                if read.dwells
                else "--wanted: several quantities need the dwells between them; add --dwells, such as 0.3:2:0.1ms."
            )
        return read

    def density(self, injector: Injector, settings: ObserverSettings, warmer: float = 0.0) -> float:
        """Density of the fuel in the cylinder [kg/m³] that converts masses to volumes; 1 for volumes."""
        temperature = injector.values["fuel.temperature"] + warmer
        return 1.0 if self.unit == "m3" else float(injector.fuel.density(settings.cylinder_pressure, temperature))

    def trains(self, rail_pressures: list[float], density: float) -> list[InjectionTrain]:
        """Trains at rail pressures [Pa], each dwell in turn; `density`: of the fuel, if masses are wanted [kg/m³]."""
        from commonrail.plugins.observer.study import InjectionTrain

        if not self.quantities:
            return []
        gaps = [(dwell,) * (len(self.quantities) - 1) for dwell in self.dwells] or [()]
        volumes = tuple(quantity / density for quantity in self.quantities)
        return [InjectionTrain(rail, volumes, gap) for rail in rail_pressures for gap in gaps]

    def add_compensation(self, observation: Observation, threads: int | None) -> Observation:
        """Add the energising times of the trains to an observation."""
        from dataclasses import replace

        import numpy as np

        from commonrail.plugins.observer.compensation import compensate

        before = float(np.median([shot.rail_pressure for shot in observation.shots]))
        states = zip(observation.settings.states, observation.memory.belief.mean.tolist(), strict=True)
        warmer = sum(value for state, value in states if state.parameter == "fuel.temperature")
        density = self.density(observation.injector, observation.settings, warmer)
        trains = self.trains(self.rail_pressures or [before], density)
        return (
            replace(observation, compensation=compensate(observation, trains, threads=threads))
            if trains
            else observation
        )


def _deviations(texts: tuple[str, ...], further: tuple[str, ...]) -> dict[str, float]:
    from commonrail.plugins.observer.study import STATES

    states = {state.name: state for state in STATES}
    deviations: dict[str, float] = {}
    for text in texts:
        name, equals, value = (piece.strip() for piece in text.partition("="))
        if not (equals and value):
            raise InputError(f'--uncertain {text}: expected STATE=VALUE, such as "nozzle flow=3%".')
        if name not in states:
            like, names = nearest(name, states), ", ".join(states)
            raise InputError(f"--uncertain {text}: unknown state{like}; choose from {names}.")
        if name in deviations:
            raise InputError(f"--uncertain {name}: it is stated twice; keep one.")
        if (of := states[name].of) and of not in further:
            raise InputError(f"--uncertain {name}: this state needs a measured {of}; omit it.")
        # of a temperature: 2 degC means 2 K
        deviations[name] = parse_difference(value, states[name].unit, f"--uncertain {name}")
    return deviations
