"""Any injectors beside one another on any data: nothing is fitted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Any, NamedTuple

from commonrail.base.arguments import instance, instances, mapping, thread_count
from commonrail.base.display import Shown
from commonrail.base.errors import CommonrailError, ConfigurationError
from commonrail.calibration.result import SCHEMA, data_records
from commonrail.calibration.scoring import check_drive
from commonrail.calibration.study import Study
from commonrail.compiler.target import describe, package_versions
from commonrail.data.base import DataSet, Missing, Score
from commonrail.data.metering import with_meters
from commonrail.data.simulator import Simulator
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.physics.meters import Meter
from commonrail.runs.model_name import check_labels


class Failure(NamedTuple):
    """A point without a number: rail pressure [Pa], energising time [s], name of the status, and what it means."""

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
        Whose data were used.
    data : tuple of DataSet
        All data sets in order; one whose name occurs twice has "(study n)" behind it.
    scores : dict of str to tuple of Score
        By label, one for each data set.
    failures : dict of str to tuple of tuple of Failure
        By label and data set, the points that have no number.
    """

    presenter = "commonrail.report.notebook:COMPARISON"

    models: dict[str, Injector]
    studies: tuple[Study, ...]
    data: tuple[DataSet, ...]
    scores: dict[str, tuple[Score, ...]]
    failures: dict[str, tuple[tuple[Failure, ...], ...]]

    @property
    def simulated(self) -> bool:
        """Return whether there is any number at all."""
        failed = (zip(self.data, found, strict=True) for found in self.failures.values())
        return any(len(points) < len(data.points) for pairs in failed for data, points in pairs)


def compare(
    models: Mapping[str, Injector],
    studies: Study | Sequence[Study],
    *,
    threads: int | None = None,
    meters: Mapping[str, Sequence[Meter]] | None = None,
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
    meters : mapping of str to sequence of Meter, optional
        By label, meters that the model was calibrated with: they replace those of the data with the same names.

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
    origins = [study for study in studies for _ in study.data]
    scores: dict[str, tuple[Score, ...]] = {}
    failures: dict[str, tuple[tuple[Failure, ...], ...]] = {}
    for label, injector in models.items():
        seen = with_meters(data, (meters or {}).get(label, ()))
        judged = [
            _judged(label, Simulator(injector, (), study.time_step, threads, same_bits=study.same_bits), d)
            for d, study in zip(seen, origins, strict=True)
        ]
        scores[label], failures[label] = tuple(score for score, _ in judged), tuple(failed for _, failed in judged)
    return Comparison(dict(models), studies, data, scores, failures)


def _several(studies: Sequence[Study]) -> tuple[Study, ...]:
    if isinstance(studies, str | PathLike):
        instance(studies, Study, "studies")
    found = instances(studies, Study, "studies")
    if not found:
        raise ConfigurationError("The studies must be at least one; its data are what the models are compared on.")
    return found


def _named_apart(studies: Sequence[Study]) -> tuple[DataSet, ...]:
    count = Counter(data.name for study in studies for data in study.data)
    return tuple(
        data.changed(name=f"{data.name} (study {i})") if count[data.name] > 1 else data
        for i, study in enumerate(studies, start=1)
        for data in study.data
    )


def _judged(label: str, simulator: Simulator, data: DataSet) -> tuple[Score, tuple[Failure, ...]]:
    """Score, and the points without a number; those that failed are simulated again, for their status."""
    try:
        score = data.score(simulator)
    except CommonrailError as error:
        raise type(error)(f"{label} on {data.name}: {error}") from error
    missing = score.missing()
    failed = [m.point for m in missing if not m.status]
    found = (Status(int(status)) for status in (simulator.once(failed).status[0] if failed else ()))
    return score, tuple(_failure(m, found) for m in missing)


def _failure(missing: Missing, statuses: Iterator[Status]) -> Failure:
    pulses = missing.point.pulses
    place = missing.point.initial_pressures()[0], pulses[0].duration if pulses else 0.0
    if missing.status:
        return Failure(*place, missing.status, missing.sentence)
    status = next(statuses)
    return Failure(*place, status.name, status.sentence)


# A comparison as one JSON-able record: what its folder keeps and its report reads.


def comparison_record(
    comparison: Comparison, arguments: Mapping[str, str] | None = None, files: Sequence[str] = ()
) -> dict[str, Any]:
    """The comparison as one record, SI units; what has no number is None.

    `arguments` are the texts that name the models on the command line, by label; `files` those of the studies.
    """
    models = comparison.models
    data = data_records(comparison.data, comparison.scores)
    for i, record in enumerate(data):
        record["failures"] = {label: [f._asdict() for f in found[i]] for label, found in comparison.failures.items()}
    return {
        "schema": SCHEMA,
        "kind": "comparison",
        "software": package_versions(),
        "target": describe().machine,
        "title": _title(list(models)),
        "synthetic": _synthetic(comparison),
        "labels": {label: label for label in models},
        "models": [_model(label, model, (arguments or {}).get(label, "")) for label, model in models.items()],
        "differences": _differences(models),
        "studies": [
            {"title": study.title, "time_step": study.time_step, "file": files[i] if i < len(files) else ""}
            for i, study in enumerate(comparison.studies)
        ],
        "data": data,
    }


def _title(labels: Sequence[str]) -> str:
    if len(labels) > 3:
        return f"Comparison of {len(labels)} models"
    return f"Comparison: {', '.join(labels)}"


def _synthetic(comparison: Comparison) -> str:
    """Synthetic parts of the models and of the data; the injectors of the studies are not considered."""
    texts = [m.synthetic for m in comparison.models.values()] + [d.synthetic for d in comparison.data]
    return " ".join(dict.fromkeys(text for text in texts if text))


def _model(label: str, injector: Injector, argument: str) -> dict[str, str]:
    return {
        "label": label,
        "name": injector.name,
        "title": injector.title,
        "variant": injector.variant.label,
        "fuel": injector.fuel.name,
        "synthetic": injector.synthetic,
        "argument": argument,
    }


def _differences(models: Mapping[str, Injector]) -> list[dict[str, Any]]:
    """Parameters whose value is not the same in all the models."""
    found = []
    for name, q in parameter_quantities().items():
        values = {label: model.values.get(name) for label, model in models.items()}
        if len(set(values.values())) > 1:
            found.append({"name": name, "unit": q.unit, "meaning": q.meaning, "values": values})
    return found
