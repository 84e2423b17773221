"""The page of a reproduction: claims first, then the paper's tables and figures."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from commonrail.arrays import Floats
from commonrail.display.text import duration, listed, percent, significant
from commonrail.kinds.records import Record
from commonrail.report import reproduction_figures as figures
from commonrail.report import reproduction_tables as tables
from commonrail.report.draw import figure_html
from commonrail.report.html import render

__all__ = ["PLATES", "PLATE_FOLDER", "reproduction_html", "verdicts"]

Traces = Mapping[int, Mapping[str, Mapping[str, Floats]]]

FEWEST = 6  # seeds that can tell a claim from chance
NOT_COMPARABLE = (
    "J depends on the data, so it cannot be compared with the paper's; what can be compared is the pattern."
)
PLATE_FOLDER, PLATES = "figures", ("fig4", "fig5", "fig6")  # for print, each as SVG and PDF


def reproduction_html(record: Record, traces: Traces, folder: str = "RUN", plates: bool = True) -> str:
    """Page of a reproduction.

    Parameters
    ----------
    record : mapping
    traces : mapping
        Curves by seed and data set.
    folder : str
        Its name, for the command lines in the page.
    plates : bool
        Whether figures for print lie beside the page.
    """
    charts = [figures.convergence(record), figures.search_boxes(record), *figures.rates(record, traces)]
    drawn = [(chart, figure_html(chart, f"figure-{i}", _height(i))) for i, chart in enumerate(charts)]
    return render(
        "reproduction.html",
        kind="Reproduction",
        record=record,
        synthetic=[record["synthetic"], NOT_COMPARABLE],
        lines=[verdicts(record)],
        signs=tables.SIGNS,
        claims=[_claim(claim) for claim in record["claims"]],
        table1=tables.table1(record),
        table3=tables.table3(record),
        models=[
            tables.j_table(record),
            tables.rigid_table(record),
            tables.meter_table(record),
            tables.phases_table(record),
            tables.edges_table(record),
            tables.overfitting_table(record),
        ],
        treatments=tables.treatments_table(record),
        convergence=drawn[0],
        boxes=drawn[1],
        rates=drawn[2:],
        plates=[(name, f"{PLATE_FOLDER}/{name}") for name in PLATES if plates],
        commands=_commands(record, folder),
        facts=_facts(record),
    )


def verdicts(record: Record) -> str:
    """Number of the paper's claims that hold, in one sentence; with too few seeds, the seeds in which each is true."""
    claims = record["claims"]
    if len(record["seeds"]) < FEWEST:
        return f"{_each(claims)} Fewer than {FEWEST} seeds cannot tell a claim from chance."
    found = [claim["verdict"] for claim in claims]
    parts = [f"{found.count(v)} {words}" for v, words in _WORDS.items() if v in found]
    return f"Of {len(found)} claims of the paper {listed(parts)} here."


def _each(claims: Sequence[Record]) -> str:
    """In how many seeds the claims are true, where there are too few of them for a verdict."""
    always = sum(claim["true_in"] == claim["of"] > 0 for claim in claims)
    never = sum(claim["true_in"] == 0 for claim in claims)
    counts = f"{always} are true in every seed, {never} in none, {len(claims) - always - never} in some"
    return f"Of {len(claims)} claims of the paper {counts}."


_WORDS = {"holds": "hold", "does not hold": "do not hold", "cannot be told": "cannot be told"}


def _claim(claim: Record) -> dict[str, str]:
    low, high = claim["interval"]
    return {
        **{key: str(claim[key]) for key in ("claim", "where", "measure", "figure", "verdict", "comment")},
        "sign": tables.SIGNS[claim["verdict"]],
        "share": f"{claim['true_in']} of {claim['of']} seeds",
        "interval": f"{percent(low, 0)}–{percent(high, 0)} %",
        "chance": "" if claim["chance"] is None else f"{percent(claim['chance'], 0)} %",
    }


def _height(index: int) -> int:
    """Height of a figure on the page [px]: those of one panel, then those of two."""
    return 400 if index < 2 else 460


def _commands(record: Record, folder: str) -> list[tuple[str, str]]:
    run = shlex.quote(folder)
    options = f"--seeds {record['asked']}"
    return [
        ("Reproduce again, with the same truth", f"commonrail reproduce {options} --truth {run}/truth.toml"),
        ("Change the truth", "commonrail virtual-bench --show > my-truth.toml"),
        ("Make this report again", f"commonrail report {run}"),
    ]


def _facts(record: Record) -> list[tuple[str, str]]:
    seeds = record["seeds"]
    return [
        ("Seeds", f"{len(seeds)} of {record['asked']} asked for: {seeds[0]} to {seeds[-1]}"),
        ("Ended", record["status"]),
        ("Simulations", f"{record['simulations']:,} injections in {duration(record['seconds'])}"),
        ("Time step", f"{significant(record['time_step'], 4, 1e6)} µs"),
        ("Software", ", ".join(f"{name} {number}" for name, number in record["software"].items())),
    ]
