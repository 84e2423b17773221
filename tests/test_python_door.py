"""Wrong arguments of the public functions: each is refused with a sentence that names it, before anything is simulated.

Text with a unit and NumPy's numbers are accepted wherever a number is.
"""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.base import arguments
from commonrail.base.errors import CommonrailError
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.calibration.study import Method
from commonrail.data.base import Role
from commonrail.plugins.new.study import write_new
from tests.every import check_every

POINT = cr.OperatingPoint("160 MPa", "700 us")
INJECTOR = cr.load_injector("virtual-lino-2016")

# No argument of any kind is meant by these.
STRANGE: tuple[Any, ...] = (object(), {1, 2}, lambda: None, b"160 MPa", 1j, [[1.0], [1.0, 2.0]], [None], ("a", "b"))
NO_NUMBER = (None, True, np.True_, "abc", "160", "", float("nan"), float("inf"), -1e308, "1e999 m", [], {}, *STRANGE)
NO_COUNT = (True, "two", -1, 0, 1.5, float("nan"), float("inf"), np.float64(0.5), 10**400, [], *STRANGE)
NO_KIND = (None, True, 0, 1e308, "study.toml", Path("study.toml"), [], {}, np.zeros(3), float("nan"), *STRANGE)
NO_LIST = (None, True, 0, 1e308, "abc", float("nan"), {}, *STRANGE)
NO_PATH = (None, True, 0, 1e308, "", "a\0b", [], {}, b"study.toml", float("nan"), object())


@pytest.fixture(scope="session")
def study(tmp_path_factory: pytest.TempPathFactory) -> cr.Study:
    folder = tmp_path_factory.mktemp("door") / "new"
    write_new(folder)
    return cr.load_study(folder / "study.toml")


def refused(call: Callable[[], object], word: str) -> None:
    """Assert that a call raises an error of the project, whose sentence has the word."""
    with pytest.raises(CommonrailError) as found:
        call()
    assert re.search(word, str(found.value), re.IGNORECASE), str(found.value)
    assert str(found.value).endswith("."), str(found.value)


def outcome(call: Callable[[], object]) -> object:
    """Result of a call, or the error of the project that it raises."""
    try:
        return call()
    except CommonrailError as error:
        return error


def point(**changed: Any) -> object:
    return cr.OperatingPoint(**{"rail_pressure": 160e6, "energisings": 700e-6, **changed})


def batch(**changed: Any) -> object:
    return cr.simulate_batch(**{"injector": INJECTOR, "points": [POINT], **changed})


K1, K2 = "plunger_needle.k1", "plunger_needle.k2"


def one(**changed: Any) -> object:
    return cr.simulate(**{"injector": INJECTOR, "point": POINT, **changed})


def mass(**changed: Any) -> cr.Parameter:
    given = {"name": "valve.mass", "reference": "4 g", "lower": 0.003, "upper": "5 g", "unit": "kg"}
    return cr.Parameter(**{**given, "mark": "E", "source": "made up", **changed})


# Callable, name of the argument, word that the sentence must have, values that must be refused.
WITHOUT_STUDY: list[tuple[Callable[..., object], str, str, tuple[Any, ...]]] = [
    (point, "rail_pressure", "rail pressure", (*NO_NUMBER, 0, -1, 160, 1600, 1e308, "160 us")),
    (point, "cylinder_pressure", "cylinder pressure", (*NO_NUMBER, 0, -1, 5, 1e308, "5 mm")),
    (point, "return_pressure", "return pressure", (*NO_NUMBER, 0, -1, 0.5, 1e308)),
    (
        point,
        "energisings",
        "energising",
        (None, True, *NO_NUMBER[3:10], *STRANGE, 700, 1e308, "700", (0.0, 250e-6), [1e-4, 2e-4]),
    ),
    (
        point,
        "energisings",
        "energising",
        ([(0, 1, 2)], [(0.0,)], [("0 us", 250)], [(1e-3, 1e-4), (0.0, 1e-4)], "-1 us"),
    ),
    (point, "energisings", "energising", ([(900, 1e-3)], [(None, 1e-3)], np.zeros(2), np.zeros((1, 3)), [(0, "1 m")])),
    (point, "drive", "drive", (0, 1e308, "drive.csv", [], (0.0, 1.0), *STRANGE)),
    (point, "horizon", "horizon", (*NO_NUMBER[1:], 0, -1, 3, 1e308)),
    (point, "start", "start", (*NO_NUMBER, -500, 1e308)),
    (lambda value: cr.Energising(value, 1e-4), "value", "start", NO_NUMBER[:8] + STRANGE),
    (lambda value: cr.Energising(0.0, value), "value", "duration", (*NO_NUMBER, -1e-6, 250, 1e308)),
    (
        lambda value: cr.Trace(value, (1.0, 2.0)),
        "value",
        "time|trace",
        (*NO_NUMBER, 0, [0, 0], [1, 0], [0, 1, 2], [[0, 1]]),
    ),
    (
        lambda value: cr.Trace.of([0.0, 1.0], value),
        "value",
        "value",
        (*NO_NUMBER, 0, [1], [1, np.nan], [[1, 2]], ["a", 1]),
    ),
    (lambda value: cr.Variant(body=value), "value", "body", NO_KIND),
    (lambda value: cr.Variant(boundary=value), "value", "boundary", NO_KIND),
    (lambda value: cr.Variant(drive=value), "value", "drive", NO_KIND),
    (INJECTOR.with_values, "values", "values", (*NO_LIST[:6], *STRANGE, {1: 2.0})),
    (lambda value: INJECTOR.with_values({K1: value}), "value", "k1", (*NO_NUMBER, 0, -1, "75 N", [1e8])),
    (lambda value: INJECTOR.with_values({value: 1.0}), "value", "parameter", ("plunger_needle.k11", "k", "")),
    (lambda value: replace(INJECTOR, fuel=value), "value", "fuel", NO_KIND),
    (lambda value: replace(INJECTOR, variant=value), "value", "variant", NO_KIND),
    (lambda value: replace(INJECTOR, values=value), "value", "no value|values", NO_KIND),
    (lambda value: replace(INJECTOR, name=value), "value", "name", (None, 0, [], b"a")),
    (lambda value: INJECTOR.fuel.density(value, 353.15), "value", "pressure", NO_NUMBER[:8] + STRANGE),
    (
        lambda value: INJECTOR.fuel.sound_speed(1e8, value),
        "value",
        "temperature|defined",
        (*NO_NUMBER[:8], 0, 20, 1e308),
    ),
    (lambda value: INJECTOR.fuel.density(np.zeros(3), np.full(value, 353.15)), "value", "shape", (2, 4)),
    (one, "injector", "injector", NO_KIND),
    (one, "point", "point", NO_KIND),
    (one, "engine", "engine", (None, 0, "lane", [], float("nan"), *STRANGE)),
    (one, "time_step", "time step", (*NO_NUMBER, 0, -1, 1, 1e308, "1 m")),
    (one, "sample_interval", "sample interval", (*NO_NUMBER[1:], 0, -1, 1, 1e308, "3 m")),
    (one, "precision", "precision", (None, 0, 64, "f16", [], *STRANGE)),
    (batch, "injector", "injector", NO_KIND),
    (batch, "points", "point", (*NO_LIST, POINT, [], [1.0], [POINT, None], ["160 MPa"])),
    (batch, "names", "names", (*NO_LIST, K1, [K1], [1], ["k11"], [K1, K1], [[K1]])),
    (batch, "time_step", "time step", (*NO_NUMBER, 0, -1, 1)),
    (batch, "threads", "threads", (*NO_COUNT, 1025)),
    (batch, "misfit", "misfit", NO_KIND[1:]),
    (batch, "prepared", "prepared", NO_KIND[1:]),
    (batch, "stop_when_closed", "stop_when_closed", (None, 0, 1, "no", [], float("nan"))),
    (batch, "precision", "precision", (None, 0, "f16", [])),
    (batch, "engine", "engine", (None, 0, "reference", "lane", [])),
    (lambda value: batch(names=[K1], values=value), "value", "value", (1e308, "a", [], {}, *STRANGE)),
    (
        lambda value: batch(names=[K1], values=value),
        "value",
        "value",
        ([[1, 2]], [1, 2], np.zeros((1, 1, 1)), np.zeros((0, 1))),
    ),
    (
        lambda value: batch(names=[K1, K2], values=[[1e8, value]]),
        "value",
        "values of candidate 1",
        (None, True, "75 N", [1]),
    ),
    (cr.load_injector, "source", "injector|path", (*NO_PATH, "virtual-lino")),
    (cr.load_study, "path", "path|file", (*NO_PATH, "no such.toml")),
    (cr.lab.load_truth, "source", "truth|path", (*NO_PATH, "virtual-lino")),
    (cr.load_fuel, "source", "fuel|path", (*NO_PATH, "iso4114", ["iso4113"])),
    (cr.runs.read_run, "folder", "folder|result.json", (*NO_PATH, "nowhere")),
    (cr.runs.create_run_folder, "path", "folder", NO_PATH),
    (cr.runs.list_runs, "folder", "folder", (*NO_PATH, "nowhere")),
    (cr.write_report, "folder", "folder|result.json", (*NO_PATH, "nowhere")),
    (cr.models.simulation_figure, "solutions", "solution", (*NO_KIND, {"a": 1})),
    (lambda value: cr.dump_injector(value, Path("x.toml")), "value", "injector", NO_KIND),
    (lambda value: cr.dump_injector(INJECTOR, value), "value", "path", NO_PATH),
    (
        lambda value: cr.dump_injector(INJECTOR, "x.toml", value),
        "value",
        "notes",
        (0, "a", {"k": "b"}, {K1: 1}, *STRANGE),
    ),
    (lambda value: cr.runs.write_run(Path("x"), value, {}), "value", "calibration", NO_KIND),
    (lambda value: cr.lab.reproduce(value, [1]), "value", "bench", NO_KIND),
    (lambda value: cr.lab.bench_curve(value, INJECTOR, 160e6, 700e-6, 1), "value", "truth", NO_KIND),
    (lambda value: cr.lab.for_seeds(lambda seed, after: None, value), "value", "seed", NO_LIST),
    (lambda value: cr.lab.for_seeds(value, [1]), "value", "search", (None, 0, 1.5, "four", [], object())),
    (lambda value: cr.fit.identify_at(value, None, np.zeros(2)), "value", "space", NO_KIND),
    (lambda value: EvolutionSettings(members=value), "value", "members", (*NO_COUNT, None, 3, 10**6)),
    (
        lambda value: EvolutionSettings(generations=value),
        "value",
        "generations",
        (-1, 1.5, "a", None, 10**9, float("nan")),
    ),
    (lambda value: EvolutionSettings(crossover=value), "value", "crossover", (*NO_NUMBER[:8], -1, 2)),
    (
        lambda value: EvolutionSettings(factor=value),
        "value",
        "factor",
        (None, 0.5, "a", (1,), (1, 2, 3), (0, 1), *STRANGE),
    ),
    (lambda value: EvolutionSettings(treatment=value), "value", "treatment", (None, 0, "repairs", [])),
    (lambda value: Method(polish=value), "value", "polish", (-1, 1.5, "a", None, [])),
    (lambda value: Method(value), "value", "evolution", NO_KIND),
    (lambda value: INJECTOR.with_values({"nozzle.holes": value}), "value", "holes", (5.5,)),
    (lambda value: mass(reference=value), "value", "reference", (*NO_NUMBER[:8], "4 mm")),
    (lambda value: mass(upper=value), "value", "upper", (*NO_NUMBER[:8], "5 mm")),
    (lambda value: mass(unit=value), "value", "unit", ("m", "g", None, 1)),
    (lambda value: cr.fit.Space(value), "value", "parameters", (None, True, 0, "valve.mass", {})),
    (lambda value: cr.fit.Space([value]), "value", "Parameter", (None, "valve.mass")),
    (lambda value: cr.fit.Space([mass()]).point(value), "value", "values", (*NO_KIND[:6], {"valve.lift": 1.0})),
    (lambda value: cr.fit.Space([mass()]).point({"valve.mass": value}), "value", "valve.mass", NO_NUMBER[:8]),
    (
        lambda value: cr.fit.percent_bounds(value, 10.0, 10.0),
        "value",
        "reference",
        (None, True, "abc", "1 m", float("nan")),
    ),
    (lambda value: cr.Noise(sigma=value), "value", "sigma", ("a", "1 mm3", [], 0, -1)),
    (lambda value: cr.fit.Objective(value, [K1], [], 1e-6), "value", "injector", NO_KIND),
    (lambda value: cr.fit.Objective(INJECTOR, [value], [], 1e-6), "value", "names", ("valve.mas", "k1")),
    (lambda value: cr.fit.Objective(INJECTOR, [K1], [], value), "value", "time step", (*NO_NUMBER, 0, -1, 1)),
    (lambda value: cr.maps.sweep(INJECTOR, value), "value", "variables", (None, ["dwell"], "dwell", 1)),
    (
        lambda value: cr.maps.quantity_map(INJECTOR, pressures=["80 MPa"], times=[value]),
        "value",
        "times",
        (300, "3 mm", "x", None),
    ),
    (
        lambda value: cr.fit.sample_feasible(cr.fit.Space([mass()]), value, np.random.default_rng(1)),
        "value",
        "number of points",
        (True, "two", None, -1, 1.5, float("nan"), float("inf"), *STRANGE),
    ),
    (lambda value: cr.fit.sample_feasible(cr.fit.Space([mass()]), 3, value), "value", "rng", NO_KIND),
    (lambda value: cr.fit.sample_feasible(value, 3, np.random.default_rng(1)), "value", "space", NO_KIND),
    (lambda value: cr.parts.TestPlan("plan", value), "value", "test", (*NO_LIST, [], [1])),
    (cr.fit.identify, "calibration", "calibration", NO_KIND),
]


def cases(rows: list[tuple[Callable[..., object], str, str, tuple[Any, ...]]]) -> list[Any]:
    return [pytest.param(*row, id=f"{i}-{row[2]}") for i, row in enumerate(rows)]


@pytest.mark.parametrize(("call", "name", "word", "values"), cases(WITHOUT_STUDY))
def test_a_wrong_argument_is_refused_by_name(
    call: Callable[..., object], name: str, word: str, values: tuple[Any, ...]
) -> None:
    check_every(values, lambda value: refused(lambda: call(**{name: value}), word))


@pytest.mark.parametrize("value", [*NO_KIND], ids=range(len(NO_KIND)))
def test_what_is_no_study_is_refused(value: Any, study: cr.Study, tmp_path: Path) -> None:
    for call in (
        lambda: cr.calibrate(value),
        lambda: cr.fit.check_study(value),
        lambda: cr.runs.calibrate_into(tmp_path / "run", value),
        lambda: cr.compare({"a": INJECTOR}, value),
        lambda: cr.compare({"a": INJECTOR}, [value]),
    ):
        refused(call, "stud")
    refused(lambda: cr.compare(value, study), "models")
    refused(lambda: cr.compare({"a": value}, study), "injector")
    assert not (tmp_path / "run").exists()


def test_settings_of_a_run_are_refused_before_anything_is_written(study: cr.Study, tmp_path: Path) -> None:
    into, bench = tmp_path / "run", cr.lab.Bench(cr.lab.load_truth("virtual-lino-2016"), INJECTOR, 1e-6)
    for threads in NO_COUNT:
        for call in (
            lambda how=threads: cr.calibrate(study, threads=how),
            lambda how=threads: cr.fit.check_study(study, how),
            lambda how=threads: cr.runs.calibrate_into(into, study, threads=how),
            lambda how=threads: cr.resume(into, threads=how),
            lambda how=threads: cr.compare({"a": INJECTOR}, study, threads=how),
            lambda how=threads: cr.lab.reproduce(bench, [1], threads=how),
        ):
            refused(call, "threads")
    for value in (0, 1.5, "four", [], object()):
        refused(lambda how=value: cr.calibrate(study, workers=how), "workers")
        refused(lambda how=value: cr.calibrate(study, progress=how), "progress")
        refused(lambda how=value: cr.calibrate(study, warn=how), "warn")
        refused(lambda how=value: cr.calibrate(study, strict=how), "strict")
        refused(lambda how=value: cr.runs.calibrate_into(into, study, strict=how), "strict")
        refused(lambda how=value: cr.calibrate(study, checkpoint=how), "checkpoint")
        refused(lambda how=value: cr.runs.calibrate_into(into, study, workers=how), "workers")
        refused(lambda how=value: cr.runs.calibrate_into(into, study, listener=how), "listener")
        refused(lambda how=value: cr.resume(into, study=how), "study")
        refused(lambda how=value: cr.resume(into, as_begun=how), "as_begun")
    for value in (-1, 1.5, "ten", None, float("nan"), float("inf"), True, [], object()):
        refused(lambda how=value: cr.resume(into, generations=how), "generations")
    for value in NO_PATH:
        refused(lambda how=value: cr.runs.calibrate_into(how, study), "folder")
        refused(lambda how=value: cr.resume(how), "folder")
    assert not into.exists()


@pytest.mark.parametrize(
    "seeds",
    [*NO_LIST, 3, [], [1, 1], [-1], [1.5], [True], ["a"], [float("nan")]],
    ids=lambda value: type(value).__name__,
)
def test_wrong_seeds_of_a_reproduction_are_refused(seeds: Any) -> None:
    bench = cr.lab.Bench(cr.lab.load_truth("virtual-lino-2016"), INJECTOR, "1 us")
    refused(lambda: cr.lab.reproduce(bench, seeds), "seed")


def test_a_bench_of_wrong_parts_is_refused() -> None:
    truth = cr.lab.load_truth("virtual-lino-2016")
    refused(lambda: cr.lab.reproduce(cr.lab.Bench("virtual-lino-2016", INJECTOR, 1e-6), [1]), "truth")
    refused(lambda: cr.lab.reproduce(cr.lab.Bench(truth, "virtual-lino-2016", 1e-6), [1]), "injector")
    refused(lambda: cr.lab.reproduce(cr.lab.Bench(truth, INJECTOR, 1), [1]), "time step")


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: cr.parts.load_plan(None), "path of a test plan"),  # type: ignore[arg-type]
        (lambda: cr.parts.TypeParameter(3, 1.0, 1.0, 0.0, 2.0), "name of a parameter"),  # type: ignore[arg-type]
        (lambda: cr.parts.TypeParameter("valve.mass", 5e-3, "x", 0.0, 1.0), "spread of valve.mass"),  # type: ignore[arg-type]
        (lambda: cr.parts.FixedValue("valve.mass", []), "valve.mass"),  # type: ignore[arg-type]
        (lambda: cr.parts.Dimension([], None), "name of a parameter"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_path_name_or_number_is_refused(call: Callable[[], object], word: str) -> None:
    refused(call, word)


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"seed": None}, "seed"),
        ({"seed": "one"}, "seed"),
        ({"time_step": 1}, "time step"),
        ({"time_step": float("nan")}, "time step"),
        ({"injector": "virtual-lino-2016"}, "load_injector"),
        ({"data": None}, "data"),
        ({"data": [1]}, "data"),
        ({"space": None}, "space"),
        ({"method": "evolution"}, "method"),
        ({"title": 5}, "title"),
        ({"precision": "f16"}, "precision"),
    ],
    ids=repr,
)
def test_a_study_of_wrong_parts_is_refused(study: cr.Study, changed: dict[str, Any], word: str) -> None:
    refused(lambda: replace(study, **changed), word)


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"bounds": [0.0, 1e-6]}, "bounds"),
        ({"bounds": None}, "bounds"),
        ({"rate": [np.nan, 1.0]}, "rate"),
        ({"rate": [[1.0, 2.0]]}, "rate"),
        ({"rate": "a"}, "rate"),
        ({"bounds": [0.0, 1e-6, 1e-6]}, "increase"),
        ({"point": "160 MPa"}, "point"),
        ({"weight": 0}, "weight"),
        ({"weight": None}, "weight"),
        ({"role": "fits"}, "role"),
        ({"name": None}, "name"),
    ],
    ids=repr,
)
def test_rate_data_of_wrong_parts_are_refused(changed: dict[str, Any], word: str) -> None:
    good = {"name": "a", "role": "fit", "point": POINT, "bounds": [0.0, "1 us", 2e-6], "rate": ["1 mm3/ms", 2e-6]}
    good |= {"weight": 1, "source": "", "synthetic": ""}
    made = cr.RateData(**good)
    assert made.role is Role.FIT
    assert made.rate.tolist() == [1e-6, 2e-6]
    refused(lambda: cr.RateData(**(good | changed)), word)


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"points": POINT}, "points"),
        ({"points": [POINT]}, "points"),
        ({"quantity": [1e-9]}, "quantities"),
        ({"quantity": [1e-9, None]}, "quantity"),
        ({"dead_time": [False]}, "dead times"),
        ({"dead_time": [0, 1]}, "dead_time"),
        ({"absolute": 0}, "absolute"),
        ({"absolute": 0.15, "relative": -1}, "relative"),
        ({"weight": float("inf")}, "weight"),
    ],
    ids=repr,
)
def test_quantity_data_of_wrong_parts_are_refused(changed: dict[str, Any], word: str) -> None:
    good = {"name": "a", "role": "fit", "points": [POINT, POINT], "quantity": [1e-9, "60 mm3"], "weight": 1.0}
    good |= {"absolute": "0.15 mm3", "relative": "3 %", "dead_time": [False, True], "source": "", "synthetic": ""}
    assert cr.QuantityData(**good).absolute == 0.15e-9
    refused(lambda: cr.QuantityData(**(good | changed)), word)


@pytest.mark.parametrize(
    ("call", "cure"),
    [
        (lambda: cr.calibrate("study.toml"), 'commonrail.load_study("study.toml")'),
        (lambda: cr.calibrate(Path("a/study.toml")), 'commonrail.load_study("a/study.toml")'),
        (lambda: cr.simulate("virtual-lino-2016", POINT), 'commonrail.load_injector("virtual-lino-2016")'),
        (lambda: cr.compare({"a": "b.toml"}, []), "one study"),
        (lambda: cr.OperatingPoint(160, 700), '"160 MPa"'),
        (lambda: cr.OperatingPoint(1600, 7e-4), '"1600 bar"'),
        (lambda: cr.OperatingPoint(160e6, 700), '"700 us"'),
        (lambda: cr.OperatingPoint(160e6, 0.7), '"0.7 ms"'),
        (
            lambda: cr.design.sensitivity(cr.load_injector("crin"), ["valve.mass"], [POINT]),
            'commonrail.design.parameters_within(injector, ["valve.mass"]) makes them',
        ),
        (lambda: cr.fit.check_study("study.toml"), 'commonrail.load_study("study.toml")'),
        (lambda: cr.OperatingPoint(160e6, -5e-6), "0 s and 100 ms, and -5 us"),
        (lambda: one(time_step=1), '"1 us"'),
        (
            lambda: batch(names=["plunger_needle.k11"]),
            'mean "plunger_needle.k1"?',
        ),
        (lambda: batch(names=["k1"]), 'mean "plunger_needle.k1"?'),
    ],
)
def test_the_sentence_has_the_cure(call: Callable[[], object], cure: str) -> None:
    with pytest.raises(CommonrailError) as found:
        call()
    assert cure in str(found.value)


@pytest.mark.parametrize("best", [None, {}, {"valve.mass": 0.004}, [1.0]])
def test_best_values_that_lack_a_free_parameter_are_refused(study: cr.Study, best: Any) -> None:
    for call in (cr.certainty, cr.predict, cr.design.next_measurements):
        refused(lambda call=call: call(study, best), "values of the parameters")


def test_text_with_a_unit_is_read_as_the_number() -> None:
    assert (mass().reference, mass().upper) == (0.004, 0.005)
    text = cr.OperatingPoint(
        "1600 bar", [("0us", "250us"), (900e-6, "0.6 ms")], "5MPa", "500 kPa", None, "3ms", start="-100us"
    )
    number = cr.OperatingPoint(160e6, [(0.0, 250e-6), (900e-6, 600e-6)], 5e6, 0.5e6, None, 3e-3, start=-100e-6)
    assert text == number
    assert text.pulses == (cr.Energising("0us", "250us"), cr.Energising(900e-6, 600e-6))
    assert cr.Trace(["0us", "1us"], [1.0, 2.0]) == cr.Trace((0.0, 1e-6), (1.0, 2.0))
    preload = "valve.spring_preload"
    assert INJECTOR.with_values({preload: "75N"}).values[preload] == 75.0
    assert INJECTOR.with_values({"fuel.temperature": "80 degC"}).values["fuel.temperature"] == 353.15
    assert INJECTOR.fuel.density("100 MPa", "80 degC") == INJECTOR.fuel.density(1e8, 353.15)
    assert cr.Variant("rigid", drive="pwm") == cr.Variant(cr.Variant("rigid").body, drive=INJECTOR.variant.drive)


@pytest.mark.parametrize("kind", [int, np.int32, np.int64, np.uint32, np.float32, np.float64, float, np.asarray])
def test_numbers_of_numpy_count_as_numbers(kind: Callable[[float], Any]) -> None:
    made = cr.OperatingPoint(kind(160_000_000), 700e-6, cylinder_pressure=kind(5_000_000), start=kind(0))
    assert made == cr.OperatingPoint(160e6, 700e-6)
    assert type(made.rail_pressure) is float
    assert arguments.integer(kind(3), "count") == 3
    assert INJECTOR.with_values({K1: kind(122_000_000)}).values[K1] == 122e6


@pytest.mark.parametrize(
    "pulses",
    [
        ((0.0, 250e-6), (900e-6, 600e-6)),
        [[0.0, 250e-6], [900e-6, 600e-6]],
        np.array([[0.0, 250e-6], [900e-6, 600e-6]]),
        [cr.Energising(0.0, 250e-6), np.array([900e-6, 600e-6])],
    ],
    ids=["tuples", "lists", "array", "mixed"],
)
def test_energisings_may_be_any_list_of_pairs(pulses: Any) -> None:
    made = cr.OperatingPoint(80e6, pulses)
    assert made.pulses == (cr.Energising(0.0, 250e-6), cr.Energising(900e-6, 600e-6))
    assert pickle.loads(pickle.dumps(made)) == made
    assert replace(made, start="-1 us").pulses == made.pulses


def test_texts_in_the_rows_of_a_batch_have_the_unit_of_their_column() -> None:
    from commonrail.engine.plan import read_candidates

    names = ("valve.spring_preload", "fuel.temperature")
    read = read_candidates(names, [["75 N", "80 degC"], [76.0, np.float64(354.0)], (np.nan, "1 kK")])
    np.testing.assert_array_equal(read, [[75.0, 353.15], [76.0, 354.0], [np.nan, 1000.0]])
    assert read_candidates(names, [75.0, "80 degC"]).tolist() == [[75.0, 353.15]]


# What division by zero, a time under way for ever and an initial state beyond all numbers came from.
EXTREME = [
    ("feed_pipe.length", 1e15),
    ("feed_pipe.diameter", 1e-308),
    ("solenoid.knee_flux_density", 1e-308),
    ("nozzle.lift_transition_offset", 1e20),
    ("control_chamber.volume", 1e308),
]


@pytest.mark.parametrize("engine", ["lanes", "reference"])
@pytest.mark.parametrize(("name", "value"), EXTREME)
def test_an_extreme_parameter_gives_a_status_or_a_sentence(name: str, value: float, engine: str) -> None:
    made = cr.OperatingPoint("160 MPa", "4 us", horizon="6 us")
    found = outcome(lambda: cr.simulate(INJECTOR.with_values({name: value}), made, engine))
    if isinstance(found, cr.Solution):
        assert isinstance(found.status, cr.Status)
    else:
        assert f"the most extreme is {name} = {value:g}" in str(found)


def test_a_text_with_an_everyday_unit_does_not_load_pint() -> None:
    code = (
        "import sys, commonrail as cr; cr.OperatingPoint('160 MPa', [('0 us', '0.7 ms')]); print('pint' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
