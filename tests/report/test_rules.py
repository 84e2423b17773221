"""Rules of the verdict by values: limits of errors, and the order of what speaks against a result."""

from __future__ import annotations

import pytest

from commonrail.report.data.view import FitError
from commonrail.report.fit.rules import BAD, CARE, GOOD, Kind, Point, Step, judge, level_of

STEP = Step("")


@pytest.mark.parametrize(
    ("error", "level"),
    [
        (FitError(0.009), GOOD),
        (FitError(0.03), GOOD),
        (FitError(0.031), CARE),
        (FitError(0.10), CARE),
        (FitError(0.12), BAD),
        (FitError(0.12, tolerance=0.15), GOOD),
        (FitError(0.02, tolerance=0.01), GOOD),  # no limit is less than that of its kind
        (FitError(1.0, in_tolerances=True), GOOD),
        (FitError(2.0, in_tolerances=True), CARE),
        (FitError(3.1, in_tolerances=True), BAD),
    ],
)
def test_an_error_has_the_level_of_its_limits(error: FitError, level: str) -> None:
    assert level_of(error) == level


@pytest.mark.parametrize(
    ("kind", "level"),
    [(Kind.FAULT, BAD), (Kind.TEST, CARE), (Kind.SEARCH, CARE), (Kind.BOUND, CARE), (Kind.NOTE, GOOD)],
)
def test_each_kind_of_point_decides_by_itself(kind: Kind, level: str) -> None:
    point = Point(kind, "", STEP)
    assert judge([point]) == (level, [] if level == GOOD else [point])
    assert judge([point, Point(Kind.FAULT, "", STEP)])[0] == BAD


def test_the_main_reason_is_the_worst_then_the_least_probable_test() -> None:
    points = [
        Point(Kind.BOUND, "bound", STEP),
        Point(Kind.ERROR, "usable", STEP, FitError(0.05)),
        Point(Kind.TEST, "likely", STEP, probability=1e-3),
        Point(Kind.TEST, "unlikely", STEP, probability=1e-9),
        Point(Kind.ERROR, "fine", STEP, FitError(0.01)),
    ]
    assert [point.reason for point in judge(points)[1]] == ["unlikely", "likely", "usable", "bound"]
    large = [Point(Kind.ERROR, str(size), STEP, FitError(size)) for size in (0.11, 0.5)]
    assert [point.reason for point in judge([*points, *large])[1][:3]] == ["0.5", "0.11", "unlikely"]
