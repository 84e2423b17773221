"""Figures printed in the paper, against one another and against the case that the project ships."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.calibration.study_file import load_study
from commonrail.plugins.paper import study as paper
from commonrail.readers.injector import load_injector

CASE = Path(__file__).parents[3] / "cases" / "paper" / "study.toml"


@pytest.mark.parametrize("configuration", paper.CONFIGURATIONS)
def test_the_last_row_of_table_3_is_the_mean_of_the_others(configuration: paper.Configuration) -> None:
    *js, mean = paper.TABLE3[configuration]
    assert np.mean(js) == pytest.approx(mean, abs=0.011)  # printed with two decimals, some of them cut off


def test_the_theoretical_stiffness_is_the_injectors_own() -> None:
    values = load_injector("virtual-lino-2016").values
    assert {name: values[name] for name in paper.NAMES} == paper.TABLE1_THEORETICAL


def test_the_papers_optimum_keeps_the_ordering_and_lies_in_the_bounds() -> None:
    space = paper.space(load_injector("virtual-lino-2016"))
    assert space.satisfies(np.array([[paper.TABLE1_OPTIMAL[name] for name in space.names]])).all()


def test_the_search_is_that_of_the_shipped_study() -> None:
    study, space = load_study(CASE), paper.space(load_injector("virtual-lino-2016"))
    assert study.space.names == space.names
    np.testing.assert_array_equal(study.space.lower, space.lower)
    np.testing.assert_array_equal(study.space.upper, space.upper)
    np.testing.assert_array_equal(study.space.rows.matrix, space.rows.matrix)
    assert study.method.evolution == paper.BEST.settings
    assert [(d.name, d.role.value) for d in study.data] == [
        (name, "fit" if name == paper.FIT else "validation") for name in paper.RAIL_PRESSURES
    ]
