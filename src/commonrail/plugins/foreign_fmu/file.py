"""Calibration of an FMU as a JSON-able record, for the run folder and the report."""

from __future__ import annotations

from typing import Any

import numpy as np

from commonrail.base.text import number
from commonrail.calibration.result import fit_record
from commonrail.plugins.foreign_fmu.data import FmuData
from commonrail.plugins.foreign_fmu.fit import FmuFit
from commonrail.plugins.foreign_fmu.fmu import FmuStatus

KIND = "fmu calibration"
LABELS = ("start", "best")


def fmu_record(fit: FmuFit) -> dict[str, Any]:
    """Record of a calibration: parameters, data with simulated values, failures with messages of the FMU."""
    study, record = fit.study, fit_record(KIND, fit.study, fit)
    counts = record["evaluations"]
    return record | {
        "note": study.note,
        "notes": list(study.notes),
        "fmu": {"name": study.fmu.name, "version": study.fmu.version, "sha256": study.fmu.digest},
        "step": study.step,
        "parameters": _parameters(fit),
        "data": [_data(fit, data) for data in study.data],
        "evaluations": counts | {"simulations": counts.pop("injections"), "failures": _failures(fit)},
        "messages": dict(fit.messages),  # of the last session, which may not have met all failures
    }


def _parameters(fit: FmuFit) -> list[dict[str, Any]]:
    variables = fit.study.fmu.variables
    return [
        {
            "name": p.name,
            "unit": variables[p.name].unit,
            "meaning": variables[p.name].description,
            "start": p.reference,
            "best": fit.best[p.name],
            "lower": p.lower,
            "upper": p.upper,
            "at_bound": p.is_at_bound(fit.best[p.name]),
            "mark": p.mark,
            "source": p.source,
            "standard_error": fit.estimates[p.name]["standard_error"],
            "verdict": fit.estimates[p.name]["verdict"],
        }
        for p in fit.study.space.parameters
    ]


def _failures(fit: FmuFit) -> list[dict[str, Any]]:
    return [
        {"status": name, "count": count, "sentence": FmuStatus[name.upper()].sentence}
        for name, count in fit.failures.items()
    ]


def _data(fit: FmuFit, data: FmuData) -> dict[str, Any]:
    values = {label: fit.simulated[label][data.name] for label in LABELS}
    rms = {label: number(np.sqrt(np.mean(data.residuals(simulated) ** 2))) for label, simulated in values.items()}
    largest = {label: number(np.max(np.abs(data.residuals(simulated)))) for label, simulated in values.items()}
    return {
        "name": data.name,
        "role": data.role.value,
        "weight": data.weight,
        "source": data.source,
        "synthetic": data.synthetic,
        "values": len(data.measured),
        "simulations": len(data.runs),
        "rms": rms,
        "largest": largest,
        **({"half_step": number(fit.step_effect[data.name])} if fit.step_effect else {}),
        "outputs": _outputs(fit, data),
    }


def _outputs(fit: FmuFit, data: FmuData) -> list[dict[str, Any]]:
    """Courses, or values by number of the simulation if only the ends are compared."""
    names, count = data.runs[0].outputs, len(data.runs[0].times)
    parts = {"measured": data.measured, **{label: fit.simulated[label][data.name] for label in LABELS}}
    shaped = {label: array.reshape(len(data.runs), len(names), count) for label, array in parts.items()}
    tolerances = data.tolerances.reshape(len(data.runs), len(names), count)
    single = len(data.runs) == 1
    return [
        {
            "variable": name,
            "unit": fit.study.fmu.variables[name].unit,
            "tolerance": float(tolerances[0, k, 0]),
            "axis": "time" if single else "row",
            "at": data.runs[0].times.tolist() if single else list(range(1, len(data.runs) + 1)),
            **{label: [number(v) for v in array[:, k, :].ravel()] for label, array in shaped.items()},
        }
        for k, name in enumerate(names)
    ]
