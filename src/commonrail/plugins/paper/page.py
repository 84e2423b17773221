"""Report of a reproduction: the paper's claims, tables and figures, from its summary alone."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

from commonrail.base.arrays import Floats
from commonrail.base.output import replacing, writing
from commonrail.base.record import from_record
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
from commonrail.plugins.paper import charts
from commonrail.plugins.paper.claims import Claim
from commonrail.plugins.paper.figures import Spread
from commonrail.plugins.paper.file import (
    MEAN,
    RECORD,
    ConfigurationResult,
    ReproductionSummary,
    RigidDimension,
    read_reproduction,
)
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.html import render
from commonrail.report.result_kind import ResultKind

SIGNS = {"holds": "✓", "does not hold": "✗", "cannot be told": "?"}
PER_MICRON = 1e-6  # N/m to N/um
_EDGES = "An edge is where the rate passes 10 % of the experiment's greatest."


def table1(summary: ReproductionSummary) -> Table:
    """Table 1: theoretical, the paper's optimal and ours [N/um], and the verdicts of the data."""
    columns: list[Column] = [
        ("", lambda k: k.symbol),
        ("theoretical", lambda k: significant(k.theoretical, 4, PER_MICRON)),
        ("paper's optimal", lambda k: significant(k.paper, 4, PER_MICRON)),
        ("ours: median (quartiles)", lambda k: _spread(k.search.best.spread, 3, PER_MICRON)),
        ("truth", lambda k: significant(k.truth, 4, PER_MICRON)),
        ("covers truth", lambda k: f"{k.covered} of {k.intervals}"),
        ("paper's change, %", lambda k: _signed_percent(k.paper_change)),
        ("our change, %", lambda k: _signed_percent(k.change.median)),
        ("standard error", lambda k: to_fixed(k.standard_error, 1, PER_MICRON)),
        (
            "verdict by the curve at 160 MPa, in seeds",
            lambda k: "; ".join(f"{verdict}: {count}" for verdict, count in k.verdicts.items()),
        ),
    ]
    note = (
        "Verdicts, standard errors (median over the seeds) and 95 % intervals are as in a run's report, at the "
        "most likely values near ours. Next to the bench's true stiffness: number of seeds whose interval contains it. "
        "Intervals do not cover laws that the model lacks, such as the meter's delay."
    )
    return table_from_columns("Table 1: stiffness, N/µm", summary.table1, columns, note)


def table3(summary: ReproductionSummary) -> Table:
    """Table 3: least J by (Gmax, Npop), median and quartiles over the seeds, and the paper's."""
    rows = summary.table3
    columns: list[Column] = [("(Gmax, Npop)", _configuration)]
    for name in (*(curve.name for curve in summary.data), MEAN):
        columns += _beside_the_paper(rows, name)
    readings = "; ".join(f"{_configuration(row)}: {row.note}" for row in rows if row.note)
    note = (
        f"{readings}. J is Σ |rate error| over the samples, mm³/ms: median (quartiles) over the seeds. ★ least of a "
        "column. J cannot be compared with the paper's, whose curves and unit are not published; the pattern can."
    )
    return table_from_columns("Table 3: least J", rows, columns, note)


def _configuration(row: ConfigurationResult) -> str:
    return f"({row.generations}, {row.members})"


def _beside_the_paper(rows: Sequence[ConfigurationResult], name: str) -> list[Column]:
    """Columns of Table 3 for one pressure."""
    best = min((row.median[name] for row in rows if isfinite(row.median[name])), default=None)

    def ours(row: ConfigurationResult) -> Cell:
        median, q1, q3 = (quantiles[name] for quantiles in (row.median, row.q1, row.q3))
        return Cell(f"{to_fixed(median, 1)} ({to_fixed(q1, 0)}–{to_fixed(q3, 0)})", best=median == best)

    return [(f"{name}: ours", ours), ("paper's", lambda row: to_fixed(row.paper[name], 2))]


def j_table(summary: ReproductionSummary) -> Table:
    """J of every model at every pressure, medians and quartiles."""
    spreads = summary.j_spread
    columns: list[Column] = [
        ("data", lambda curve: curve.name),
        ("role", lambda curve: curve.role),
        *((text, lambda curve, k=k: _spread(spreads[curve.name][k], 4)) for k, text in summary.labels.items()),
    ]
    note = "The paper's optimal k are those of its Table 1, put into the fitted model, not those of a fit."
    return table_from_columns("J of the models, mm³/ms", summary.data, columns, note, 2)


def rigid_table(summary: ReproductionSummary) -> Table:
    """Stop and control volume of the rigid body that is fitted."""

    def in_field_unit(value: float, dimension: RigidDimension) -> str:
        return significant(value, 4, field_unit(dimension.unit).factor)

    columns: list[Column] = [
        ("", lambda p: f"{p.meaning}, {field_unit(p.unit).text}"),
        ("drawing", lambda p: in_field_unit(p.drawing, p)),
        ("searched", lambda p: f"{in_field_unit(p.search.lower, p)} to {in_field_unit(p.search.upper, p)}"),
        ("fitted: median (quartiles)", lambda p: _spread(p.search.best.spread, 3, field_unit(p.unit).factor)),
    ]
    note = "Fitted at 160 MPa like k1…k7, because the paper does not state the rigid body's parameters; its J is above."
    return table_from_columns("The rigid body that is fitted", summary.rigid_fit, columns, note)


def phases_table(summary: ReproductionSummary) -> Table:
    """Median J by phase and by window."""
    medians = summary.phases.median
    columns: list[Column] = [
        *_data_and_model(summary),
        *(
            (phase, lambda row, i=i: to_fixed(medians[row[0].name][row[1]][i], 1))
            for i, phase in enumerate(summary.phases.names)
        ),
    ]
    note = f"Medians over the seeds; time counts from the opening of the synthetic experiment. {_EDGES}"
    return table_from_columns(
        "J by phase and by window, mm³/ms", product(summary.data, summary.labels), columns, note, 2
    )


def edges_table(summary: ReproductionSummary) -> Table:
    """Opening and closing of each model against the experiment's [us]."""
    edges = summary.edges
    columns: list[Column] = [
        *_data_and_model(summary),
        ("opening", lambda row: _signed_spread(edges[row[0].name][row[1]].opening)),
        ("closing", lambda row: _signed_spread(edges[row[0].name][row[1]].closing)),
    ]
    note = f"Model − synthetic experiment, median (quartiles) over the seeds; + is late. {_EDGES}"
    return table_from_columns("Opening and closing, µs", product(summary.data, summary.labels), columns, note, 2)


def _data_and_model(summary: ReproductionSummary) -> list[Column]:
    """First columns of rows (curve, label)."""
    return [("data", lambda row: row[0].name), ("model", lambda row: summary.labels[row[1]])]


def treatments_table(summary: ReproductionSummary) -> Table:
    """Treatments of infeasible trials: share of simulated trials, and least J."""
    columns: list[Column] = [
        ("treatment", lambda t: t.text),
        ("slots", lambda t: f"{t.slots:,}"),
        ("simulated, %", lambda t: _spread(t.share, 3, 100.0)),
        ("least J, mm³/ms", lambda t: _spread(t.spread, 4)),
    ]
    note = (
        "The paper does not say how trials that violate (14) to (16) were treated. Here (70, 50) at 160 MPa: median "
        "(quartiles) over the seeds; no number if a search found no feasible member."
    )
    return table_from_columns("Treatments of the constraints", summary.treatments, columns, note)


def overfitting_table(summary: ReproductionSummary) -> Table:
    """J at the unseen pressures: fitted at 160 MPa against fitted there."""
    columns: list[Column] = [
        ("data", lambda row: row[0]),
        ("theoretical", lambda row: _spread(row[1].theoretical, 4)),
        ("fitted at 160 MPa", lambda row: _spread(row[1].fitted_at_160, 4)),
        ("fitted to this curve", lambda row: _spread(row[1].fitted_there, 4)),
        ("gain kept, %", lambda row: _spread(row[1].gain_kept, 3, 100.0)),
    ]
    note = "Gain over the theoretical model; gain kept: share of it that the fit at 160 MPa reaches."
    title = "What one pressure teaches about the others: J, mm³/ms"
    return table_from_columns(title, summary.overfitting.items(), columns, note)


def meter_table(summary: ReproductionSummary) -> Table:
    """Effect of the bench's meter on stiffness and unseen J."""
    names = [curve.name for curve in summary.data]
    columns: list[Column] = [
        ("meter in the fit", lambda m: m.text),
        *((f"J, {name}", lambda m, n=name: _spread(m.j[n], 4)) for name in names),
        *((f"{k}, N/µm", lambda m, k=k: _spread(m.stiffness[k].spread, 3, PER_MICRON)) for k in ("k5", "k7")),
        ("delay, µs", lambda m: _spread(m.delay, 3, MICROSECOND) if m.delay else ""),
    ]
    true = {k.symbol: significant(k.paper, 3, PER_MICRON) for k in summary.table1}
    note = (
        "Fitted at 160 MPa with (70, 50); J [mm³/ms] at 120 and 80 MPa is of unseen curves. Median (quartiles) over "
        f"the seeds. The paper's k5 and k7, which are the default bench's true ones: {true['k5']} and {true['k7']} "
        "N/µm. A delay and k7 do nearly the same to one curve."
    )
    return table_from_columns("Fits that know the rate meter", summary.meter, columns, note)


def _spread(values: Spread, digits: int, scale: float = 1.0) -> str:
    median, q1, q3 = (significant(value, digits, scale) for value in values)
    return f"{median} ({q1}–{q3})" if isfinite(values.median) else median


def _signed_spread(values: Spread) -> str:
    median, q1, q3 = (to_signed(value * MICROSECOND, 1) for value in values)
    return f"{median} ({q1} to {q3})" if isfinite(values.median) else median


def _signed_percent(share: float) -> str:
    return to_signed(100.0 * share, 0)


# The page of a reproduction: claims first, then the paper's tables and figures.

Traces = Mapping[int, Mapping[str, Mapping[str, Floats]]]

FEWEST = 6  # seeds that can separate a claim from chance
NOT_COMPARABLE = (
    "J depends on the data, so it cannot be compared with the paper's; what can be compared is the pattern."
)
PLATE_FOLDER, PLATES = "figures", ("fig4", "fig5", "fig6")  # for print, each as SVG and PDF


def reproduction_html(record: Record, traces: Traces, folder: str = "RUN", plates: bool = True) -> str:
    """Page of a reproduction from its record and its curves by seed and data set.

    `folder`: name of the folder for command lines in the page; `plates`: figures for print are next to the page.
    """
    summary = from_record(ReproductionSummary, record)
    figures = [charts.convergence(summary), charts.search_boxes(summary), *charts.rates(summary, traces)]
    heights = [400, 400, *(360 if i == 0 else 460 for i, _ in enumerate(figures[2:]))]  # [px], of one panel, and of two
    drawn = [(f, figure_html(f, f"figure-{i}", h)) for i, (f, h) in enumerate(zip(figures, heights, strict=True))]
    return render(
        "reproduction.html",
        package=__package__,
        kind="Reproduction",
        record=record,
        synthetic=[summary.synthetic, NOT_COMPARABLE],
        lines=meaning(summary),
        tiles=_tiles(summary),
        first=drawn[2] if len(drawn) > 2 else None,
        counted=verdicts(summary),
        groups=_group_claims(summary.claims),
        table1=table1(summary),
        table3=table3(summary),
        models=[table(summary) for table in MODEL_TABLES],
        treatments=treatments_table(summary),
        convergence=drawn[0],
        boxes=drawn[1],
        rates=drawn[3:],
        plates=[(name, f"{PLATE_FOLDER}/{name}") for name in PLATES if plates],
        commands=_commands(summary.asked, folder),
        facts=[
            *_facts(summary),
            ("Software", ", ".join(f"{name} {version}" for name, version in record["software"].items())),
        ],
    )


MODEL_TABLES = (j_table, rigid_table, meter_table, phases_table, edges_table, overfitting_table)
# Claims by subject, in the order of the page; each covers the claims whose identifiers begin with it.
GROUPS = {
    "Models and prediction": ("ordering", "optimised-", "no-overfitting", "theoretical-", "rigid-", "gains-", "window"),
    "Single stiffnesses": ("stiffer", "near-theory", "close-to-theory", "k4", "far-from-theory", "k6", "clearance"),
    "Search": ("rapid", "best-configuration", "cheap-configuration"),
}
ORDERING, FITTED = "ordering-", "ordering-fitted-"


def _group_claims(claims: Sequence[Claim]) -> list[tuple[str, list[dict[str, Any]]]]:
    """Claims by group, ungrouped ones at the end."""
    groups: dict[str, list[dict[str, Any]]] = {group: [] for group in (*GROUPS, "Others")}
    for claim in claims:
        group = next((group for group, names in GROUPS.items() if claim.id.startswith(names)), "Others")
        groups[group].append(_claim(claim))
    return [(group, rows) for group, rows in groups.items() if rows]


def _orders(claims: Sequence[Claim]) -> tuple[list[Claim], list[Claim]]:
    """Claims on the order of the models at each pressure: with the rigid body as drawn, and with a fitted one."""
    fitted = [claim for claim in claims if claim.id.startswith(FITTED)]
    return [claim for claim in claims if claim.id.startswith(ORDERING) and claim not in fitted], fitted


def _seeds(claims: list[Claim]) -> str:
    return f"{' · '.join(str(claim.true_in) for claim in claims)} of {max(claim.of for claim in claims)}"


def _describe_gains_kept(summary: ReproductionSummary) -> str:
    gains = [row.gain_kept.median for row in summary.overfitting.values()]
    return " · ".join(f"{percent(gain, 0)} %" for gain in gains if isfinite(gain))


def _count_covered(summary: ReproductionSummary) -> str:
    return f"{sum(k.covered for k in summary.table1)} of {sum(k.intervals for k in summary.table1)}"


def meaning(summary: ReproductionSummary) -> list[str]:
    """Sentences on the results of the study: models and prediction, single stiffnesses, the meter's effect on k7."""
    drawn, fitted = _orders(summary.claims)
    names = " · ".join(curve.name for curve in summary.data)
    sentences = []
    if drawn and fitted:
        sentences.append(
            f"The optimised model beats the theoretical model, which beats the rigid body, in {_seeds(drawn)} "
            f"seeds at {names}, and in {_seeds(fitted)} if the rigid body is fitted too; on the unseen curves the "
            f"fit keeps {_describe_gains_kept(summary)} of the possible gain."
        )
    verdicts = [k.verdicts for k in summary.table1]
    determined, judged = sum(v.get("determined", 0) for v in verdicts), sum(sum(v.values()) for v in verdicts)
    sentences.append(
        f"Single stiffnesses are another matter, since one curve determines mostly combinations of them: "
        f"{determined} of {judged} are determined, and {_count_covered(summary)} intervals hold the bench's true value."
    )
    return [*sentences, *_behind_k7(summary)]


def _behind_k7(summary: ReproductionSummary) -> list[str]:
    """Sentence on k7 without the meter and with the bench's meter in the model, and the truth."""
    medians = {meter.label: meter.stiffness["k7"].spread.median for meter in summary.meter}
    truth = next((k.truth for k in summary.table1 if k.symbol == "k7"), None)
    without, with_known_meter = (number(medians.get(label)) for label in ("none", "known"))
    if without is None or with_known_meter is None or truth is None:
        return []
    texts = [significant(k, 3, PER_MICRON) for k in (without, with_known_meter, truth)]
    is_nearer = abs(with_known_meter - truth) < abs(without - truth)
    return [
        f"Without the rate meter in the model k7 is {texts[0]} N/µm, with the meter {texts[1]}; the truth is "
        f"{texts[2]}{': k7 absorbs the delay of the meter' if is_nearer else ''}."
    ]


def _tiles(summary: ReproductionSummary) -> list[Tile]:
    drawn, _ = _orders(summary.claims)
    worst = max((_LEVELS[claim.verdict] for claim in drawn), key=_WORST.index, default="")
    order = [Tile("order of the models", _seeds(drawn), "seeds, as in the paper", worst)] if drawn else []
    always = sum(claim.true_in == claim.of > 0 for claim in summary.claims)
    return [
        *order,
        Tile(
            "unseen curves",
            _describe_gains_kept(summary) or MISSING,
            f"of the gain kept at {' · '.join(summary.overfitting)}",
        ),
        Tile("stiffnesses", _count_covered(summary), "intervals hold the truth"),
        Tile("claims", f"{always} of {len(summary.claims)}", "of the paper's claims, true in every seed"),
    ]


_WORST = (GOOD, CARE, BAD)
_LEVELS = {"holds": GOOD, "does not hold": BAD, "cannot be told": CARE}


def verdicts(summary: ReproductionSummary) -> str:
    """Sentence with the number of the paper's claims that hold, or with too few seeds, that are true in each seed."""
    claims = summary.claims
    if len(summary.seeds) < FEWEST:
        always = sum(claim.true_in == claim.of > 0 for claim in claims)
        never = sum(claim.true_in == 0 for claim in claims)
        return (
            f"Of {len(claims)} claims of the paper {always} are true in every seed, {never} in none, "
            f"{len(claims) - always - never} in some. Fewer than {FEWEST} seeds cannot tell a claim from chance."
        )
    counts = Counter(claim.verdict for claim in claims)
    parts = [f"{counts[verdict]} {words}" for verdict, words in _WORDS.items() if verdict in counts]
    return f"Of {len(claims)} claims of the paper {join_words(parts)} here."


_WORDS = {"holds": "hold", "does not hold": "do not hold", "cannot be told": "cannot be told"}


def _claim(claim: Claim) -> dict[str, Any]:
    """Texts of a claim."""
    low, high = claim.interval
    return claim._asdict() | {
        "sign": SIGNS[claim.verdict],
        "share": f"{claim.true_in} of {claim.of} seeds",
        "interval": f"{percent(low, 0)}–{percent(high, 0)} %",
        "chance": "" if claim.chance is None else f"{percent(claim.chance, 0)} %",
    }


def _commands(asked: int, folder: str) -> list[tuple[str, str]]:
    run, again = shlex.quote(folder), f"commonrail lab reproduce --seeds {asked}"
    return [
        ("Reproduce again, with the same truth", f"{again} --truth {run}/truth.toml"),
        ("Change the truth", "commonrail lab virtual-bench --show > my-truth.toml"),
        ("Make this report again", f"commonrail report {run}"),
    ]


def _facts(summary: ReproductionSummary) -> list[tuple[str, str]]:
    seeds = summary.seeds
    return [
        ("Seeds", f"{len(seeds)} of {summary.asked} asked for: {seeds[0]} to {seeds[-1]}"),
        ("Ended", summary.status),
        ("Simulations", f"{summary.simulations:,} injections in {duration(summary.seconds)}"),
        ("Time step", f"{significant(summary.time_step, 4, 1e6)} µs"),
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

    summary = from_record(ReproductionSummary, record)
    rates = charts.rates(summary, traces)
    return print_sheets(
        {
            "fig4": lambda: single(charts.convergence(summary), (COLUMN, 66.0)),
            "fig5": lambda: single(charts.search_boxes(summary), (COLUMN, 66.0)),
            "fig6": lambda: side_by_side(rates, (PAGE, 62.0 * len(rates))),
        }
    )


def _has_plates(folder: Path) -> bool:
    return all((folder / PLATE_FOLDER / f"{name}.{kind}").is_file() for name in PLATES for kind in ("svg", "pdf"))


RESULT = ResultKind(RECORD, "reproduction", "lab reproduce", _page, extra=draw_plates)
