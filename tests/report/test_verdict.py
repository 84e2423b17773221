"""Verdict and next steps on the first page of a calibration's report."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.calibration.record import SearchVerdict, read_as
from commonrail.report.fit import verdict as judged
from commonrail.report.fit.rules import Tile
from tests.report.samples import fit_of, map_record, rate_record


def verdict(record: dict[str, Any], run: str) -> judged.ReportVerdict:
    return judged.verdict(fit_of(record), run)


def tiles(record: dict[str, Any]) -> list[Tile]:
    return judged.tiles(fit_of(record))


def sound() -> dict[str, Any]:
    """Converged fit of measured data, every parameter pinned, with data that were held back."""
    record = map_record() | {"convergence": {"converged": True, "sentence": "converged: all agree"}}
    record["parameters"] = [p | {"verdict": "determined", "at_bound": False} for p in record["parameters"]]
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = 2.0
    return record


def test_a_sound_fit_leads_to_its_use() -> None:
    found = verdict(sound(), "runs/a b")
    assert (found.level, found.reasons, found.notes) == ("good", [], [])
    assert [step.command for step in found.steps] == ["commonrail map 'runs/a b' --time-step 1us --out map.dcm"]


def test_the_map_for_the_control_unit_has_the_pressures_of_the_data() -> None:
    """`commonrail map` has 5 MPa in the cylinder by default; data at 0.5 MPa would lead to other energising times."""
    record = sound()
    for row in record["data"][0]["rows"]:
        row |= {"cylinder_pressure": 0.5e6, "return_pressure": 0.1e6}
    commands = [step.command for step in verdict(record, "r").steps]
    assert commands == [
        "commonrail map r --cylinder-pressure 500kPa --return-pressure 100kPa --time-step 1us --out map.dcm"
    ]


def test_the_map_has_the_time_step_of_the_calibration() -> None:
    commands = [step.command for step in verdict(sound() | {"time_step": 5e-7}, "r").steps]
    assert commands == ["commonrail map r --time-step 500ns --out map.dcm"]


def test_of_several_pressures_the_map_takes_the_most_frequent_and_says_so() -> None:
    """The first data set may be one curve at a pressure that all others do not have."""
    record = sound()
    assert len(record["data"]) > 1
    for data, cylinder in zip(record["data"], (8e6, 0.5e6), strict=False):
        for row in data["rows"]:
            row |= {"cylinder_pressure": cylinder, "return_pressure": 0.1e6}
    record["data"][0]["rows"] = record["data"][0]["rows"][:1]
    (step,) = verdict(record, "r").steps
    assert (
        step.command
        == "commonrail map r --cylinder-pressure 500kPa --return-pressure 100kPa --time-step 1us --out map.dcm"
    )
    assert "1 other pair" in step.text


@pytest.mark.parametrize(
    ("change", "level", "reason", "cure"),
    [
        ({"status": "interrupted"}, "bad", "stopped before", "commonrail resume runs/a"),
        ({"objective": {"start": 1.0, "best": None}}, "bad", "No candidate", ""),
        (
            {"convergence": {"converged": False, "sentence": "not converged: 1 of 3 ends agree"}},
            "care",
            "1 of 3 ends agree.",
            "commonrail resume runs/a --generations 50",
        ),
        (
            {"warnings": [{"code": "shift", "subject": "s", "sentence": "t"}]},
            "bad",
            "t",
            "calibrate",
        ),
    ],
)
def test_what_speaks_against_a_fit_has_a_reason_and_a_cure(
    change: dict[str, Any], level: str, reason: str, cure: str
) -> None:
    found = verdict(sound() | change, "runs/a")
    assert found.level == level
    assert any(reason in text for text in found.reasons)
    assert cure in found.steps[0].command
    assert any("commonrail map" in step.command for step in found.steps) == (level != "bad")


def test_resume_is_for_a_search_that_was_cut_short() -> None:
    """One that ended by itself ends there again; once the most likely values confirm it, nothing is left to do."""
    record = sound() | {"convergence": {"converged": False, "sentence": "not converged: x", "cut_short": False}}
    assert verdict(record, "r").steps[0].command == "commonrail certainty r"
    known = {"starts": 8, "agreeing": 8, "level": 0.95, "gain": 1.0, "parameters": [], "settled": False}
    assert verdict(record | {"certainty": known}, "r").steps[0].command == "commonrail certainty r --starts 32"
    many = verdict(record | {"certainty": known | {"starts": 32}}, "r").steps
    assert not any("--starts" in step.command for step in many)  # they would cost minutes and end as these did
    assert verdict(record | {"certainty": known | {"settled": True}}, "r").level == "good"
    assert verdict(record | {"certainty": known | {"settled": True, "agreeing": 2}}, "r").notes


def test_weights_that_favour_some_data_leave_the_title_as_it_is() -> None:
    weights = {"code": "share", "subject": "map", "sentence": "it makes 0.4 % of J"}
    assert verdict(sound() | {"warnings": [weights]}, "r").level == "good"
    assert verdict(sound() | {"warnings": [weights, weights | {"code": "shift"}]}, "r").level == "bad"


@pytest.mark.parametrize(("percent", "level"), [(2.0, "good"), (12.0, "bad")])
def test_a_quantity_that_is_far_off_counts_by_the_error_of_its_map(percent: float, level: str) -> None:
    """One point where the injector just opens does not make a map unusable that is met else."""
    record = sound()
    data = record["data"][0]
    record["warnings"] = [{"code": "quantity", "subject": data["name"], "sentence": "odd"}]
    data["figures"]["best"]["rms_large_percent"] = percent
    found = verdict(record, "r")
    assert found.level == level
    assert "odd" in (found.notes if level == "good" else found.reasons[0])


def test_parameters_at_a_bound_and_those_not_pinned_are_named() -> None:
    record = sound()
    record["parameters"][0]["at_bound"] = True
    record["parameters"][1]["verdict"] = "only in combination"
    found = verdict(record, "runs/a")
    assert found.level == "care"
    assert "bound: plunger_needle.k1." in " ".join(found.reasons)
    assert "1 of 3 parameters: plunger_needle.k2." in " ".join(found.notes)
    again = "commonrail calibrate runs/a/study.toml --widen runs/a"
    assert found.steps[0].command == again  # the bounds before what rests on them
    assert found.steps[0].text.startswith("Widen the bounds of plunger_needle.k1 ")
    assert found.steps[1].command == "commonrail next runs/a --points 3 --out plan.csv"
    levels = {tile.head: tile.level for tile in tiles(record)}
    assert (levels["parameters"], levels["search"], levels["unseen"]) == ("care", "good", "good")


def test_no_bound_is_widened_beyond_what_a_study_accepts() -> None:
    record = sound()
    coefficient = {"name": "nozzle.discharge_maximum", "lower": 0.6, "position": 1.0, "at_bound": True}
    for upper, is_advised in ((1.0, False), (0.8, True), (2.0, False)):
        record["parameters"][0] |= coefficient | {"upper": upper, "best": upper}
        steps = verdict(record, "r").steps
        assert any("--widen" in step.command for step in steps) is is_advised


@pytest.mark.parametrize("at_bound", [False, True])
def test_steps_go_from_bounds_over_the_search_to_the_map(at_bound: bool) -> None:
    """Whatever the subjects: a map of values that a bound holds is made twice."""
    record = sound() | {"convergence": {"converged": False, "sentence": "not converged: x"}}
    record["parameters"][0] |= {"at_bound": at_bound}
    record["parameters"][1] |= {"verdict": "not confirmed"}
    record["certainty"] = {"starts": 8, "level": 0.95, "gain": 30.0, "parameters": [], "settled": False}
    words = ("calibrate", "resume", "next", "map")
    commands = [step.command for step in verdict(record, "r").steps if step.command]
    assert len(commands) == len(words) - (not at_bound)
    for command, word in zip(commands, words[not at_bound :], strict=True):
        assert command.startswith(f"commonrail {word}")


def test_profiled_intervals_lead_to_a_measuring_plan() -> None:
    record = sound() | {"certainty": {"starts": 5, "level": 0.95, "gain": None, "parameters": []}}
    record["parameters"][1]["verdict"] = "only in combination"
    assert verdict(record, "runs/a").steps[0].command == "commonrail next runs/a --points 3 --out plan.csv"


def test_the_plan_of_one_operating_point_asks_for_the_range_of_the_bench() -> None:
    """Without a range `commonrail next` refuses such a run; the validation data play no part in it."""
    record = rate_record() | {"certainty": {"starts": 5, "level": 0.95, "gain": None, "parameters": []}}
    record["parameters"][1]["verdict"] = "only in combination"
    step = next(step for step in verdict(record, "r").steps if step.text.startswith("Plan"))
    assert step.command == ""
    assert "--rail-pressure and --energising-time" in step.text
    for data in record["data"]:
        data["role"] = "fit"
    assert "commonrail next r --points 3 --out plan.csv" in [step.command for step in verdict(record, "r").steps]


def test_synthetic_data_and_none_that_were_held_back_are_noted() -> None:
    record = rate_record() | {"convergence": {"converged": True, "sentence": ""}}
    record["data"] = record["data"][:1]
    found = verdict(record, "runs/a")
    assert len(found.notes) == 3  # that parameters are not pinned is the third
    assert "EVI 160 MPa is synthetic" in " ".join(found.notes)


def test_a_trivial_model_that_is_as_good_is_told() -> None:
    record = sound()
    baselines = [
        {"beaten": False, "sentence": "Interpolation is better."},
        {"beaten": True, "sentence": "A gain is not."},
    ]
    record["data"][1]["baselines"] = baselines
    assert verdict(record, "runs/a").notes == ["Interpolation is better."]


def test_a_trivial_model_that_predicts_held_out_rows_better_is_told() -> None:
    record = sound()
    one = {"name": "map", "searches": 3, "values": 9, "figures": {}, "baselines": [{"text": "x", "beaten": False}]}
    left_out = [one | {"by": by} for by in ("rail_pressure", "energising_time")]
    found = verdict(record | {"refits": {"left_out": left_out}}, "runs/a")
    assert found.level == "good"
    assert found.notes == ["On held out rows of map a trivial model is as good or better."]


def test_held_back_data_at_which_the_model_does_not_run_are_no_praise() -> None:
    curves = rate_record() | {"convergence": {"converged": True, "sentence": ""}}
    curves["data"][1]["J"]["best"] = None
    reason = "The calibrated model does not run at all points of EVI 120 MPa."
    assert reason in verdict(curves, "runs/a").reasons
    maps = sound()
    maps["data"][1]["rows"][0]["best"] = None
    assert verdict(maps, "runs/a").reasons == ["The calibrated model does not run at all points of map at 80 MPa."]


@pytest.mark.parametrize(
    ("values", "covered", "course", "narrow"),
    [
        (7, 4, False, True),  # four or fewer of seven have a probability of 2.6 % at 90 %
        (7, 5, False, False),  # 15 %
        (500, 350, True, False),  # samples that follow each other: as seven of ten, 7 %
        (500, 300, True, True),  # as six of ten, 1.3 %
        (7, 7, False, False),
    ],
)
def test_bands_that_hold_too_few_values_are_noted(values: int, covered: int, course: bool, narrow: bool) -> None:
    record = sound()
    band = {"level": 0.9, "values": values, "covered": covered}
    halves = {"half_widths": [None] * len(record["data"][0]["rows"])}
    record["data"][0] |= {"kind": "rate", "band": band} if course else {"band": band | halves}
    found = verdict(record, "runs/a")
    name = record["data"][0]["name"]
    reason = f"The bands hold too few measured values of {name}: they are too narrow."
    assert (reason in found.notes) is narrow


def test_the_first_screen_has_errors_in_percent_of_what_was_fitted_and_what_was_not() -> None:
    record = rate_record() | {"convergence": {"converged": False, "spread": 41.0, "sentence": "not converged: x"}}
    found = {tile.head: tile for tile in tiles(record)}
    assert found["fit"].figure == "1.2 %"  # 171.5/14000 of the rate, as samples.py has it
    assert found["fit"].words.endswith("EVI 160 MPa (start 2.9 %)")  # 402.2/14000
    assert found["unseen"].figure == "1.1 %"  # the larger of 160.2 and 158.4
    assert [text.split()[-2:] for text in found["unseen"].others.split("; ")] == [["1.1", "%"]] * 2
    assert found["quantity"].figure == "+0.4 %"  # 51.9/51.7 − 1
    assert (found["parameters"].figure, found["parameters"].sign) == ("3 of 7", "!")
    assert found["search"].figure == "not converged"
    assert found["search"].words.endswith("spread after 50 steps")


def test_the_first_screen_of_a_map_has_both_small_and_large_quantities() -> None:
    record = sound()
    found = {tile.head: (tile.figure, tile.words) for tile in tiles(record)}
    assert found["fit"] == ("2.0 %", "rms of the quantities above 3 mm³ (start 22.4 %)")
    assert found["quantity"][0] == "0.21 mm³"


def test_data_that_were_not_held_back_leave_the_unseen_error_open() -> None:
    record = sound()
    record["data"] = record["data"][:1]
    unseen = next(tile for tile in tiles(record) if tile.head == "unseen")
    assert (unseen.figure, unseen.level) == ("not known", "")


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"converged": True, "spread": 0.1}, "the population has contracted and gains no more"),
        ({"converged": False, "spread": 3.0}, "the population is still spread"),
        ({"converged": False, "spread": 0.1}, "the best still falls"),
        ({"converged": False, "starts": 8, "agreeing": 2}, "2 of 8 starts converged to the same optimum"),
        (
            {"converged": False, "sentence": "not converged: it ended with one point; more would"},
            "it ended with one point",
        ),
    ],
)
def test_the_state_of_a_search_is_told_in_words_of_an_engineer(found: dict[str, Any], words: str) -> None:
    assert judged.search_words(read_as(SearchVerdict, {"sentence": ""} | found)) == words


def test_of_many_curves_the_worst_is_shown_and_the_others_below_the_mouse() -> None:
    record = rate_record()
    first = record["data"][0]
    record["data"] = [
        first | {"name": f"shot {i}", "J_relative": {"start": 0.04, "best": 0.01 * (1 + i % 5)}} for i in range(9)
    ]
    fit, *_ = tiles(record)
    assert fit.figure == "5.0 %"
    assert "shot 4" in fit.words
    assert len(fit.others.split("; ")) == 9


def test_no_more_than_five_figures_are_on_the_first_screen() -> None:
    record = rate_record()
    maps = sound()["data"]
    figures = tiles(record | {"data": [*record["data"], *maps]})
    assert len(figures) <= judged.MOST_TILES
    assert len({tile.head for tile in figures}) == len(figures)


@pytest.mark.parametrize(("best", "sign"), [(0.009, "✓"), (0.03, "✓"), (0.06, "!"), (0.12, "✗"), (0.22, "✗")])
@pytest.mark.parametrize("kind", ["rate", "quantities"])
def test_the_mark_of_a_tile_is_that_of_its_own_figure(kind: str, best: float, sign: str) -> None:
    record = rate_record() if kind == "rate" else sound()
    record["data"][0] |= {"J_relative": {"start": best, "best": best}}
    record["data"][0].setdefault("figures", {"best": {}})["best"]["rms_large_percent"] = 100.0 * best
    fit, unseen, *_ = tiles(record)
    assert (fit.sign, unseen.sign) == (sign, "✓")
    assert (verdict(record, "r").level == "bad") is (sign == "✗")


def test_the_noise_of_a_curve_is_no_error_of_the_model() -> None:
    record = rate_record()
    record["data"][0] |= {"J_relative": {"start": 1.0, "best": 0.05}, "noise_relative": 0.045}
    assert tiles(record)[0].level == "good"


@pytest.mark.parametrize(("percent", "level"), [(2.0, "good"), (6.0, "bad")])
def test_an_objective_that_did_not_fall_is_a_fault_unless_the_fit_is_good(percent: float, level: str) -> None:
    record = sound() | {"objective": {"start": 1.0, "best": 1.0}}
    record["data"][0]["figures"]["best"]["rms_large_percent"] = percent
    assert verdict(record, "r").level == level


@pytest.mark.parametrize(("percent", "level"), [(8.0, "care"), (5.0, "good"), (12.0, "bad")])
def test_a_larger_tolerance_of_the_study_takes_the_place_of_a_limit(percent: float, level: str) -> None:
    record = sound()
    record["data"][0]["figures"]["best"]["rms_large_percent"] = percent
    record["data"][0]["relative_tolerance"] = 0.06
    assert verdict(record, "r").level == level


def test_what_a_test_found_stands_in_the_headline() -> None:
    """However small the errors are; of several the least probable one."""
    record = sound()
    tests = [
        {"name": name, "score": score, "size": None, "found": found, "sentence": name, "looks_like": ""}
        for name, score, found in (("gain", 1e-3, True), ("delay", 1e-9, True), ("friction", 0.5, False))
    ]
    record["certainty"] = {"starts": 1, "level": 0.95, "gain": 1.0, "parameters": [], "settled": True, "tests": tests}
    found = verdict(record, "r")
    assert (found.level, found.reasons) == ("care", ["Delay.", "Gain."])
    assert found.headline.endswith("Delay.")


@pytest.mark.parametrize(("settled", "level"), [(True, "good"), (False, "care")])
def test_an_unfinished_search_matters_where_the_most_likely_values_are_not_found(settled: bool, level: str) -> None:
    record = sound() | {"convergence": {"converged": False, "sentence": "not converged: x", "cut_short": False}}
    record["certainty"] = {"starts": 1, "agreeing": 1, "level": 0.95, "parameters": [], "settled": settled}
    assert verdict(record, "r").level == level


def test_a_tile_without_a_figure_has_no_sign() -> None:
    """A curve of zeros has no error in percent, however good the fit."""
    record = rate_record()
    for data in record["data"]:
        data["J_relative"] = dict.fromkeys(data["J_relative"])
    fit = tiles(record)[0]
    assert (fit.head, fit.figure, fit.level, fit.sign) == ("fit", "– %", "", "")


def looks_like(test: dict[str, Any], percent: float) -> list[str]:
    """Commands that are advised where a test found something."""
    record = sound()
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = percent
    record["certainty"] = {
        "level": 0.95,
        "parameters": [],
        "settled": True,
        "tests": [{"found": True, "sentence": "the residuals look like it", "score": 1e-6} | test],
    }
    return [step.command for step in verdict(record, "r").steps if "--free" in step.command]


@pytest.mark.parametrize(
    ("relief", "percent", "is_freed"), [(0.3, 8.0, True), (0.02, 8.0, False), (0.02, 2.0, True), (None, 8.0, True)]
)
def test_a_value_is_freed_where_that_lowers_errors_or_where_they_are_good(
    relief: float | None, percent: float, is_freed: bool
) -> None:
    """On a bench that the model does not fit, one more free value takes 2 % of the error and spoils what is unseen.

    A record of an older version has no relief.
    """
    test = {"name": "fixed values", "suspect": "needle_seat.cone_angle", "relief": relief}
    assert bool(looks_like(test, percent)) is is_freed


@pytest.mark.parametrize("name", ["meter.unnamed.gain", "map"])
def test_a_gain_is_checked_on_the_bench_and_not_freed(name: str) -> None:
    """A free gain of 0.8 moved all quantities of a foreign bench by 25 %."""
    assert looks_like({"name": name, "suspect": "gain", "relief": 0.5}, 2.0) == []


@pytest.mark.parametrize(("percent", "is_planned"), [(2.0, True), (40.0, False)])
def test_measurements_are_planned_for_a_model_that_fits(percent: float, is_planned: bool) -> None:
    record = sound()
    record["parameters"][1]["verdict"] = "only in combination"
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = percent
    assert any("commonrail next" in step.command for step in verdict(record, "r").steps) is is_planned


@pytest.mark.parametrize(("widening", "is_widened"), [(0.3, True), (0.02, False), (None, True)])
def test_a_bound_is_widened_where_that_lowers_errors(widening: float | None, is_widened: bool) -> None:
    record = sound()
    record["parameters"][0]["at_bound"] = True
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = 8.0
    record["certainty"] = {"level": 0.95, "parameters": [], "settled": True, "widening": widening}
    steps = verdict(record, "r").steps
    assert any("--widen" in step.command for step in steps) is is_widened
    assert (judged.LACKING in steps) is not is_widened


def test_of_two_suspects_one_that_helps_is_freed_and_nothing_is_lacking() -> None:
    record = sound()
    for data in record["data"]:
        data["figures"]["best"]["rms_large_percent"] = 8.0
    found = {"found": True, "score": 1e-6, "name": "fixed values"}
    tests = [
        found | {"sentence": name, "suspect": name, "relief": relief}
        for name, relief in (("needle_seat.cone_angle", 0.3), ("valve.spring_preload", 0.0))
    ]
    record["certainty"] = {"level": 0.95, "parameters": [], "settled": True, "tests": tests}
    steps = verdict(record, "r").steps
    assert [step.command.split()[-1] for step in steps if "--free" in step.command] == ["needle_seat.cone_angle"]
    assert judged.LACKING not in steps
