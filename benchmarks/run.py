"""The benchmark stage by stage, into one record that is complete as far as it got, and its tables and sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from statistics import median
from typing import Any, NamedTuple

from benchmarks.accuracy import find_truth
from benchmarks.case import CASE, injector
from benchmarks.methods import Method, measure_methods, own_methods
from benchmarks.searches import OWN, Optimiser, measure_search
from benchmarks.throughput import COUNTS, TIME_STEPS, measure_throughput
from benchmarks.timing import Effort
from commonrail.base.choices import Precision
from commonrail.engine.threads import usable_threads
from commonrail.plugins.doctor.run import busy, load, machine

SEEDS = (1, 2, 3, 4, 5)
LOAD_NOTE = (
    "The machine was busy with other work (a load of {load:.1f} or more on {threads} threads): "
    "times are too long, and ratios of them uncertain."
)


class Stage(NamedTuple):
    """A list of rows in the record: its title, number of rows and their source."""

    key: str
    title: str
    rows: int
    measure: Callable[[], Iterator[dict[str, Any]]]


def effort(quick: bool) -> Effort:
    """Length of each timing."""
    return Effort(3, 0.3) if quick else Effort(100, 2.0)


def run_bench(
    planned: Sequence[Stage],
    tell: Callable[[str, int, int], None] | None = None,
    *,
    options: dict[str, bool],
    missing: Sequence[dict[str, str]] = (),
) -> dict[str, Any]:
    """Measure the planned stages; returns the JSON-able record, in which the options are kept.

    `tell` receives title, rows done and rows in all after every row. `missing` lists peers that are not installed
    ("peer") and their installation ("install"). The status is "interrupted" if Ctrl-C ended it; the record has the rows
    measured until then.
    """
    threads, before = usable_threads(), load()
    others = before or 0.0  # greatest load that is not the benchmark's own
    record: dict[str, Any] = {
        "schema": 1,
        "kind": "bench",
        "status": "finished",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "options": options,
        "case": CASE,
        "synthetic": f"SYNTHETIC: {injector().synthetic} The curve of the searches is the virtual test bench's.",
        "timing": "wall time, the shortest of several runs after one that is not counted; processor time too",
        "machine": machine(),
        "missing": list(missing),
    }
    try:
        for stage in planned:
            rows = record.setdefault(stage.key, [])
            if tell:
                tell(stage.title, 0, stage.rows)
            for row in stage.measure():
                rows.append(row)
                others = max(others, (load() or 0.0) - threads)
                if tell:
                    tell(stage.title, len(rows), stage.rows)
    except KeyboardInterrupt:
        record["status"] = "interrupted"
    record["load"] = {"before": before, "after": load(), "others_at_least": others}
    record["notes"] = [LOAD_NOTE.format(load=others, threads=threads)] if busy(others, threads) else []
    return record


def stages(quick: bool, methods: Sequence[Method] = (), optimisers: Sequence[Optimiser] = ()) -> list[Stage]:
    """Stages of commonrail's own methods in order, then of other methods and optimisers.

    `quick` are shorter timings and fewer rows.
    """
    methods = [*own_methods(quick), *methods]
    optimisers = [OWN, *optimisers]
    seeds = SEEDS[:1] if quick else SEEDS
    truths: list[dict[str, Any]] = []

    def judged() -> Iterator[dict[str, Any]]:
        truth = find_truth()
        truths.append(truth.record())
        yield from measure_methods(methods, truth, effort(quick))

    populations = len(Precision) * len(TIME_STEPS) * len(COUNTS) * len({1, usable_threads()})
    return [
        Stage("methods", "one simulation by every method", len(methods), judged),
        Stage("truth", "the reference they are judged by", 1, lambda: iter(truths)),
        Stage("throughput", "populations", populations, lambda: measure_throughput(effort(quick))),
        Stage(
            "searches",
            "the paper's calibration",
            len(optimisers) * len(seeds),
            lambda: (measure_search(o, seed) for seed in seeds for o in optimisers),
        ),
    ]


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


def make_table(title: str, columns: Columns, texts: int = 1) -> Make:
    """Table with a line for each row of a record; its first `texts` columns hold words."""
    heads, cells = zip(*columns, strict=True)
    return lambda rows: Grid(title, heads, [tuple(cell(row) for cell in cells) for row in rows], texts)


def grids(record: Row, tables: Mapping[str, Make] | None = None) -> Iterator[Grid]:
    """Tables of those parts that were measured; `tables` by default are those of commonrail's own methods."""
    for key, make in (TABLES if tables is None else tables).items():
        if record.get(key):
            yield make(record[key])


def sentences(record: Row) -> list[str]:
    """Notes on the tables: machine, timing, missing peers, load, interruption."""
    machine = record["machine"]
    said = [
        f"{machine['processor']}, {machine['threads']} threads, {' '.join(machine['instruction_sets'])}.",
        f"{record['case']}. Times: {record['timing']}.",
        record["synthetic"],
    ]
    said += [f"{m['peer']} is not installed; `{m['install']}` installs it." for m in record["missing"]]
    said += record["notes"]
    if record["status"] == "interrupted":
        said.append("Interrupted: the rows measured until then.")
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
    lines = []
    for name, package in dict.fromkeys((row["optimiser"], row["package"]) for row in rows):
        optimiser_rows = [row for row in rows if (row["optimiser"], row["package"]) == (name, package)]
        objectives = [row["J"] if row["J"] is not None else float("inf") for row in optimiser_rows]
        lines.append(
            (
                name,
                package,
                str(len(optimiser_rows)),
                number(median(row["seconds"] for row in optimiser_rows)),
                f"{median(row['simulations'] for row in optimiser_rows):.0f}",
                f"{median(objectives):.2f}",
                f"{max(objectives):.2f}",
            )
        )
    return Grid("The paper's calibration, 50 members, 70 generations, on synthetic data", heads, lines, 2)


TABLES: dict[str, Make] = {
    "methods": make_table("One simulation", _METHODS),
    "throughput": make_table("Populations at one operating point", _THROUGHPUT, 0),
    "searches": _searches,
}
