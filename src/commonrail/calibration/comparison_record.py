"""A comparison as one JSON-able record: what its folder keeps and its report reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from commonrail.calibration.comparison import Comparison
from commonrail.calibration.result import SCHEMA, data_records
from commonrail.compile_target import describe, package_versions
from commonrail.injector.definition import Injector, parameter_quantities

__all__ = ["comparison_record"]


def comparison_record(
    comparison: Comparison, arguments: Mapping[str, str] | None = None, files: Sequence[str] = ()
) -> dict[str, Any]:
    """The comparison as one record, SI units; what has no number is None.

    Parameters
    ----------
    comparison : Comparison
    arguments : mapping of str to str, optional
        By label, the text that names the model on the command line.
    files : sequence of str, optional
        File of each study.
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
