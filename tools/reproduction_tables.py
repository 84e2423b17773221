"""Write figures of docs/reproduction.md from two folders of `commonrail lab reproduce`, and from a study of friction.

    commonrail lab reproduce --seeds 20 --out runs/paper-study
    commonrail lab reproduce --seeds 20 --truth virtual-lino-2016-ideal --out runs/ideal
    python -m tools.reproduction_tables runs/paper-study runs/ideal

Everything between ``<!-- NAME -->`` and ``<!-- end -->`` in the page is replaced. The text around it states results of
a run: compare it with the new tables.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.base.record import from_record
from commonrail.base.table import Table
from commonrail.base.text import duration, percent, to_fixed, to_signed
from commonrail.data.records import Record
from commonrail.plugins.paper import page as tables
from commonrail.plugins.paper import study
from commonrail.plugins.paper.bench import Bench, Friction, Scatter, Sensor, Truth
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.file import ReproductionSummary
from commonrail.plugins.paper.page import RESULT, SIGNS, verdicts
from commonrail.plugins.paper.run import measure, search
from commonrail.readers.injector import load_injector

Floats = NDArray[np.float64]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reproduction.md"
TRUTH, TIME_STEP = "virtual-lino-2016", 1e-6
FRICTION_SEEDS = range(1, 9)
# columns of Table 1 that only the run's report has
IN_THE_REPORT = ("paper's change, %", "our change, %", "what the curve at 160 MPa says, in seeds")


def format_grid(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def format_table(table: Table, without: Sequence[str] = (), medians_only: bool = False) -> str:
    """A table of the report in Markdown.

    `without`: columns that the page omits; `medians_only`: omit quartiles, which follow a median in brackets.
    """
    shown = [i for i, column in enumerate(table.columns) if column not in without]
    rows = [[row[i].plain.replace("\N{NO-BREAK SPACE}", " ") for i in shown] for row in table.rows]
    if medians_only:
        rows = [[row[0], *(re.sub(r" \([^()]*\)$", "", cell) for cell in row[1:])] for row in rows]
    return format_grid([table.columns[i] for i in shown], rows)


def list_claims(summary: ReproductionSummary) -> str:
    """Claims by verdict, each with the seeds in which it is true."""
    parts = [verdicts(summary)]
    for verdict in SIGNS:
        claims = [claim for claim in summary.claims if claim.verdict == verdict]
        if claims:
            parts.append(f"**{verdict[0].upper()}{verdict[1:]}**")
            parts.append("\n".join(f"- {claim.claim} ({claim.true_in} of {claim.of})" for claim in claims))
    return "\n\n".join(parts)


def describe_run(summary: ReproductionSummary, versions: Mapping[str, str]) -> str:
    """Source of the figures; `versions`: of the software."""
    software = ", ".join(f"{name} {number}" for name, number in versions.items())
    return (
        f"{len(summary.seeds)} seeds, {summary.simulations:,} injections in {duration(summary.seconds)} on the "
        f"machine that wrote this page; {software}."
    )


def describe_ideal(summary: ReproductionSummary) -> str:
    """Median J relative to the theoretical model's at 160 MPa, and k6, if the model contains the truth."""
    j = summary.j_spread["160 MPa"]
    share = j["optimised"].median / j["theoretical"].median
    k6 = summary.table1[5]
    return (
        f"Median J after the search is {percent(share, 2)} % of the theoretical model's at 160 MPa; k6 ends "
        f"{to_signed(100.0 * k6.change.median, 0)} % from theory (median), and the truth is "
        f"{to_signed(100.0 * k6.paper_change, 0)} %."
    )


def friction_truths() -> dict[str, Truth]:
    """Truths of theoretical stiffness without noise, which differ in friction or meter."""
    bench = load_truth(TRUTH)
    rest = {name: value for name, value in bench.values.items() if name not in study.NAMES}
    plain = replace(
        bench, values=rest, friction=Friction(), rate_meter=Sensor(), rail_sensor=Sensor(), scatter=Scatter()
    )
    sums = (sum(bench.friction.coulomb), sum(bench.friction.viscous))
    even = Friction(*((total / 8.0,) * 8 + (0.0,) for total in sums))
    meter = replace(bench.rate_meter, noise=0.0, resolution=0.0)
    return {
        "no friction, ideal meter": plain,
        "the bench's friction, ideal meter": replace(plain, friction=bench.friction),
        "as much friction spread evenly over masses 1 to 8, ideal meter": replace(plain, friction=even),
        "no friction, the meter's delay": replace(plain, rate_meter=meter),
    }


def tabulate_friction() -> str:
    """Changes of k1…k7 that searches end with although the theoretical stiffness is the truth."""
    rows = []
    for text, truth in friction_truths().items():
        bench = Bench(truth, load_injector(truth.injector), TIME_STEP)
        data = measure(bench, 1)[0]
        searches = [search(bench, data, study.BEST.settings, seed) for seed in FRICTION_SEEDS]
        theory = study.space(bench.injector).reference
        change = np.median([f.x / theory - 1.0 for f in searches], axis=0)
        cost = float(np.median([f.cost for f in searches]))
        rows.append((text, *(to_signed(100.0 * value, 0) for value in change), to_fixed(cost, 1)))
    return format_grid(("truth", *(f"k{i}, %" for i in range(1, 8)), "J"), rows)


def make_blocks(record: Record, ideal: Record) -> dict[str, str]:
    """Every block of the page by name.

    `record`: of the study; `ideal`: of the study without friction, noise, scatter and meter.
    """
    summary = from_record(ReproductionSummary, record)
    return {
        "run": describe_run(summary, record["software"]),
        "claims": list_claims(summary),
        "table1": format_table(tables.table1(summary), IN_THE_REPORT),
        "table3": format_table(tables.table3(summary), medians_only=True),
        "models": format_table(tables.j_table(summary), medians_only=True),
        "meter": format_table(tables.meter_table(summary), medians_only=True),
        "ideal": describe_ideal(from_record(ReproductionSummary, ideal)),
        "friction": tabulate_friction(),
    }


def fill_page(page: str, texts: dict[str, str]) -> str:
    """The page with its blocks replaced; SystemExit if it lacks a block or has one without a text."""
    blocks = re.findall(r"^<!-- (\w+) -->$", page, re.M)
    blocks = [name for name in blocks if name != "end"]
    if sorted(blocks) != sorted(texts):
        raise SystemExit(f"{PAGE}: its blocks are {blocks}, and these are filled: {list(texts)}")
    for name, text in texts.items():
        block = re.compile(rf"(^<!-- {name} -->$\n).*?(^<!-- end -->$)", re.S | re.M)
        # the site needs the empty line: a table does not begin within the paragraph of a comment
        page = block.sub(lambda m, text=text: f"{m[1]}\n{text}\n{m[2]}", page)  # type: ignore[misc]
    return page


def main() -> None:
    """Read the command line and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of commonrail lab reproduce")
    parser.add_argument("ideal", type=Path, help="folder of the same with --truth virtual-lino-2016-ideal")
    args = parser.parse_args()
    blocks = make_blocks(*(RESULT.read(folder) for folder in (args.run, args.ideal)))
    PAGE.write_text(fill_page(PAGE.read_text(encoding="utf-8"), blocks), encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
