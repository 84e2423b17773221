"""Any injectors on any data: each as if it were alone, and failures that do not spread."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.choices import Body, Drive
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.result import data_records
from commonrail.calibration.scoring import score_all
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.status import Status
from commonrail.physics.injector import Injector
from commonrail.physics.variants import EXTENDING
from commonrail.plugins.compare.file import comparison_record
from commonrail.plugins.compare.run import Comparison, compare

CASES = Path(__file__).resolve().parents[3] / "cases"
TAP = Status.NOT_CLOSED_AT_START
# A valve spring that cannot hold the valve: the injector flows before it is energised.
WEAK = {"valve.spring_preload": 1.0}


@cache
def paper() -> Study:
    """The paper's study with its first curve only."""
    study = load_study(CASES / "paper" / "study.toml")
    return replace(study, data=study.data[:1])


@cache
def small_map() -> Study:
    """Two quantities and a dead time of a measured map."""
    study = load_study(CASES / "cri2-16" / "study.toml")
    data = study.data[1]
    assert isinstance(data, QuantityData)
    rows = [4, 5, len(data.points) - 1]
    assert data.dead_time[rows].tolist() == [False, False, True]
    part = replace(
        data,
        points=tuple(data.points[i] for i in rows),
        quantity=data.quantity[rows],
        dead_time=data.dead_time[rows],
    )
    return replace(study, data=(part,))


def plain() -> Injector:
    """The injector of the map with the paper's laws alone, whose kernel other tests compile, too."""
    own = small_map().injector
    return own.with_values({name: 0.0 for name in EXTENDING if own.values[name]})


def rigid(injector: Injector) -> Injector:
    return replace(injector, variant=injector.variant._replace(body=Body.RIGID))


@cache
def mixed() -> Comparison:
    """Flexible, rigid and an injector that cannot be simulated, on a curve and a map."""
    own = paper().injector
    models = {"flexible": own, "stiff": rigid(own), "weak": own.with_values(WEAK)}
    return compare(models, [paper(), small_map()], threads=1)


def test_each_model_has_the_figures_that_it_has_alone() -> None:
    record = comparison_record(mixed())
    for study, data in zip((paper(), small_map()), record["data"], strict=True):
        for label in ("flexible", "stiff"):
            (alone,) = data_records(study.data, {"best": score_all(study, mixed().models[label], 1)})
            if data["kind"] == "rate":
                assert data["J"][label] == alone["J"]["best"]
                assert data["volume"][label] == alone["volume"]["best"]
            else:
                assert [row[label] for row in data["rows"]] == [row["best"] for row in alone["rows"]]
                assert data["figures"][label] == alone["figures"]["best"]


def test_a_rigid_body_is_not_the_flexible_one() -> None:
    curve = comparison_record(mixed())["data"][0]
    assert curve["J"]["stiff"] > 2.0 * curve["J"]["flexible"]  # the paper's Fig. 6: largest errors


def test_a_model_that_fails_has_no_number_and_a_reason_at_every_point() -> None:
    curve, quantities = comparison_record(mixed())["data"]
    assert curve["J"]["weak"] is curve["J_relative"]["weak"] is curve["volume"]["weak"] is None
    (failure,) = curve["failures"]["weak"]
    assert (failure["status"], failure["sentence"]) == (TAP.name, TAP.sentence)
    assert (failure["rail_pressure"], failure["energising_time"]) == (curve["rail_pressure"], 700e-6)
    assert [row["weak"] for row in quantities["rows"]] == [None] * 3
    assert [f["status"] for f in quantities["failures"]["weak"]] == [TAP.name] * 2 + ["NO_DEAD_TIME"]
    assert curve["failures"]["flexible"] == curve["failures"]["stiff"] == []


def test_whether_anything_was_simulated_is_known() -> None:
    assert mixed().simulated
    assert not compare({"weak": paper().injector.with_values(WEAK)}, paper(), threads=1).simulated


def test_data_of_the_same_name_are_told_apart() -> None:
    data = compare({"a": paper().injector}, [paper(), small_map(), paper()], threads=1).data
    assert [d.name for d in data] == ["160 MPa (study 1)", "map 120 MPa", "160 MPa (study 3)"]


def test_each_study_keeps_its_time_step() -> None:
    coarse = replace(paper(), time_step=2e-6)
    scores = compare({"a": paper().injector}, [paper(), coarse], threads=1).scores["a"]
    (alone,) = compare({"a": paper().injector}, coarse, threads=1).scores["a"]
    np.testing.assert_array_equal(scores[1].values, alone.values)
    assert not np.array_equal(scores[0].values, scores[1].values)


def test_the_record_tells_what_differs_and_what_is_synthetic() -> None:
    record = comparison_record(mixed(), {"weak": "weak=x.toml"}, ["a.toml"])
    (difference,) = record["differences"]
    assert difference["name"] == "valve.spring_preload"
    assert difference["values"]["weak"] == 1.0
    assert record["models"][2]["argument"] == "weak=x.toml"
    assert [study["file"] for study in record["studies"]] == ["a.toml", ""]
    assert paper().injector.synthetic in record["synthetic"]
    assert paper().data[0].synthetic in record["synthetic"]
    measured = compare({"a": plain()}, small_map(), threads=1)
    assert comparison_record(measured)["synthetic"] == ""


def test_the_injector_of_the_study_does_not_make_measured_data_synthetic() -> None:
    study = replace(small_map(), injector=paper().injector)
    assert comparison_record(compare({"a": plain()}, study, threads=1))["synthetic"] == ""


def driven(drive: Drive) -> Injector:
    own = paper().injector
    return replace(own, variant=own.variant._replace(drive=drive))


def test_a_drive_by_a_trace_needs_the_trace() -> None:
    with pytest.raises(ConfigurationError, match=r'^a: .*current trace.*"160 MPa"'):
        compare({"a": driven(Drive.CURRENT)}, paper())
