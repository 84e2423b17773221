"""The run folder of a reproduction: record, curves and truth."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from itertools import dropwhile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.files.atomic import replacing, write_text
from commonrail.reproduction.repetition import LABELS, Repetition
from commonrail.reproduction.run import Reproduction

__all__ = ["read_reproduction", "write_reproduction"]

Floats = NDArray[np.float64]
Traces = dict[int, dict[str, dict[str, Floats]]]

RECORD, TRACES, TRUTH = "reproduce.json", "traces.csv", "truth.toml"
EXPERIMENT = "experiment"
_COLUMNS = (EXPERIMENT, *LABELS)


def write_reproduction(folder: Path, reproduction: Reproduction, record: Mapping[str, Any]) -> None:
    """Write reproduce.json, traces.csv and truth.toml."""
    text = json.dumps(record, indent=1, allow_nan=False)
    write_text(folder / RECORD, text + "\n")
    write_text(folder / TRUTH, reproduction.bench.truth.text)
    with replacing(folder / TRACES) as stream:
        stream.write(f"# SYNTHETIC: {' '.join(reproduction.bench.truth.synthetic.split())}\n")
        stream.write("# a row is the mean rate of one sample, whose middle is the time\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["seed", "data", "time [us]", *(f"{column} [mm3/ms]" for column in _COLUMNS)])
        for repetition in reproduction.repetitions:
            writer.writerows(_rows(repetition))


def _rows(repetition: Repetition) -> list[list[str]]:
    rows = []
    for i, data in enumerate(repetition.data):
        middles = 0.5 * (data.bounds[1:] + data.bounds[:-1])
        rates = [data.rate, *(repetition.rates[label][i] for label in LABELS)]
        # repr: J of a data set can be recomputed from the file to the last digits
        for moment, *values in zip(middles * 1e6, *(1e6 * rate for rate in rates), strict=True):
            texts = [repr(float(v)) if np.isfinite(v) else "" for v in values]
            rows.append([str(repetition.seed), data.name, repr(round(float(moment), 6)), *texts])
    return rows


def read_reproduction(folder: Path) -> tuple[dict[str, Any], Traces]:
    """reproduce.json, and by seed and data set the arrays "time_s" and rates [m³/s] by column; NaN for an empty cell.

    Raises
    ------
    InputError
        If the folder was not left by ``commonrail reproduce``, or its files are broken.
    """
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        with (folder / TRACES).open(encoding="utf-8", newline="") as stream:
            rows = list(csv.reader(dropwhile(lambda line: line.startswith("#"), stream)))
        return record, _traces(rows)
    except (OSError, ValueError, LookupError, RecursionError) as error:
        raise InputError(
            f"{folder}: not a whole folder of commonrail reproduce ({type(error).__name__}: {error}); reproduce again."
        ) from error


def _traces(rows: list[list[str]]) -> Traces:
    lists: dict[int, dict[str, dict[str, list[float]]]] = {}
    for seed, data, moment, *values in rows[1:]:
        trace = lists.setdefault(int(seed), {}).setdefault(data, {key: [] for key in ("time_s", *_COLUMNS)})
        trace["time_s"].append(1e-6 * float(moment))
        for column, text in zip(_COLUMNS, values, strict=True):
            trace[column].append(1e-6 * float(text) if text else float("nan"))
    return {seed: {d: {k: np.array(v) for k, v in t.items()} for d, t in sets.items()} for seed, sets in lists.items()}
