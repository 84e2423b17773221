"""Record of a comparison, and its files comparison.json and traces.csv."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

from commonrail.base.output import write_set, writing
from commonrail.base.record import Key, to_record
from commonrail.calibration.result import data_records
from commonrail.data.records import MEASURED, Record, record_head
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.plugins.compare.run import Comparison, Failure
from commonrail.runs.folder import TRACES, rate_curves, write_record
from commonrail.runs.traces import write_traces

RECORD = "comparison.json"


class ModelFacts(NamedTuple):
    """Model of a comparison; `argument` is its text on the command line."""

    label: str
    name: str
    title: str
    variant: str
    fuel: str
    synthetic: str
    argument: str = ""


class Difference(NamedTuple):
    """Parameter whose values [SI] by label differ; None for a model without it."""

    name: str
    unit: str
    meaning: str
    values: Mapping[str, float | None]


class StudyFacts(NamedTuple):
    """Study whose data are used; `time_step` [s]."""

    title: str
    time_step: float
    file: str = ""


class ComparedData(NamedTuple):
    """Record of a data set, as its kind of data has it, and the points without a number by label."""

    record: Annotated[Record, Key("")]
    failures: Mapping[str, tuple[Failure, ...]] = MappingProxyType({})

    @property
    def name(self) -> str:
        """Name of the data set."""
        return str(self.record["name"])


class ComparisonRecord(NamedTuple):
    """Record of a comparison."""

    title: str
    synthetic: str
    labels: Mapping[str, str]
    models: tuple[ModelFacts, ...]
    differences: tuple[Difference, ...]
    studies: tuple[StudyFacts, ...]
    data: tuple[ComparedData, ...]
    software: Mapping[str, str] = MappingProxyType({})

    @property
    def data_records(self) -> list[Record]:
        """Records of the data sets."""
        return [data.record for data in self.data]


def comparison_record(
    comparison: Comparison, arguments: Mapping[str, str] = MappingProxyType({}), files: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the comparison as a record for JSON, in SI units; missing numbers are None.

    `arguments`: texts of the models on the command line, by label; `files`: paths of the studies.
    """
    models, studies = comparison.models, comparison.studies
    title = f"Comparison of {len(models)} models" if len(models) > 3 else f"Comparison: {', '.join(models)}"
    # the injectors of the studies do not count
    texts = [m.synthetic for m in models.values()] + [d.synthetic for d in comparison.data]
    head = record_head("comparison", title, " ".join(dict.fromkeys(filter(None, texts))))
    record = ComparisonRecord(
        title=title,
        synthetic=head["synthetic"],
        labels={label: label for label in models},
        models=tuple(_model(label, model, arguments.get(label, "")) for label, model in models.items()),
        differences=_differences(models),
        studies=tuple(
            StudyFacts(study.title, study.time_step, files[i] if i < len(files) else "")
            for i, study in enumerate(studies)
        ),
        data=tuple(
            ComparedData(data, {label: failed[i] for label, failed in comparison.failures.items()})
            for i, data in enumerate(data_records(comparison.data, comparison.scores))
        ),
        software=head["software"],
    )
    return head | to_record(record._asdict())


def _model(label: str, injector: Injector, argument: str) -> ModelFacts:
    return ModelFacts(
        label=label,
        name=injector.name,
        title=injector.title,
        variant=injector.variant.label,
        fuel=injector.fuel.name,
        synthetic=injector.synthetic,
        argument=argument,
    )


def _differences(models: Mapping[str, Injector]) -> tuple[Difference, ...]:
    """Parameters whose values differ between the models."""
    differences = []
    for name, q in parameter_quantities().items():
        values = {label: model.values.get(name) for label, model in models.items()}
        if len(set(values.values())) > 1:
            differences.append(Difference(name, q.unit, q.meaning, values))
    return tuple(differences)


def write_comparison(folder: Path, comparison: Comparison, record: Mapping[str, Any]) -> None:
    """Write comparison.json and traces.csv; traces.csv suffices to compute J of every curve."""
    synthetic = record["synthetic"]
    notes = (
        record["title"],
        f"SYNTHETIC: {synthetic}" if synthetic else "measured data",
        "a row is the mean rate of one sample, whose middle is the time; J is the sum of |model - measured|",
    )
    curves = rate_curves(comparison.data, comparison.scores)
    with writing(folder), write_set(folder):
        write_record(folder / RECORD, record)
        write_traces(folder / TRACES, notes, (MEASURED, *comparison.models), curves)
