"""Record of a benchmark as tables and sentences for a person."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

__all__ = ["TABLES", "Columns", "Grid", "Make", "column", "grids", "number", "sentences", "tabulated", "words"]

Row = dict[str, Any]
Columns = tuple[tuple[str, Callable[[Row], str]], ...]  # head, and a row's text below it


class Grid(NamedTuple):
    """A table: title, heads, rows of texts; columns from `texts` on hold numbers."""

    title: str
    heads: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    texts: int = 1


Make = Callable[[Sequence[Row]], Grid]


def number(value: float | None) -> str:
    """Three digits, whole numbers from a thousand."""
    if value is None:
        return "failed"
    return f"{value:,.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def column(key: str, factor: float = 1.0) -> Callable[[Row], str]:
    """Numbers of a key, times a factor."""
    return lambda row: number(None if row[key] is None else factor * row[key])


def words(key: str) -> Callable[[Row], str]:
    """Texts of a key."""
    return lambda row: str(row[key])


def tabulated(title: str, columns: Columns, texts: int = 1) -> Make:
    """Table with a line for each row of a record.

    Parameters
    ----------
    title : str
    columns : sequence of (head, function of a row)
    texts : int
        Number of first columns that hold words.
    """
    heads, cells = zip(*columns, strict=True)
    return lambda rows: Grid(title, heads, [tuple(cell(row) for cell in cells) for row in rows], texts)


def grids(record: Row, tables: Mapping[str, Make] | None = None) -> Iterator[Grid]:
    """Tables of those parts that were measured; `tables` by default are those of commonrail's own methods."""
    for key, make in (TABLES if tables is None else tables).items():
        if record.get(key):
            yield make(record[key])


def sentences(record: Row) -> list[str]:
    """Notes beside the tables: machine, how it was timed, what is missing, load, interruption."""
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


_METHODS: Columns = (
    ("method", words("method")),
    ("ms", column("seconds", 1e3)),
    ("runs", words("runs")),
    ("evaluations", lambda row: str(row["evaluations"] or "")),
    ("L1 error %", column("L1_percent")),
    ("volume error %", column("volume_percent")),
    ("times the first", column("times_the_first")),
)
_THROUGHPUT: Columns = (
    ("candidates", words("candidates")),
    ("threads", words("threads")),
    ("precision", words("precision")),
    ("step us", column("time_step", 1e6)),
    ("ms", column("seconds", 1e3)),
    ("per second", column("per_second")),
    ("L1 error %", column("L1_percent")),
    ("worst L1 error %", column("worst_L1_percent")),
)


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
                number(median(row["seconds"] for row in own)),
                f"{median(row['simulations'] for row in own):.0f}",
                f"{median(found):.2f}",
                f"{max(found):.2f}",
            )
        )
    return Grid("The paper's calibration, 50 members, 70 generations, on synthetic data", heads, made, 2)


TABLES: dict[str, Make] = {
    "methods": tabulated("One simulation", _METHODS),
    "throughput": tabulated("Populations at one operating point", _THROUGHPUT, 0),
    "searches": _searches,
}
