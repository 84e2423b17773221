"""Simulate one injection, or many at once."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import fields
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.engine import lanes, plan
from commonrail.engine.balance import relative_balance
from commonrail.engine.channels import read_channels
from commonrail.engine.lanes import Misfit, Outcome, Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch, Solution
from commonrail.engine.stability import longest_step
from commonrail.engine.status import Status
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector

Floats = NDArray[np.float64]

AT_A_TIME = 16_384  # simulations; the parameters of that many take 20 MB
DEFAULT_STEP = 1e-6  # [s]; its error is measured by `commonrail verify`


class Engine(Enum):
    """Who runs the simulation."""

    LANES = "lanes"
    REFERENCE = "reference"


def usable_threads() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def reference_density(injector: Injector, point: OperatingPoint) -> float:
    """Fuel density at cylinder pressure of time zero and fuel temperature [kg/m³]."""
    pressure = point.at_start(point.cylinder_pressure)
    return float(injector.fuel.density(pressure, injector.values[FUEL_TEMPERATURE]))


def simulate(
    injector: Injector,
    point: OperatingPoint,
    engine: Engine | str = Engine.LANES,
    time_step: float = DEFAULT_STEP,
    sample_interval: float | None = None,
    precision: Precision | str = Precision.F64,
) -> Solution:
    """Simulate one injection.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint
    engine : Engine or str
        "lanes" (fast, fixed step) or "reference" (slow, error-controlled).
    time_step : float
        Step of the lanes [s].
    sample_interval : float, optional
        Spacing of the samples [s]; by default the time step of the lanes, 3 us for the reference.
    precision : Precision or str
        "f64" or "f32", of the lanes; the reference is f64 alone.

    Raises
    ------
    ConfigurationError
        If the settings contradict each other. A simulation that fails returns a `Solution` whose status says so.
    """
    check_step(time_step)
    if sample_interval is not None and not 1e-9 <= sample_interval <= point.duration:
        raise ConfigurationError(
            f"The sample interval must lie between 1 ns and the simulated {point.duration * 1e3:g} ms, "
            f"not {sample_interval:g} s."
        )
    real = _precision(precision)
    if Engine(engine) is Engine.REFERENCE:
        if real is not Precision.F64:
            raise ConfigurationError(f"The reference computes in f64 alone, not in {real.value}; use the lanes for it.")
        from commonrail.engine.reference import simulate_reference

        return simulate_reference(injector, point, sample_interval or 3e-6)
    theta = plan.candidate_matrix(injector, (), np.empty((1, 0)))
    job = plan.make_job(injector, theta, [point], time_step, False, real)
    outcome, trace = lanes.run_traced(job, injector.variant, precision=real)
    stride = max(round((sample_interval or time_step) / time_step), 1)
    rows = trace[0, ::stride, :, 0]
    names = lanes.trace_paths(injector.variant)
    time: Floats = np.asarray(point.start + time_step * stride * np.arange(len(rows)), float)
    injected = rows[:, names.index("nozzle.injected")]
    status = _status(injector, theta, outcome, time_step, 1, 1)[0, 0]
    return Solution(
        time,
        np.diff(injected) / np.diff(time),
        injected,
        read_channels(injector, point, names, rows),
        float(injected[-1]),
        float(rows[-1, names.index("books.returned")]),
        point.start + time_step * float(outcome.opening[0, 0]),
        point.start + time_step * float(outcome.closing[0, 0]),
        reference_density(injector, point),
        Status(int(status)),
        "lanes",
        relative_balance(injector, point, names, trace[0, :, :, 0], time_step),
    )


def simulate_batch(
    injector: Injector,
    points: Sequence[OperatingPoint],
    names: Sequence[str] = (),
    values: Floats | None = None,
    *,
    time_step: float = DEFAULT_STEP,
    threads: int | None = None,
    misfit: Misfit | None = None,
    stop_when_closed: bool = True,
    precision: Precision | str = Precision.F64,
) -> Batch:
    """Simulate many candidates at many operating points.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    names : sequence of str
        Dotted names of the parameters that vary.
    values : (candidates, names), optional
        Their SI values; one candidate, the injector itself, if left out.
    time_step : float
        [s].
    threads : int, optional
        All usable processors by default. The result does not depend on it.
    misfit : Misfit, optional
        Rate samples to compare with inside the loop.
    stop_when_closed : bool
        End a simulation once its needle has closed for good.
    precision : Precision or str
        "f64", or "f32": 1.6 times as fast, with an L1 error of the rate below 0.01 % from rounding.
    """
    check_step(time_step)
    if threads is not None and not 1 <= threads <= 1024:
        raise ConfigurationError(f"The number of threads must lie between 1 and 1024, not {threads}.")
    if not len(points):
        raise ConfigurationError("At least one operating point is needed.")
    candidates = np.empty((1, 0)) if values is None else np.atleast_2d(np.asarray(values, float))
    if candidates.shape[1] != len(names):
        raise ConfigurationError(f"{len(names)} names but {candidates.shape[1]} values a candidate were given.")
    if not len(candidates):
        raise ConfigurationError("At least one candidate is needed.")
    stop = stop_when_closed and misfit is None
    how = _How(time_step, threads or usable_threads(), misfit, stop, _precision(precision))
    many = max(AT_A_TIME // len(points), 1)
    parts = [
        _simulate(injector, points, names, candidates[first : first + many], how)
        for first in range(0, len(candidates), many)
    ]
    return parts[0] if len(parts) == 1 else _joined(parts)


def _precision(name: Precision | str) -> Precision:
    try:
        return Precision(name)
    except ValueError:
        raise ConfigurationError(f'The precision must be "f64" or "f32", not {name!r}.') from None


class _How(NamedTuple):
    time_step: float
    threads: int
    misfit: Misfit | None
    stop_when_closed: bool
    precision: Precision


def _simulate(
    injector: Injector, points: Sequence[OperatingPoint], names: Sequence[str], candidates: Floats, how: _How
) -> Batch:
    """A part of a population that is small enough to have all its parameters in memory."""
    inside = plan.admissible(names, candidates)
    if not inside.all():
        own = np.array([injector.values[name] for name in names])
        candidates = np.where(inside[:, None], candidates, own)
    theta = plan.candidate_matrix(injector, names, candidates)
    job = plan.make_job(injector, theta, points, how.time_step, how.stop_when_closed, how.precision)
    outcome = lanes.run(job, injector.variant, how.misfit, how.threads, how.precision)
    status = _status(injector, theta, outcome, how.time_step, len(theta), len(points))
    status[~inside] = Status.OUTSIDE_DOMAIN

    failed = (status != Status.OK) & (status != Status.STILL_INJECTING)

    def figure(values: Floats) -> Floats:
        return np.where(failed, np.nan, plan.by_candidate(values, len(theta), len(points)))

    begin = np.array([point.start for point in points])
    return Batch(
        figure(outcome.injected),
        figure(outcome.returned),
        begin + how.time_step * figure(outcome.opening),
        begin + how.time_step * figure(outcome.closing),
        figure(outcome.greatest_lift),
        status,
        np.array([reference_density(injector, point) for point in points]),
        figure(outcome.absolute),
        figure(outcome.squared),
    )


def _joined(parts: Sequence[Batch]) -> Batch:
    """One batch of several; the reference density is of the points, and the same in all."""
    names = [f.name for f in fields(Batch)]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Batch(**{**columns, "reference_density": parts[0].reference_density})


def check_step(time_step: float) -> None:
    """Refuse a time step that makes no sense."""
    if not 1e-9 <= time_step <= 1e-4:
        raise ConfigurationError(f"The time step must lie between 1 ns and 100 us, not {time_step * 1e6:g} us.")


def _status(
    injector: Injector, theta: Floats, outcome: Outcome, dt: float, candidates: int, points: int
) -> NDArray[np.int64]:
    def table(figures: Floats) -> Floats:
        return plan.by_candidate(figures, candidates, points)

    status = np.full((candidates, points), int(Status.OK))
    status[table(outcome.closed_at_end) == 0.0] = Status.STILL_INJECTING
    bad = table(outcome.sound) == 0.0
    if bad.any():
        finite = np.isfinite(table(outcome.injected))
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
        unstable = np.array([longest_step(injector, row) < dt for row in theta])
        status[bad & unstable[:, None]] = Status.STEP_UNSTABLE
    status[table(outcome.closed_at_start) == 0.0] = Status.NOT_CLOSED_AT_START
    return status


__all__ = ["DEFAULT_STEP", "Engine", "simulate", "simulate_batch", "usable_threads"]
