"""Further searches of a study: with other seeds, and for cross-validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from commonrail.base.errors import SimulationError
from commonrail.base.text import number
from commonrail.base.units import to_text
from commonrail.calibration.run import Calibration, calibrate
from commonrail.calibration.study import NO_JUDGEMENT, Judgement, Study
from commonrail.data.base import DataSet, Role
from commonrail.data.quantities.baselines import interpolate_map
from commonrail.data.quantities.data import Fold, QuantityData, fold_record, levels, without
from commonrail.data.records import JUDGED, MEAN
from commonrail.data.registry import of_role

if TYPE_CHECKING:
    from commonrail.workers.workers import Workers

Note = Callable[[str], None]
Search = Callable[[Study], "Calibration | None"]

_UNITS = {"rail_pressure": "Pa", "energising_time": "s"}


class _StoppedError(Exception):
    """A stop of a further search by the user."""


def refits_of(
    calibration: Calibration, *, threads: int | None = None, workers: Workers | None = None, note: Note = lambda _: None
) -> dict[str, Any]:
    """Searches that the study's `judgement` asks for, as a JSON-able record; empty where it asks for none.

    "seeds" and "left_out"; "interrupted" is true if the user stopped before the last search. Nothing is searched if the
    calibration was interrupted. `note` is called before each search.
    """
    judgement: Judgement = calibration.study.judgement
    if not judgement.has_searches or calibration.status != "finished":
        return {}

    def search(study: Study) -> Calibration | None:
        try:
            refit = calibrate(study, threads=threads, workers=workers)
        except SimulationError:
            return None
        except KeyboardInterrupt:
            raise _StoppedError from None
        if refit.status != "finished":
            raise _StoppedError
        return refit

    record: dict[str, Any] = {"seeds": [_seed_record(calibration)] if judgement.seeds else [], "left_out": []}
    study = replace(calibration.study, judgement=NO_JUDGEMENT)
    try:
        for seed in range(study.seed + 1, study.seed + 1 + judgement.seeds):
            note(f"searching with seed {seed} ...")
            other = search(replace(study, seed=seed))
            record["seeds"].append({"seed": seed, "failed": True} if other is None else _seed_record(other))
        for by in judgement.leave_out:
            record["left_out"] += _left_out(study, by.value, search, note)
    except _StoppedError:
        record["interrupted"] = True
    return record


def _seed_record(calibration: Calibration) -> dict[str, Any]:
    """Objective, errors of the data sets and positions of the parameters that one seed has found."""
    scores = zip(calibration.study.data, calibration.scores["best"], strict=True)
    parameters = calibration.study.space.parameters
    return {
        "seed": calibration.study.seed,
        "objective": number(calibration.cost),
        "errors": {data.name: number(score.error) for data, score in scores},
        "error_heads": {data.name: " ".join(data.error_head) for data in calibration.study.data},
        "positions": {p.name: p.position(calibration.best[p.name]) for p in parameters},
    }


def _left_out(study: Study, by: str, search: Search, note: Note) -> list[dict[str, Any]]:
    """Cross-validation of all fitted maps: the rows at each value of `by` are held out in turn."""
    fitted = of_role(study.data, Role.FIT)
    maps = [data for data in fitted if isinstance(data, QuantityData)]
    folds: dict[str, list[Fold]] = {data.name: [] for data in maps}
    failed = []
    for value in sorted({level for data in maps for level in levels(data, by)}):
        text = to_text(value, _UNITS[by])
        splits = {data.name: split for data in maps if (split := without(data, by, value)) is not None}
        if not splits:
            continue
        note(f"searching without {text} ...")
        fit_data = [splits[data.name][0] if data.name in splits else data for data in fitted]
        held_out = [split[1] for split in splits.values()]
        other = search(replace(study, data=(*fit_data, *held_out)))
        if other is None:
            failed.append(text)
            continue
        _add(folds, splits, other, fit_data)
    records = [fold_record(data, folds[data.name]) for data in maps if folds[data.name]]
    return [{"by": by, "searches": len(folds[record["name"]]), "failed": failed, **record} for record in records]


def _add(folds: dict[str, list[Fold]], splits: dict[str, Any], refit: Calibration, fit_data: Sequence[DataSet]) -> None:
    """Note the scores of one search on the rows that it has not seen."""
    names = [data.name for data in refit.study.data]
    maps = [data for data in fit_data if isinstance(data, QuantityData)]
    for name, (_, held_out, rows) in splits.items():
        scores: dict[str, Any] = {
            label: set_scores[names.index(held_out.name)] for label, set_scores in refit.scores.items()
        }
        baseline = interpolate_map(held_out, [fit_map for fit_map in maps if fit_map.kind == held_out.kind])
        folds[name].append(Fold(rows, scores[JUDGED], baseline, scores.get(MEAN)))
