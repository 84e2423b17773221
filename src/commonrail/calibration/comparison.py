"""Any injectors beside one another on any data: nothing is fitted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import NamedTuple

import numpy as np

from commonrail.arguments import instance, instances, mapping, thread_count
from commonrail.calibration.score import DataScore, QuantityScore, RateScore, score_data
from commonrail.calibration.study import QuantityData, RateData, Study
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import Status
from commonrail.errors import CommonrailError, ConfigurationError
from commonrail.injector.definition import Injector
from commonrail.injector.variants import Drive

__all__ = ["MOST_MODELS", "Comparison", "Failure", "check_drive", "check_labels", "compare"]

MOST_MODELS = 8  # colours and markers that can be told apart

_TRACES = (Drive.CURRENT, Drive.VOLTAGE)
# Names that the results give to other things than models.
_RESERVED = frozenset(
    {"data", "dead_time", "measured", "quantity", "synthetic", "time_s"}
    | {"rail_pressure", "cylinder_pressure", "return_pressure", "energising_time"}
)
_NOT_REACHED = (
    "No dead time was found: the quantity is not passed between energising times of 120 and 480 us, or the "
    "simulation fails there."
)


class Failure(NamedTuple):
    """A point without a number: rail pressure [Pa], energising time [s], name of the status, and what it means."""

    rail_pressure: float
    energising_time: float
    status: str
    sentence: str


@dataclass(frozen=True)
class Comparison:
    """Several injectors on several data sets.

    Attributes
    ----------
    models : dict of str to Injector
        By label.
    studies : tuple of Study
        Whose data were used.
    data : tuple of RateData or QuantityData
        All data sets in order; one whose name occurs twice has "(study n)" behind it.
    scores : dict of str to tuple of DataScore
        By label, one for each data set.
    failures : dict of str to tuple of tuple of Failure
        By label and data set, the points that have no number.
    """

    models: dict[str, Injector]
    studies: tuple[Study, ...]
    data: tuple[RateData | QuantityData, ...]
    scores: dict[str, tuple[DataScore, ...]]
    failures: dict[str, tuple[tuple[Failure, ...], ...]]

    @property
    def simulated(self) -> bool:
        """Whether there is any number at all."""
        return any(_has_number(score) for scores in self.scores.values() for score in scores)


def compare(
    models: Mapping[str, Injector], studies: Study | Sequence[Study], *, threads: int | None = None
) -> Comparison:
    """Simulate every injector at every point of the data; roles, parameters and optimisers of the studies do not count.

    Parameters
    ----------
    models : mapping of str to Injector
        One to eight injectors by the labels that tables and figures show.
    studies : Study or sequence of Study
        Whose data are used.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, a label cannot be used, there is no model or too many, no study, or a model's
        drive does not fit the data. A simulation that fails is no error: its point has no number, and
        `Comparison.failures` says why.
    """
    studies = (studies,) if isinstance(studies, Study) else _several(studies)
    threads = thread_count(threads)
    check_labels(list(mapping(models, "models", '{"first": injector}')))
    for label, injector in models.items():
        instance(injector, Injector, f'injector "{label}" of the models')
        for study in studies:
            check_drive(injector, study, label)
    data = _named_apart(studies)
    steps = [study.time_step for study in studies for _ in study.data]
    scores = {
        label: tuple(_score(label, injector, d, dt, threads) for d, dt in zip(data, steps, strict=True))
        for label, injector in models.items()
    }
    failures = {
        label: tuple(
            tuple(_failures(injector, d, score, dt)) for d, score, dt in zip(data, scores[label], steps, strict=True)
        )
        for label, injector in models.items()
    }
    return Comparison(dict(models), studies, data, scores, failures)


def _several(studies: Sequence[Study]) -> tuple[Study, ...]:
    if isinstance(studies, str | PathLike):
        instance(studies, Study, "studies")
    found = instances(studies, Study, "studies")
    if not found:
        raise ConfigurationError("The studies must be at least one; its data are what the models are compared on.")
    return found


def check_labels(labels: Sequence[str]) -> None:
    """Refuse no model, too many, and labels that tables and files cannot carry.

    Raises
    ------
    ConfigurationError
        With the label.
    """
    if not 1 <= len(labels) <= MOST_MODELS:
        raise ConfigurationError(f"Between 1 and {MOST_MODELS} models can be compared at a time, not {len(labels)}.")
    for label in labels:
        if label in _RESERVED:
            raise ConfigurationError(f'"{label}" cannot be the label of a model: results use it; choose another one.')
        if not label.strip() or not label.isprintable():
            raise ConfigurationError(f"{label!r} cannot be the label of a model; choose a short printable text.")


def check_drive(injector: Injector, study: Study, label: str) -> None:
    """Refuse an injector driven by a measured trace where the data hold no such trace.

    Raises
    ------
    ConfigurationError
        With the first such data set.
    """
    drive = injector.variant.drive
    if drive not in _TRACES:
        return
    for data in study.data:
        points = (data.point,) if isinstance(data, RateData) else data.points
        if study.injector.variant.drive is not drive or any(point.drive is None for point in points):
            raise ConfigurationError(
                f'{label}: the injector is driven by a {drive.value}, and the data set "{data.name}" has none; '
                "take a variant with regulated or pwm drive, or data with that trace."
            )


def _named_apart(studies: Sequence[Study]) -> tuple[RateData | QuantityData, ...]:
    count = Counter(data.name for study in studies for data in study.data)
    return tuple(
        replace(data, name=f"{data.name} (study {i})") if count[data.name] > 1 else data
        for i, study in enumerate(studies, start=1)
        for data in study.data
    )


def _score(
    label: str, injector: Injector, data: RateData | QuantityData, time_step: float, threads: int | None
) -> DataScore:
    try:
        return score_data(data, injector, time_step, threads)
    except CommonrailError as error:
        raise type(error)(f"{label} on {data.name}: {error}") from error


def _failures(injector: Injector, data: RateData | QuantityData, score: DataScore, time_step: float) -> list[Failure]:
    """Points without a number; only they are simulated again, for their status."""
    if isinstance(score, RateScore):
        points = [data.point] if isinstance(data, RateData) and not math.isfinite(score.j) else []
        return _judged(injector, points, time_step)
    assert isinstance(data, QuantityData)
    missing = np.isnan(score.quantity) & ~data.dead_time
    found = _judged(injector, [data.points[i] for i in np.flatnonzero(missing)], time_step)
    dead = np.flatnonzero(data.dead_time)[np.isnan(score.dead_time)]
    return found + [_failure(data.points[i], "NO_DEAD_TIME", _NOT_REACHED) for i in dead]


def _judged(injector: Injector, points: Sequence[OperatingPoint], time_step: float) -> list[Failure]:
    if not points:
        return []
    found = [Status(int(s)) for s in simulate_batch(injector, points, time_step=time_step).status[0]]
    return [_failure(point, s.name, s.sentence) for point, s in zip(points, found, strict=True)]


def _failure(point: OperatingPoint, status: str, sentence: str) -> Failure:
    pulses = point.pulses
    return Failure(point.initial_pressures()[0], pulses[0].duration if pulses else 0.0, status, sentence)


def _has_number(score: DataScore) -> bool:
    values = np.append(score.quantity, score.dead_time) if isinstance(score, QuantityScore) else score.rate
    return bool(np.isfinite(values).any())
