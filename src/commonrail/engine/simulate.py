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
from commonrail.engine.lanes import VECTORS, Job, Misfit, Outcome, Precision
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, reference_density
from commonrail.engine.solution import Batch, Solution
from commonrail.engine.stability import longest_step
from commonrail.engine.status import OK, STILL_INJECTING, Status, which_failed
from commonrail.errors import ConfigurationError
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector
from commonrail.injector.variants import Variant

Floats = NDArray[np.float64]

DEFAULT_STEP = 1e-6  # [s]; its error is measured by `commonrail verify`


class Engine(Enum):
    """Who runs the simulation."""

    LANES = "lanes"
    CUDA = "cuda"
    REFERENCE = "reference"


# Simulations, by their parameters in memory: 20 MB, and on a GPU, which needs many to be busy, 160 MB.
AT_A_TIME = {Engine.LANES: 16_384, Engine.CUDA: 131_072}


def usable_threads() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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
        "lanes" (fast, fixed step), "cuda" (the same on an NVIDIA GPU; to compare, one injection is no work for it) or
        "reference" (slow, error-controlled).
    time_step : float
        The fixed step [s].
    sample_interval : float, optional
        Spacing of the samples [s]; by default the fixed step, 3 us for the reference.
    precision : Precision or str
        "f64" or "f32", of the fast engines; the reference is f64 alone.

    Raises
    ------
    ConfigurationError
        If the settings contradict each other, or the engine is not to be had here. A simulation that fails returns a
        `Solution` whose status says so.
    """
    check_step(time_step)
    engine = _engine(engine)
    if sample_interval is not None and not 1e-9 <= sample_interval <= point.duration:
        raise ConfigurationError(
            f"The sample interval must lie between 1 ns and the simulated {point.duration * 1e3:g} ms, "
            f"not {sample_interval:g} s."
        )
    real = _precision(precision)
    if engine is Engine.REFERENCE:
        if real is not Precision.F64:
            raise ConfigurationError(f"The reference computes in f64 alone, not in {real.value}; use the lanes for it.")
        from commonrail.engine.reference import simulate_reference

        return simulate_reference(injector, point, sample_interval or 3e-6)
    theta = plan.candidate_matrix(injector, (), np.empty((1, 0)))
    job = plan.make_job(injector, theta, [point], time_step, False, _width(engine, real))
    outcome, trace = _run_traced(job, injector.variant, engine, real)
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
        read_channels(injector, point, names, time, rows),
        float(injected[-1]),
        float(rows[-1, names.index("books.returned")]),
        point.start + time_step * float(outcome.opening[0, 0]),
        point.start + time_step * float(outcome.closing[0, 0]),
        point.start + time_step * float(outcome.first_closing[0, 0]),
        reference_density(injector, point),
        Status(int(status)),
        engine.value,
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
    prepared: Prepared | None = None,
    engine: Engine | str = Engine.LANES,
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
        "f64", or "f32": twice as fast, with an L1 error of the rate below 0.01 % from rounding.
    prepared : Prepared, optional
        `plan.prepare` of the same injector, points and time step: saves time where many batches follow each other.
    engine : Engine or str
        "lanes", or "cuda" for one simulation on each thread of an NVIDIA GPU; `threads` are then of no account.

    Raises
    ------
    ConfigurationError
        If the settings contradict each other, or the engine is not to be had here.
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
    how = _How(
        prepared or plan.prepare(injector, points, time_step),
        time_step,
        threads or usable_threads(),
        misfit,
        stop_when_closed and misfit is None,
        _precision(precision),
        _batch_engine(engine),
    )
    many = max(AT_A_TIME[how.engine] // len(points), 1)
    parts = [
        _simulate(injector, names, candidates[first : first + many], how) for first in range(0, len(candidates), many)
    ]
    return parts[0] if len(parts) == 1 else _joined(parts)


def _precision(name: Precision | str) -> Precision:
    try:
        return Precision(name)
    except ValueError:
        raise ConfigurationError(f'The precision must be "f64" or "f32", not {name!r}.') from None


def _engine(name: Engine | str) -> Engine:
    try:
        engine = Engine(name)
    except ValueError:
        known = " or ".join(f'"{one.value}"' for one in Engine)
        raise ConfigurationError(f"The engine must be {known}, not {name!r}.") from None
    if engine is Engine.CUDA:
        from commonrail.engine import cuda

        cuda.require_device()
    return engine


def _batch_engine(name: Engine | str) -> Engine:
    engine = _engine(name)
    if engine is Engine.REFERENCE:
        raise ConfigurationError(
            'The engine "reference" simulates one injection at a time; use `simulate`, or the engine "lanes" or "cuda".'
        )
    return engine


def _width(engine: Engine, precision: Precision) -> int:
    return 1 if engine is Engine.CUDA else VECTORS[precision].lanes


class _How(NamedTuple):
    prepared: Prepared
    time_step: float
    threads: int
    misfit: Misfit | None
    stop_when_closed: bool
    precision: Precision
    engine: Engine


def _run(job: Job, variant: Variant, how: _How, densities: Floats) -> Outcome:
    misfit = how.misfit and how.misfit.own_where_open(densities)
    if how.engine is Engine.CUDA:
        from commonrail.engine import cuda

        return cuda.run(job, variant, misfit, how.precision)
    return lanes.run(job, variant, misfit, how.threads, how.precision)


def _run_traced(job: Job, variant: Variant, engine: Engine, precision: Precision) -> tuple[Outcome, Floats]:
    if engine is Engine.CUDA:
        from commonrail.engine import cuda

        return cuda.run_traced(job, variant, precision)
    return lanes.run_traced(job, variant, precision=precision)


def _simulate(injector: Injector, names: Sequence[str], candidates: Floats, how: _How) -> Batch:
    """A part of a population that is small enough to have all its parameters in memory."""
    prepared, points = how.prepared, how.prepared.points
    inside = plan.admissible(names, candidates, injector.fuel)
    if not inside.all():
        own = np.array([injector.values[name] for name in names])
        candidates = np.where(inside[:, None], candidates, own)
    theta = plan.candidate_matrix(injector, names, candidates, prepared)
    width = _width(how.engine, how.precision)
    job = plan.make_job(injector, theta, points, how.time_step, how.stop_when_closed, width, prepared)
    varies = FUEL_TEMPERATURE in names
    densities = plan.reference_densities(injector, points, names, candidates) if varies else prepared.densities
    outcome = _run(job, injector.variant, how, densities)
    status = _status(injector, theta, outcome, how.time_step, len(theta), len(points))
    status[~inside] = Status.OUTSIDE_DOMAIN

    failed = which_failed(status)
    some_failed = bool(failed.any())

    def figure(values: Floats) -> Floats:
        table = plan.by_candidate(values, len(theta), len(points))
        return np.where(failed, np.nan, table) if some_failed else np.ascontiguousarray(table)

    begin = prepared.begin
    return Batch(
        figure(outcome.injected),
        figure(outcome.returned),
        begin + how.time_step * figure(outcome.opening),
        begin + how.time_step * figure(outcome.closing),
        begin + how.time_step * figure(outcome.first_closing),
        figure(outcome.greatest_lift),
        status,
        np.broadcast_to(densities, status.shape),
        figure(outcome.absolute),
        figure(outcome.squared),
    )


def _joined(parts: Sequence[Batch]) -> Batch:
    """One batch of several."""
    names = [f.name for f in fields(Batch)]
    return Batch(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def check_step(time_step: float) -> None:
    """Refuse a time step that makes no sense."""
    if not 1e-9 <= time_step <= 1e-4:
        raise ConfigurationError(f"The time step must lie between 1 ns and 100 us, not {time_step * 1e6:g} us.")


def _status(
    injector: Injector, theta: Floats, outcome: Outcome, dt: float, candidates: int, points: int
) -> NDArray[np.int64]:
    def table(figures: Floats) -> Floats:
        return plan.by_candidate(figures, candidates, points)

    status = np.full((candidates, points), OK)
    status[table(outcome.closed_at_end) == 0.0] = STILL_INJECTING
    bad = table(outcome.sound) == 0.0
    if bad.any():
        finite = np.isfinite(table(outcome.injected))
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
        unstable = np.array([longest_step(injector, row) < dt for row in theta])
        status[bad & unstable[:, None]] = Status.STEP_UNSTABLE
    status[table(outcome.closed_at_start) == 0.0] = Status.NOT_CLOSED_AT_START
    return status


__all__ = ["DEFAULT_STEP", "Engine", "reference_density", "simulate", "simulate_batch", "usable_threads"]
