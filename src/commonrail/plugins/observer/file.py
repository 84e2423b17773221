"""Result of an observer and its record, and the log that it reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.errors import InputError
from commonrail.base.text import numbers
from commonrail.compiler.target import describe, package_versions
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.physics.law import Domain
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.kalman import Alarm
from commonrail.plugins.observer.study import ObserverSettings
from commonrail.readers.columns import PLAIN, Column, FileForm
from commonrail.readers.tables import open_sheet, take_columns

SCHEMA = 1
FIGURES = ("quantity", "opening", "closing")
COMMAND_UNITS = ("V", "A", "1")  # of a channel whose edges are the energisings


class ObservedShot(NamedTuple):
    """What is known of one shot; None where it could not be simulated.

    Attributes
    ----------
    start : float
        Start of the first energising in the time of the log [s].
    rail_pressure : float
        Shown before it [Pa].
    energisings : tuple of Energising
        From `start` on.
    open_loop : (3, injections)
        Figures of the model without the measured pressure.
    figures, deviations : (3, injections)
        Quantity [m³], opening and closing from `start` on [s], and their standard deviations.
    drift, drift_deviations : (states,)
        After this shot.
    consistency : float
        Squared innovation over its expectation.
    alarm : Alarm or None
        Drift that was noticed at this shot.
    """

    start: float
    rail_pressure: float
    energisings: tuple[Energising, ...]
    open_loop: Floats | None
    figures: Floats | None
    deviations: Floats | None
    drift: Floats | None
    drift_deviations: Floats | None
    consistency: float | None
    alarm: Alarm | None


@dataclass(frozen=True, repr=False)
class Observation(Shown):
    """Result of an observer over a log.

    Attributes
    ----------
    injector : Injector
    settings : ObserverSettings
    disturbance : Disturbance
        As found in the quiet pressure before the shots.
    shots : tuple of ObservedShot
    asked : int
        Shots of the log.
    injections : int
        Single simulations that it took.
    seconds : float
    """

    presenter = "commonrail.plugins.observer.page:OBSERVATION"

    injector: Injector
    settings: ObserverSettings
    disturbance: Disturbance
    shots: tuple[ObservedShot, ...]
    asked: int
    injections: int
    seconds: float

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each injection, SI; ``pandas.DataFrame(rows)`` takes them."""
        rows = []
        for k, shot in enumerate(self.record()["shots"], 1):
            for i, injection in enumerate(shot["injections"], 1):
                row = {"shot": k, "injection": i, "rail_pressure": shot["rail_pressure"], **injection}
                rows.append(row | {"alarm": shot["alarm"] and shot["alarm"]["state"]})
        return rows

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; what does not exist is None."""
        settings = self.settings
        return {
            "schema": SCHEMA,
            "kind": "observer",
            "software": package_versions(),
            "target": describe().machine,
            "title": f"Injected quantities of {self.injector.title}",
            "synthetic": self.injector.synthetic,
            "injector": {"title": self.injector.title, "variant": self.injector.variant.label},
            "status": "complete" if len(self.shots) == self.asked else "interrupted",
            "asked": self.asked,
            "sensor": settings.sensor,
            "learning": settings.learning,
            "significance": settings.significance,
            "discrepancy": settings.discrepancy,
            "time_step": settings.time_step,
            "states": [state._asdict() for state in settings.states],
            "disturbance": self.disturbance._asdict(),
            "shots": [_shot(shot) for shot in self.shots],
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
    }


class LogColumns(NamedTuple):
    """Columns of a log and how they are written; `energisings` is a file of its own, or None for a command channel."""

    time: str = "time"
    pressure: str = "pressure"
    command: str = "command"
    energisings: Path | None = None
    time_unit: str | None = None
    pressure_unit: str | None = None
    form: FileForm = PLAIN


class Log(NamedTuple):
    """Times (samples,) [s], pressure (samples,) [Pa], and (start, duration) of the energisings [s]."""

    time: Floats
    pressure: Floats
    energisings: list[tuple[float, float]]


def read_log(path: Path, columns: LogColumns) -> Log:
    """Log of pressure and command.

    An energising lasts while the command lies above the middle between its least and its largest value. A file of
    energisings has the columns start and duration. Raises `InputError` if a file cannot be read, or the command has no
    edge.
    """
    sheet = open_sheet(path, columns.form)
    time = Column(columns.time, "s", columns.time_unit, increasing=True)
    wanted = [Column(columns.pressure, "Pa", columns.pressure_unit, domain=Domain.POSITIVE)]
    if columns.energisings is None:
        wanted.append(Column(columns.command, COMMAND_UNITS, otherwise="1"))
    if sheet.apart:
        tables = [take_columns(sheet, [time, column]) for column in wanted]
    else:
        tables = [take_columns(sheet, [time, *wanted])] * len(wanted)
    clock, pressure = tables[0].columns[columns.time], tables[0].columns[columns.pressure]
    if columns.energisings is None:
        return Log(clock, pressure, _edges(path, columns.command, tables[1].columns, columns.time))
    pairs = take_columns(
        open_sheet(columns.energisings, columns.form),
        [Column("start", "s", increasing=True), Column("duration", "s", domain=Domain.POSITIVE)],
        1,
    )
    return Log(
        clock, pressure, list(zip(*(pairs.columns[name].tolist() for name in ("start", "duration")), strict=True))
    )


def _edges(path: Path, command: str, columns: dict[str, Floats], time: str) -> list[tuple[float, float]]:
    """Energisings of a command, each complete."""
    clock, value = columns[time], columns[command]
    on = value > 0.5 * (value.min() + value.max())
    if on.all() or not on.any():
        raise InputError(f'{path}, column "{command}": the command is constant; name the channel with --command.')
    turns = np.flatnonzero(np.diff(on.astype(np.int8)))
    at = 0.5 * (clock[turns] + clock[turns + 1])  # between two samples
    if on[0]:
        at = at[1:]
    return [(float(a), float(b - a)) for a, b in zip(at[::2], at[1::2], strict=False)]
