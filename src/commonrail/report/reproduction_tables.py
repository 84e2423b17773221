"""Tables of a reproduction as text, from its record alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from commonrail.display.table import Cell, Table
from commonrail.display.text import fixed, number, signed, significant
from commonrail.kinds.records import Record

__all__ = [
    "SIGNS",
    "edges_table",
    "j_table",
    "overfitting_table",
    "phases_table",
    "rigid_tables",
    "table1",
    "table3",
    "treatments_table",
]

SIGNS = {"holds": "✓", "does not hold": "✗", "cannot be told": "?"}
PER_MICRON = 1e-6  # N/m to N/um
MICROSECOND = 1e6


def table1(record: Record) -> Table:
    """Table 1: theoretical, the paper's optimal and ours [N/um], and what the data pin down."""
    rows = []
    for k in record["table1"]:
        change = k["change"]
        rows.append(
            (
                k["symbol"],
                significant(k["theoretical"], 4, PER_MICRON),
                significant(k["paper"], 4, PER_MICRON),
                _spread(k, 3, PER_MICRON),
                _signed_percent(k["paper_change"]),
                _signed_percent(change["median"]),
                fixed(k["standard_error"], 1, PER_MICRON),
                "; ".join(f"{verdict}: {count}" for verdict, count in k["verdicts"].items()),
            )
        )
    columns = (
        "",
        "theoretical",
        "paper's optimal",
        "ours: median (quartiles)",
        "paper's change, %",
        "our change, %",
        "standard error",
        "what the curve at 160 MPa says, in seeds",
    )
    note = (
        "The stiffnesses of the bench's truth are given below. The standard error (median over the seeds) is that "
        "of the linearised fit; it says nothing about other minima."
    )
    return Table("Table 1: stiffness, N/µm", columns, _cells(rows), note)


def table3(record: Record) -> Table:
    """Table 3: least J by (Gmax, Npop), median and quartiles over the seeds, beside the paper's."""
    names = [*(d["name"] for d in record["data"]), "mean"]
    best = {name: _least(c["median"][name] for c in record["table3"]) for name in names}
    rows = []
    for c in record["table3"]:
        cells = [Cell(f"({c['generations']}, {c['members']})")]
        for name in names:
            values = {key: c[key][name] for key in ("median", "q1", "q3")}
            quartiles = f"{fixed(values['q1'], 0)}–{fixed(values['q3'], 0)}"
            cells.append(Cell(f"{fixed(values['median'], 1)} ({quartiles})", best=values["median"] == best[name]))
            cells.append(Cell(fixed(c["paper"][name], 2)))
        rows.append(tuple(cells))
    heads = [head for name in names for head in (f"{name}: ours", "paper's")]
    readings = "; ".join(f"({c['generations']}, {c['members']}): {c['note']}" for c in record["table3"] if c["note"])
    note = (
        f"{readings}. J is Σ |rate error| over the samples, mm³/ms: median (quartiles) over the seeds. ★ least of a "
        "column. J cannot be compared with the paper's, whose curves and unit are not published; the pattern can."
    )
    return Table("Table 3: least J", ("(Gmax, Npop)", *heads), tuple(rows), note)


def j_table(record: Record) -> Table:
    """J of every model at every pressure, medians and quartiles."""
    labels = record["labels"]
    spreads = record["J_spread"]
    rows = [(d["name"], d["role"], *(_spread(spreads[d["name"]][k], 4) for k in labels)) for d in record["data"]]
    note = "The paper's optimal k are those of its Table 1, put into the fitted model, not those of a fit."
    return Table("J of the models, mm³/ms", ("data", "role", *labels.values()), _cells(rows), note, 2)


def rigid_tables(record: Record) -> list[Table]:
    """Stop and control volume of the rigid body that is fitted; none in a record of before it was."""
    rows = []
    for p in record.get("rigid_fit", ()):
        scale, unit = _SCALES[p["unit"]]
        drawing, lower, upper = (significant(p[key], 4, scale) for key in ("drawing", "lower", "upper"))
        rows.append((f"{p['meaning']}, {unit}", drawing, f"{lower} to {upper}", _spread(p, 3, scale)))
    note = (
        "Fitted at 160 MPa, as k1…k7 are, because the paper does not say how its rigid body was set up; its J is above."
    )
    columns = ("", "drawing", "searched", "fitted: median (quartiles)")
    return [Table("The rigid body that is fitted", columns, _cells(rows), note)] if rows else []


_SCALES = {"m": (1e6, "µm"), "m3": (1e9, "mm³")}


def phases_table(record: Record) -> Table:
    """Median J by phase."""
    phases, labels = record["phases"], record["labels"]
    rows = []
    for d in record["data"]:
        for key, text in labels.items():
            rows.append((d["name"], text, *(fixed(j, 1) for j in phases["median"][d["name"]][key])))
    note = f"Medians over the seeds; time counts from the opening of the synthetic experiment. {_EDGES}"
    return Table("J by phase, mm³/ms", ("data", "model", *phases["names"]), _cells(rows), note, 2)


def edges_table(record: Record) -> Table:
    """Opening and closing of each model against the experiment's [us]."""
    rows = []
    for d in record["data"]:
        for key, text in record["labels"].items():
            found = record["edges"][d["name"]][key]
            rows.append((d["name"], text, *(_signed_spread(found[w]) for w in ("opening", "closing"))))
    note = f"Model − synthetic experiment, median (quartiles) over the seeds; + is late. {_EDGES}"
    return Table("Opening and closing, µs", ("data", "model", "opening", "closing"), _cells(rows), note, 2)


def treatments_table(record: Record) -> Table:
    """What becomes of infeasible trials: share of the slots simulated and J reached."""
    rows = [
        (t["text"], f"{t['slots']:,}", _spread({k: _times(v, 100.0) for k, v in t["share"].items()}, 3), _spread(t, 4))
        for t in record["treatments"]
    ]
    note = (
        "The paper does not say how trials that break (14) to (16) were treated. Here (70, 50) at 160 MPa; median "
        "(quartiles) over the seeds; without a number where a search found no feasible member."
    )
    columns = ("treatment", "slots", "simulated, %", "least J, mm³/ms")
    return Table("Treatments of the constraints", columns, _cells(rows), note)


def overfitting_table(record: Record) -> Table:
    """J at the unseen pressures: fitted at 160 MPa against fitted there."""
    rows = [
        (
            name,
            _spread(found["theoretical"], 4),
            _spread(found["fitted_at_160"], 4),
            _spread(found["fitted_there"], 4),
            _spread({k: _times(v, 100.0) for k, v in found["gain_kept"].items()}, 3),
        )
        for name, found in record["overfitting"].items()
    ]
    note = "The gain is that over the theoretical model; kept is the share that the fit at 160 MPa brings."
    columns = ("data", "theoretical", "fitted at 160 MPa", "fitted to this curve", "gain kept, %")
    return Table("What one pressure teaches about the others: J, mm³/ms", columns, _cells(rows), note)


_EDGES = "An edge is where the rate passes 10 % of the experiment's greatest."


def _cells(rows: Sequence[tuple[str, ...]]) -> tuple[tuple[Cell, ...], ...]:
    return tuple(tuple(Cell(text) for text in row) for row in rows)


def _spread(s: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    median, q1, q3 = (significant(s[key], digits, scale) for key in ("median", "q1", "q3"))
    return f"{median} ({q1}–{q3})" if number(s["median"]) is not None else median


def _signed_spread(s: Mapping[str, Any]) -> str:
    median, q1, q3 = (signed(_times(s[key], MICROSECOND), 1) for key in ("median", "q1", "q3"))
    return f"{median} ({q1} to {q3})" if number(s["median"]) is not None else median


def _signed_percent(share: Any) -> str:
    return signed(_times(share, 100.0), 0)


def _times(value: Any, factor: float) -> float | None:
    found = number(value)
    return None if found is None else found * factor


def _least(values: Any) -> float | None:
    return min((v for v in values if number(v) is not None), default=None)
