"""Accuracy that a rail sensor would give, from the linearised model alone: a table for whoever chooses hardware."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import instance
from commonrail.base.arrays import Floats
from commonrail.base.errors import SimulationError
from commonrail.base.table import Table, tabulated
from commonrail.base.text import fixed, significant
from commonrail.engine.operating_point import Energising
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.disturbance import Disturbance
from commonrail.plugins.observer.kalman import Belief, update
from commonrail.plugins.observer.response import Response, Simulator
from commonrail.plugins.observer.run import with_discrepancy
from commonrail.plugins.observer.study import ObserverSettings, ShotRecord, check_model, states_of

RATES = (20e3, 50e3, 200e3)  # samples a second: an engine's control unit, a fast one, a laboratory
NOISES = (0.05e6, 0.1e6, 0.2e6, 0.5e6)  # [Pa]
RAILS = (60e6, 90e6, 120e6, 150e6)  # of the shots in turn [Pa]
TIME = 700e-6  # energising time [s]
SHOTS = 20
OTHERS = Disturbance(0.0, 0.5e9, 2e-3, 0.05e6, 2e3, 1e-3)  # pump and neighbours: estimates [E]


class DesignRow(NamedTuple):
    """Sampling rate [1/s] and noise of a sample [Pa], and root mean squares of what they give after `SHOTS`.

    Relative standard deviation of a quantity, those of opening and closing [s], and of the state "nozzle flow".
    """

    rate: float
    noise: float
    quantity: float
    opening: float
    closing: float
    nozzle_flow: float


def observer_design(injector: Injector, settings: ObserverSettings | None = None) -> list[DesignRow]:
    """Accuracy by rate and noise: covariance of the filter over shots at `RAILS`, without any measurement.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong kind, or the injector has an ideal rail.
    SimulationError
        If a shot cannot be simulated.
    """
    check_model(instance(injector, Injector, "injector"))
    settings = ObserverSettings() if settings is None else instance(settings, ObserverSettings, "settings")
    rows = []
    for rate in RATES:
        given = replace(settings, sensor="rail", states=states_of(injector, settings))
        time = np.arange(-round(given.before * rate), round((TIME + given.after) * rate)) / rate
        many = given.averaged_samples(time)
        shot = ShotRecord(0.0, (Energising(0.0, TIME),), time, time, time)
        simulator = Simulator(injector, given)
        found = [simulator.at(shot, rail, np.zeros(len(given.states))) for rail in RAILS]
        responses = [one for one in found if one is not None]
        if len(responses) < len(RAILS):
            raise SimulationError(f"{injector.name}: a shot of the design cannot be simulated.")
        at = simulator.averaged(time, time)
        for noise in NOISES:
            accuracy = _accuracy(given, responses, at, noise / many**0.5)
            rows.append(DesignRow(rate, noise, *accuracy))
    return rows


def _accuracy(settings: ObserverSettings, responses: Sequence[Response], at: Floats, noise: float) -> list[float]:
    """Accuracies of a `DesignRow`; `noise`: of an averaged sample [Pa]."""
    covariance = with_discrepancy(OTHERS._replace(noise=noise), settings, at)
    belief, squares = Belief.before(settings.states), []
    for k in range(SHOTS):
        one = responses[k % len(responses)]
        done = update(belief.walked(settings.states), settings.states, one.pressure, covariance, partial(_same, one), 1)
        assert done is not None
        belief = done.belief
        squares.append((done.deviations[:, 0] / [one.figures[0, 0], 1.0, 1.0]) ** 2)
    flow = [state.name == "nozzle flow" for state in settings.states]  # none where it is known
    found = np.sqrt(np.mean(squares[-len(responses) :], axis=0))
    return [*found.tolist(), float(np.diag(belief.covariance)[flow].sum() ** 0.5)]


def _same(response: Response, states: Floats) -> Response:
    """The response at any states: with a pressure equal to it the filter stays where it is."""
    return response


def design_table(rows: Sequence[DesignRow]) -> Table:
    """Table of a design."""
    return tabulated(
        "Accuracy of a rail sensor",
        rows,
        [
            ("rate, kHz", lambda row: fixed(row.rate, 0, 1e-3)),
            ("noise, MPa", lambda row: significant(row.noise, 2, 1e-6)),
            ("quantity, %", lambda row: fixed(row.quantity, 2, 100.0)),
            ("opening, µs", lambda row: fixed(row.opening, 1, 1e6)),
            ("closing, µs", lambda row: fixed(row.closing, 1, 1e6)),
            ("nozzle flow, %", lambda row: fixed(row.nozzle_flow, 2, 100.0)),
        ],
        f"Standard deviations after {SHOTS} shots of {TIME * 1e6:.0f} µs at {RAILS[0] * 1e-6:.0f} to "
        f"{RAILS[-1] * 1e-6:.0f} MPa, from the linearised model; pump and neighbours as estimated.",
    )
