"""Statistics of features over repeated shots: mean, scatter, their intervals, and outliers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from commonrail.base.arguments import fraction, instances
from commonrail.base.errors import ConfigurationError
from commonrail.base.record import Key, to_record
from commonrail.plugins.features.rate_trace import spread
from commonrail.plugins.features.result import Features, feature_unit
from commonrail.plugins.features.table import features_of_traces

APART = 3.5  # robust standard deviations from the median, beyond which a shot is an outlier
FEWEST_TO_JUDGE = 5  # shots

Interval = tuple[float, float]


@dataclass(frozen=True)
class ShotStatistic:
    """One feature over repeated shots [SI].

    Attributes
    ----------
    name, unit : str
    injection : int
        Number of the injection, see `Features.of`.
    count, missing : int
        Shots with the feature, and shots without it.
    mean, deviation : float
        Of the shots with the feature; the deviation of a single shot is NaN.
    mean_interval, deviation_interval : (float, float)
        By Student's t and by chi-squared, for normal scatter.
    outliers : tuple of int
        Shots, from 1, beyond 3.5 robust standard deviations. They count in all other figures.
    """

    name: Annotated[str, Key("feature")]
    unit: str
    injection: int
    count: int
    missing: int
    mean: float
    mean_interval: Interval
    deviation: float
    deviation_interval: Interval
    outliers: tuple[int, ...]

    def record(self) -> dict[str, Any]:
        """JSON-able form [SI]; null for a missing number."""
        record: dict[str, Any] = to_record(self)
        return record


def shot_statistics(shots: Sequence[Features], level: float = 0.95) -> tuple[ShotStatistic, ...]:
    """Compute statistics of every feature of every injection that at least one shot has.

    Parameters
    ----------
    shots : sequence of Features
        Repeated shots at one operating point.
    level : float
        Probability of the intervals.

    Raises
    ------
    ConfigurationError
        If there are no shots, their units differ, or the level is not a probability.
    """
    shots = instances(shots, Features, "shots")
    if not shots or len({shot.unit for shot in shots}) > 1:
        raise ConfigurationError("The shots must be one or more with rates of one unit.")
    level = fraction(level, "level")
    most = max(len(shot.energisings or shot.injections) for shot in shots)
    statistics = (_statistic(name, shots, i, level) for i in range(1, most + 1) for name in features_of_traces())
    return tuple(statistic for statistic in statistics if statistic.count)


def _statistic(name: str, shots: Sequence[Features], injection: int, level: float) -> ShotStatistic:
    values = np.array([shot.value(name, injection) for shot in shots])
    finite = values[np.isfinite(values)]
    count, unit = len(finite), feature_unit(name, shots[0].unit)
    mean = float(np.mean(finite)) if count else math.nan
    deviation = float(np.std(finite, ddof=1)) if count > 1 else math.nan
    about_mean, about_deviation = _intervals(mean, deviation, count, level)
    scatter = spread(finite) if count >= FEWEST_TO_JUDGE else 0.0
    is_outlier = np.abs(values - np.median(finite)) > APART * scatter if scatter > 0.0 else np.zeros(len(values), bool)
    outliers = tuple(int(i) + 1 for i in np.flatnonzero(is_outlier))
    return ShotStatistic(
        name=name,
        unit=unit,
        injection=injection,
        count=count,
        missing=len(shots) - count,
        mean=mean,
        mean_interval=about_mean,
        deviation=deviation,
        deviation_interval=about_deviation,
        outliers=outliers,
    )


def _intervals(mean: float, deviation: float, count: int, level: float) -> tuple[Interval, Interval]:
    from scipy.special import chdtri, stdtrit  # slow to import

    if count < 2:
        return (math.nan, math.nan), (math.nan, math.nan)
    freedom, tail = count - 1.0, 0.5 * (1.0 - level)
    half = float(stdtrit(freedom, 1.0 - tail)) * deviation / math.sqrt(count)
    low, high = (deviation * math.sqrt(freedom / float(chdtri(freedom, p))) for p in (tail, 1.0 - tail))
    return (mean - half, mean + half), (low, high)
