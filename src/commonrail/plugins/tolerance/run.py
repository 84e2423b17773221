"""Tolerance study: draw parts, simulate them block by block, and keep what the figures need."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from commonrail.base.arguments import Limits, amount, function, instance, thread_count
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.base.hooks import hold_interrupts
from commonrail.engine.status import OK, Status
from commonrail.plugins.tolerance.file import DimensionFacts, InjectorFacts, PointResult, ToleranceResult
from commonrail.plugins.tolerance.statistics import GROUPS, Draws, Parts, Simulated, VarianceShares, spread_of
from commonrail.plugins.tolerance.study import Tolerances
from commonrail.plugins.tolerance.trim import trimmed

LARGEST_BLOCK, SMALLEST_BLOCK = 16_384, 64  # parts that are simulated together; powers of two


class Progress(NamedTuple):
    """Phase, and parts done and in all."""

    phase: str
    done: int
    total: int


def tolerance(
    tolerances: Tolerances,
    *,
    threads: int | None = None,
    confidence: float = 0.95,
    progress: Callable[[Progress], None] | None = None,
) -> ToleranceResult:
    """Spread of the injected quantity over parts whose dimensions scatter.

    Ctrl-C ends the study with the parts that are simulated by then, without the trim.

    Parameters
    ----------
    tolerances : Tolerances
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    confidence : float
        Probability of the intervals, between 0.5 and 0.999.
    progress : function of Progress, optional

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or limits are crossed.
    SimulationError
        If the part as drawn cannot be simulated, or hardly any part can.
    """
    t = instance(tolerances, Tolerances, "tolerances")
    sure = amount(confidence, "1", "confidence", Limits(0.5, 0.999))
    report = function(progress, "progress") or (lambda _: None)
    begin = time.perf_counter()
    simulated = Simulated(t, thread_count(threads))
    nominal = _nominal(simulated)
    limits = [_limits(t, k, nominal[k]) for k in range(len(t.points))]
    with hold_interrupts() as request:
        simulated_parts, shares, done = _all(simulated, nominal, report, lambda: request.asked)
        if not done:
            request.check()
        spreads = [
            spread_of(simulated_parts.quantities[:done, k], simulated_parts.codes[:done, k], limits[k], sure)
            for k in range(len(limits))
        ]
        lost = [p.name for p, spread in zip(t.points, spreads, strict=True) if spread is None]
        if lost:
            why = Status(int(np.bincount(simulated_parts.codes[:done].ravel()).argmax()))
            raise SimulationError(f"{t.title}: hardly any part can be simulated at {lost[0]}. {why.sentence}")
        trim = None
        if t.trim is not None and not request.asked:
            trim = trimmed(
                simulated, simulated_parts, nominal, limits, sure, lambda i, n: report(Progress("trimming", i, n))
            )
    results = [
        PointResult.of(p, float(nominal[k]), spreads[k], t.names, shares.shares(k, sure))  # type: ignore[arg-type]
        for k, p in enumerate(t.points)
    ]
    return ToleranceResult(
        title=t.title,
        synthetic=" ".join(dict.fromkeys(text for text in (t.synthetic, t.injector.synthetic) if text)),
        injector=InjectorFacts(t.injector.name, t.injector.title, t.injector.variant.label),
        status="interrupted" if done < t.parts else "complete",
        asked=t.parts,
        parts=done,
        injections=simulated.injections,
        seed=t.seed,
        sampling=t.sampling,
        time_step=t.time_step,
        precision=t.precision,
        confidence=sure,
        dimensions=tuple(DimensionFacts.of(dimension, t.injector) for dimension in t.dimensions),
        correlations=t.correlations,
        points=tuple(results),
        trim=trim,
        seconds=time.perf_counter() - begin,
    )


def _nominal(simulated: Simulated) -> Floats:
    """Quantities (points,) of the part as drawn [m³]."""
    nominal_part = simulated.parts(None)
    for p, code in zip(simulated.tolerances.points, nominal_part.codes[0], strict=True):
        if code != OK:
            raise SimulationError(
                f"{simulated.tolerances.injector.name} as drawn cannot be simulated at {p.name}: "
                f"{Status(int(code)).sentence}"
            )
    return np.asarray(nominal_part.quantities[0])


def _limits(t: Tolerances, k: int, nominal: float) -> tuple[float | None, float | None]:
    point = t.points[k]
    lower, upper = (limit and limit.at(nominal) for limit in (point.lower, point.upper))
    if lower is not None and upper is not None and not lower < upper:
        raise ConfigurationError(f"{point.name}: the lower limit must be below the upper; correct them.")
    return lower, upper


def _all(
    simulated: Simulated, nominal: Floats, report: Callable[[Progress], None], stop: Callable[[], bool]
) -> tuple[Parts, VarianceShares, int]:
    """Quantities of all parts, the sums of the shares, and the number of parts that were simulated."""
    t = simulated.tolerances
    size = min(LARGEST_BLOCK, max(SMALLEST_BLOCK, 1 << (max(t.parts // GROUPS, 1).bit_length() - 1)))
    shape = (t.parts, len(t.points))
    quantities, codes = np.full(shape, np.nan), np.zeros(shape, np.int8)
    draws, shares = Draws(t), VarianceShares(t, nominal)
    done = 0
    while done < t.parts and not stop():
        values = draws.take(min(size, t.parts - done))
        chunk = simulated.parts(values)
        following = done + len(values)
        quantities[done:following], codes[done:following] = chunk
        shares.add((done // size) % GROUPS, values, chunk.quantities)
        done = following
        report(Progress("simulating", done, t.parts))
    return Parts(quantities, codes), shares, done
