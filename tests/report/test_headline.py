"""The sentences of the report say what the record says, in bad cases too."""

from __future__ import annotations

from commonrail.report.fit.verdict import headline
from tests.report.samples import map_record, rate_record


def test_task_objective_fit_and_validation_each_have_a_sentence() -> None:
    task, objective, fit, validation = headline(rate_record())
    assert task.startswith("7 parameters of “Virtual injector”")
    assert "fitted to 1 data set (EVI 160 MPa); the search ran to its end." in task
    assert objective == "The objective fell from 402.2 to 171.5 (−57 %)."
    assert "EVI 160 MPa has J = 171.5 mm³/ms against 402.2 with the start values" in fit
    assert validation.startswith("On data that the fit never saw, EVI 120 MPa has J = 160.2")


def test_an_interrupted_search_says_so() -> None:
    assert "stopped early" in headline(rate_record() | {"status": "interrupted"})[0]


def test_start_values_that_fail_are_not_compared_with() -> None:
    record = rate_record() | {"objective": {"start": None, "best": 171.5}}
    assert "the start values fail" in headline(record)[1]


def test_an_objective_that_did_not_fall_is_not_praised() -> None:
    record = rate_record() | {"objective": {"start": 171.5, "best": 171.5}}
    assert headline(record)[1].startswith("The objective did not fall")


def test_a_map_is_summed_up_by_its_three_figures() -> None:
    fit = headline(map_record())[2]
    assert "quantities above 3 mm³ are met to 4.8 % rms (start: 22.4)" in fit
    assert "those up to 3 mm³ to 0.21 mm³ rms" in fit
    assert "dead times to 4 µs rms (start: 31)" in fit


def test_a_map_without_dead_times_does_not_speak_of_them() -> None:
    record = map_record()
    for d in record["data"]:
        for figures in d["figures"].values():
            figures["dead_time_rms"] = None
    assert not any("dead times" in line for line in headline(record))


def test_many_curves_are_told_by_their_range_and_the_worst() -> None:
    record = rate_record()
    first = record["data"][0]
    record["data"] = [
        first
        | {
            "name": f"shot {i}",
            "J": {"start": 400.0 + i, "best": 100.0 + i},
            "J_relative": {"best": 0.01 * (1 + i % 5)},
        }
        for i in range(9)
    ]
    task, _, data, *_ = headline(record)
    assert "fitted to 9 data sets; " in task
    assert "J of 9 curves is 100.0 to 108.0 mm³/ms against 400.0 to 408.0 with the start values" in data
    assert "worst is shot 4 with 5.0 %" in data
