"""Sentences and tables of the report on the certainty of a fit."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.calibration.record import CertaintyRecord, ParameterRecord, read_as
from commonrail.report.fit.certainty import certainty_lines, certainty_tables


def certain(**more: Any) -> CertaintyRecord:
    """Certainty of one parameter and one quantity of the bench."""
    bench = {
        "name": "meter.bench.delay",
        "unit": "s",
        "stated": 0.0,
        "deviation": 2e-6,
        "source": "stated as uncertain",
        "value": 1.5e-6,
        "standard_error": 4e-7,
    }
    one = {"name": "k7", "sentence": "determined", "value": 1.0, "lower": 0.5, "upper": 1.5, "cure": ""}
    certainty = {
        "level": 0.95,
        "starts": 1,
        "agreeing": 1,
        "draws": {"refused": ""},
        "noise": [],
        "discrepancy": 0.0,
        "withdrawn": "",
        "parameters": [one],
        "bench": [bench],
        "combinations": [],
    }
    return read_as(CertaintyRecord, certainty | more)


def test_nothing_is_said_where_nothing_is_to_be_said() -> None:
    assert certainty_lines(certain()) == []


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"discrepancy": 0.042}, "about 4 %"),
        ({"withdrawn": "like a delay"}, "like a delay"),
        ({"draws": {"refused": "k-hat 0.9"}}, "k-hat 0.9"),
        ({"starts": 8, "agreeing": 3}, "3 of 8 starts"),
    ],
)
def test_each_finding_has_one_sentence(more: dict[str, Any], words: str) -> None:
    (line,) = certainty_lines(certain(**more))
    assert words in line


def test_a_quantity_of_the_bench_is_shown_as_stated_and_as_the_data_have_it() -> None:
    table = next(
        one
        for one in certainty_tables(certain(), [ParameterRecord(name="k7", unit="m")])
        if "bench" in one.title.lower()
    )
    (row,) = table.rows
    assert [cell.text for cell in row] == ["meter.bench.delay", "stated as uncertain", "0 s ± 2 µs", "1.5 µs ± 400 ns"]
