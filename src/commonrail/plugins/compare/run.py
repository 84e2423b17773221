"""Compare injectors on any data, without fitting."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import NamedTuple

from commonrail.base.arguments import instance, instances, mapping, thread_count
from commonrail.base.display import Shown
from commonrail.base.errors import CommonrailError, ConfigurationError
from commonrail.base.hooks import naming
from commonrail.calibration.scoring import check_drive
from commonrail.calibration.study import Study
from commonrail.cli.model_name import check_labels
from commonrail.data.base import DataSet, Missing, Score
from commonrail.data.metering import with_meters
from commonrail.data.simulator import Simulator
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.physics.meters import Meter


class Failure(NamedTuple):
    """A point without a number: rail pressure [Pa], energising time [s], name and meaning of the status."""

    rail_pressure: float
    energising_time: float
    status: str
    sentence: str


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Several injectors on several data sets.

    Attributes
    ----------
    models : dict of str to Injector
        By label.
    studies : tuple of Study
        Studies with the data.
    data : tuple of DataSet
        All data sets in order; "(study n)" is appended to a repeated name.
    scores : dict of str to tuple of Score
        Score on each data set, by label.
    failures : dict of str to tuple of tuple of Failure
        Points without a number, by label and data set.
    """

    presenter = "commonrail.plugins.compare.page:COMPARISON"

    models: dict[str, Injector]
    studies: tuple[Study, ...]
    data: tuple[DataSet, ...]
    scores: dict[str, tuple[Score, ...]]
    failures: dict[str, tuple[tuple[Failure, ...], ...]]

    @property
    def simulated(self) -> bool:
        """True if a point has a number."""
        pairs = (pair for failures in self.failures.values() for pair in zip(self.data, failures, strict=True))
        return any(len(failures) < len(data.points) for data, failures in pairs)


def compare(
    models: Mapping[str, Injector],
    studies: Study | Sequence[Study],
    *,
    threads: int | None = None,
    meters: Mapping[str, Sequence[Meter]] | None = None,
) -> Comparison:
    """Simulate every injector at every point of the data; roles, parameters and optimisers of the studies are ignored.

    Parameters
    ----------
    models : mapping of str to Injector
        One to eight injectors by their labels in tables and figures.
    studies : Study or sequence of Study
        Studies with the data.
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    meters : mapping of str to sequence of Meter, optional
        Calibrated meters of a model, by label: they replace the data's meters with the same names.

    Raises
    ------
    ConfigurationError
        If an argument has the wrong type, a label is not usable, models or studies are missing, there are too many
        models, or the drive of a model does not fit the data. A failed simulation does not raise: its point has no
        number, and `Comparison.failures` has the reason.
    """
    studies = (studies,) if isinstance(studies, Study) else _study_list(studies)
    threads = thread_count(threads)
    check_labels(list(mapping(models, "models", '{"first": injector}')))
    for label, injector in models.items():
        instance(injector, Injector, f'injector "{label}" of the models')
        for study in studies:
            check_drive(injector, study, label)
    data = _rename_duplicates(studies)
    study_of_data = [study for study in studies for _ in study.data]
    scores: dict[str, tuple[Score, ...]] = {}
    failures: dict[str, tuple[tuple[Failure, ...], ...]] = {}
    for number, (label, injector) in enumerate(models.items(), start=1):
        metered = with_meters(data, (meters or {}).get(label, ()))
        with naming(f"model {number} of {len(models)}"):
            scored = [
                _score(label, Simulator(injector, (), study.time_step, threads, same_bits=study.same_bits), d)
                for d, study in zip(metered, study_of_data, strict=True)
            ]
        scores[label], failures[label] = tuple(score for score, _ in scored), tuple(failed for _, failed in scored)
    return Comparison(dict(models), studies, data, scores, failures)


def _study_list(studies: Sequence[Study]) -> tuple[Study, ...]:
    if isinstance(studies, str | PathLike):
        instance(studies, Study, "studies")  # the error says how a study is loaded from a file
    items = instances(studies, Study, "studies")
    if not items:
        raise ConfigurationError("At least one study is needed: the models are compared on its data.")
    return items


def _rename_duplicates(studies: Sequence[Study]) -> tuple[DataSet, ...]:
    count = Counter(data.name for study in studies for data in study.data)
    return tuple(
        data.changed(name=f"{data.name} (study {i})") if count[data.name] > 1 else data
        for i, study in enumerate(studies, start=1)
        for data in study.data
    )


def _score(label: str, simulator: Simulator, data: DataSet) -> tuple[Score, tuple[Failure, ...]]:
    """Return the score, and the points without a number; failed points are simulated again for their status."""
    try:
        score = data.score(simulator)
    except CommonrailError as error:
        raise type(error)(f"{label} on {data.name}: {error}") from error
    missing = score.missing()
    failed = [m.point for m in missing if not m.status]
    statuses = (Status(int(status)) for status in (simulator.once(failed).status[0] if failed else ()))
    return score, tuple(_failure(m, statuses) for m in missing)


def _failure(missing: Missing, statuses: Iterator[Status]) -> Failure:
    pulses = missing.point.pulses
    point = missing.point.initial_pressures()[0], pulses[0].duration if pulses else 0.0
    if missing.status:
        return Failure(*point, missing.status, missing.sentence)
    status = next(statuses)
    return Failure(*point, status.name, status.sentence)
