"""A calibration as one JSON-able record: what the run folder keeps and the report reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from commonrail.base.record import to_record
from commonrail.base.text import number
from commonrail.calibration.objective import Loss
from commonrail.calibration.optimisers.registry import registered
from commonrail.calibration.record import ParameterRecord
from commonrail.calibration.run import Calibration
from commonrail.calibration.search import Searched, SearchResult
from commonrail.calibration.study import Method, Study
from commonrail.data.base import DataSet, Role, Score
from commonrail.data.metering import meter_records
from commonrail.data.records import JUDGED, LABELS, record_head
from commonrail.data.registry import of_role
from commonrail.physics.meters import known_quantity

CERTAINTY = "certainty"  # likelihood, intervals, tests and verdicts; `certainty` writes them again
CLOCK = "clock"  # holds what depends on the clock; all else is the same whenever and however often a study is run


def fit_record(kind: str, study: Searched, fit: SearchResult) -> dict[str, Any]:
    """The part of a record that all kinds of fit share; all that depends on the clock is under "clock"."""
    return {
        **record_head(kind, study.title, study.synthetic),
        "seed": study.seed,
        "status": fit.status,
        "reason": fit.reason,
        "optimiser": _optimiser(study.method),
        **({"convergence": fit.convergence.record()} if fit.convergence else {}),
        "objective": {"start": number(fit.start_cost), "best": number(fit.cost)},
        "evaluations": {
            "slots": fit.counts.slots,
            "simulated": fit.counts.simulated,
            "failed": fit.counts.failed,
            "injections": fit.simulations,
            "failures": dict(sorted(fit.failures.items())),
        },
        "generations": to_record(fit.history),
        CLOCK: {
            "seconds": fit.seconds,
            "simulations_per_second": fit.simulations / max(fit.seconds, 1e-9),
            "ended": datetime.now(UTC).isoformat(timespec="seconds"),
        },
    }


def result_record(calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Record of a calibration, with what `identify` says of each parameter."""
    study, bands = calibration.study, getattr(identified, "bands", {})
    return {
        **fit_record("calibration", study, calibration),
        "note": study.note,
        **({"author": study.author} if study.author else {}),
        **({"logo": study.logo} if study.logo else {}),
        **({"files": files} if (files := _files(study)) else {}),
        "time_step": study.time_step,
        "precision": study.precision.value,
        "same_bits": study.same_bits,
        "injector": {
            "name": study.injector.name,
            "title": study.injector.title,
            "variant": study.injector.variant.label,
        },
        "parameters": _parameters(calibration, identified),
        "constraints": list(study.space.labels),
        "labels": {label: text for label, text in LABELS.items() if label in calibration.scores},
        **({"loss": study.loss.value} if study.loss is not Loss.KINDS else {}),
        **({"loss_scale": study.loss_scale} if study.loss is Loss.SOFT_L1 else {}),
        **getattr(identified, "sections", {}),
        "data": [
            {**record, "band": bands[record["name"]]} if record["name"] in bands else record
            for record in data_records(study.data, calibration.scores)
        ],
        **meter_records(calibration.meters),
        "warnings": to_record(calibration.warnings),
        **({"start_warnings": to_record(calibration.start_warnings)} if calibration.start_warnings else {}),
    }


def _files(study: Study) -> list[dict[str, str]]:
    """Name and SHA-256 of each data file of the study; TOML files change where a run folder moves them."""
    data = sorted((path.name, digest) for path, digest in study.files.items() if path.suffix not in (".toml", ""))
    return [{"name": name, "sha256": digest} for name, digest in data]


def data_records(data: Sequence[DataSet], scores: Mapping[str, Sequence[Score]]) -> list[dict[str, Any]]:
    """One record for each data set, with the figures of every label in `scores`."""
    return [
        {"name": d.name, "role": d.role.value, "source": d.source, "synthetic": d.synthetic, "kind": d.kind}
        | ({} if d.meter is None else {"meter": d.meter.name})
        | d.record({label: set_scores[i] for label, set_scores in scores.items()})
        | _baselines(d, data, scores[JUDGED][i] if JUDGED in scores else None)
        for i, d in enumerate(data)
    ]


def _baselines(data_set: DataSet, data: Sequence[DataSet], score: Score | None) -> dict[str, Any]:
    """Trivial models beside the calibrated one on data that it was not fitted to, if there are any."""
    if score is None or data_set.role is not Role.VALIDATION:
        return {}
    baselines = score.baselines(of_role(data, Role.FIT))
    return {"baselines": baselines} if baselines else {}


def _parameters(calibration: Calibration, identified: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    records = []
    for p in calibration.study.space.parameters:
        best, quantity = calibration.best[p.name], known_quantity(p.name)
        record = ParameterRecord(
            name=p.name,
            unit=quantity.unit,
            meaning=quantity.meaning,
            reference=p.reference,
            lower=p.lower,
            upper=p.upper,
            best=best,
            mark=p.mark,
            source=p.source,
            position=p.position(best),
            at_bound=p.is_at_bound(best),
            prior=p.prior,
            pull=None if p.prior is None else p.prior.residual(best),
        )
        records.append(to_record(record) | dict(identified.get(p.name, {})))
    return records


def _optimiser(method: Method) -> dict[str, Any]:
    """Settings of the search, by the keys of a study file."""
    entry = registered(method.evolution)
    assert entry is not None  # Method has checked it
    settings = {name: list(v) if isinstance(v, tuple) else v for name, v in vars(method.evolution).items()}
    polish = {"polish": method.polish, "polish_iterations": method.polish_iterations}
    return {"method": entry.name, **settings, **polish, "stop_when_converged": method.stop_when_converged}
