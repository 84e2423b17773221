"""Figures 4, 5 and 6 of the paper from the record and the curves of a reproduction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from commonrail.arrays import Floats
from commonrail.display.chart import MARKERS, Band, Boxes, Figure, Panel, Series, points
from commonrail.display.text import number
from commonrail.kinds.records import MICROSECOND, MM3_PER_MS, Record

__all__ = ["convergence", "rates", "search_boxes"]


# Labels of the record that the paper's Fig. 6 shows, with their looks.
SHOWN = {"rigid": "rigid", "rigid_fitted": "rigid fitted", "theoretical": "start", "optimised": "best"}
BOX = ("minimum", "q1", "median", "q3", "maximum")


def convergence(record: Record) -> Figure:
    """Best and mean J against generation, medians and quartiles over the seeds (the paper's Fig. 4)."""
    found = record["convergence"]
    x = tuple(float(g) for g in found["generation"])
    level = number(found["level"]["median"])
    series = [
        Series("mean of the population", "mean", x, tuple(found["mean"]["median"])),
        Series("best", "best", x, tuple(found["best"]["median"])),
    ]
    if level is not None:
        series.append(Series("theoretical model", "level", (x[0], x[-1]), (level, level)))
    bands = tuple(Band(k, x, tuple(found[k]["low"]), tuple(found[k]["high"])) for k in ("mean", "best"))
    return Figure(
        "Convergence (Fig. 4)",
        f"J at 160 MPa of (70, 50) against generation: medians over {_seeds(record)}; bands span the quartiles.",
        "generation",
        (Panel("J, mm³/ms", tuple(series), logarithmic=True, bands=bands),),
    )


def search_boxes(record: Record) -> Figure:
    """Box plots of k1…k7 over the search, relative to theory (the paper's Fig. 5)."""
    rows: Sequence[Mapping[str, Any]] = record["search"]
    at = tuple(float(i) for i in range(len(rows)))
    boxes = (
        Boxes(f"seed {record['shown_seed']}", "start", _boxes(rows, "seed"), -0.17),
        Boxes(f"all of {_seeds(record)}", "best", _boxes(rows, "all"), 0.17),
    )
    ends = (at[0] - 0.5, at[-1] + 0.5)
    bounds = {key: tuple(row[key] for row in rows) for key in ("lower", "upper")}
    series = (
        Series("paper's optimal k", "paper", at, tuple(row["paper"] for row in rows), MARKERS),
        Series("theoretical", "level", ends, (1.0, 1.0)),
        Series("bounds", "solid", at, bounds["lower"], MARKERS, 5),
        Series("", "solid", at, bounds["upper"], MARKERS, 5),
    )
    return Figure(
        "Spread of k1…k7 over the search (Fig. 5)",
        "All members of all generations of (70, 50) at 160 MPa, each stiffness over its theoretical value; outliers "
        "beyond 1.5 interquartile ranges are left out of the whiskers.",
        "stiffness",
        (Panel("k / k theoretical", series, boxes=boxes, categories=tuple(row["symbol"] for row in rows)),),
    )


def rates(record: Record, traces: Mapping[int, Mapping[str, Mapping[str, Floats]]]) -> list[Figure]:
    """Rate and error at each pressure for one seed (the paper's Fig. 6)."""
    shown = traces[record["shown_seed"]]
    return [_rate(record, data, shown[data["name"]]) for data in record["data"]]


def _rate(record: Record, data: Record, trace: Mapping[str, Floats]) -> Figure:
    time = points(trace["time_s"] * MICROSECOND)
    experiment = trace["experiment"]
    texts = record["labels"]
    curves = [Series("synthetic experiment", "measured", time, points(experiment * MM3_PER_MS))]
    curves += [Series(texts[k], look, time, points(trace[k] * MM3_PER_MS)) for k, look in SHOWN.items()]
    errors = [Series("", look, time, points((trace[k] - experiment) * MM3_PER_MS)) for k, look in SHOWN.items()]
    return Figure(
        f"Rate of injection at {data['name']} ({data['role']}) (Fig. 6)",
        f"Energising time {data['energising_time'] * MICROSECOND:.0f} µs, seed {record['shown_seed']}; below, "
        "simulated − synthetic experiment.",
        "time, µs",
        (
            Panel("rate, mm³/ms", tuple(curves), 0.6),
            Panel("error, mm³/ms", tuple(errors), 0.4, zero_line=True),
        ),
    )


def _boxes(rows: Sequence[Mapping[str, Any]], which: str) -> tuple[tuple[float, float, float, float, float], ...]:
    return tuple(tuple(float(row[which][key]) for key in BOX) for row in rows)  # type: ignore[misc]


def _seeds(record: Record) -> str:
    count = len(record["seeds"])
    return f"{count} seed{'' if count == 1 else 's'}"
