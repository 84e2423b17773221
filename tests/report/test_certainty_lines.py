"""Sentences of the report on the tests that a fit has passed."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.report.fit.certainty import certainty_lines, certainty_tables


def record(found: bool) -> dict[str, Any]:
    """Record of one parameter, whose fit was tested for friction of the guides."""
    test = {"name": "guides", "score": 0.001 if found else 0.42, "size": None, "suspect": "friction", "found": found}
    certainty = {
        "starts": 1,
        "adopted": 0,
        "gain": None,
        "noise": [],
        "fitted_as_stated": [],
        "visible_delay": None,
        "withdrawn": "friction in the guides explains the curves better" if found else "",
        "parameters": [{"name": "k7", "moved_by": [], "cure": ""}],
        "sensitivity": [],
        "tests": [test],
    }
    return {"certainty": certainty, "parameters": [{"name": "k7", "unit": "N/m", "best": 1.0}]}


def test_a_test_of_friction_that_found_nothing_is_told_with_its_probability() -> None:
    (line,) = [one for one in certainty_lines(record(False)) if "friction" in one]
    assert "no better than chance does (probability 0.42)" in line


def test_friction_that_was_found_is_told_as_the_reason_alone() -> None:
    (line,) = [one for one in certainty_lines(record(True)) if "friction" in one]
    assert line.startswith("No parameter is called pinned")


def test_one_estimator_of_all_is_told_once_and_several_with_each_parameter() -> None:
    one = {"name": "k1", "sentence": "pinned", "value": 1.0, "lower": 0.5, "upper": 1.5, "estimator": "curvature"}
    for estimators in (("curvature",) * 2, ("curvature", "profile")):
        parameters = [one | {"name": f"k{i}", "estimator": text} for i, text in enumerate(estimators)]
        found = {"level": 0.95, "parameters": parameters, "combinations": [], "noise": []}
        table = certainty_tables(
            {"certainty": found, "parameters": [{"name": p["name"], "unit": "m"} for p in parameters]}
        )[0]
        same = len(set(estimators)) == 1
        assert ("estimator" in table.columns) is not same
        assert ("Estimator of all: curvature." in table.note) is same
        assert table.columns[table.texts] == "most likely"  # numbers stand after all words


def test_what_was_fitted_as_stated_is_told_with_its_value() -> None:
    found = record(False)
    found["certainty"]["fitted_as_stated"] = [{"name": "plunger_needle.friction", "value": 4.21, "unit": "N"}]
    assert "Fitted within what the study states, and integrated out: plunger_needle.friction 4.2 N." in certainty_lines(
        found
    )


@pytest.mark.parametrize("is_stated", [False, True])
def test_what_a_delay_moves_is_told_once(is_stated: bool) -> None:
    """By fits where the study states it, else by derivatives: two figures for one question are one too many."""
    found = record(False)
    move = {"name": "delay of bench", "deviation": 1e-6, "unit": "s", "percent": 6.5}
    found["certainty"] |= {
        "parameters": [{"name": "k7", "moved_by": [move] if is_stated else [], "cure": ""}],
        "sensitivity": [
            {"quantity": "delay", "text": "1 us of delay", "percent": [1.8]},
            {"quantity": "gain", "text": "1 % of gain", "percent": [0.4]},
        ],
        "visible_delay": 2e-6,
    }
    lines = certainty_lines(found)
    assert "1 % of gain would move k7 by 0.4 %." in lines
    assert ("1 us of delay would move k7 by 1.8 %." in lines) is not is_stated
    assert ("One standard deviation of the delay of bench (1 µs) moves k7 by 6.5 %." in lines) is is_stated
    words = "beyond what the study states" if is_stated else "which the study lacks"
    assert any(line.startswith(f"A delay of the meter of 2 µs, {words}, ") for line in lines)
