"""Parameters against their bounds."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.base.table import Table
from commonrail.calibration.record import CertainParameter, CertaintyRecord, ParameterRecord, read_as
from commonrail.report.fit import tables
from commonrail.report.fit.certainty import interval_text
from tests.report.samples import rate_record

Records = list[dict[str, Any]]


def parameter_rows(parameters: Records, certainty: dict[str, Any] | None = None) -> list[tables.ParameterRow]:
    return tables.parameter_rows([read_as(ParameterRecord, p) for p in parameters], _certain(certainty))


def parameter_table(parameters: Records, certainty: dict[str, Any] | None = None) -> Table:
    return tables.parameter_table([read_as(ParameterRecord, p) for p in parameters], _certain(certainty))


def _certain(certainty: dict[str, Any] | None) -> CertaintyRecord | None:
    return None if certainty is None else read_as(CertaintyRecord, certainty)


def test_positions_are_percentages_of_the_range() -> None:
    record = rate_record()["parameters"][1]  # k2: 0.1 … 2 times the start value
    (row,) = parameter_rows([record])
    assert row.start_at == 47.37  # (1 − 0.1)/1.9
    assert row.best_at == 48.54  # (8.26/8.08 − 0.1)/1.9
    assert row.bounds == "8.08 to 162 N/µm"
    assert row.change == "+2.2"


def test_a_start_value_outside_the_bounds_stays_on_the_bar() -> None:
    record = rate_record()["parameters"][1] | {"reference": 1.0e7, "lower": 2.0e7}
    assert parameter_rows([record])[0].start_at == 0.0


def test_a_standard_error_beyond_the_range_is_not_given_as_a_number() -> None:
    record = rate_record()["parameters"][1]
    assert parameter_rows([record])[0].interval == "± 2.48 N/µm"  # 3 % of 82.6
    wide = record | {"standard_error": 2e8}  # the range is 154 N/µm
    assert parameter_rows([wide])[0].interval.startswith("± more")


def test_the_mark_is_written_in_words() -> None:
    assert parameter_rows(rate_record()["parameters"])[0].mark == "fitted or derived"


def test_a_parameter_without_identification_has_dashes() -> None:
    record = rate_record()["parameters"][0]
    for key in ("effect", "pinned", "standard_error", "verdict"):
        del record[key]
    (row,) = parameter_rows([record])
    assert (row.effect, row.interval, row.verdict, row.span) == ("–", "", "–", None)


def test_a_machine_zero_is_not_given_as_an_effect() -> None:
    record = rate_record()["parameters"][0]
    assert parameter_rows([record | {"effect": 0.25, "pinned": 2.9e-15}])[0].effect.startswith("0.25, none")
    assert parameter_rows([record | {"effect": 0.25, "pinned": 0.01}])[0].effect.startswith("0.25, 0.01 ")


def test_a_parameter_has_one_value_and_the_interval_of_the_likelihood() -> None:
    """The most likely value is offered for adoption elsewhere; two values of one parameter are one too many."""
    record = rate_record()["parameters"][1]  # calibrated 82.6 N/µm, bounds 8.08 to 161.6 N/µm
    likely = {"name": record["name"], "value": 50e6, "lower": 45e6, "upper": 55e6, "percent": 10.0}
    certainty = {"level": 0.95, "parameters": [likely]}
    (row,) = parameter_rows([record], certainty)
    assert (row.best, row.interval) == ("82.6 N/µm", "45 to 55 N/µm")
    assert row.span == pytest.approx((24.05, 6.52), abs=0.02)  # (45 − 8.08)/153.52 and 10/153.52
    table = parameter_table([record], certainty)
    assert "95 % interval" in table.columns
    assert "50 N/µm" not in [cell.plain for row in table.rows for cell in row]


def test_a_value_has_as_many_digits_as_its_interval() -> None:
    record = rate_record()["parameters"][1] | {"best": 82.604e6}
    known = {"name": record["name"], "value": 82.604e6, "lower": 82.602e6, "upper": 82.606e6, "percent": 0.002}
    (row,) = parameter_rows([record], {"level": 0.95, "parameters": [known]})
    low, _, high = row.interval.removesuffix(" N/µm").partition(" to ")
    assert float(low) < float(row.best.removesuffix(" N/µm")) < float(high)


def test_an_interval_beyond_the_bounds_fills_the_bar() -> None:
    record = rate_record()["parameters"][1]
    wide = {"name": record["name"], "value": 50e6, "lower": -1e9, "upper": 1e9, "percent": 2000.0}
    (row,) = parameter_rows([record], {"level": 0.95, "parameters": [wide]})
    assert (row.interval, row.span) == ("not bounded by the data", (0.0, 100.0))


@pytest.mark.parametrize(
    ("lower", "upper", "text"),
    [
        (-1693.6e6, 2377.9e6, "not bounded by the data"),
        (-12e6, 100e6, "below 100 N/µm"),
        (20e6, 300e6, "above 20 N/µm"),
        (20e6, 100e6, "20 to 100 N/µm"),
        (None, None, "–"),
    ],
)
def test_an_interval_is_given_within_the_bounds(lower: float | None, upper: float | None, text: str) -> None:
    known = read_as(ParameterRecord, rate_record()["parameters"][1])  # bounds 8.08 to 162 N/µm
    likely = CertainParameter(name=known.name, value=50e6, lower=lower, upper=upper, percent=100.0)
    assert interval_text(likely, known) == text


def test_the_terminal_has_value_error_and_bounds_of_each_parameter() -> None:
    record = rate_record()["parameters"][1] | {"verdict": "determined", "at_bound": False}
    del record["standard_error"]
    table = parameter_table([record | {"standard_error": 2.48e6}, record | {"at_bound": True}])
    first, second = ([cell.plain for cell in row] for row in table.rows)
    assert first[:5] == [record["name"], "82.6 N/µm", "± 2.48 N/µm", "determined", "80.8 N/µm"]
    assert first[5:] == ["+2.2", "8.08 to 162 N/µm", "no"]
    assert second[2:] == ["–", "determined", "80.8 N/µm", "+2.2", "8.08 to 162 N/µm", "yes"]


def test_a_prior_is_shown_with_its_pull() -> None:
    record = rate_record()["parameters"][1]
    prior = {"prior": {"value": 8e7, "sigma": 2e6, "source": "a sister part"}, "pull": 1.3}
    assert parameter_rows([record])[0].pull == ""
    (row,) = parameter_rows([record | prior])
    assert row.pull == "+1.3 σ"
    assert row.prior == pytest.approx((45.54, 2.61), abs=0.02)  # 78 to 82 N/µm between 8.08 and 161.6
    table = parameter_table([record | prior, record])
    assert table.columns[-1] == "from its prior"
    assert [row[-1].plain for row in table.rows] == ["+1.3 σ", "–"]
    assert "from its prior" not in parameter_table([record]).columns
