"""The sentences of the report say what the record says, in bad cases too."""

from __future__ import annotations

import re

from commonrail.report.fit.verdict import headline
from tests.report.samples import fit_of, rate_record


def test_task_and_objective_each_have_a_sentence() -> None:
    task, objective = headline(fit_of(rate_record()))
    assert task.startswith("7 parameters of “Virtual injector”")
    assert re.search(r"\b1 data set \(EVI 160 MPa\); .*\bend", task)
    assert re.search(r"402\.2 to 171\.5 \(−57 %\)", objective)


def test_an_interrupted_search_says_so() -> None:
    assert "stopped early" in headline(fit_of(rate_record() | {"status": "interrupted"}))[0]


def test_start_values_that_fail_are_not_compared_with() -> None:
    record = rate_record() | {"objective": {"start": None, "best": 171.5}}
    assert "values fail" in headline(fit_of(record))[1]


def test_an_objective_that_did_not_fall_is_not_praised() -> None:
    record = rate_record() | {"objective": {"start": 171.5, "best": 171.5}}
    assert headline(fit_of(record))[1].startswith("The objective did not fall")
