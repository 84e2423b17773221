"""Simulate one injection, or many at once."""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any, NamedTuple, ParamSpec

import numpy as np
from numpy.typing import ArrayLike, NDArray

from commonrail.arguments import (
    Limits,
    Quantity,
    amount,
    array,
    chosen,
    flag,
    instance,
    instances,
    known_names,
    number,
    sequence,
    thread_count,
)
from commonrail.choices import Engine, Precision
from commonrail.engine import lanes, plan
from commonrail.engine.balance import relative_balance
from commonrail.engine.channels import read_channels
from commonrail.engine.lanes import VECTORS, Job, Misfit, Outcome
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, reference_density
from commonrail.engine.solution import Batch, Solution
from commonrail.engine.stability import longest_step, too_long
from commonrail.engine.status import OK, STILL_INJECTING, Status, which_failed
from commonrail.errors import ConfigurationError, SimulationError
from commonrail.injector.definition import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.injector.variants import Variant

Floats = NDArray[np.float64]

TIME_STEPS = Limits(1e-9, 1e-4, (50e-9, 10e-6), ("us", "ns"))
BACKFLOW = 1e-7  # largest mass that a SAC takes back from the cylinder [kg]; more is an injector that has run empty
DEFAULT_STEP = 1e-6  # [s]; its error is measured by `commonrail verify`


_Given = ParamSpec("_Given")


# Simulations, by their parameters in memory: 20 MB, and on a GPU, which needs many to be busy, 160 MB.
AT_A_TIME = {Engine.LANES: 16_384, Engine.CUDA: 131_072}


def usable_threads() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _within_numbers(run: Callable[_Given, Solution]) -> Callable[_Given, Solution]:
    """Turn the arithmetic error of parameters that are far from any injector's into a sentence."""

    @functools.wraps(run)
    def refusing(*args: _Given.args, **kwargs: _Given.kwargs) -> Solution:
        try:
            return run(*args, **kwargs)
        except ArithmeticError as error:
            injector = args[0] if args else kwargs["injector"]
            raise SimulationError(_beyond_numbers(instance(injector, Injector, "injector"), error)) from error

    return refusing


def _beyond_numbers(injector: Injector, error: ArithmeticError) -> str:
    sizes = {name: abs(math.log10(abs(value))) for name, value in injector.values.items() if value}
    name = max(sizes, key=lambda name: sizes[name])
    return (
        f"{injector.name}: its parameters lead to numbers beyond all bounds ({error}); correct the one that is far "
        f"from an injector's, the most extreme is {name} = {injector.values[name]:g} "
        f"{parameter_quantities()[name].unit.removesuffix('1')}".rstrip()
        + "."
    )


@_within_numbers
def simulate(
    injector: Injector,
    point: OperatingPoint,
    engine: Engine | str = Engine.LANES,
    time_step: Quantity = DEFAULT_STEP,
    sample_interval: Quantity | None = None,
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
    time_step : float or str
        The fixed step [s], or text such as ``"1 us"``; from 1 ns to 100 us.
    sample_interval : float or str, optional
        Spacing of the samples [s], or text; by default the fixed step, 3 us for the reference.
    precision : Precision or str
        "f64" or "f32", of the fast engines; the reference is f64 alone.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong kind or beyond its limits, the settings contradict each other, or the engine is
        not to be had here. A simulation that fails returns a `Solution` whose status says so.
    SimulationError
        If parameters far from any injector's lead to a division by zero or a number beyond all bounds.
    """
    instance(injector, Injector, "injector")
    instance(point, OperatingPoint, "point")
    time_step = check_step(time_step)
    engine = _engine(engine)
    if sample_interval is not None:
        sample_interval = number(sample_interval, "s", "sample interval")
        if not 1e-9 <= sample_interval <= point.duration:
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
    prepared = plan.prepare(injector, [point], time_step)
    theta = plan.candidate_matrix(injector, (), np.empty((1, 0)), prepared)
    job = plan.make_job(injector, theta, [point], time_step, False, _width(engine, real), prepared)
    outcome, trace = _run_traced(job, injector.variant, engine, real)
    stride = max(round((sample_interval or time_step) / time_step), 1)
    rows = trace[0, ::stride, :, 0]
    names = lanes.trace_paths(injector.variant)
    time: Floats = np.asarray(point.start + time_step * stride * np.arange(len(rows)), float)
    injected = rows[:, names.index("nozzle.injected")]
    beyond = _beyond(injector, (), theta, prepared, outcome, time_step)
    reached = float(np.nan_to_num(outcome.greatest_lift[0, 0]))
    return Solution(
        time,
        np.diff(injected) / np.diff(time),
        injected,
        read_channels(injector, point, names, time, rows),
        float(trace[0, -1, names.index("nozzle.injected"), 0]),  # at the horizon, which a sample need not meet
        float(trace[0, -1, names.index("books.returned"), 0]),
        point.start + time_step * float(outcome.opening[0, 0]),
        point.start + time_step * float(outcome.closing[0, 0]),
        point.start + time_step * float(outcome.first_closing[0, 0]),
        reference_density(injector, point),
        Status(int(_status(outcome, beyond, 1)[0, 0])),
        engine.value,
        relative_balance(injector, point, names, trace[0, :, :, 0], time_step),
        longest_step(injector, theta[0], prepared.medium, reached),
    )


def simulate_batch(
    injector: Injector,
    points: Sequence[OperatingPoint],
    names: Sequence[str] = (),
    values: ArrayLike | None = None,
    *,
    time_step: Quantity = DEFAULT_STEP,
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
        Dotted names of the parameters that vary, each once.
    values : (candidates, names), optional
        Their SI values, or texts with units; one candidate, the injector itself, if left out. A candidate with a value
        that is not finite or outside its domain has the status OUTSIDE_DOMAIN.
    time_step : float or str
        [s], or text such as ``"1 us"``; from 1 ns to 100 us.
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
        If an argument is of the wrong kind or beyond its limits, a name is unknown or repeated, the settings contradict
        each other, or the engine is not to be had here.
    """
    instance(injector, Injector, "injector")
    time_step, threads = check_step(time_step), thread_count(threads)
    points = instances(points, OperatingPoint, "points")
    if not points:
        raise ConfigurationError("At least one operating point is needed among the points.")
    names = known_names(names, parameter_quantities(), "names", "valve.spring_preload")
    candidates = _candidates(names, values)
    for given, kind, what in ((misfit, Misfit, "misfit"), (prepared, Prepared, "prepared")):
        if given is not None:
            instance(given, kind, what)
    how = _How(
        prepared or plan.prepare(injector, points, time_step),
        time_step,
        threads or usable_threads(),
        misfit,
        flag(stop_when_closed, "stop_when_closed") and misfit is None,
        _precision(precision),
        _batch_engine(engine),
    )
    many = max(AT_A_TIME[how.engine] // len(points), 1)
    parts = [
        _simulate(injector, names, candidates[first : first + many], how) for first in range(0, len(candidates), many)
    ]
    return parts[0] if len(parts) == 1 else _joined(parts)


def _candidates(names: Sequence[str], values: ArrayLike | None) -> Floats:
    """Values (candidates, names) as SI numbers; text is read in the unit of its own column."""
    if values is None:
        candidates = np.empty((1, 0))
    elif isinstance(values, np.ndarray) and values.dtype.kind in "iuf":
        candidates = np.atleast_2d(np.asarray(values, float))
    else:
        candidates = _read_rows(names, values)
    if candidates.ndim != 2 or candidates.shape[1] != len(names):
        raise ConfigurationError(
            f"{len(names)} names but {candidates.shape[-1]} values a candidate were given: the values must have a row "
            "for each candidate and in it one value for each name, such as [[1e-3], [2e-3]] for one name."
        )
    if not len(candidates):
        raise ConfigurationError("At least one candidate is needed among the values.")
    return candidates


def _read_rows(names: Sequence[str], values: Any) -> Floats:
    rows = sequence(values, "values", "[[1e-3], [2e-3]], a row for each candidate")
    if not any(isinstance(row, Sequence | np.ndarray) and not isinstance(row, str) for row in rows):
        rows = [rows]
    known = parameter_quantities()
    read = []
    for i, row in enumerate(rows, start=1):
        what = f"values of candidate {i}"
        items = sequence(row, what, "[1e-3]")
        if len(items) != len(names):
            raise ConfigurationError(f"{len(names)} names but {len(items)} {what} were given; give one for each name.")
        read.append(
            [
                float(array(item, known[name].unit, f"{what}, {name}", 0, finite=False))
                for item, name in zip(items, names, strict=True)
            ]
        )
    return np.reshape(read, (len(read), len(names))).astype(float)


def _precision(name: Precision | str) -> Precision:
    return chosen(name, Precision, "precision")


def _engine(name: Engine | str) -> Engine:
    engine = chosen(name, Engine, "engine")
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
    beyond = _beyond(injector, names, theta, prepared, outcome, how.time_step)
    status = _status(outcome, beyond, len(points))
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


def check_step(time_step: Quantity) -> float:
    """Read a time step [s], from 1 ns to 100 us."""
    return amount(time_step, "s", "time step", TIME_STEPS)


def _beyond(
    injector: Injector, names: Sequence[str], theta: Floats, prepared: Prepared, outcome: Outcome, time_step: float
) -> NDArray[np.bool_]:
    """Candidates (n,) for which the step is too long at the greatest lift that they reached."""
    lifts = np.nan_to_num(plan.by_candidate(outcome.greatest_lift, len(theta), len(prepared.points)))
    return too_long(injector, names, theta, prepared.medium, time_step, lifts.max(axis=1))


def _status(outcome: Outcome, beyond: NDArray[np.bool_], points: int) -> NDArray[np.int64]:
    """Status (candidates, points); `beyond` (candidates,) tells for which candidates the step is too long."""

    def table(figures: Floats) -> Floats:
        return plan.by_candidate(figures, len(beyond), points)

    status = np.full((len(beyond), points), OK)
    status[table(outcome.closed_at_end) == 0.0] = STILL_INJECTING
    bad = table(outcome.sound) == 0.0
    if bad.any():
        finite = np.isfinite(table(outcome.injected))
        status[bad] = np.where(finite[bad], Status.RAN_AWAY, Status.NOT_FINITE)
    status[table(outcome.injected) < -BACKFLOW] = Status.NOT_FINITE
    # whatever came out: beyond the limit a plausible figure may be far off
    status[beyond] = Status.STEP_UNSTABLE
    status[table(outcome.closed_at_start) == 0.0] = Status.NOT_CLOSED_AT_START
    return status


__all__ = ["DEFAULT_STEP", "Engine", "reference_density", "simulate", "simulate_batch", "usable_threads"]
