"""Numbers that a page is made of: sliders, limits, fan, presets; and the sentences where there can be no page."""

from __future__ import annotations

import base64
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.choices import Drive
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.calibration.objective import Objective
from commonrail.data.base import Role
from commonrail.data.registry import of_role
from commonrail.engine.plan import candidate_matrix
from commonrail.physics.variants import Variant
from commonrail.plugins.page.page import FIRST_POINT, content
from commonrail.plugins.page.subject import MEMBERS, WORSE, Slider, Subject, near_fits, read_subject
from commonrail.runs.folder import DRAWS, read_fit


@pytest.fixture(scope="module")
def of_run(run_folder: Path) -> Subject:
    return read_subject(str(run_folder))


def unpacked(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f8")


def test_the_free_parameters_of_a_run_are_its_sliders(of_run: Subject, run_folder: Path) -> None:
    study, best = read_fit(run_folder)
    assert [s.name for s in of_run.sliders] == list(study.space.names)
    assert {name: of_run.injector.values[name] for name in best} == best
    assert of_run.start == dict(zip(study.space.names, study.space.reference.tolist(), strict=True))
    found = content(of_run, FIRST_POINT, "0")
    assert found["narrowed"] == 1.0
    for slider, parameter in zip(found["sliders"], study.space.parameters, strict=True):
        # 0.9 + 1.0 × (lower − 0.9): the ends have a rounding of their own
        assert (slider["low"], slider["high"]) == pytest.approx((parameter.lower, parameter.upper), rel=1e-12)
        assert slider["value"] == best[slider["name"]]
        assert slider["unit"] == "N/µm"


def test_the_full_vector_is_that_of_the_engine(of_run: Subject) -> None:
    found = content(of_run, FIRST_POINT, "0")
    row = candidate_matrix(of_run.injector, (), np.empty((1, 0)))[0]
    assert unpacked(found["theta"]).tolist() == row.tolist()
    nodes, at = found["temperature"]["nodes"], found["temperature"]["at"]
    assert nodes[at] == of_run.injector.values["fuel.temperature"]
    assert unpacked(found["temperature"]["coefficients"][at]).tolist() == row[found["parameters"] :].tolist()
    names = [s["name"] for s in found["sliders"]]
    assert [row[found["columnOf"][name]] for name in names] == [of_run.injector.values[name] for name in names]


def test_ranges_that_the_time_step_does_not_bear_are_narrowed(of_run: Subject) -> None:
    point = cr.OperatingPoint("200 MPa", "700 us")
    coarse = replace(of_run, time_step=0.9 * cr.simulate(of_run.injector, point).longest_step)
    share = content(coarse, FIRST_POINT, "0")["narrowed"]
    assert 0.0 < share < 1.0
    corner = {s["name"]: s["high"] for s in content(coarse, FIRST_POINT, "0")["sliders"]}
    stiff = coarse.injector.with_values(corner)
    assert not cr.simulate(stiff, point, time_step=coarse.time_step).status.failed
    ends = {s.name: s.high for s in coarse.sliders}  # not narrowed
    assert cr.simulate(coarse.injector.with_values(ends), point, time_step=coarse.time_step).status.failed


def test_members_of_the_fan_explain_the_data_almost_as_well(of_run: Subject, run_folder: Path) -> None:
    study, best = read_fit(run_folder)
    assert of_run.fan is not None
    objective = Objective(study.injector, of_run.fan.names, of_role(study.data, Role.FIT), study.time_step)
    level = objective.costs(np.array([[best[name] for name in of_run.fan.names]])).costs[0]
    costs = objective.costs(of_run.fan.members).costs
    assert len(costs) == MEMBERS
    assert np.all(costs <= (1.0 + WORSE) * level)
    # they reach the level, or the bounds or an order of the study stop them before
    assert np.sum(costs > (1.0 + 0.5 * WORSE) * level) >= MEMBERS // 4
    assert np.all(study.space.satisfies(of_run.fan.members))
    assert len(np.unique(of_run.fan.members, axis=0)) == MEMBERS


def test_the_draws_of_a_run_are_the_fan_and_damaged_ones_are_refused(run_folder: Path, tmp_path: Path) -> None:
    run = shutil.copytree(run_folder, tmp_path / "run")
    study, best = read_fit(run)
    names = list(study.space.names)
    points = np.tile([best[name] for name in names], (40, 1))
    np.savez(run / DRAWS, points=points, names=np.array(names))
    (run / "SHA256SUMS").unlink(missing_ok=True)
    found = near_fits(run, study, best, 1)
    assert found is not None
    assert found.short == "draws"
    (run / DRAWS).write_bytes(b"PK nothing")
    with pytest.raises(InputError, match=r"draws\.npz"):
        near_fits(run, study, best, 1)


def test_a_model_has_usual_sliders_and_those_that_are_asked_for() -> None:
    subject = read_subject("virtual-lino-2016", ("sac.volume", "valve.lift"))
    names = [s.name for s in subject.sliders]
    assert names[-1] == "sac.volume"
    assert names.count("valve.lift") == 1
    assert subject.data == ()
    assert subject.fan is not None
    assert "assumption" in subject.fan.note
    assert subject.synthetic == (subject.injector.synthetic,)


def test_numbers_of_a_direct_acting_injector_are_in_the_columns_of_its_parts() -> None:
    """With the measured current, whose wiring other tests simulate."""
    direct = cr.load_injector("direct-acting-kr")
    current = cr.Trace((0.0, 280e-6, 400e-6, 600e-6, 640e-6), (0.0, 11.0, 2.5, 2.5, 0.0))
    point = cr.OperatingPoint(20e6, [], 0.1e6, 0.1e6, drive=current, horizon=1.3e-3)
    data = cr.RateData("traced", Role.FIT, point, np.linspace(0.0, 1.3e-3, 131), np.zeros(130), 1.0, "none", "zeros")
    slider = Slider("armature.idle_stroke", 20e-6, 90e-6)
    found = content(Subject("direct", direct, (slider,), 1e-6, {}, (data,), (), None), FIRST_POINT, "0")
    assert {"armature_lift", "needle_lift"} <= set(found["channels"])
    theta = unpacked(found["theta"])
    assert len(theta) == found["columns"]
    assert theta[found["columnOf"][slider.name]] == direct.values[slider.name]
    assert found["traced"]
    # J of a rate of zero is all that is injected
    assert found["data"][0]["reference"] > 1.0


def test_no_slider_moves_a_count() -> None:
    with pytest.raises(InputError, match=r"nozzle\.holes .*pieces"):
        read_subject("virtual-lino-2016", ("nozzle.holes",))
    with pytest.raises(ConfigurationError, match=r"read rail\.volume"):
        read_subject("virtual-lino-2016", ("rail.volume",))


@pytest.mark.slow  # the fan is simulated, and no other test compiles this wiring
def test_a_direct_acting_injector_has_a_page_too(tmp_path: Path) -> None:
    traced = cr.load_injector("direct-acting-kr")
    regulated = replace(traced, variant=traced.variant._replace(drive=Drive.REGULATED))
    cr.dump_injector(regulated, tmp_path / "direct.toml")
    subject = read_subject(str(tmp_path / "direct.toml"))
    found = content(subject, FIRST_POINT, "0")
    assert "armature_lift" in found["channels"]
    assert [s["name"] for s in found["sliders"]]


@pytest.mark.parametrize(
    ("text", "more", "sentence"),
    [
        ("no-such-injector", (), "or injector"),
        (
            "virtual-lino-2016",
            ("valve.lfit",),
            "valve.lfit: .*slider.*valve.lift",
        ),
        ("virtual-lino-2016", ("solenoid.eddy_lag",), "solenoid.eddy_lag is zero"),
    ],
)
def test_what_cannot_be_read_is_a_sentence(text: str, more: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(cr.errors.InputError, match=sentence):
        read_subject(text, more)


def test_an_injector_that_follows_a_trace_is_refused(tmp_path: Path) -> None:
    injector = replace(cr.load_injector("virtual-lino-2016"), variant=Variant(drive=Drive.CURRENT))
    cr.dump_injector(injector, tmp_path / "traced.toml")
    with pytest.raises(cr.errors.ConfigurationError, match=r"current trace.*run folder"):
        read_subject(str(tmp_path / "traced.toml"))
