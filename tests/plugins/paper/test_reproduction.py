"""The page of a reproduction: everything said is in the record, everything in it is escaped."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from scipy.stats import binomtest

from commonrail.base.errors import InputError
from commonrail.base.record import from_record
from commonrail.base.text import MISSING
from commonrail.plugins.paper import charts
from commonrail.plugins.paper import page as tables
from commonrail.plugins.paper.file import ReproductionSummary
from commonrail.plugins.paper.page import FEWEST, RESULT, meaning, reproduction_html, verdicts
from tests.report.reproduction_sample import record, summary, traces


def rows(table: tables.Table) -> list[list[str]]:
    return [[cell.plain for cell in row] for row in table.rows]


def test_the_verdicts_are_counted() -> None:
    enough = replace(summary(), seeds=tuple(range(6)))
    assert re.findall(r"\d+", verdicts(enough)) == ["4", "2", "1", "1"]


def test_with_too_few_seeds_it_is_said_what_they_show() -> None:
    claims = summary().claims
    few = claims[0], claims[1]._replace(true_in=0), claims[2]._replace(true_in=1), claims[3]
    assert re.findall(r"\d+", verdicts(replace(summary(), claims=few))) == ["4", "2", "1", "1", "6"]


def test_six_seeds_are_the_fewest_that_can_tell_a_claim_from_chance() -> None:
    lows = {n: float(binomtest(n, n).proportion_ci(0.95).low) for n in (FEWEST - 1, FEWEST)}
    assert lows[FEWEST - 1] < 0.5 < lows[FEWEST]


def test_the_page_says_what_the_record_says() -> None:
    page = reproduction_html(record(), traces(), "runs/my study")
    text = re.sub(r"<script.*?</script>|</?span[^>]*>", "", page, flags=re.S)
    for words in (
        "All of it is made up for a test.",
        "The claim one &amp; &lt;more&gt;.",
        "✗ does not",
        "2 of 2 seeds",
        "16–100 %",
        "A comment.",
        "probability 91 %",
        "is fitted",
        "noise",
        "figures/fig6.pdf",
        "--truth &#39;runs/my study&#39;/truth.toml",
        "123,456 injections in 12.5 s",
        "few seeds",
        "reproduce --seeds 2 --truth",
    ):
        assert words in text, words
    assert "<more>" not in page


def test_the_study_leads_with_orders_truths_and_the_meter_in_the_records_numbers() -> None:
    order = [summary().claims[0]._replace(id=f"ordering-{n}", true_in=n, of=9) for n in (9, 8)]
    claims = (*order, order[0]._replace(id="ordering-fitted-9", true_in=0))

    def sentences(without: float, with_meter: float) -> list[str]:
        """With these medians of k7; the truth is 8.4e8."""
        made = record()
        made["meter"][0]["stiffness"]["k7"]["median"] = without
        made["meter"][1]["stiffness"]["k7"]["median"] = with_meter
        return meaning(replace(from_record(ReproductionSummary, made), claims=claims))

    models, single, meter = sentences(4.0e8, 8.0e8)
    assert "9 · 8 of 9" in models
    assert "0 of 9" in models
    assert "12 of 14" in single  # 6 parameters × 2 seeds, none of k7
    assert re.search(r"400 N/µm, .*800.*840.* absorbs", meter)
    assert "absorbs" not in sentences(4.0e8, 3.0e8)[2]  # farther off: the meter explains nothing


def test_an_interrupted_run_says_how_far_it_came() -> None:
    page = reproduction_html(record() | {"status": "interrupted", "asked": 20}, traces())
    assert "2 of 20" in page


def test_what_the_meter_changes_stands_beside_the_fit_without_it() -> None:
    table = tables.meter_table(summary())
    found = rows(table)
    assert [row[0] for row in found] == ["no meter", "a known meter", "a fitted delay"]
    assert found[0][1:4] == ["200 (180–220)", "201 (180.9–221.1)", "202 (181.8–222.2)"]
    assert [row[5:] for row in found[1:]] == [["60.5 (54.4–66.6)", ""], ["60.5 (54.4–66.6)", "5.3 (4.77–5.83)"]]


def test_table_1_is_in_newtons_per_micrometre() -> None:
    found = rows(tables.table1(summary()))
    assert found[0] == ["k1", "100", "150", "123 (111–136)", "120", "2 of 2", "+50", "−25", "5.5", "determined: 2"]
    assert found[6][4:6] == ["840", "0 of 2"]
    assert found[6][9] == "only in combination: 1; not confirmed: 1"
    assert found[6][8] == MISSING  # no standard error


def test_table_3_marks_the_least_of_a_column() -> None:
    found = rows(tables.table3(summary()))
    assert found[1][:3] == ["(50, 70)", "★ 148.0 (148–148)".replace("★ ", "★\N{NO-BREAK SPACE}"), "166.25"]
    assert not any("★" in cell for cell in (*found[0], *found[2]))
    assert "(70, 50): " in tables.table3(summary()).note


def test_a_search_without_success_has_no_number() -> None:
    assert rows(tables.treatments_table(summary()))[1] == ["treatment literal", "3,550", "0.13 (0.117–0.143)", MISSING]


def test_edges_are_microseconds_with_their_sign() -> None:
    assert rows(tables.edges_table(summary()))[0] == ["160 MPa", "rigid body", "−93.5 (−84.2 to −102.9)", MISSING]


def test_the_fitted_rigid_body_is_in_the_drawings_units() -> None:
    table = tables.rigid_table(summary())
    assert rows(table) == [
        ["lift of the stop, µm", "100", "10 to 1000", "212 (191–233)"],
        ["volume of the control chamber, mm³", "18", "1.8 to 180", "50 (45–55)"],
    ]


def test_the_tables_have_as_many_cells_as_columns() -> None:
    found = summary()
    for make in (
        tables.table1,
        tables.table3,
        tables.j_table,
        tables.phases_table,
        tables.edges_table,
        tables.treatments_table,
        tables.overfitting_table,
    ):
        table = make(found)
        assert {len(row) for row in table.rows} == {len(table.columns)}


def test_figure_4_has_medians_and_quartiles() -> None:
    (panel,) = charts.convergence(summary()).panels
    assert panel.series[1].y == (300.0, 200.0, 156.0)
    assert {(band.look, band.low[0], band.high[0]) for band in panel.bands} == {
        ("mean", 1900.0, 2100.0),
        ("best", 280.0, 320.0),
    }
    assert panel.series[2].y == (830.0, 830.0)


def test_figure_5_is_relative_to_theory() -> None:
    (panel,) = charts.search_boxes(summary()).panels
    assert panel.categories == tuple(f"k{i}" for i in range(1, 8))
    assert panel.boxes[0].boxes[0] == (0.5, 0.8, 1.0, 1.2, 1.9)
    assert panel.boxes[0].label == "seed 4"


def test_figure_6_shows_one_seed_with_gaps_where_a_simulation_failed() -> None:
    found = charts.rates(summary(), traces())
    assert [f.title for f in found] == [
        "Rate of injection at 160 MPa (fit) (Fig. 6)",
        "Rate of injection at 120 MPa (validation) (Fig. 6)",
        "Rate of injection at 80 MPa (validation) (Fig. 6)",
    ]
    curves, errors = found[2].panels
    assert [s.label for s in curves.series] == [
        "synthetic experiment",
        "rigid body",
        "rigid body, fitted",
        "theoretical",
        "optimised",
    ]
    assert curves.series[1].y == (None, None, None, None)
    assert curves.series[0].y[1] == pytest.approx(20.0)
    # the fourth of the sample's models, optimised, is 1.4 times the experiment
    assert errors.series[3].y[1] == pytest.approx(8.0)


@pytest.mark.parametrize(
    "broken", [{}, {"kind": "calibration", "schema": 1}, {"kind": "reproduction", "schema": 9}, []]
)
def test_another_record_is_refused(tmp_path: Path, broken: object) -> None:
    (tmp_path / "reproduce.json").write_text(json.dumps(broken), encoding="utf-8")
    with pytest.raises(InputError, match=r"reproduce\.json"):
        RESULT.read(tmp_path)
