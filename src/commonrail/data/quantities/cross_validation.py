"""A quantity map whose rows are held out in turn, and predicted by fits to the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arrays import Bools
from commonrail.data.base import Role
from commonrail.data.quantities.baselines import Interpolated, baseline_record, places_of, sister_baseline
from commonrail.data.quantities.data import QuantityData, QuantityScore, chosen_rows, held_out_name, rows_of

_COLUMNS = {"rail_pressure": 0, "energising_time": 1}


class Fold(NamedTuple):
    """Rows (n,) of a map that were left out, and scores on them: of the model, its interpolation, its members' mean."""

    rows: Bools
    model: QuantityScore
    baseline: Interpolated | None
    mean: QuantityScore | None = None


def levels(data: QuantityData, by: str) -> list[float]:
    """Rail pressures [Pa] or energising times [s] of the quantities of a map, in rising order."""
    return sorted(set(places_of(data)[data.judged, _COLUMNS[by]].tolist()))


def without(data: QuantityData, by: str, value: float) -> tuple[QuantityData, QuantityData, Bools] | None:
    """Map without the rows at a value, those rows as data of validation, and their mask; None where it is all or none.

    Dead times are left out `by` their rail pressure alone, not by "energising_time". `value`: [Pa] or
    [s].
    """
    rows = rows_of(data, _COLUMNS[by], value)
    if by == "energising_time":
        rows = rows & data.judged
    if not (rows & data.judged).any() or not (~rows & data.judged).any():
        return None
    return chosen_rows(data, ~rows), chosen_rows(data, rows, held_out_name(data.name), Role.VALIDATION), rows


def folded_record(data: QuantityData, folds: Sequence[Fold]) -> dict[str, Any]:
    """JSON-able figures of the predictions of all rows that were held out, each by the fit that did not see it."""
    rows = np.any([fold.rows for fold in folds], axis=0)
    part = chosen_rows(data, rows)
    model = _joined(data, rows, [(fold.rows, fold.model) for fold in folds])
    record: dict[str, Any] = {"name": data.name, "values": int(part.judged.sum()), "figures": model.figures}
    means = [(fold.rows, fold.mean) for fold in folds if fold.mean is not None]
    if len(means) == len(folds):
        record["mean"] = _joined(data, rows, means).figures
    found = [sister_baseline(model)]
    others = [(fold.rows, fold.baseline) for fold in folds if fold.baseline is not None]
    if len(others) == len(folds):
        baseline = _joined(data, rows, others)
        beyond = sum(one.extrapolated for _, one in others)
        text = "interpolating the other points"
        found.insert(0, baseline_record(model, baseline, text=text, extrapolated=beyond))
    record["baselines"] = [one for one in found if one]
    return record


def _joined(
    data: QuantityData, kept: Bools, parts: Sequence[tuple[Bools, QuantityScore | Interpolated]]
) -> QuantityScore:
    """Score of the kept rows from predictions of their parts."""
    quantity, dead_time = np.full((2, len(kept)), np.nan)
    for rows, score in parts:
        quantity[rows] = score.values
        dead_time[rows & data.dead_time] = score.dead_time
    return QuantityScore(chosen_rows(data, kept), quantity[kept], dead_time[kept & data.dead_time])
