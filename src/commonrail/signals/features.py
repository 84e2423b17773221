"""Features of a rate of injection: one function for measured and simulated traces."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from commonrail.arguments import instance, shown
from commonrail.display.text import number
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.errors import ConfigurationError, nearest
from commonrail.signals.measures import FEATURES, Instants, Measured, instants_of, measured_between
from commonrail.signals.parts import Part, averaged, parts_of
from commonrail.signals.rate_trace import RATE_UNITS, RateTrace, rate_trace
from commonrail.signals.settings import CLEAR, FeatureSettings, Levels, levels_of
from commonrail.signals.status import FeatureStatus

__all__ = ["SHOWN", "Features", "Injection", "Shown", "features", "known_feature", "unit_of"]


class Shown(NamedTuple):
    """Unit in which features of one SI unit are shown: factor, text in files and on pages, decimals."""

    factor: float
    unit: str
    text: str
    decimals: int


SHOWN = {  # by SI unit
    "s": Shown(1e6, "us", "µs", 1),
    "m3/s": Shown(1e6, "mm3/ms", "mm³/ms", 2),
    "kg/s": Shown(1e3, "mg/ms", "mg/ms", 2),
    "m3": Shown(1e9, "mm3", "mm³", 3),
    "kg": Shown(1e6, "mg", "mg", 3),
}


@dataclass(frozen=True)
class Injection:
    """One injection of a trace.

    Attributes
    ----------
    values : mapping of str to float
        By feature [SI]; NaN where there is none, and `statuses` say why.
    standard_errors : mapping of str to float
        By feature [SI], as far as the noise of the trace gives them.
    statuses : tuple of FeatureStatus
        Empty if all features were found.
    energising : int or None
        Number of its energising, from 1; None if unknown.
    """

    values: Mapping[str, float]
    standard_errors: Mapping[str, float]
    statuses: tuple[FeatureStatus, ...] = ()
    energising: int | None = None

    def __getitem__(self, name: str) -> float:
        """Value of a feature [SI]; `ConfigurationError` for a name that is none."""
        return self.values[known_feature(name)]


@dataclass(frozen=True)
class Features:
    """Features of a trace.

    Attributes
    ----------
    injections : tuple of Injection
        In the order of time.
    status : FeatureStatus
        OK if there are injections, or the reason for which there is none.
    quantity : float
        Sum over the whole trace [m³ or kg].
    noise : float
        Standard deviation of one sample [m³/s or kg/s].
    levels : Levels
        Threshold and averaging that were applied.
    unit : str
        Of rates, "m3/s" or "kg/s".
    energisings : tuple of Energising
        Those of the trace.
    """

    injections: tuple[Injection, ...]
    status: FeatureStatus
    quantity: float
    noise: float
    levels: Levels
    unit: str
    energisings: tuple[Energising, ...]

    def of(self, injection: int) -> Injection | None:
        """Injection of an energising, or by order where energisings are unknown, from 1; None if there is none."""
        if self.energisings:
            return next((one for one in self.injections if one.energising == injection), None)
        return self.injections[injection - 1] if 0 < injection <= len(self.injections) else None

    def value(self, name: str, injection: int = 1) -> float:
        """Feature of one injection [SI]; NaN where there is none.

        Parameters
        ----------
        name : str
        injection : int
            As for `of`.
        """
        name, found = known_feature(name), self.of(injection)
        return math.nan if found is None else found.values[name]

    def reason(self, injection: int = 1) -> FeatureStatus:
        """Status that explains a missing feature of one injection, numbered as for `of`."""
        found = self.of(injection)
        if found is None:
            return FeatureStatus.NO_INJECTION if self.injections else self.status
        return found.statuses[0] if found.statuses else FeatureStatus.OK

    @property
    def silent(self) -> tuple[int, ...]:
        """Numbers of the energisings without an injection."""
        return tuple(i for i in range(1, len(self.energisings) + 1) if self.of(i) is None)

    def record(self) -> dict[str, Any]:
        """JSON-able form [SI]; null where there is no number."""
        return {
            "status": self.status.value,
            "message": self.status.sentence,
            "unit": self.unit,
            "quantity": number(self.quantity),
            "noise": number(self.noise),
            "threshold": number(self.levels.threshold),
            "averaging": number(self.levels.width),
            "energisings": [{"start": p.start, "duration": p.duration} for p in self.energisings],
            "energisings_without_injection": list(self.silent),
            "injections": [_record(one) for one in self.injections],
        }


def features(
    source: Any,
    energisings: OperatingPoint | Sequence[Energising] | None = None,
    settings: FeatureSettings | None = None,
    levels: Levels | None = None,
) -> Features:
    """Features of a rate of injection, measured or simulated.

    Parameters
    ----------
    source : RateTrace, Solution, Trace or RateData
        Rate of injection.
    energisings : OperatingPoint or sequence of Energising, optional
        Those of the source if it has some. Delays need them.
    settings : FeatureSettings, optional
    levels : Levels, optional
        Those of another trace, to judge both alike; by default they follow from the settings and this trace.

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
    >>> found = cr.features(cr.RateTrace(bounds, ramps), [cr.Energising(0.0, "700 us")])
    >>> round(found.value("opening_delay") * 1e6), round(found.value("quantity") * 1e9, 2)
    (310, 30.0)
    """
    trace = rate_trace(source, energisings)
    settings = FeatureSettings() if settings is None else instance(settings, FeatureSettings, "settings")
    if settings.zero_at_rest:
        trace = _from_zero(trace)
    levels = levels_of(trace, settings) if levels is None else instance(levels, Levels, "levels")
    total = trace.quantity(trace.bounds[0], trace.bounds[-1])

    def found(injections: tuple[Injection, ...], status: FeatureStatus) -> Features:
        return Features(injections, status, total, trace.noise, levels, trace.unit, trace.energisings)

    if math.isnan(levels.threshold):
        return found((), FeatureStatus.NO_INJECTION)
    if CLEAR * levels.noise > levels.trigger - levels.threshold:
        return found((), FeatureStatus.HIDDEN_IN_NOISE)
    injections = tuple(_injections(trace, levels, settings))
    return found(injections, FeatureStatus.OK if injections else FeatureStatus.NO_INJECTION)


def _from_zero(trace: RateTrace) -> RateTrace:
    if not len(trace.at_rest):
        raise ConfigurationError(
            "The rate has no sample before the first energising, so that its zero is unknown; give a longer trace and "
            "its energisings, or omit zero_at_rest."
        )
    return trace.with_rate(trace.rate - float(np.mean(trace.at_rest)))


def _injections(trace: RateTrace, levels: Levels, settings: FeatureSettings) -> list[Injection]:
    course = averaged(trace, levels.width)
    parts = parts_of(course, levels, settings.split)
    if not parts:
        return []
    instants = [instants_of(course, part, levels) for part in parts]
    windows = _windows(trace, instants, parts, float(settings.tail))
    measured = [
        measured_between(trace, course, part, window, levels, settings)
        for part, window in zip(parts, windows, strict=True)
    ]
    numbers = [_energising_of(at.begin, trace.energisings, float(settings.least_delay)) for at in instants]
    before = [math.nan, *(at.closing for at in instants[:-1])]
    return [_injection(measured, i, numbers, trace.energisings, before[i]) for i in range(len(parts))]


def _windows(
    trace: RateTrace, instants: Sequence[Instants], parts: Sequence[Part], tail: float
) -> Iterator[tuple[float, float]]:
    """Times between which the quantity of each injection counts [s]."""
    first, last = float(trace.bounds[0]), float(trace.bounds[-1])
    middles = [0.5 * (one.end + after.begin) for one, after in pairwise(instants)]
    edges = zip([first, *middles], [*middles, last], strict=True)
    for at, part, (low, high) in zip(instants, parts, edges, strict=True):
        yield (
            at.begin if part.fused_before and math.isnan(at.opening) else max(low, at.begin - tail),
            at.end if part.fused_after and math.isnan(at.closing) else min(high, at.end + tail),
        )


def _energising_of(opening: float, energisings: Sequence[Energising], delay: float) -> int | None:
    """Number of the last energising that starts at least a delay [s] before an opening."""
    before = [i for i, pulse in enumerate(energisings, start=1) if pulse.start + delay <= opening]
    return before[-1] if before else None


def _injection(
    measured: Sequence[Measured],
    i: int,
    numbers: Sequence[int | None],
    energisings: Sequence[Energising],
    before: float,
) -> Injection:
    """Injection i with what depends on its energising, on its reopenings, and on the closing `before` it [s]."""
    values, errors, statuses = dict(measured[i].values), dict(measured[i].standard_errors), list(measured[i].statuses)
    again = numbers[i] is not None and numbers[i] in numbers[:i]
    number = None if again else numbers[i]
    pulse = None if number is None else energisings[number - 1]
    start, end = (math.nan, math.nan) if pulse is None else (pulse.start, pulse.start + pulse.duration)
    own = [m.values["quantity"] for m, other in zip(measured, numbers, strict=True) if other == number]
    values |= {
        "opening_delay": values["opening"] - start,
        "closing_delay": values["closing"] - end,
        "separation": values["opening"] - before,
        "total_quantity": math.nan if again else values["quantity"] if number is None else sum(own),
    }
    if pulse is not None:
        errors |= {"opening_delay": errors["opening"], "closing_delay": errors["closing"]}
    if energisings and pulse is None:
        statuses.append(FeatureStatus.REOPENED if again else FeatureStatus.NO_ENERGISING)
    return Injection({name: values[name] for name in FEATURES}, errors, tuple(statuses), number)


def known_feature(name: object) -> str:
    """Name of a feature.

    Raises
    ------
    ConfigurationError
        If there is none of that name, with the nearest.
    """
    if not isinstance(name, str) or name not in FEATURES:
        meant = nearest(name, FEATURES) if isinstance(name, str) else ""
        raise ConfigurationError(f"There is no feature {shown(name)}{meant}; the features are {', '.join(FEATURES)}.")
    return name


def unit_of(name: str, unit: str = "m3/s") -> str:
    """SI unit of a feature of a trace whose rate has a unit."""
    return {"time": "s", "rate": unit, "quantity": RATE_UNITS[unit]}[FEATURES[name].of]


def _record(one: Injection) -> dict[str, Any]:
    return {
        "energising": one.energising,
        "statuses": [status.value for status in one.statuses],
        "messages": [status.sentence for status in one.statuses],
        "values": {name: number(value) for name, value in one.values.items()},
        "standard_errors": {name: number(value) for name, value in one.standard_errors.items()},
    }
