"""Result of an observer and its record, and the reading of its log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError
from commonrail.base.record import Key, to_record
from commonrail.data.currents import find_flow, read_energisings
from commonrail.data.records import make_record
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.physics.law import Domain
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.kalman import Alarm, Belief, StepTest
from commonrail.plugins.observer.study import FURTHER, DriftState, InjectionTrain, ObserverSettings
from commonrail.readers.columns import PLAIN, Column, FileForm, Table
from commonrail.readers.tables import open_sheet, take_columns, take_each

SLOWEST = 20e3  # lowest sampling rate of a log, as in the table of accuracies [1/s]
COMMAND_UNITS = ("V", "A", "1")  # units of a channel from whose edges energisings are read
HOLD, HOLDING = 0.75, 0.25  # a current is below this share of its range during this share of the time, a switch is not
CUT = 2e-6  # assumed part of a cut energising outside the log [s]


class ObservedShot(NamedTuple):
    """Figures of one shot; None if it could not be simulated.

    Attributes
    ----------
    start : float
        Start of the first energising in the time of the log [s].
    rail_pressure : float
        Pressure before it, as the sensor shows it [Pa].
    energisings : tuple of Energising
        From `start` on.
    open_loop : (3, injections)
        Figures of the model without the log.
    figures, deviations : (3, injections)
        Quantity [m³], opening and closing from `start` on [s], and their standard deviations; NaN for an
        injection that does not open, and for times that do not exist.
    drift, drift_deviations : (states,)
        After this shot.
    consistency : float
        Squared innovation over its expectation.
    alarm : Alarm or None
        Drift detected at this shot.
    rate, rate_deviation, rate_open_loop : (times,)
        Mean injection rate over each 10 µs from `start` on, its standard deviation, and the model's alone [m³/s].
    further : mapping of str to bool
        Whether each further sensor counted; a sensor that contradicts the pressure is left out.
    """

    start: float
    rail_pressure: float
    energisings: tuple[Energising, ...]
    open_loop: Floats | None
    figures: Floats | None = None
    deviations: Floats | None = None
    drift: Floats | None = None
    drift_deviations: Floats | None = None
    consistency: float | None = None
    alarm: Alarm | None = None
    rate: Floats | None = None
    rate_deviation: Floats | None = None
    rate_open_loop: Floats | None = None
    further: Mapping[str, bool] = MappingProxyType({})


class Memory(NamedTuple):
    """State of the filter after a log, from which the next log continues.

    `shots`: number so far; `alone`: belief from the pressures alone, against which further sensors are tested.
    """

    belief: Belief
    test: StepTest
    shots: int
    alone: Belief


class Compensated(NamedTuple):
    """Energising times of a train, and the quantities by the model with its estimated states.

    Attributes
    ----------
    train : InjectionTrain
    energising_times, quantities : (injections,)
        Compensated times [s] and their quantities [m³].
    plain_times, plain_quantities : (injections,)
        Times of single injections by the model without estimated states [s], and their quantities in the train [m³].
    met : bool
        True if the target quantities are met within 0.1 %.
    """

    train: InjectionTrain
    energising_times: Floats
    quantities: Floats
    plain_times: Floats
    plain_quantities: Floats
    met: bool

    @property
    def energisings(self) -> tuple[Energising, ...]:
        """Energisings for an operating point."""
        return self.train.energisings(self.energising_times)


class Origin(NamedTuple):
    """Origin of a log from a file: its name, the command line, source of the rail volume, errors of a current's times.

    The errors [s] are not finite for an energising without an end.
    """

    log: str | None = None
    command: str | None = None
    volume_source: str | None = None
    errors: tuple[float, ...] | None = None


@dataclass(frozen=True, repr=False)
class Observation(Shown):
    """Result of an observer over a log.

    Attributes
    ----------
    injector : Injector
    settings : ObserverSettings
    disturbance : Disturbance
        Estimated from the quiet pressure before the shots.
    memory : Memory
        After the last shot.
    shots : tuple of ObservedShot
    asked : int
        Number of shots in the log.
    injections : int
        Number of simulations.
    seconds : float
    origin : Origin
        Of a log from a file.
    compensation : sequence of Compensated
        Results of `compensate` for the report, if any.
    """

    presenter = "commonrail.plugins.observer.page:OBSERVATION"

    injector: Injector
    settings: ObserverSettings
    disturbance: Disturbance
    memory: Memory
    shots: tuple[ObservedShot, ...]
    asked: int
    injections: int
    seconds: float
    origin: Origin = field(default_factory=Origin)
    compensation: Sequence[Compensated] = ()

    def rows(self) -> list[dict[str, Any]]:
        """One flat row per injection, SI; ``pandas.DataFrame(rows)`` takes them."""
        rows = []
        for k, shot in enumerate(self.summary.shots, 1):
            for i, injection in enumerate(shot.injections, 1):
                row = {"shot": k, "injection": i, "rail_pressure": shot.rail_pressure, **to_record(injection)}
                rows.append(row | {"alarm": shot.alarm and shot.alarm.state})
        return rows

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; missing values are None."""
        return make_record("observer", self.summary)

    @property
    def summary(self) -> ObservationSummary:
        """Content of the record and the report."""
        return ObservationSummary.of(self)


class InjectorFacts(NamedTuple):
    """Injector of an observation."""

    title: str
    variant: str


class InjectionFigures(NamedTuple):
    """Start in the time of the log and energising time [s], and the figures of an injection; NaN for a missing one.

    Quantity [m³], opening and closing from the start of the shot on [s], each with its standard deviation and the
    value of the model without the log.
    """

    start: float
    energising_time: float
    quantity: float
    quantity_deviation: float
    quantity_open_loop: float
    opening: float
    opening_deviation: float
    opening_open_loop: float
    closing: float
    closing_deviation: float
    closing_open_loop: float


class ShotFigures(NamedTuple):
    """Figures of a shot, as of `ObservedShot`, by injection."""

    start: float
    rail_pressure: float
    injections: tuple[InjectionFigures, ...]
    drift: Floats | None
    drift_deviations: Floats | None
    consistency: float | None
    alarm: Alarm | None
    further: Mapping[str, bool] = MappingProxyType({})

    @classmethod
    def of(cls, shot: ObservedShot) -> ShotFigures:
        """Figures of an observed shot."""
        lacking = np.full((3, len(shot.energisings)), np.nan)
        tables = [lacking if table is None else table for table in (shot.figures, shot.deviations, shot.open_loop)]
        columns = np.stack(tables, axis=1).reshape(9, -1).T.tolist()
        injections = tuple(
            InjectionFigures(shot.start + pulse.start, pulse.duration, *column)
            for pulse, column in zip(shot.energisings, columns, strict=True)
        )
        states = shot.drift, shot.drift_deviations
        return cls(shot.start, shot.rail_pressure, injections, *states, shot.consistency, shot.alarm, shot.further)


class TrainTimes(NamedTuple):
    """Train and its energising times, as of `Compensated`; `targets`: quantities of the train [m³]."""

    rail_pressure: float
    dwells: tuple[float, ...]
    targets: Annotated[tuple[float, ...], Key("wanted")]
    energising_times: Floats
    quantities: Floats
    plain_times: Floats
    plain_quantities: Floats
    met: bool

    @classmethod
    def of(cls, compensated: Compensated) -> TrainTimes:
        """Times of a compensated train."""
        train = compensated.train
        return cls(train.rail_pressure, train.dwells, train.quantities, *compensated[1:])


@dataclass(frozen=True, kw_only=True)
class ObservationSummary:
    """Content of the record and the report of an observation [SI].

    Attributes
    ----------
    title, synthetic : str
    injector : InjectorFacts
    status : str
        "complete" or "interrupted".
    asked : int
        Number of shots in the log.
    log : Origin
    pressures : (float, float)
        Cylinder and return pressure.
    rail_volume : float
    sensor, learning, horizon, significance, discrepancy, time_step
        As in `ObserverSettings`.
    further : mapping of str to (float, float)
        Noise of a sample [A] or of a shot's quantity [1], and discrepancy, by further sensor.
    states : tuple of DriftState
    disturbance : Disturbance
    shots : tuple of ShotFigures
    compensation : tuple of TrainTimes
    injections : int
        Number of simulations.
    seconds : float
    """

    title: str
    synthetic: str
    injector: InjectorFacts
    status: str
    asked: int
    log: Origin
    pressures: tuple[float, float]
    rail_volume: float
    sensor: str
    learning: int
    horizon: int = 1
    significance: float
    discrepancy: float
    further: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    time_step: float
    states: tuple[DriftState, ...]
    disturbance: Disturbance
    shots: tuple[ShotFigures, ...]
    compensation: tuple[TrainTimes, ...] = ()
    injections: int
    seconds: Annotated[float, Key("clock.seconds")]

    @classmethod
    def of(cls, observation: Observation) -> ObservationSummary:
        """Summary of an observation."""
        injector, settings = observation.injector, observation.settings
        noise = np.nan if settings.current_noise is None else settings.current_noise
        further = {
            "current": (noise, settings.current_discrepancy),
            "return": (settings.return_deviation * settings.return_shots**0.5, settings.return_discrepancy),
        }
        return cls(
            title=f"Injected quantities of {injector.title}",
            synthetic=injector.synthetic,
            injector=InjectorFacts(injector.title, injector.variant.label),
            status="complete" if len(observation.shots) == observation.asked else "interrupted",
            asked=observation.asked,
            log=observation.origin,
            pressures=(settings.cylinder_pressure, settings.return_pressure),
            rail_volume=injector.values["rail.volume"],
            sensor=settings.sensor.value,
            learning=settings.learning,
            horizon=settings.horizon,
            significance=settings.significance,
            discrepancy=settings.discrepancy,
            further={name: further[name] for name in settings.further},
            time_step=settings.time_step,
            states=settings.states,
            disturbance=observation.disturbance,
            shots=tuple(map(ShotFigures.of, observation.shots)),
            compensation=tuple(map(TrainTimes.of, observation.compensation)),
            injections=observation.injections,
            seconds=observation.seconds,
        )

    @property
    def every_injection(self) -> list[InjectionFigures]:
        """Injections of all shots, in order."""
        return [injection for shot in self.shots for injection in shot.injections]

    @property
    def observed(self) -> list[InjectionFigures]:
        """Injections with a quantity."""
        return [injection for injection in self.every_injection if np.isfinite(injection.quantity)]

    @property
    def alarms(self) -> list[tuple[int, Alarm]]:
        """Alarms with the numbers of their shots."""
        return [(k, shot.alarm) for k, shot in enumerate(self.shots, 1) if shot.alarm is not None]

    @property
    def last_shot(self) -> ShotFigures | None:
        """Last shot with an estimate of the states."""
        return next((shot for shot in reversed(self.shots) if shot.drift is not None), None)


class LogColumns(NamedTuple):
    """Columns of a log and their form; `energisings` is a separate file, or None for a command channel."""

    time: str = "time"
    pressure: str = "pressure"
    command: str = "command"
    energisings: Path | None = None
    time_unit: str | None = None
    pressure_unit: str | None = None
    form: FileForm = PLAIN
    # Columns of further sensors by name, and their units if the file has none.
    further: Mapping[str, str] = MappingProxyType({})
    units: Mapping[str, str | None] = MappingProxyType({})


class Log(NamedTuple):
    """Log: times (samples,) [s], pressure (samples,) [Pa], energisings (start, duration) [s], and their errors.

    Errors of energisings read from a current are largest errors of the duration [s], infinite if the end is missing.
    `further` has samples (samples,) of other sensors by name; `volume` marks a return flow by volume.
    """

    time: Floats
    pressure: Floats
    energisings: list[tuple[float, float]]
    errors: Sequence[float] = ()
    further: Mapping[str, Floats] = MappingProxyType({})
    volume: bool = False


def read_log(path: Path, columns: LogColumns) -> Log:
    """Read a log of pressure and command.

    An energising lasts while the command is above the middle of its range. For a current it lasts while the current
    flows, because the hold current may be lower. An energising cut by the log begins or ends outside it. A file of
    energisings has the columns start and duration. `InputError` if a file cannot be read, or the command has no edge.
    """
    sheet = open_sheet(path, columns.form)
    time = Column(columns.time, "s", columns.time_unit, increasing=True, stating="--time-unit")
    columns_to_read = [
        Column(columns.pressure, "Pa", columns.pressure_unit, domain=Domain.POSITIVE, stating="--pressure-unit")
    ]
    if columns.energisings is None:
        columns_to_read.append(Column(columns.command, COMMAND_UNITS, otherwise="1"))
    tables = take_each(sheet, time, columns_to_read)
    clock, pressure = tables[0].columns[columns.time], tables[0].columns[columns.pressure]
    further, volume = {}, False
    for name, heading in columns.further.items():
        unit = ("kg/s", "m3/s") if name == "return" else FURTHER[name]
        column = Column(heading, unit, columns.units.get(name), stating=f"--{name}-unit")
        table = take_columns(sheet, [time, column])  # the column may also be the command's
        volume = volume or table.units[heading] == "m3/s"
        sensor_clock, place = table.columns[columns.time], f'{path}, column "{heading}"'  # MDF has several clocks
        step = float(np.median(np.diff(sensor_clock)))
        if (
            max(sensor_clock[0] - clock[0], clock[-1] - sensor_clock[-1]) > 1.01 * step
        ):  # a mean over cycles may lack the last sample
            raise InputError(
                f"{place}: it reaches from {sensor_clock[0]:.6g} to {sensor_clock[-1]:.6g} s, the pressure from "
                f"{clock[0]:.6g} to {clock[-1]:.6g} s; give a column that covers the pressure, or cut the log."
            )
        if name == "current" and SLOWEST * step > 1.01:
            raise InputError(
                f"{place}: it has {1e-3 / step:.3g} samples per millisecond, and a current needs {1e-3 * SLOWEST:g} or "
                "more; give a faster one, or leave it out."
            )
        further[name] = np.interp(clock, sensor_clock, table.columns[heading])
    if columns.energisings is None:
        return Log(clock, pressure, *_read_command(tables[1], columns.time, columns.command), further, volume)
    start = Column("start", "s", increasing=True, stating="")
    duration = Column("duration", "s", domain=Domain.POSITIVE, stating="")
    pairs = take_columns(open_sheet(columns.energisings, columns.form), [start, duration], 1)
    pulses = list(zip(*(pairs.columns[name].tolist() for name in ("start", "duration")), strict=True))
    return Log(clock, pressure, pulses, (), further, volume)


def _read_command(table: Table, time: str, command: str) -> tuple[list[tuple[float, float]], list[float]]:
    """Energisings of a command, and their largest errors [s] if it is a current or has the shape of a current."""
    clock, value = table.columns[time], table.columns[command]
    least, most = float(value.min()), float(value.max())
    on = value > 0.5 * (least + most)
    if on.all() or not on.any():
        raise InputError(
            f'{table.path}, column "{command}": it is constant and energises nothing; give the column of '
            "the command by --command, or a file of its times by --energisings."
        )
    current, flows = find_flow(clock, value)
    inner = current[1:-1][flows[:-2] & flows[1:-1] & flows[2:]]
    if table.units[command] == "A" or (len(inner) and float(np.mean(inner < HOLD * current.max())) > HOLDING):
        read = read_energisings(clock, value)
        return [(energising.start, energising.duration) for energising in read], [
            energising.error for energising in read
        ]
    turns = np.flatnonzero(np.diff(on.astype(np.int8)))
    at = 0.5 * (clock[turns] + clock[turns + 1])  # between two samples
    # an energising cut by the log extends beyond it, which marks its shot as incomplete
    at = np.concatenate([[clock[0] - CUT] * bool(on[0]), at, [clock[-1] + CUT] * bool(on[-1])])
    return [(float(a), float(b - a)) for a, b in zip(at[::2], at[1::2], strict=True)], []
