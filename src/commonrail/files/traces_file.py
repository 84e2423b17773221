"""traces.csv of a run folder: injection curves of the data and of every model, sample by sample."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import dropwhile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.errors import InputError
from commonrail.files.atomic import replacing
from commonrail.files.csv_rows import LARGEST_FILE, check_count, check_header, check_row, parse_cells
from commonrail.files.tables import LONGEST_NUMBER
from commonrail.files.text_file import read_lines
from commonrail.kinds.records import MEASURED, MM3_PER_MS

__all__ = ["Curve", "Traces", "read_curve_rows", "read_traces", "write_traces"]

Floats = NDArray[np.float64]
Traces = dict[str, dict[str, Floats]]

TIME = "time_s"
MOST_COLUMNS = 20  # eight models, the data and what names them
MOST_SETS = 1000  # curves

_KEYS = ("data", "time [us]")
_UNIT = " [mm3/ms]"


class Curve(NamedTuple):
    """A data set: its name, bounds of the samples (n + 1,) [s], and rates (n,) [m³/s] by label, the data's included."""

    data: str
    bounds: Floats
    rates: Mapping[str, Floats]


def write_traces(path: Path, notes: Iterable[str], labels: Sequence[str], curves: Iterable[Curve]) -> None:
    """Write curves under comment lines; what a curve does not have, or is not finite, stays empty.

    The digits are those of the numbers themselves: J can be computed again from the file.
    """
    with replacing(path) as stream:
        stream.writelines(f"# {' '.join(note.split())}\n" for note in notes)
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([*_KEYS, *(label + _UNIT for label in labels)])
        for curve in curves:
            writer.writerows(_rows(curve, labels))


def _rows(curve: Curve, labels: Sequence[str]) -> Iterator[list[str]]:
    middles = 0.5e6 * (curve.bounds[1:] + curve.bounds[:-1])
    for i, moment in enumerate(middles):
        rates = (float(curve.rates[label][i]) if label in curve.rates else math.nan for label in labels)
        texts = (repr(rate * MM3_PER_MS) if math.isfinite(rate) else "" for rate in rates)
        yield [curve.data, repr(round(float(moment), 6)), *texts]  # 1e-6 us: below any clock


def read_traces(path: Path) -> Traces:
    """By data set the arrays "time_s" [s] and rates [m³/s] by label; NaN where a simulation has no number.

    A label without any number for a data set is left out there.

    Raises
    ------
    InputError
        If the file cannot be read, or a row in it is not one of such a file; the message has the line.
    """
    rows = read_curve_rows(path)
    _, header = next(rows, (0, []))
    labels = [cell.removesuffix(_UNIT) for cell in header[len(_KEYS) :]]
    whole = all(cell.endswith(_UNIT) for cell in header[len(_KEYS) :]) and len({*labels}) == len(labels)
    if tuple(header[: len(_KEYS)]) != _KEYS or MEASURED not in labels or not whole:
        raise InputError(f'{path}: the header is not that of curves, "data,time [us],{MEASURED}{_UNIT},…".')
    check_header(path, header)
    if len(header) > MOST_COLUMNS:
        raise InputError(f"{path}: the header has {len(header)} columns, and at most {MOST_COLUMNS} are read.")
    lists: dict[str, array[float]] = {}
    for count, (line, cells) in enumerate(rows, start=1):
        check_row(path, line, cells, len(header))
        check_count(path, line, count)
        where = f"{path}, line {line}"
        values = [_number(text, column, where) for text, column in zip(cells[1:], header[1:], strict=True)]
        lists.setdefault(cells[0], array("d")).extend(values)
        if len(lists) > MOST_SETS:
            raise InputError(f"{where}: the file has more than the {MOST_SETS} data sets that are read.")
    return {name: _trace(np.array(values).reshape(-1, len(header) - 1), labels) for name, values in lists.items()}


def read_curve_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Rows of a file of curves, header first, and the line on which each begins; comments stand only before the header.

    Raises
    ------
    InputError
        If the file or a row cannot be read.
    """
    lines = enumerate(read_lines(path, LARGEST_FILE), start=1)
    counting = dropwhile(lambda line: line[1].startswith("#"), lines)
    rows = parse_cells(path, counting, ",", trimmed=False)
    return ((line, cells) for line, cells in rows if cells)


def _number(text: str, column: str, where: str) -> float:
    """A finite number, or NaN for an empty cell of a model."""
    needed = column in (_KEYS[1], MEASURED + _UNIT)
    if not needed and text in ("", "nan"):  # "nan": files of early versions
        return math.nan
    try:
        value = float(text) if len(text) <= LONGEST_NUMBER else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f'{where}, column "{column}": "{text[:40]}" is not a finite number.')
    return value


def _trace(values: Floats, labels: Sequence[str]) -> dict[str, Floats]:
    rates = {label: values[:, 1 + i] / MM3_PER_MS for i, label in enumerate(labels)}
    found = {label: rate for label, rate in rates.items() if np.isfinite(rate).any()}
    return {TIME: 1e-6 * values[:, 0], **found}
