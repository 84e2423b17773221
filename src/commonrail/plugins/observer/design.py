"""Expected accuracy of sensors from the linearised model: a table for choosing hardware."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import instance
from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation
from commonrail.base.errors import SimulationError
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import significant, to_fixed
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.kalman import Belief, update
from commonrail.plugins.observer.response import Response, Simulator
from commonrail.plugins.observer.run import make_covariance
from commonrail.plugins.observer.study import ObserverSettings, ShotRecord, check_model, resolve_states

RATES = (20e3, 50e3, 200e3)  # samples per second: an engine's control unit, a fast one, a laboratory
NOISES = (0.05e6, 0.1e6, 0.2e6, 0.5e6)  # [Pa]
RAILS = (60e6, 90e6, 120e6, 150e6)  # rail pressures of consecutive shots [Pa]
TIME = 700e-6  # energising time [s]
SHOTS = 20
OTHERS = Disturbance(0.0, 0.5e9, 2e-3, 0.05e6, 2e3, 1e-3)  # pump and neighbours: estimates [E]
PERIOD = 40e-3  # of a cycle, over which the return flow is metered: 3,000 revolutions per minute [s]
USUAL = (50e3, 0.1e6)  # rate and noise of the short table
# Compared sensors: pressure, and further ones.
CHOICES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("rail", ()),
    ("rail", ("current",)),
    ("rail", ("return",)),
    ("rail", ("current", "return")),
    ("line", ()),
)


class DesignRow(NamedTuple):
    """Sensors, sampling rate [1/s] and noise of a pressure sample [Pa], and their accuracy after `SHOTS`.

    Root mean squares of the relative standard deviation of the quantity, and of the deviations of opening and closing
    [s]; deviation of the state "nozzle flow".
    """

    sensors: str
    rate: float
    noise: float
    quantity: float
    opening: float
    closing: float
    nozzle_flow: float


def observer_design(injector: Injector, settings: ObserverSettings | None = None) -> list[DesignRow]:
    """Compute the accuracy of the settings' sensors by rate and noise: covariance of the filter over shots at `RAILS`.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type, or the injector has an ideal rail.
    SimulationError
        If a shot cannot be simulated.
    """
    settings = ObserverSettings() if settings is None else instance(settings, ObserverSettings, "settings")
    check_model(instance(injector, Injector, "injector"), settings.further)
    rows, words = [], " + ".join([settings.sensor, *settings.further])
    for rate in RATES:
        complete = replace(settings, states=resolve_states(injector, settings))
        time = np.arange(-round(complete.before * rate), round((TIME + complete.after) * rate)) / rate
        many = complete.count_averaged_samples(time)
        further = dict.fromkeys(complete.further, time)
        shot = ShotRecord(0.0, (Energising(0.0, TIME),), time, time, time, further, PERIOD)
        simulator = Simulator(injector, complete)
        simulated = [simulator.at(shot, rail, np.zeros(len(complete.states))) for rail in RAILS]
        responses = [response for response in simulated if response is not None]
        if len(responses) < len(RAILS):
            raise SimulationError(f"{injector.name}: a shot of the design cannot be simulated.")
        at = simulator.average(time, time)
        for noise in NOISES:
            others = OTHERS._replace(noise=noise / many**0.5)
            accuracy = _accuracy(complete, responses, make_covariance(others, complete, at, shot))
            rows.append(DesignRow(words, rate, noise, *accuracy))
    return rows


def sensor_designs(injector: Injector, settings: ObserverSettings) -> list[DesignRow]:
    """Accuracy of each of `CHOICES` that the injector has, by rate and noise; errors as in `observer_design`."""
    direct = injector.variant.actuation is Actuation.DIRECT
    return [
        row
        for sensor, further in CHOICES
        if not (direct and further)
        for row in observer_design(injector, replace(settings, sensor=sensor, further=further))
    ]


def _accuracy(
    settings: ObserverSettings, responses: Sequence[Response], covariance: Callable[[Response], Floats]
) -> list[float]:
    """Accuracies of a `DesignRow`."""
    belief, squares = Belief.before(settings.states), []
    for k in range(SHOTS):
        response = responses[k % len(responses)]
        # measured and simulated pressure are equal, so the filter keeps its states
        walked = belief.walk(settings.states)
        done = update(walked, settings.states, response.shown, covariance, lambda _, response=response: response, 1)  # type: ignore[misc]
        assert done is not None
        belief = done.belief
        squares.append((done.deviations[:, 0] / [response.figures[0, 0], 1.0, 1.0]) ** 2)
    flow = [state.name == "nozzle flow" for state in settings.states]  # all false if that state is fixed
    accuracies = np.sqrt(np.mean(squares[-len(responses) :], axis=0))
    return [*accuracies.tolist(), float(np.diag(belief.covariance)[flow].sum() ** 0.5)]


def design_tables(rows: Sequence[DesignRow]) -> list[Table]:
    """Tables of a design: sensors at a usual rate and noise, then all rates and noises."""
    columns: list[Column] = [
        ("sensors", lambda row: row.sensors.replace("return", "return flow")),
        ("rate, kHz", lambda row: to_fixed(row.rate, 0, 1e-3)),
        ("noise, MPa", lambda row: significant(row.noise, 2, 1e-6)),
        ("quantity, %", lambda row: to_fixed(row.quantity, 2, 100.0)),
        ("opening, µs", lambda row: to_fixed(row.opening, 1, 1e6)),
        ("closing, µs", lambda row: to_fixed(row.closing, 1, 1e6)),
        ("nozzle flow, %", lambda row: to_fixed(row.nozzle_flow, 2, 100.0)),
    ]
    note = (
        f"Standard deviations after {SHOTS} shots of {TIME * 1e6:.0f} µs at {RAILS[0] * 1e-6:.0f} to "
        f"{RAILS[-1] * 1e-6:.0f} MPa, from the linearised model alone; pump and neighbours as estimated. Deviations "
        "for a sensor in the line were too small by a factor of three in a trial (studies/observer_trial.py)."
    )
    short = [row for row in rows if (row.rate, row.noise) == USUAL]
    titled = (("Sensors at a usual rate and noise of the pressure", short), ("Accuracy by rate and noise", rows))
    return [table_from_columns(title, some, columns, note) for title, some in titled]
