"""Find features of an injection rate: one function for measured and simulated traces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from commonrail.base.arguments import instance
from commonrail.base.errors import ConfigurationError
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.plugins.features.injections import (
    FeatureStatus,
    Instant,
    Instants,
    Segment,
    TracedInjection,
    average,
    find_instants,
    find_segments,
)
from commonrail.plugins.features.levels import CLEAR, Levels, resolve_levels
from commonrail.plugins.features.rate_trace import RateTrace, rate_trace
from commonrail.plugins.features.result import Features, Injection
from commonrail.plugins.features.settings import FeatureSettings
from commonrail.plugins.features.table import features_of_traces


def find_features(
    source: Any,
    energisings: OperatingPoint | Sequence[Energising] | None = None,
    settings: FeatureSettings | None = None,
    levels: Levels | None = None,
) -> Features:
    """Find features of an injection rate, measured or simulated.

    Parameters
    ----------
    source : RateTrace, Solution, Trace or RateData
        Injection rate.
    energisings : OperatingPoint or sequence of Energising, optional
        By default from the source. Delays need energisings.
    settings : FeatureSettings, optional
    levels : Levels, optional
        Levels of another trace, to compare both by equal levels; by default from the settings and this trace.

    Raises
    ------
    ConfigurationError
        If the source has no rate, or the settings do not fit it.

    Examples
    --------
    >>> import numpy as np
    >>> import commonrail as cr
    >>> bounds = 5e-6 * np.arange(241)
    >>> ramps = np.interp(bounds[1:] - 2.5e-6, [300e-6, 400e-6, 900e-6, 1000e-6], [0.0, 50e-6, 50e-6, 0.0])
    >>> found = cr.features.find_features(cr.features.RateTrace(bounds, ramps), [cr.Energising(0.0, "700 us")])
    >>> round(found.value("opening_delay") * 1e6), round(found.value("quantity") * 1e9, 2)
    (310, 30.0)
    """
    trace = rate_trace(source, energisings)
    settings = FeatureSettings() if settings is None else instance(settings, FeatureSettings, "settings")
    if settings.zero_at_rest:
        if not len(trace.at_rest):
            raise ConfigurationError(
                "The rate has no sample before the first energising, and its zero is unknown; give a longer trace "
                "and its energisings, or omit zero_at_rest."
            )
        trace = trace.with_rate(trace.rate - float(np.mean(trace.at_rest)))
    levels = resolve_levels(trace, settings) if levels is None else instance(levels, Levels, "levels")
    total = trace.quantity(trace.bounds[0], trace.bounds[-1])

    def make_features(injections: tuple[Injection, ...], status: FeatureStatus) -> Features:
        return Features(injections, status, total, trace.noise, levels, trace.unit, trace.energisings)

    if math.isnan(levels.threshold):
        return make_features((), FeatureStatus.NO_INJECTION)
    if CLEAR * levels.noise > levels.trigger - levels.threshold:
        return make_features((), FeatureStatus.HIDDEN_IN_NOISE)
    injections = tuple(_injections(trace, levels, settings))
    return make_features(injections, FeatureStatus.OK if injections else FeatureStatus.NO_INJECTION)


def _injections(trace: RateTrace, levels: Levels, settings: FeatureSettings) -> list[Injection]:
    course = average(trace, levels.width)
    parts = find_segments(course, levels, settings.split)
    if not parts:
        return []
    instants = [find_instants(trace, course, segment, levels) for segment in parts]
    windows = list(_windows(trace, instants, parts, settings.tail))
    # number of the last energising that starts `least_delay` or more before the opening
    starts = [pulse.start + settings.least_delay for pulse in trace.energisings]
    numbers = [sum(start <= at.begin for start in starts) or None for at in instants]
    before = [Instant(), *(at.closing for at in instants[:-1])]
    injections = []
    for i, (segment, at, window, number) in enumerate(zip(parts, instants, windows, numbers, strict=True)):
        again = number is not None and number in numbers[:i]  # a reopening
        same = [w for w, other in zip(windows, numbers, strict=True) if other == number]
        together = () if again else (window,) if number is None else tuple(same)
        pulse = None if again or number is None else trace.energisings[number - 1]
        traced = TracedInjection(trace, course, segment, levels, settings, at, window, together, pulse, before[i])
        injections.append(_injection(traced, None if again else number, again=again))
    return injections


def _windows(
    trace: RateTrace, instants: Sequence[Instants], parts: Sequence[Segment], tail: float
) -> Iterator[tuple[float, float]]:
    """Times between which the quantity of each injection counts [s]."""
    first, last = float(trace.bounds[0]), float(trace.bounds[-1])
    middles = [0.5 * (earlier.end + after.begin) for earlier, after in pairwise(instants)]
    edges = zip([first, *middles], [*middles, last], strict=True)
    for at, segment, (low, high) in zip(instants, parts, edges, strict=True):
        yield (
            at.begin if segment.fused_before and math.isnan(at.opening.time) else max(low, at.begin - tail),
            at.end if segment.fused_after and math.isnan(at.closing.time) else min(high, at.end + tail),
        )


def _injection(traced: TracedInjection, number: int | None, *, again: bool) -> Injection:
    """Injection with all features of the table; `number` counts energisings, `again` marks a reopening."""
    estimates = {name: f.of_trace(traced) for name, f in features_of_traces().items() if f.of_trace}
    errors = {name: estimate.error for name, estimate in estimates.items() if estimate.error is not None}
    statuses = traced.statuses
    if traced.trace.energisings and traced.pulse is None:
        statuses = (*statuses, FeatureStatus.REOPENED if again else FeatureStatus.NO_ENERGISING)
    return Injection({name: estimate.value for name, estimate in estimates.items()}, errors, statuses, number)
