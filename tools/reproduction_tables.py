"""Write figures of docs/reproduction.md from two folders of `commonrail lab reproduce`, and from a study of friction.

    commonrail lab reproduce --seeds 20 --out runs/paper-study
    commonrail lab reproduce --seeds 20 --truth virtual-lino-2016-ideal --out runs/ideal
    python -m tools.reproduction_tables runs/paper-study runs/ideal

Everything between ``<!-- NAME -->`` and ``<!-- end -->`` in the page is replaced. The text around it holds no figure of
a run, but speaks of what came out: read it against the new tables.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.base.table import Table
from commonrail.base.text import duration, percent, to_fixed, to_signed
from commonrail.plugins.paper import page as tables
from commonrail.plugins.paper import study
from commonrail.plugins.paper.bench import Bench, Friction, Scatter, Sensor, Truth
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.paper.page import RESULT, verdicts
from commonrail.plugins.paper.run import measure, search
from commonrail.readers.injector import load_injector

Floats = NDArray[np.float64]
Record = dict[str, Any]

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reproduction.md"
TRUTH, TIME_STEP = "virtual-lino-2016", 1e-6
FRICTION_SEEDS = range(1, 9)


def grid(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def markdown(table: Table) -> str:
    """A table of the report in Markdown."""
    return grid(table.columns, [[cell.plain.replace("\N{NO-BREAK SPACE}", " ") for cell in row] for row in table.rows])


def claims(record: Record) -> str:
    """Claims, measures and verdicts."""
    columns = ("claim, in our words", "measure", "what came out", "at random", "true in", "verdict")
    rows = []
    for c in record["claims"]:
        low, high = c["interval"]
        share = f"{c['true_in']} of {c['of']} ({percent(low, 0)}–{percent(high, 0)} %)"
        chance = "" if c["chance"] is None else f"{percent(c['chance'], 1)} %"
        rows.append((c["claim"], c["measure"], c["figure"], chance, share, f"**{c['verdict']}**"))
    return f"{verdicts(record)}\n\n{grid(columns, rows)}"


def run_facts(record: Record) -> str:
    """Source of the figures."""
    software = ", ".join(f"{name} {number}" for name, number in record["software"].items())
    return (
        f"{len(record['seeds'])} seeds, {record['simulations']:,} injections in {duration(record['seconds'])} on the "
        f"machine that wrote this page; {software}."
    )


def further(record: Record) -> str:
    """Figures that no table of the report holds."""
    worst = max(max(c["J"]["80 MPa"]) for c in record["table3"])
    count = len(record["table3"]) * len(record["seeds"])
    k7 = record["table1"][-1]
    treatments = {t["name"]: t for t in record["treatments"]}
    k6 = next(c for c in record["claims"] if c["id"] == "k6-at-maximum")
    return "\n".join(
        (
            f"- Greatest J at 80 MPa of the {count} searches of Table 3: {to_fixed(worst, 0)}; the paper's (60, 30) "
            f"has {study.TABLE3[study.Configuration(60, 30)][2]}.",
            f"- k7: {to_fixed(k7['median'], 1, 1e-6)} N/µm, and {to_fixed(k7['truth'], 1, 1e-6)} N/µm in truth, which "
            f"{k7['covered']} of {k7['intervals']} intervals of 95 % hold (standard error "
            f"{to_fixed(k7['standard_error'], 1, 1e-6)} N/µm, median): the meter's delay is in none of them.",
            f"- k6 near its maximum: {k6['figure']}. {k6['comment']}",
            f"- Least J of a search that starts from the theoretical stiffness, of one that does not: "
            f"{to_fixed(treatments['reference']['median'], 1)} and {to_fixed(treatments['repair']['median'], 1)} "
            "(medians).",
        )
    )


def ideal(record: Record) -> str:
    """Median J against theory's at 160 MPa, and k6, where the model contains the truth."""
    j = record["J_spread"]["160 MPa"]
    share = j["optimised"]["median"] / j["theoretical"]["median"]
    k6 = record["table1"][5]
    return (
        f"{markdown(tables.j_table(record))}\n\n"
        f"Median J after the search is {percent(share, 2)} % of the theoretical model's at 160 MPa; k6 ends "
        f"{to_signed(100.0 * k6['change']['median'], 0)} % from theory (median), and the truth is "
        f"{to_signed(100.0 * k6['paper_change'], 0)} %."
    )


def friction_truths() -> dict[str, Truth]:
    """Truths of theoretical stiffness without noise, that differ in friction or meter."""
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


def friction() -> str:
    """Changes of k1…k7 that searches make up where the theoretical stiffness is the truth."""
    rows = []
    for text, truth in friction_truths().items():
        bench = Bench(truth, load_injector(truth.injector), TIME_STEP)
        data = measure(bench, 1)[0]
        searches = [search(bench, data, study.BEST.settings, seed) for seed in FRICTION_SEEDS]
        theory = study.space(bench.injector).reference
        change = np.median([f.x / theory - 1.0 for f in searches], axis=0)
        cost = float(np.median([f.cost for f in searches]))
        rows.append((text, *(to_signed(100.0 * value, 0) for value in change), to_fixed(cost, 1)))
    return grid(("truth", *(f"k{i}, %" for i in range(1, 8)), "J"), rows)


def blocks(record: Record, perfect: Record) -> dict[str, str]:
    """Every block of the page by name."""
    return {
        "run": run_facts(record),
        "claims": claims(record),
        "further": further(record),
        "table1": markdown(tables.table1(record)),
        "table3": markdown(tables.table3(record)),
        "models": markdown(tables.j_table(record)),
        "rigid": markdown(tables.rigid_table(record)),
        "edges": markdown(tables.edges_table(record)),
        "phases": markdown(tables.phases_table(record)),
        "overfitting": markdown(tables.overfitting_table(record)),
        "meter": markdown(tables.meter_table(record)),
        "treatments": markdown(tables.treatments_table(record)),
        "ideal": ideal(perfect),
        "friction": friction(),
    }


def filled(page: str, texts: dict[str, str]) -> str:
    """The page with its blocks replaced; SystemExit if it lacks a block, or has one that nothing fills."""
    blocks = re.findall(r"^<!-- (\w+) -->$", page, re.M)
    blocks = [name for name in blocks if name != "end"]
    if sorted(blocks) != sorted(texts):
        raise SystemExit(f"{PAGE}: its blocks are {blocks}, and these are filled: {list(texts)}")
    for name, text in texts.items():
        block = re.compile(rf"(^<!-- {name} -->$\n).*?(^<!-- end -->$)", re.S | re.M)
        page = block.sub(lambda m, text=text: f"{m[1]}{text}\n{m[2]}", page)  # type: ignore[misc]
    return page


def main() -> None:
    """Read the command line and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of commonrail lab reproduce")
    parser.add_argument("ideal", type=Path, help="folder of the same with --truth virtual-lino-2016-ideal")
    args = parser.parse_args()
    records = [RESULT.read(folder) for folder in (args.run, args.ideal)]
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), blocks(*map(dict, records))), encoding="utf-8")
    print(PAGE)


if __name__ == "__main__":
    main()
