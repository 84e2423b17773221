"""Result of an observer and its record, and the reading of its log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError
from commonrail.base.text import numbers
from commonrail.data.currents import flow_of, read_energisings
from commonrail.data.records import record_head
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.physics.law import Domain
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.kalman import Alarm, Belief, StepTest
from commonrail.plugins.observer.study import FURTHER, InjectionTrain, ObserverSettings
from commonrail.readers.columns import PLAIN, Column, FileForm, Table
from commonrail.readers.tables import open_sheet, take_columns, take_each

SLOWEST = 20e3  # lowest sampling rate of a log, as in the table of accuracies [1/s]
FIGURES = ("quantity", "opening", "closing")
COMMAND_UNITS = ("V", "A", "1")  # of a channel whose edges are the energisings
HOLD, HOLDING = 0.75, 0.25  # a current stays below this share of its range, for this share of the time; a switch not
CUT = 2e-6  # assumed overhang of an energising that the log cuts [s]


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

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI."""
        train, tables = self.train, {key: numbers(getattr(self, key)) for key in self._fields[1:-1]}
        asked = {"rail_pressure": train.rail_pressure, "dwells": train.dwells, "wanted": train.quantities}
        return {**asked, **tables, "met": self.met}


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
    origin : mapping
        Of a log from a file: its name, the command line, source of the rail volume, errors of a current's times [s].
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
    origin: Mapping[str, Any] = field(default_factory=dict)
    compensation: Sequence[Compensated] = ()

    def rows(self) -> list[dict[str, Any]]:
        """One flat row per injection, SI; ``pandas.DataFrame(rows)`` takes them."""
        rows = []
        for k, shot in enumerate(self.record()["shots"], 1):
            for i, injection in enumerate(shot["injections"], 1):
                row = {"shot": k, "injection": i, "rail_pressure": shot["rail_pressure"], **injection}
                rows.append(row | {"alarm": shot["alarm"] and shot["alarm"]["state"]})
        return rows

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; missing values are None."""
        settings = self.settings
        # noise of a sample [A] or of a shot's quantity [1], and discrepancy
        further = {
            "current": (settings.current_noise, settings.current_discrepancy),
            "return": (settings.return_deviation * settings.return_shots**0.5, settings.return_discrepancy),
        }
        plain_settings = ("sensor", "learning", "horizon", "significance", "discrepancy")
        return {
            **record_head("observer", f"Injected quantities of {self.injector.title}", self.injector.synthetic),
            "injector": {"title": self.injector.title, "variant": self.injector.variant.label},
            "status": "complete" if len(self.shots) == self.asked else "interrupted",
            "asked": self.asked,
            "log": dict(self.origin),
            "pressures": [settings.cylinder_pressure, settings.return_pressure],
            "rail_volume": float(self.injector.values["rail.volume"]),
            **{name: getattr(settings, name) for name in plain_settings},
            "further": {name: numbers(np.array(further[name], float)) for name in settings.further},
            "time_step": settings.time_step,
            "states": [state._asdict() for state in settings.states],
            "disturbance": self.disturbance._asdict(),
            "shots": [_shot(shot) for shot in self.shots],
            "compensation": [train.record() for train in self.compensation],
            "injections": self.injections,
            "clock": {"seconds": self.seconds},
        }


def _shot(shot: ObservedShot) -> dict[str, Any]:
    injections = []
    for i, pulse in enumerate(shot.energisings):
        row: dict[str, Any] = {"start": shot.start + pulse.start, "energising_time": pulse.duration}
        for j, name in enumerate(FIGURES):
            tables = {"": shot.figures, "_deviation": shot.deviations, "_open_loop": shot.open_loop}
            for suffix, table in tables.items():
                row[f"{name}{suffix}"] = None if table is None else numbers([table[j, i]])[0]
        injections.append(row)
    tables = {"drift": shot.drift, "drift_deviations": shot.drift_deviations}
    return {
        "start": shot.start,
        "rail_pressure": shot.rail_pressure,
        "injections": injections,
        **{key: None if table is None else numbers(table) for key, table in tables.items()},
        "consistency": shot.consistency,
        "alarm": shot.alarm and shot.alarm._asdict(),
        "further": dict(shot.further),
    }


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

    Errors of energisings from a current are the largest of their durations, infinite without an end [s]. Samples
    (samples,) of further sensors by name; `volume` marks a return flow by volume.
    """

    time: Floats
    pressure: Floats
    energisings: list[tuple[float, float]]
    errors: Sequence[float] = ()
    further: Mapping[str, Floats] = MappingProxyType({})
    volume: bool = False


def read_log(path: Path, columns: LogColumns) -> Log:
    """Read a log of pressure and command.

    An energising lasts while the command is above the middle of its range, or while a current flows, whose hold may be
    below that. An energising cut by the log begins or ends beyond it. A file of energisings has the columns start and
    duration.
    `InputError` if a file cannot be read, or the command has no edge.
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
    """Energisings of a command, and their largest errors if it is a current, or has the course of one [s]."""
    clock, value = table.columns[time], table.columns[command]
    least, most = float(value.min()), float(value.max())
    on = value > 0.5 * (least + most)
    if on.all() or not on.any():
        raise InputError(
            f'{table.path}, column "{command}": it is constant and energises nothing; give the column of '
            "the command by --command, or a file of its times by --energisings."
        )
    current, flows = flow_of(clock, value)
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
