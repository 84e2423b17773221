"""A study in one call."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import commonrail as cr

TEMPLATE = Path(cr.__file__).parent / "plugins" / "new" / "template" / "study.toml"
NAME = "valve.spring_preload"


@pytest.fixture(scope="module")
def given() -> cr.Study:
    """Study of the template, for its injector and data."""
    return cr.load_study(TEMPLATE)


def test_bounds_are_values_texts_or_shares(given: cr.Study) -> None:
    start = given.injector.values["nozzle.discharge_maximum"]
    free = {NAME: ("60 N", 95.0), "nozzle.discharge_maximum": "10 %"}
    study = cr.study(given.injector, given.data, free=free)
    first, second = study.space.parameters
    assert (first.name, first.lower, first.upper, first.unit) == (NAME, 60.0, 95.0, "N")
    assert first.reference == given.injector.values[NAME]
    assert (second.lower, second.upper) == pytest.approx((0.9 * start, 1.1 * start))
    assert study.title == given.injector.name
    assert study.time_step == given.time_step
    assert study.method.polish == 3


def test_one_data_set_needs_no_list_and_constraints_are_texts(given: cr.Study) -> None:
    names = "control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter"
    study = cr.study(given.injector, given.data[0], free=dict.fromkeys(names, "10 %"), constraints=[" < ".join(names)])
    assert study.data == given.data
    assert len(study.space.rows) == 1


@pytest.mark.parametrize(
    ("free", "words"),
    [
        ({"valve.spring_preloat": "5 %"}, r"valve\.spring_preloat \(.*valve\.spring_preload"),
        ({NAME: "60 N"}, r'\(lower, upper\) .*"10 %"'),
        ({NAME: ("95 N", "60 N")}, "lower bound .*upper"),
        ({NAME: ("60 mm", "95 N")}, "bound of valve.spring_preload"),
        (["a"], "free"),
        ({}, "one parameter"),
    ],
)
def test_bounds_that_cannot_be_used_are_refused(given: cr.Study, free: Any, words: str) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=words):
        cr.study(given.injector, given.data, free=free)
