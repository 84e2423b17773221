"""Parameters against their bounds."""

from __future__ import annotations

from commonrail.report.parameters import parameter_rows, parameter_table
from tests.report.samples import rate_record


def test_positions_are_percentages_of_the_range() -> None:
    record = rate_record()["parameters"][1]  # k2: 0.1 … 2 times the start value
    (row,) = parameter_rows([record])
    assert row.start_at == 47.37  # (1 − 0.1)/1.9
    assert row.best_at == 48.54  # (8.26/8.08 − 0.1)/1.9
    assert (row.lower, row.upper) == ("8.08 N/µm", "162 N/µm")
    assert row.change == "+2.2"


def test_a_start_value_outside_the_bounds_stays_on_the_bar() -> None:
    record = rate_record()["parameters"][1] | {"reference": 1.0e7, "lower": 2.0e7}
    assert parameter_rows([record])[0].start_at == 0.0


def test_a_standard_error_beyond_the_range_is_not_given_as_a_number() -> None:
    record = rate_record()["parameters"][1]
    assert parameter_rows([record])[0].error == "± 2.48 N/µm"  # 3 % of 82.6
    wide = record | {"standard_error": 2e8}  # the range is 154 N/µm
    assert parameter_rows([wide])[0].error == "± more than its range"


def test_the_mark_is_written_in_words() -> None:
    assert parameter_rows(rate_record()["parameters"])[0].mark == "fitted or derived"


def test_a_parameter_without_identification_has_dashes() -> None:
    record = rate_record()["parameters"][0]
    for key in ("effect", "pinned", "standard_error", "verdict"):
        del record[key]
    (row,) = parameter_rows([record])
    assert (row.effect, row.pinned, row.error, row.verdict) == ("–", "–", "", "–")


def test_the_terminal_has_value_error_and_bounds_of_each_parameter() -> None:
    record = rate_record()["parameters"][1] | {"verdict": "pinned", "at_bound": False}
    del record["standard_error"]
    table = parameter_table([record | {"standard_error": 2.48e6}, record | {"at_bound": True}])
    first, second = ([cell.plain for cell in row] for row in table.rows)
    assert first[:2] == [record["name"], "pinned"]
    assert first[3:] == ["82.6 N/µm", "± 2.48 N/µm", "+2.2", "8.08 N/µm to 162 N/µm", "no"]
    assert second[4:] == ["–", "+2.2", "8.08 N/µm to 162 N/µm", "yes"]


def test_a_prior_is_shown_with_its_pull() -> None:
    record = rate_record()["parameters"][1]
    prior = {"prior": {"value": 8e7, "sigma": 2e6, "source": "a sister part"}, "pull": 1.3}
    assert parameter_rows([record])[0].pull == ""
    assert parameter_rows([record | prior])[0].pull == "+1.3 σ"
    table = parameter_table([record | prior, record])
    assert table.columns[-1] == "from its prior"
    assert [row[-1].plain for row in table.rows] == ["+1.3 σ", "–"]
    assert "from its prior" not in parameter_table([record]).columns
