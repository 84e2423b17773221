"""The run folder of a reproduction: record, curves and truth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from commonrail.errors import InputError
from commonrail.files.atomic import write_text
from commonrail.files.record_file import read_record, write_record
from commonrail.files.sums import summed
from commonrail.files.traces_file import Curve, Trace, read_curves, write_traces
from commonrail.reproduction.repetition import LABELS, Repetition
from commonrail.reproduction.run import Reproduction

__all__ = ["RECORD", "read_reproduction", "write_reproduction"]

Traces = dict[int, dict[str, Trace]]

RECORD, TRACES, TRUTH = "reproduce.json", "traces.csv", "truth.toml"
EXPERIMENT = "experiment"
BEFORE = ("seed",)


def write_reproduction(folder: Path, reproduction: Reproduction, record: Mapping[str, Any]) -> None:
    """Write reproduce.json, traces.csv and truth.toml."""
    notes = (
        f"SYNTHETIC: {reproduction.bench.truth.synthetic}",
        "a row is the mean rate of one sample, whose middle is the time",
    )
    with summed(folder, RECORD, TRUTH, TRACES):
        write_record(folder / RECORD, record)
        write_text(folder / TRUTH, reproduction.bench.truth.text)
        write_traces(folder / TRACES, notes, (EXPERIMENT, *LABELS), _curves(reproduction.repetitions), BEFORE)


def _curves(repetitions: Iterable[Repetition]) -> Iterator[Curve]:
    for repetition in repetitions:
        for i, data in enumerate(repetition.data):
            rates = {label: repetition.rates[label][i] for label in LABELS}
            yield Curve(data.name, data.bounds, {EXPERIMENT: data.rate, **rates}, (str(repetition.seed),))


def read_reproduction(folder: Path) -> tuple[dict[str, Any], Traces]:
    """reproduce.json, and by seed and data set the arrays "time_s" and rates [m³/s] by column; NaN for an empty cell.

    Raises
    ------
    InputError
        If the folder was not left by ``commonrail reproduce``, or its files are broken.
    """
    try:
        record = read_record(folder / RECORD, "commonrail reproduce")
        columns = ("time_s", EXPERIMENT, *map(str, record["labels"]))
        traces: Traces = {}
        for (seed, data), trace in read_curves(folder / TRACES, EXPERIMENT, BEFORE).items():
            if set(trace) != set(columns):
                raise InputError(f"{TRACES} has other curves than {RECORD}")
            traces.setdefault(int(seed), {})[data] = {name: trace[name] for name in columns}
        return record, traces
    except (InputError, LookupError, TypeError, ValueError) as error:
        reason = str(error).removesuffix(".")
        raise InputError(
            f"{folder}: not a whole folder of commonrail reproduce ({reason}); reproduce again."
        ) from error
