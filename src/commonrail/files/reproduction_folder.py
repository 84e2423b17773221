"""The run folder of a reproduction: record, curves and truth."""

from __future__ import annotations

import csv
import json
import math
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.files.atomic import replacing, write_text
from commonrail.files.csv_rows import check_count, check_row
from commonrail.files.record_file import read_record
from commonrail.files.traces_file import MOST_SETS, read_curve_rows
from commonrail.reproduction.repetition import LABELS, Repetition
from commonrail.reproduction.run import Reproduction

__all__ = ["read_reproduction", "write_reproduction"]

Floats = NDArray[np.float64]
Traces = dict[int, dict[str, dict[str, Floats]]]

RECORD, TRACES, TRUTH = "reproduce.json", "traces.csv", "truth.toml"
EXPERIMENT = "experiment"
_KEYS = ("seed", "data", "time [us]")


def write_reproduction(folder: Path, reproduction: Reproduction, record: Mapping[str, Any]) -> None:
    """Write reproduce.json, traces.csv and truth.toml."""
    text = json.dumps(record, indent=1, allow_nan=False)
    write_text(folder / RECORD, text + "\n")
    write_text(folder / TRUTH, reproduction.bench.truth.text)
    with replacing(folder / TRACES) as stream:
        stream.write(f"# SYNTHETIC: {' '.join(reproduction.bench.truth.synthetic.split())}\n")
        stream.write("# a row is the mean rate of one sample, whose middle is the time\n")
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*_KEYS, *(f"{column} [mm3/ms]" for column in (EXPERIMENT, *LABELS))])
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
        record = read_record(folder / RECORD, "commonrail reproduce")
        # the record's own labels: a folder of a former version has fewer models
        return record, _traces(folder / TRACES, (EXPERIMENT, *map(str, record["labels"])))
    except (InputError, LookupError, TypeError, ValueError) as error:
        reason = str(error).removesuffix(".")
        raise InputError(
            f"{folder}: not a whole folder of commonrail reproduce ({reason}); reproduce again."
        ) from error


def _traces(path: Path, columns: Sequence[str]) -> Traces:
    lists: dict[tuple[int, str], array[float]] = {}
    rows = read_curve_rows(path)
    next(rows, None)
    for count, (line, cells) in enumerate(rows, start=1):
        check_row(path, line, cells, len(_KEYS) + len(columns))
        check_count(path, line, count)
        seed, data, moment, *values = cells
        found = [1e-6 * float(text) if text else math.nan for text in (moment, *values)]
        lists.setdefault((int(seed), data), array("d")).extend(found)
        if len(lists) > MOST_SETS:
            raise InputError(f"{path}, line {line}: the file has more than the {MOST_SETS} curves that are read.")
    traces: Traces = {}
    for (number, data), found_values in lists.items():
        traces.setdefault(number, {})[data] = _trace(found_values, columns)
    return traces


def _trace(values: array[float], columns: Sequence[str]) -> dict[str, Floats]:
    table = np.array(values).reshape(-1, 1 + len(columns)).T
    return dict(zip(("time_s", *columns), table, strict=True))
