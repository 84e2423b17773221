"""Simulate one injection, or many at once."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import (
    Quantity,
    enum_member,
    flag,
    instance,
    instances,
    known_names,
    number,
    thread_count,
)
from commonrail.base.arrays import Floats
from commonrail.base.choices import Engine, Precision
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.base.hooks import naming
from commonrail.base.units import to_text
from commonrail.engine import lanes, plan
from commonrail.engine.job import VECTORS, Outcome
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import Course, OperatingPoint, Trace
from commonrail.engine.plan import Prepared, admissible, candidate_matrix, read_candidates, statuses_of
from commonrail.engine.solution import Batch, Solution, read_channels, relative_balance
from commonrail.engine.status import Status, check_inputs, which_failed
from commonrail.engine.threads import usable_threads
from commonrail.engine.time_step import DEFAULT_STEP, check_step, longest_step
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import Variant

ROUNDING = 1e-6  # relative difference from a whole number of steps that counts as rounding

# Simulations per batch. Their parameters take 20 MB, or 160 MB on a GPU, which needs many simulations to be busy.
AT_A_TIME = {Engine.LANES: 16_384, Engine.CUDA: 131_072}


def _beyond_numbers(injector: Injector, error: ArithmeticError) -> str:
    sizes = {name: abs(math.log10(abs(value))) for name, value in injector.values.items() if value}
    name = max(sizes, key=lambda name: sizes[name])
    return (
        f"{injector.name}: the simulation fails with an arithmetic error ({error}); correct the implausible "
        f"parameter; the most extreme is {name} = {injector.values[name]:g} "
        f"{injector.quantities[name].unit.removesuffix('1')}".rstrip()
        + "."
    )


def simulate(
    injector: Injector,
    point: OperatingPoint | None = None,
    engine: Engine | str = Engine.LANES,
    time_step: Quantity = DEFAULT_STEP,
    sample_interval: Quantity | None = None,
    precision: Precision | str = Precision.F64,
    *,
    rail_pressure: Course | str | None = None,
    energising_time: Quantity | None = None,
    energisings: Sequence[tuple[Quantity, Quantity]] | None = None,
    cylinder_pressure: Course | str | None = None,
    return_pressure: Course | str | None = None,
    drive: Trace | None = None,
    horizon: Quantity | None = None,
    same_bits: bool = False,
) -> Solution:
    """Simulate one injection, or several that follow one another.

    Parameters
    ----------
    injector : Injector
    point : OperatingPoint, optional
        Or its fields by keyword: `rail_pressure` with `energising_time` or `energisings`, and, if not by
        default, `cylinder_pressure`, `return_pressure`, `drive` and `horizon`.
    engine : Engine or str
        "lanes" (fast, fixed step), "cuda" (the same on an NVIDIA GPU; useful for comparison only, one injection cannot
        fill it) or "reference" (slow, error-controlled).
    time_step : float or str
        Fixed step [s], or text such as ``"1 us"``; from 1 ns to 100 us.
    sample_interval : float or str, optional
        Spacing of the samples [s], or text; by default the fixed step, 3 us for the reference. A whole number of fixed
        steps.
    precision : Precision or str
        "f64" or "f32", for the fast engines; the reference is always f64.
    rail_pressure, cylinder_pressure, return_pressure : float, str or Trace, optional
        [Pa], or text such as ``"160 MPa"``.
    energising_time : float or str, optional
        Duration of one energising from t = 0 [s], or text such as ``"700 us"``.
    energisings : sequence of (start, duration), optional
        Several energisings, [s] or texts.
    drive, horizon
        As in `OperatingPoint`.
    same_bits : bool
        As in `simulate_batch`.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type or beyond its limits, the settings contradict each other, or the engine is
        not available on this machine. A failed simulation returns a `Solution` with that status.
    SimulationError
        If parameters far from those of any injector lead to a division by zero or an overflow.

    Examples
    --------
    >>> import commonrail as cr
    >>> solution = cr.simulate(cr.load_injector("cri2-16"), rail_pressure="160 MPa", energising_time="700 us")
    >>> solution.injected_volume > 50e-9
    True
    """
    instance(injector, Injector, "injector")
    fields_of_point = {
        "rail_pressure": rail_pressure,
        "energising_time": energising_time,
        "energisings": energisings,
        "cylinder_pressure": cylinder_pressure,
        "return_pressure": return_pressure,
        "drive": drive,
        "horizon": horizon,
    }
    point = _read_point(point, {name: value for name, value in fields_of_point.items() if value is not None})
    check_inputs(injector, point)
    time_step = check_step(time_step)
    engine = _engine(engine)
    if sample_interval is not None:
        sample_interval = number(sample_interval, "s", "sample interval")
        if not 1e-9 <= sample_interval <= point.duration:
            raise ConfigurationError(
                f"The sample interval must lie between 1 ns and the simulated {point.duration * 1e3:g} ms, "
                f"not {sample_interval:g} s."
            )
    real = enum_member(precision, Precision, "precision")
    alike = _alike(same_bits, engine)
    try:
        if engine is Engine.REFERENCE:
            if real is not Precision.F64:
                raise ConfigurationError(
                    f"The reference engine computes in f64 alone; use the lanes engine for {real.value}."
                )
            from commonrail.engine.reference import simulate_reference

            return simulate_reference(injector, point, sample_interval or 3e-6)
        stride = 1 if sample_interval is None else _stride(sample_interval, time_step)
        return _simulate_course(injector, plan.prepare(injector, [point], time_step), stride, engine, real, alike)
    except ArithmeticError as error:  # parameters far from those of any injector
        raise SimulationError(_beyond_numbers(injector, error)) from error


def _read_point(point: OperatingPoint | None, keywords: dict[str, Any]) -> OperatingPoint:
    """Operating point of `simulate`, given as an object or by its fields."""
    if point is not None:
        instance(point, OperatingPoint, "point")
        if keywords:
            raise ConfigurationError(f"Give either an operating point or {' and '.join(keywords)}, not both.")
        return point
    energised = [keywords.pop(name) for name in ("energising_time", "energisings") if name in keywords]
    if "rail_pressure" not in keywords or len(energised) != 1:
        raise ConfigurationError(
            'Give an operating point, or a rail_pressure, such as "160 MPa", and either an energising_time, such as '
            '"700 us", or energisings, a list of pairs of start and duration.'
        )
    return OperatingPoint(energisings=energised[0], **keywords)


def _simulate_course(
    injector: Injector, prepared: Prepared, stride: int, engine: Engine, precision: Precision, same_bits: bool
) -> Solution:
    """Simulate one injection by a fast engine, with a sample every `stride` steps."""
    point, time_step, variant = prepared.points[0], prepared.dt, injector.wired()
    c, theta = plan.coefficients_at(injector, point, time_step), prepared.row[None]
    outcome, trace = _run(
        theta,
        prepared,
        variant,
        prepared.densities,
        engine=engine,
        precision=precision,
        traced=True,
        same_bits=same_bits,
    )
    states = dict(zip(lanes.trace_paths(injector.variant), trace[0, :, :, 0].T, strict=True))
    time: Floats = np.asarray(point.start + time_step * stride * np.arange(-(-trace.shape[1] // stride)), float)
    injected = np.ascontiguousarray(states["nozzle.injected"][::stride])
    reached = float(np.nan_to_num(outcome.greatest_lift[0, 0]))
    return Solution(
        time=time,
        mass_rate=np.diff(injected) / np.diff(time),
        injected=injected,
        channels=read_channels(c, variant, point, time, {name: row[::stride] for name, row in states.items()}),
        injected_mass=float(states["nozzle.injected"][-1]),  # at the horizon, which may lie between samples
        returned_mass=float(states["cumulative_flows.returned"][-1]),
        opening=point.start + time_step * float(outcome.opening[0, 0]),
        closing=point.start + time_step * float(outcome.closing[0, 0]),
        first_closing=point.start + time_step * float(outcome.first_closing[0, 0]),
        reference_density=float(prepared.densities[0, 0]),
        status=Status(int(statuses_of((), theta, prepared, outcome)[0, 0])),
        engine=engine.value,
        balance=relative_balance(c, states, time_step),
        find_longest_step=functools.partial(longest_step, injector, theta[0], prepared.medium, reached),
        point=point,
    )


def _stride(sample_interval: float, time_step: float) -> int:
    """Steps of a sample; `ConfigurationError` if not a whole number."""
    steps = sample_interval / time_step
    stride = max(round(steps), 1)
    if abs(steps - stride) > ROUNDING * stride:
        near = [to_text(n * time_step, "s") for n in sorted({max(int(steps), 1), int(steps) + 1})]
        raise ConfigurationError(
            f"The sample interval must be a whole number of time steps, and {to_text(sample_interval, 's')} is "
            f"{steps:.4g} steps of {to_text(time_step, 's')}; take {' or '.join(near)}."
        )
    return stride


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
    same_bits: bool = False,
) -> Batch:
    """Simulate many candidates at many operating points.

    Candidates and points fill the lanes of the processor together: one injector at eight points takes as long as eight
    candidates at one point. Each result has the same bits as a separate simulation.

    Parameters
    ----------
    injector : Injector
    points : sequence of OperatingPoint
    names : sequence of str
        Dotted names of the parameters that vary, each once.
    values : (candidates, names), optional
        SI values, or texts with units; default: one candidate, the injector itself. A candidate with a value
        that is not finite or outside its domain has the status OUTSIDE_DOMAIN.
    time_step : float or str
        [s], or text such as ``"1 us"``; from 1 ns to 100 us.
    threads : int, optional
        Default: all usable processors. The result does not depend on it.
    misfit : Misfit, optional
        Rate samples to compare with inside the loop.
    stop_when_closed : bool
        End a simulation once its needle has closed for good.
    precision : Precision or str
        "f64", or "f32": twice as fast, with an L1 error of the rate below 0.01 % from rounding.
    prepared : Prepared, optional
        `plan.prepare` of the same injector, points and time step: saves time in a series of batches.
    engine : Engine or str
        "lanes", or "cuda" for one simulation on each thread of an NVIDIA GPU; `threads` is then ignored.
    same_bits : bool
        Use machine code without fused or reordered operations: equal bits on every x86-64 processor and in an
        exported library. Lanes only. docs/performance.md states the cost.

    Raises
    ------
    ConfigurationError
        If an argument is of the wrong type or beyond its limits, a name is unknown or repeated, the settings contradict
        each other, or the engine is not available on this machine.
    """
    instance(injector, Injector, "injector")
    time_step, threads = check_step(time_step), thread_count(threads)
    points = instances(points, OperatingPoint, "points")
    if not points:
        raise ConfigurationError("At least one operating point is needed among the points.")
    if prepared is None:  # a comparison reuses points prepared for another drive
        for point in points:
            check_inputs(injector, point)
    names = known_names(names, injector.quantities, "names", "nozzle.hole_diameter")
    candidates = read_candidates(names, values)
    for argument, kind, what in ((misfit, Misfit, "misfit"), (prepared, Prepared, "prepared")):
        if argument is not None:
            instance(argument, kind, what)
    prepared = prepared or plan.prepare(injector, points, time_step)
    run = functools.partial(
        _run,
        prepared=prepared,
        variant=injector.wired(names),
        misfit=misfit,
        stop_when_closed=flag(stop_when_closed, "stop_when_closed") and misfit is None,
        precision=enum_member(precision, Precision, "precision"),
        engine=(engine := _batch_engine(engine)),
        threads=threads or usable_threads(),
        same_bits=_alike(same_bits, engine),
    )
    many = max(AT_A_TIME[engine] // len(points), 1)
    parts = [
        _simulate(names, candidates[first : first + many], prepared, run) for first in range(0, len(candidates), many)
    ]
    if len(parts) == 1:
        return parts[0]
    return Batch(**{f.name: np.concatenate([getattr(batch, f.name) for batch in parts]) for f in fields(Batch)})


def _engine(name: Engine | str) -> Engine:
    engine = enum_member(name, Engine, "engine")
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


def _alike(same_bits: bool, engine: Engine) -> bool:
    if flag(same_bits, "same_bits") and engine is not Engine.LANES:
        raise ConfigurationError(
            f'The same bits on every processor are promised for the engine "lanes" alone, not for "{engine.value}"; '
            "omit same_bits or take the lanes."
        )
    return same_bits


def _run(
    theta: Floats,
    prepared: Prepared,
    variant: Variant,
    densities: Floats,
    *,
    engine: Engine = Engine.LANES,
    precision: Precision = Precision.F64,
    misfit: Misfit | None = None,
    stop_when_closed: bool = False,
    traced: bool = False,
    injected_only: bool = False,
    threads: int = 1,
    same_bits: bool = False,
) -> tuple[Outcome, Floats]:
    """Run candidates by a fast engine; arguments as in `plan.make_job` and `lanes.run`."""
    misfit = misfit and misfit.fill_density(densities)
    if engine is Engine.CUDA:
        from commonrail.engine import cuda

        return cuda.run(plan.make_job(prepared, theta, stop_when_closed, 1), variant, misfit, precision, traced)
    separate_points = misfit is not None and bool(misfit.bound_count.any())
    job = plan.make_job(prepared, theta, stop_when_closed, VECTORS[precision].lanes, separate_points=separate_points)
    with naming(f"{variant.label}, {precision.value}"):
        return lanes.run(
            job, variant, misfit, precision, traced, threads, injected_only=injected_only, same_bits=same_bits
        )


def _simulate(
    names: Sequence[str], candidates: Floats, prepared: Prepared, run: Callable[..., tuple[Outcome, Floats]]
) -> Batch:
    """Simulate a batch of candidates whose parameters fit into memory."""
    injector, points = prepared.injector, prepared.points
    inside = admissible(names, candidates, injector.fuel, injector.variant.actuation)
    if not inside.all():
        nominal = np.array([injector.values[name] for name in names])
        candidates = np.where(inside[:, None], candidates, nominal)
    theta = candidate_matrix(injector, names, candidates, prepared.row)
    varies = FUEL_TEMPERATURE in names
    densities = plan.reference_densities(injector, points, names, candidates) if varies else prepared.densities
    outcome, _ = run(theta, densities=densities)
    status = statuses_of(names, theta, prepared, outcome)
    status[~inside] = Status.OUTSIDE_DOMAIN

    failed = which_failed(status)
    some_failed = bool(failed.any())

    def figure(table: Floats) -> Floats:
        return np.where(failed, np.nan, table) if some_failed else np.ascontiguousarray(table)

    return Batch(
        injected_mass=figure(outcome.injected),
        returned_mass=figure(outcome.returned),
        opening=prepared.begin + prepared.dt * figure(outcome.opening),
        closing=prepared.begin + prepared.dt * figure(outcome.closing),
        first_closing=prepared.begin + prepared.dt * figure(outcome.first_closing),
        greatest_lift=figure(outcome.greatest_lift),
        status=status,
        reference_density=np.broadcast_to(densities, status.shape),
        absolute_error=figure(outcome.absolute),
        squared_error=figure(outcome.squared),
    )


# Sampled rates of several candidates, from traced runs.


def sampled_rates(
    injector: Injector,
    point: OperatingPoint,
    bounds: Floats,
    names: Sequence[str],
    values: Floats,
    time_step: float,
    *,
    threads: int | None = None,
    prepared: plan.Prepared | None = None,
    same_bits: bool = False,
) -> Floats:
    """Mean mass flow between time bounds [s] for each candidate: (candidates, bounds − 1) [kg/s].

    Rows of failed simulations, including those with too long a step, are NaN.

    `bounds` (n,): [s]; `prepared` (Prepared, optional): of the injector at this point and time step;
    `injector`, `point`, `names`, `values`, `time_step`, `threads`, `same_bits`: as in `simulate_batch`.
    """
    prepared = prepared or plan.prepare(injector, [point], time_step)
    theta = candidate_matrix(injector, names, values, prepared.row)
    outcome, trace = _run(
        theta,
        prepared,
        injector.wired(names),
        prepared.densities,
        traced=True,
        injected_only=True,
        threads=threads or usable_threads(),
        same_bits=same_bits,
    )
    injected = np.moveaxis(trace[:, :, 0, :], 1, 2).reshape(-1, trace.shape[1])[: len(theta)]
    time = point.start + time_step * np.arange(trace.shape[1])
    bounds_are_steps = np.array_equal(bounds, time)
    masses = injected if bounds_are_steps else np.array([np.interp(bounds, time, mass) for mass in injected])
    rates = np.diff(masses, axis=1) / np.diff(bounds)
    failed = which_failed(statuses_of(names, theta, prepared, outcome))[:, 0]
    return np.where(failed[:, None], np.nan, rates)
