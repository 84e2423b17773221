"""Tables of a reproduction as text, from its record alone."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import Any

from commonrail.base.arrays import Floats
from commonrail.base.output import replacing, writing
from commonrail.base.table import Cell, Column, Table, table_from_columns
from commonrail.base.text import (
    MISSING,
    duration,
    field_unit,
    join_words,
    number,
    percent,
    significant,
    to_fixed,
    to_signed,
)
from commonrail.data.records import MICROSECOND, Record
from commonrail.plugins.paper import figures
from commonrail.plugins.paper.file import RECORD, read_reproduction
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind

SIGNS = {"holds": "✓", "does not hold": "✗", "cannot be told": "?"}
PER_MICRON = 1e-6  # N/m to N/um
_EDGES = "An edge is where the rate passes 10 % of the experiment's greatest."


def table1(record: Record) -> Table:
    """Table 1: theoretical, the paper's optimal and ours [N/um], and the verdicts of the data."""
    columns: list[Column] = [
        ("", "symbol"),
        ("theoretical", lambda k: significant(k["theoretical"], 4, PER_MICRON)),
        ("paper's optimal", lambda k: significant(k["paper"], 4, PER_MICRON)),
        ("ours: median (quartiles)", lambda k: _spread(k, 3, PER_MICRON)),
        ("truth", lambda k: significant(k["truth"], 4, PER_MICRON)),
        ("covers truth", lambda k: f"{k['covered']} of {k['intervals']}"),
        ("paper's change, %", lambda k: _signed_percent(k["paper_change"])),
        ("our change, %", lambda k: _signed_percent(k["change"]["median"])),
        ("standard error", lambda k: to_fixed(k["standard_error"], 1, PER_MICRON)),
        (
            "what the curve at 160 MPa says, in seeds",
            lambda k: "; ".join(f"{verdict}: {count}" for verdict, count in k["verdicts"].items()),
        ),
    ]
    note = (
        "Verdicts, standard errors (median over the seeds) and 95 % intervals are those that a run would report: "
        "about the most likely values near ours. Beside the bench's true stiffness stands in how many seeds "
        "the interval holds it; a law that the model lacks, such as the meter's delay, is not in an interval."
    )
    return table_from_columns("Table 1: stiffness, N/µm", record["table1"], columns, note)


def table3(record: Record) -> Table:
    """Table 3: least J by (Gmax, Npop), median and quartiles over the seeds, and the paper's."""
    rows = record["table3"]
    names = [*(d["name"] for d in record["data"]), "mean"]
    columns: list[Column] = [("(Gmax, Npop)", _configuration)]
    columns += [column for name in names for column in _beside_the_paper(rows, name)]
    readings = "; ".join(f"{_configuration(c)}: {c['note']}" for c in rows if c["note"])
    note = (
        f"{readings}. J is Σ |rate error| over the samples, mm³/ms: median (quartiles) over the seeds. ★ least of a "
        "column. J cannot be compared with the paper's, whose curves and unit are not published; the pattern can."
    )
    return table_from_columns("Table 3: least J", rows, columns, note)


def _configuration(c: Record) -> str:
    return f"({c['generations']}, {c['members']})"


def _beside_the_paper(rows: list[Record], name: str) -> list[Column]:
    """Columns of Table 3 for one pressure."""
    best = min((m for c in rows if number(m := c["median"][name]) is not None), default=None)

    def ours(c: Record) -> Cell:
        median, q1, q3 = (c[key][name] for key in ("median", "q1", "q3"))
        return Cell(f"{to_fixed(median, 1)} ({to_fixed(q1, 0)}–{to_fixed(q3, 0)})", best=median == best)

    return [(f"{name}: ours", ours), ("paper's", lambda c: to_fixed(c["paper"][name], 2))]


def j_table(record: Record) -> Table:
    """J of every model at every pressure, medians and quartiles."""
    spreads = record["J_spread"]
    columns: list[Column] = [
        ("data", "name"),
        ("role", "role"),
        *((text, lambda d, k=k: _spread(spreads[d["name"]][k], 4)) for k, text in record["labels"].items()),
    ]
    note = "The paper's optimal k are those of its Table 1, put into the fitted model, not those of a fit."
    return table_from_columns("J of the models, mm³/ms", record["data"], columns, note, 2)


def rigid_table(record: Record) -> Table:
    """Stop and control volume of the rigid body that is fitted."""

    def in_field_unit(p: Record, key: str) -> str:
        return significant(p[key], 4, field_unit(p["unit"]).factor)

    columns: list[Column] = [
        ("", lambda p: f"{p['meaning']}, {field_unit(p['unit']).text}"),
        ("drawing", lambda p: in_field_unit(p, "drawing")),
        ("searched", lambda p: f"{in_field_unit(p, 'lower')} to {in_field_unit(p, 'upper')}"),
        ("fitted: median (quartiles)", lambda p: _spread(p, 3, field_unit(p["unit"]).factor)),
    ]
    note = (
        "Fitted at 160 MPa, as k1…k7 are, because the paper does not say how its rigid body was set up; its J is above."
    )
    return table_from_columns("The rigid body that is fitted", record["rigid_fit"], columns, note)


def phases_table(record: Record) -> Table:
    """Median J by phase and by window."""
    names, medians = record["phases"]["names"], record["phases"]["median"]
    columns: list[Column] = [
        *_data_and_model(record),
        *((p, lambda row, i=i: to_fixed(medians[row[0]["name"]][row[1]][i], 1)) for i, p in enumerate(names)),
    ]
    note = f"Medians over the seeds; time counts from the opening of the synthetic experiment. {_EDGES}"
    return table_from_columns(
        "J by phase and by window, mm³/ms", product(record["data"], record["labels"]), columns, note, 2
    )


def edges_table(record: Record) -> Table:
    """Opening and closing of each model against the experiment's [us]."""
    edges = record["edges"]
    columns: list[Column] = [
        *_data_and_model(record),
        *((w, lambda row, w=w: _signed_spread(edges[row[0]["name"]][row[1]][w])) for w in ("opening", "closing")),
    ]
    note = f"Model − synthetic experiment, median (quartiles) over the seeds; + is late. {_EDGES}"
    return table_from_columns("Opening and closing, µs", product(record["data"], record["labels"]), columns, note, 2)


def _data_and_model(record: Record) -> list[Column]:
    """First columns of rows (data set, label)."""
    return [("data", lambda row: row[0]["name"]), ("model", lambda row: record["labels"][row[1]])]


def treatments_table(record: Record) -> Table:
    """Treatments of infeasible trials: share of the slots simulated, and J reached."""
    columns: list[Column] = [
        ("treatment", "text"),
        ("slots", lambda t: f"{t['slots']:,}"),
        ("simulated, %", lambda t: _percent_spread(t["share"])),
        ("least J, mm³/ms", lambda t: _spread(t, 4)),
    ]
    note = (
        "The paper does not say how trials that break (14) to (16) were treated. Here (70, 50) at 160 MPa; median "
        "(quartiles) over the seeds; without a number where a search found no feasible member."
    )
    return table_from_columns("Treatments of the constraints", record["treatments"], columns, note)


def overfitting_table(record: Record) -> Table:
    """J at the unseen pressures: fitted at 160 MPa against fitted there."""
    columns: list[Column] = [
        ("data", lambda row: row[0]),
        ("theoretical", lambda row: _spread(row[1]["theoretical"], 4)),
        ("fitted at 160 MPa", lambda row: _spread(row[1]["fitted_at_160"], 4)),
        ("fitted to this curve", lambda row: _spread(row[1]["fitted_there"], 4)),
        ("gain kept, %", lambda row: _percent_spread(row[1]["gain_kept"])),
    ]
    note = "The gain is that over the theoretical model; kept is the share that the fit at 160 MPa brings."
    title = "What one pressure teaches about the others: J, mm³/ms"
    return table_from_columns(title, record["overfitting"].items(), columns, note)


def meter_table(record: Record) -> Table:
    """Effect of the bench's meter on stiffness and unseen J."""
    names = [d["name"] for d in record["data"]]
    columns: list[Column] = [
        ("meter in the fit", "text"),
        *((f"J, {name}", lambda m, n=name: _spread(m["J"][n], 4)) for name in names),
        *((f"{k}, N/µm", lambda m, k=k: _spread(m["stiffness"][k], 3, PER_MICRON)) for k in ("k5", "k7")),
        ("delay, µs", lambda m: _spread(m["delay"], 3, MICROSECOND) if m["delay"] else ""),
    ]
    true = {k["symbol"]: significant(k["paper"], 3, PER_MICRON) for k in record["table1"]}
    note = (
        "Fitted at 160 MPa with (70, 50); J [mm³/ms] at 120 and 80 MPa is of unseen curves. Median (quartiles) over "
        f"the seeds. The paper's k5 and k7, which are the default bench's true ones: {true['k5']} and {true['k7']} "
        "N/µm. A delay and k7 do nearly the same to one curve."
    )
    return table_from_columns("Fits that know the rate meter", record["meter"], columns, note)


def _spread(s: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    median, q1, q3 = (significant(s[key], digits, scale) for key in ("median", "q1", "q3"))
    return f"{median} ({q1}–{q3})" if number(s["median"]) is not None else median


def _percent_spread(s: Mapping[str, Any]) -> str:
    return _spread({key: _times(value, 100.0) for key, value in s.items()}, 3)


def _signed_spread(s: Mapping[str, Any]) -> str:
    median, q1, q3 = (to_signed(_times(s[key], MICROSECOND), 1) for key in ("median", "q1", "q3"))
    return f"{median} ({q1} to {q3})" if number(s["median"]) is not None else median


def _signed_percent(share: Any) -> str:
    return to_signed(_times(share, 100.0), 0)


def _times(value: Any, factor: float) -> float | None:
    parsed = number(value)
    return None if parsed is None else parsed * factor


# The page of a reproduction: claims first, then the paper's tables and figures.

Traces = Mapping[int, Mapping[str, Mapping[str, Floats]]]

FEWEST = 6  # seeds that can separate a claim from chance
NOT_COMPARABLE = (
    "J depends on the data, so it cannot be compared with the paper's; what can be compared is the pattern."
)
PLATE_FOLDER, PLATES = "figures", ("fig4", "fig5", "fig6")  # for print, each as SVG and PDF


def reproduction_html(record: Record, traces: Traces, folder: str = "RUN", plates: bool = True) -> str:
    """Page of a reproduction from its record and its curves by seed and data set.

    `folder` is its name for the command lines in the page, and `plates` is whether figures for print are next to it.
    """
    charts = [figures.convergence(record), figures.search_boxes(record), *figures.rates(record, traces)]
    heights = [400, 400, *(360 if i == 0 else 460 for i, _ in enumerate(charts[2:]))]  # [px], of one panel, and of two
    drawn = [(f, figure_html(f, f"figure-{i}", h)) for i, (f, h) in enumerate(zip(charts, heights, strict=True))]
    return render(
        "reproduction.html",
        package=__package__,
        kind="Reproduction",
        record=record,
        synthetic=[record["synthetic"], NOT_COMPARABLE],
        lines=meaning(record),
        tiles=_tiles(record),
        first=drawn[2] if len(drawn) > 2 else None,
        counted=verdicts(record),
        groups=_group_claims(record["claims"]),
        table1=table1(record),
        table3=table3(record),
        models=[table(record) for table in MODEL_TABLES],
        treatments=treatments_table(record),
        convergence=drawn[0],
        boxes=drawn[1],
        rates=drawn[3:],
        plates=[(name, f"{PLATE_FOLDER}/{name}") for name in PLATES if plates],
        commands=_commands(record, folder),
        facts=_facts(record),
    )


MODEL_TABLES = (j_table, rigid_table, meter_table, phases_table, edges_table, overfitting_table)
# Claims by subject, in the order of the page; each covers the claims whose identifiers begin with it.
GROUPS = {
    "Models and prediction": ("ordering", "optimised-", "no-overfitting", "theoretical-", "rigid-", "gains-", "window"),
    "Single stiffnesses": ("stiffer", "near-theory", "close-to-theory", "k4", "far-from-theory", "k6", "clearance"),
    "Search": ("rapid", "best-configuration", "cheap-configuration"),
}
ORDERING, FITTED = "ordering-", "ordering-fitted-"


def _group_claims(claims: list[Record]) -> list[tuple[str, list[dict[str, str]]]]:
    """Claims by group, ungrouped ones at the end."""
    groups: dict[str, list[dict[str, str]]] = {group: [] for group in (*GROUPS, "Others")}
    for claim in claims:
        group = next((group for group, names in GROUPS.items() if claim["id"].startswith(names)), "Others")
        groups[group].append(_claim(claim))
    return [(group, rows) for group, rows in groups.items() if rows]


def _orders(record: Record) -> tuple[list[Record], list[Record]]:
    """Claims on the order of the models at each pressure: with the rigid body as drawn, and with a fitted one."""
    fitted = [c for c in record["claims"] if c["id"].startswith(FITTED)]
    return [c for c in record["claims"] if c["id"].startswith(ORDERING) and c not in fitted], fitted


def _seeds(claims: list[Record]) -> str:
    return f"{' · '.join(str(c['true_in']) for c in claims)} of {max(c['of'] for c in claims)}"


def _describe_gains_kept(record: Record) -> str:
    gains = [number(gain["gain_kept"]["median"]) for gain in record["overfitting"].values()]
    return " · ".join(f"{percent(gain, 0)} %" for gain in gains if gain is not None)


def _totals(record: Record, *keys: str) -> list[int]:
    return [sum(k[key] for k in record["table1"]) for key in keys]


def meaning(record: Record) -> list[str]:
    """Sentences on the results of the study: models and prediction, single stiffnesses, the meter's effect on k7."""
    drawn, fitted = _orders(record)
    names = " · ".join(d["name"] for d in record["data"])
    sentences = []
    if drawn and fitted:
        sentences.append(
            f"The order of the models, optimised before theoretical before rigid body, came out in {_seeds(drawn)} "
            f"seeds at {names}, and in {_seeds(fitted)} where the rigid body is fitted too; on the unseen curves the "
            f"fit keeps {_describe_gains_kept(record)} of the gain that is possible."
        )
    covered, intervals = _totals(record, "covered", "intervals")
    verdicts = [k["verdicts"] for k in record["table1"]]
    determined, judged = sum(v.get("determined", 0) for v in verdicts), sum(sum(v.values()) for v in verdicts)
    sentences.append(
        f"Single stiffnesses are another matter, since one curve determines mostly combinations of them: "
        f"{determined} of {judged} are determined, and {covered} of {intervals} intervals hold the bench's true value."
    )
    return [*sentences, *_behind_k7(record)]


def _behind_k7(record: Record) -> list[str]:
    """Sentence on k7 without the meter and with the bench's meter in the model, and the truth."""
    by_label = {m["label"]: m["stiffness"]["k7"]["median"] for m in record["meter"]}
    truth = next((k["truth"] for k in record["table1"] if k["symbol"] == "k7"), None)
    without, with_known_meter = (number(by_label.get(label)) for label in ("none", "known"))
    if without is None or with_known_meter is None or truth is None:
        return []
    texts = [significant(k, 3, PER_MICRON) for k in (without, with_known_meter, truth)]
    is_nearer = abs(with_known_meter - truth) < abs(without - truth)
    return [
        f"Without the rate meter in the model k7 comes to {texts[0]} N/µm, with it to {texts[1]}, and the truth is "
        f"{texts[2]}{': the delay of the meter sits in k7' if is_nearer else ''}."
    ]


def _tiles(record: Record) -> list[Tile]:
    drawn, _ = _orders(record)
    covered, intervals = _totals(record, "covered", "intervals")
    claims = record["claims"]
    always = sum(c["true_in"] == c["of"] > 0 for c in claims)
    worst = max((_LEVELS[c["verdict"]] for c in drawn), key=_WORST.index, default="")
    order = [Tile("order of the models", _seeds(drawn), "seeds, as in the paper", worst)] if drawn else []
    return [
        *order,
        Tile(
            "unseen curves",
            _describe_gains_kept(record) or MISSING,
            f"of the gain kept at {' · '.join(record['overfitting'])}",
        ),
        Tile("stiffnesses", f"{covered} of {intervals}", "intervals hold the truth"),
        Tile("claims", f"{always} of {len(claims)}", "of the paper's claims, true in every seed"),
    ]


_WORST = (GOOD, CARE, BAD)
_LEVELS = {"holds": GOOD, "does not hold": BAD, "cannot be told": CARE}


def verdicts(record: Record) -> str:
    """Number of the paper's claims that hold, in one sentence; with too few seeds, the seeds in which each is true."""
    claims = record["claims"]
    if len(record["seeds"]) < FEWEST:
        always = sum(claim["true_in"] == claim["of"] > 0 for claim in claims)
        never = sum(claim["true_in"] == 0 for claim in claims)
        return (
            f"Of {len(claims)} claims of the paper {always} are true in every seed, {never} in none, "
            f"{len(claims) - always - never} in some. Fewer than {FEWEST} seeds cannot tell a claim from chance."
        )
    verdict_of_claims = [claim["verdict"] for claim in claims]
    parts = [f"{verdict_of_claims.count(v)} {words}" for v, words in _WORDS.items() if v in verdict_of_claims]
    return f"Of {len(verdict_of_claims)} claims of the paper {join_words(parts)} here."


_WORDS = {"holds": "hold", "does not hold": "do not hold", "cannot be told": "cannot be told"}


def _claim(claim: Record) -> dict[str, str]:
    low, high = claim["interval"]
    return {
        **{key: str(claim[key]) for key in ("claim", "where", "measure", "figure", "verdict", "comment")},
        "sign": SIGNS[claim["verdict"]],
        "share": f"{claim['true_in']} of {claim['of']} seeds",
        "interval": f"{percent(low, 0)}–{percent(high, 0)} %",
        "chance": "" if claim["chance"] is None else f"{percent(claim['chance'], 0)} %",
    }


def _commands(record: Record, folder: str) -> list[tuple[str, str]]:
    run, again = shlex.quote(folder), f"commonrail lab reproduce --seeds {record['asked']}"
    return [
        ("Reproduce again, with the same truth", f"{again} --truth {run}/truth.toml"),
        ("Change the truth", "commonrail lab virtual-bench --show > my-truth.toml"),
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


# Folder of a reproduction: its page, and its figures for print.

NO_PLATES = (
    "figures for print (SVG, PDF) are left out, because they need matplotlib: install it with "
    "pip install 'commonrail[plates]', then `commonrail report {}` draws them"
)


def _page(record: Record, folder: Path) -> str:
    _, traces = read_reproduction(folder)
    return reproduction_html(record, traces, folder.as_posix() or "RUN", _has_plates(folder))


def draw_plates(folder: Path) -> str:
    """Draw the missing figures for print of a reproduction's folder.

    Returns an empty text, or a sentence with the extra that is to be installed. InputError if the folder is not whole;
    OutputError if they cannot be written.
    """
    if _has_plates(folder):
        return ""
    if find_spec("matplotlib") is None:
        return NO_PLATES.format(shlex.quote(str(folder)))
    plates = folder / PLATE_FOLDER
    with RESULT.refusing_broken(folder):
        drawn = make_plates(*read_reproduction(folder))
    with writing(plates):
        plates.mkdir(exist_ok=True)
    for file, content in drawn.items():
        with replacing(plates / file, "wb") as stream:
            stream.write(content)
    return ""


def make_plates(record: Record, traces: Traces) -> dict[str, bytes]:
    """Figures 4, 5 and 6 of the paper as SVG and PDF, by the names of their files."""
    from commonrail.plugins.paper.plates import COLUMN, PAGE, print_sheets, side_by_side, single

    rates = figures.rates(record, traces)
    return print_sheets(
        {
            "fig4": lambda: single(figures.convergence(record), (COLUMN, 66.0)),
            "fig5": lambda: single(figures.search_boxes(record), (COLUMN, 66.0)),
            "fig6": lambda: side_by_side(rates, (PAGE, 62.0 * len(rates))),
        }
    )


def _has_plates(folder: Path) -> bool:
    return all((folder / PLATE_FOLDER / f"{name}.{kind}").is_file() for name in PLATES for kind in ("svg", "pdf"))


RESULT = ResultKind(RECORD, "reproduction", "lab reproduce", _page, extra=draw_plates)
