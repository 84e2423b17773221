"""Names of columns that state operating points."""

from __future__ import annotations

import pytest

from commonrail.base.errors import InputError
from commonrail.readers.location import Place
from commonrail.readers.operating_points import ColumnPattern, unit_of_name
from tests.refused import refused

AT = Place("study.toml", "columns")


@pytest.mark.parametrize(
    ("pattern", "name", "point"),
    [
        ("{p}bar_{et}us", "800bar_300us", (80e6, 300e-6, "")),
        ("{p} MPa, {et} ms ({shot})", "160 MPa, 0,7 ms (12)", (160e6, 700e-6, "12")),
        ("ET{et}us", "ET1000us", (None, 1e-3, "")),
        ("roi.{rail_pressure}MPa", "roi.80.5MPa", (80.5e6, None, "")),
    ],
)
def test_a_name_is_read(pattern: str, name: str, point: tuple[float | None, float | None, str]) -> None:
    found = ColumnPattern(pattern, {}, AT).read(name)
    assert found is not None
    expected = [value if value is None else pytest.approx(value) for value in point[:2]]
    assert [found.rail_pressure, found.energising_time] == expected
    assert found.shot == point[2]


@pytest.mark.parametrize("name", ["800bar", "800bar_300us_2", "xbar_300us", "x800bar_300us"])
def test_a_name_of_another_form_is_no_point(name: str) -> None:
    assert ColumnPattern("{p}bar_{et}us", {}, AT).read(name) is None


def test_a_unit_may_be_stated() -> None:
    found = ColumnPattern("p{p}_t{et}", {"Pa": "bar", "s": "us"}, AT).read("p800_t300")
    assert found is not None
    assert found.rail_pressure == pytest.approx(80e6)


@pytest.mark.parametrize(
    ("pattern", "words"),
    [
        ("{p}bar_{t}us", "unknown-name columns"),
        ("{p}bar_{rail_pressure}bar", "repeated columns"),
        ("800bar", "no-placeholder columns"),
        ("{p}_{et}us", "no-unit columns"),
        ("{p}us_{et}us", "no-unit columns"),
    ],
)
def test_a_pattern_that_cannot_be_read(pattern: str, words: str) -> None:
    with refused(InputError, words):
        ColumnPattern(pattern, {}, AT)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("run.t_ms", "ms"),
        ("mdot_mg_ms_100bar", "mg/ms"),
        ("mdot_mg_per_ms", "mg/ms"),
        ("flow_per_ms", ""),
        ("I_A_20bar_3us", "A"),
        ("A", ""),
        ("speed_1", ""),
        ("q_x", ""),
    ],
)
def test_a_unit_stands_at_the_end_of_a_name_before_its_point(name: str, unit: str) -> None:
    assert unit_of_name(name) == unit
