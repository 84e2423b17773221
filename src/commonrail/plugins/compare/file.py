"""Record of a comparison, and the folder that it leaves: comparison.json and traces.csv."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.base.output import write_set, writing
from commonrail.calibration.result import data_records
from commonrail.data.records import MEASURED, record_head
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.plugins.compare.run import Comparison
from commonrail.runs.folder import TRACES, rate_curves, write_record
from commonrail.runs.traces import write_traces

RECORD = "comparison.json"


def comparison_record(
    comparison: Comparison, arguments: Mapping[str, str] | None = None, files: Sequence[str] = ()
) -> dict[str, Any]:
    """The comparison as one record that JSON can hold, SI units; what has no number is None.

    `arguments` are the texts that name the models on the command line, by label; `files` those of the studies.
    """
    models = comparison.models
    data = data_records(comparison.data, comparison.scores)
    for i, record in enumerate(data):
        record["failures"] = {label: [f._asdict() for f in failed[i]] for label, failed in comparison.failures.items()}
    title = f"Comparison of {len(models)} models" if len(models) > 3 else f"Comparison: {', '.join(models)}"
    return {
        **record_head("comparison", title, _synthetic(comparison)),
        "labels": {label: label for label in models},
        "models": [_model(label, model, (arguments or {}).get(label, "")) for label, model in models.items()],
        "differences": _differences(models),
        "studies": [
            {"title": study.title, "time_step": study.time_step, "file": files[i] if i < len(files) else ""}
            for i, study in enumerate(comparison.studies)
        ],
        "data": data,
    }


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
    differences = []
    for name, q in parameter_quantities().items():
        values = {label: model.values.get(name) for label, model in models.items()}
        if len(set(values.values())) > 1:
            differences.append({"name": name, "unit": q.unit, "meaning": q.meaning, "values": values})
    return differences


def write_comparison(folder: Path, comparison: Comparison, record: Mapping[str, Any]) -> None:
    """Write comparison.json and traces.csv; J of every curve can be computed again from the latter."""
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
