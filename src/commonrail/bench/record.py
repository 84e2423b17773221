"""Record of a benchmark as tables for a person."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from statistics import median
from typing import Any, NamedTuple

__all__ = ["Grid", "grids", "sentences"]

Row = dict[str, Any]


class Grid(NamedTuple):
    """A table: title, heads, rows of texts; columns from `texts` on hold numbers."""

    title: str
    heads: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    texts: int = 1


def grids(record: Row) -> Iterator[Grid]:
    """The tables of those parts that were measured."""
    for key, make in _TABLES.items():
        if record.get(key):
            yield make(record[key])


def sentences(record: Row) -> list[str]:
    """What has to be said beside the tables: machine, how it was timed, what is missing, load, interruption."""
    machine = record["machine"]
    said = [
        f"{machine['processor']}, {machine['threads']} threads, {' '.join(machine['instruction_sets'])}.",
        f"{record['case']}. Times: {record['timing']}.",
        record["synthetic"],
    ]
    said += [f"{m['peer']} is not installed; `{m['install']}` installs it." for m in record["missing"]]
    said += record["notes"]
    if record["status"] == "interrupted":
        said.append("Interrupted: this is what was measured until then.")
    return said


def _methods(rows: Sequence[Row]) -> Grid:
    heads = ("method", "ms", "runs", "evaluations", "L1 error %", "volume error %", "times the first")
    made = [
        (
            row["method"],
            _number(1e3 * row["seconds"]),
            str(row["runs"]),
            str(row["evaluations"] or ""),
            _number(row["L1_percent"]),
            _number(row["volume_percent"]),
            _number(row["times_the_first"]),
        )
        for row in rows
    ]
    return Grid("One simulation", heads, made)


def _throughput(rows: Sequence[Row]) -> Grid:
    made = [
        (
            str(row["candidates"]),
            str(row["threads"]),
            row["precision"],
            _number(1e6 * row["time_step"]),
            _number(1e3 * row["seconds"]),
            _number(row["per_second"]),
            _number(row["L1_percent"]),
            _number(row["worst_L1_percent"]),
        )
        for row in rows
    ]
    heads = ("candidates", "threads", "precision", "step us", "ms", "per second", "L1 error %", "worst L1 error %")
    return Grid("Populations at one operating point", heads, made, 0)


def _searches(rows: Sequence[Row]) -> Grid:
    heads = ("optimiser", "package", "searches", "s, median", "simulations", "J, median", "J, worst")
    made = []
    for name, package in dict.fromkeys((row["optimiser"], row["package"]) for row in rows):
        own = [row for row in rows if (row["optimiser"], row["package"]) == (name, package)]
        found = [row["J"] if row["J"] is not None else float("inf") for row in own]
        made.append(
            (
                name,
                package,
                str(len(own)),
                _number(median(row["seconds"] for row in own)),
                f"{median(row['simulations'] for row in own):.0f}",
                f"{median(found):.2f}",
                f"{max(found):.2f}",
            )
        )
    return Grid("The paper's calibration, 50 members, 70 generations, on synthetic data", heads, made, 2)


def _extrapolated(rows: Sequence[Row]) -> Grid:
    made = [
        (row["optimiser"], str(row["measured_simulations"]), str(row["simulations"]), _number(row["seconds"]))
        for row in rows
    ]
    title = "The same by scalar solvers on one core: EXTRAPOLATED from the simulations measured"
    return Grid(title, ("optimiser", "measured", "of simulations", "s"), made)


def _curve(title: str, key: str, factor: float = 1.0) -> Callable[[Sequence[Row]], Grid]:
    def make(rows: Sequence[Row]) -> Grid:
        made = [
            (_number(factor * row[key]), _number(row["seconds"]), _number(row["per_second"]), str(row["threads"]))
            for row in rows
        ]
        return Grid(title, (title.lower(), "s", "simulations per second", "threads"), made, 0)

    return make


def _candidates(rows: Sequence[Row]) -> Grid:
    made = []
    for row in rows:
        if "failed" in row:
            made.append((str(row["candidates"]), row["failed"], "", ""))
            continue
        peak = "" if row["peak_bytes"] is None else _number(row["peak_bytes"] / 1e6)
        made.append((str(row["candidates"]), _number(row["seconds"]), _number(row["per_second"]), peak))
    return Grid("Candidates", ("candidates", "s", "per second", "greatest memory, MB"), made, 0)


def _number(value: float | None) -> str:
    if value is None:
        return "failed"
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


_TABLES: dict[str, Callable[[Sequence[Row]], Grid]] = {
    "methods": _methods,
    "throughput": _throughput,
    "searches": _searches,
    "extrapolated": _extrapolated,
    "points": _curve("Operating points", "points"),
    "horizon": _curve("Horizon ms", "horizon", 1e3),
    "threads": _curve("Threads", "threads"),
    "candidates": _candidates,
}
