"""Calibration of a foreign FMU: known truths, failures by policy, nothing of which ends the search."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError, InputError, SimulationError
from commonrail.calibration.optimisers.evolution import EvolutionSettings
from commonrail.plugins.foreign_fmu.data import FmuInputs, fmu_curve, fmu_rows
from commonrail.plugins.foreign_fmu.file import fmu_record
from commonrail.plugins.foreign_fmu.fit import calibrate_fmu
from commonrail.plugins.foreign_fmu.fmu import Asked, FmuStatus, FmuWork, open_simulator, read_fmu, unpack
from commonrail.plugins.foreign_fmu.page import _step_lines, fmu_lines
from commonrail.plugins.foreign_fmu.study import fmu_study
from tests.plugins.foreign_fmu.samples import TIMES, TRUTH, decay_data

pytestmark = pytest.mark.process

SHORT = cr.fit.Method(EvolutionSettings(members=10, generations=6), 2)
FREE = {"k": (0.2, 4.0)}


def test_a_reference_equation_is_calibrated_in_ten_lines_though_a_fifth_of_all_runs_fails(decay_fmu):
    study = fmu_study(decay_fmu, decay_data(0.2), free=FREE, step=0.1, method=SHORT)
    fit = calibrate_fmu(study, processes=1)
    # the equation is solved exactly over each step; the data lie on communication points, so only rounding is left
    assert fit.best["k"] == pytest.approx(TRUTH, rel=1e-6)
    assert fit.status == "finished"
    failed = fit.failures["fmu_error"]
    assert failed == fit.counts.failed
    assert 0.05 < failed / fit.counts.simulated < 0.45  # a fifth of 70, give or take what chance allows at 3 sigma
    assert "no solution" in fit.messages["fmu_error"]
    assert fit.simulated["best"]["decay"] == pytest.approx(study.data[0].measured, rel=1e-6)


def test_data_without_noise_converge_by_the_exactness_of_the_simulations(decay_fmu):
    """Costs of all ends are rounding: they differ by orders of magnitude, and by nothing that data could tell."""
    fit = calibrate_fmu(fmu_study(decay_fmu, decay_data(), free=FREE, step=0.1), processes=1)
    assert fit.cost < 1e-8
    assert fit.convergence is not None
    assert fit.convergence.converged, fit.convergence.sentence
    assert "converged: " not in fit.reason  # the evolution's own verdict, which refinements have replaced


def test_a_stopped_calibration_has_findings_that_say_so(decay_fmu):
    def stop(progress):
        raise KeyboardInterrupt

    fit = calibrate_fmu(
        fmu_study(decay_fmu, decay_data(), free=FREE, step=0.1, method=SHORT), processes=1, progress=stop
    )
    assert fit.status == "interrupted"
    assert fit.estimates["k"]["standard_error"] is None
    assert re.match("not judged: .*stopped$", fit.estimates["k"]["verdict"])
    assert fit.step_effect == {}


def test_the_effect_of_the_communication_step_is_told(decay_fmu):
    """Between communication points outputs are linear: a chord of exp(-kt) over 0.5 s lies above it by 5 %."""
    coarse = fmu_study(decay_fmu, decay_data(), free=FREE, step=0.5, method=SHORT)
    fit = calibrate_fmu(coarse, processes=1)
    k = fit.best["k"]
    chords = [
        np.interp(TIMES, points, np.exp(-k * points)) for points in (np.arange(0, 2.1, 0.5), np.arange(0, 2.1, 0.25))
    ]
    assert fit.step_effect["decay"] == pytest.approx(np.max(np.abs(chords[0] - chords[1])) / 0.01, rel=1e-9)
    record = fmu_record(fit)
    (line,) = _step_lines(record)
    assert line in fmu_lines(record)
    fine = calibrate_fmu(replace(coarse, step=0.1), processes=1)
    assert fine.step_effect["decay"] < 1e-9  # samples lie on its communication points
    assert _step_lines(fmu_record(fine)) == []


BAD = 1.0001  # k that fails in the stated way, see decay.c; those beside it do not
GOOD = (1.0008, 1.0009)


def failing(kind: int):
    """Data of a model that fails in a way for half of all k."""
    return fmu_curve(f"failing {kind}", TIMES, {"x": TIMES}, start={"failing.share": 0.5, "failing.kind": float(kind)})


@pytest.mark.parametrize(
    ("kind", "status", "said"),
    [
        (1, FmuStatus.FMU_DISCARDED, "no solution"),
        (2, FmuStatus.FMU_ERROR, "no solution"),
        (4, FmuStatus.FMU_NOT_FINITE, "x is not"),
    ],
)
def test_a_failure_is_a_status_with_the_fmu_s_own_words(decay_fmu, monkeypatch, kind, status, said):
    monkeypatch.setattr("commonrail.plugins.foreign_fmu.fmu._keep_the_output_clean", lambda: None)
    fmu = read_fmu(decay_fmu)
    with unpack(fmu) as folder:
        work = FmuWork(str(folder), fmu.digest, ("k",), failing(kind).runs, 0.1)
        answered = work(Asked(0, (BAD,)))
        beside = work(Asked(0, (GOOD[0],)))
    assert answered.status == status
    assert said in answered.message
    assert np.isnan(answered.values).all()
    assert beside.status == FmuStatus.FMU_OK
    assert beside.values == pytest.approx(np.exp(-GOOD[0] * TIMES), rel=1e-12)


def forced():
    """With u held at 2, k = 1 and x0 = 1 the solution is 2 - exp(-t)."""
    held = FmuInputs(np.array([0.0, 2.0]), {"u": np.array([2.0, 2.0])})
    return fmu_curve("forced", TIMES, {"x": 2.0 - np.exp(-TIMES)}, inputs=held)


def rows():
    """Ends of simulations from different x0, with k = 1."""
    return fmu_rows("rows", [{"x0": 1.0}, {"x0": 3.0}], {"x": np.exp(-2.0) * np.array([1.0, 3.0])}, 2.0)


@pytest.fixture(scope="module")
def simulator(decay_fmu):
    """One process with the FMU, replaced when it ends; no time limit that a busy machine could meet."""
    data = [failing(3), failing(5), forced(), rows()]
    with open_simulator(read_fmu(decay_fmu), ["k"], data, 0.1, 600.0, 1) as found:
        yield found


@pytest.mark.parametrize(("kind", "status"), [(3, FmuStatus.FMU_FATAL), (5, FmuStatus.FMU_CRASHED)])
def test_an_fmu_that_ends_its_process_fails_its_own_candidate_alone(simulator, kind, status):
    simulated = simulator.simulate([failing(kind)], np.array([[GOOD[0]], [BAD], [GOOD[1]]]))
    assert simulated.statuses.tolist() == [0, int(status), 0]
    assert np.isnan(simulated.values[1]).all()
    for row, k in zip((0, 2), GOOD, strict=True):
        assert simulated.values[row] == pytest.approx(np.exp(-k * TIMES), rel=1e-12)
    assert status in simulator.messages


def test_inputs_and_rows_of_values_are_simulated(simulator):
    simulated = simulator.simulate([rows(), forced()], np.array([[1.0]]))
    assert simulated.values[0] == pytest.approx(np.concatenate([rows().measured, forced().measured]), rel=1e-12)


@pytest.mark.slow
def test_an_fmu_that_hangs_is_ended(decay_fmu):
    data = failing(6)
    with open_simulator(read_fmu(decay_fmu), ["k"], [data], 0.1, 1.0, 1) as simulator:
        simulated = simulator.simulate([data], np.array([[BAD]]))
    assert simulated.statuses.tolist() == [int(FmuStatus.FMU_TOO_LONG)]


@pytest.mark.parametrize("status", list(FmuStatus))
def test_every_status_has_a_sentence(status):
    assert status.sentence.endswith(".")


def test_where_all_candidates_fail_the_fmu_s_own_message_is_in_the_sentence(decay_fmu):
    study = fmu_study(decay_fmu, decay_data(1.0), free=FREE, step=0.1, method=SHORT)
    with pytest.raises(SimulationError, match=r'status "error".*no solution'):
        calibrate_fmu(study, processes=1)


@pytest.mark.slow
def test_the_number_of_processes_does_not_change_the_result(decay_fmu):
    data = decay_data(0.2)
    found = []
    for processes in (1, 2):
        with open_simulator(read_fmu(decay_fmu), ["k"], [data], 0.1, 60.0, processes) as simulator:
            simulated = simulator.simulate([data], np.linspace(0.5, 3.0, 9)[:, None])
        found.append((simulated.values.tobytes(), simulated.statuses.tobytes()))
    assert found[0] == found[1]


def changed(fmu: Path, folder: Path, old: bytes, new: bytes) -> Path:
    """The FMU with another text in its description."""
    path = folder / "changed.fmu"
    with zipfile.ZipFile(fmu) as given, zipfile.ZipFile(path, "w") as written:
        for name in given.namelist():
            content = given.read(name)
            assert name != "modelDescription.xml" or old in content
            written.writestr(name, content.replace(old, new) if name == "modelDescription.xml" else content)
    return path


K = b'<Real unit="1/s" start="1"/>'
LIMITED = b'<Real unit="1/s" start="1" min="0.2" max="4"/>'


def test_values_outside_the_limits_of_the_fmu_are_refused(decay_fmu, tmp_path):
    fmu = read_fmu(changed(decay_fmu, tmp_path, K, LIMITED))
    fmu_study(fmu, decay_data(), free={"k": (0.2, 4.0)}, step=0.1)
    with pytest.raises(InputError, match=r"upper .* k, 4\.5 1/s.*max.* 4 1/s"):
        fmu_study(fmu, decay_data(), free={"k": (0.2, 4.5)}, step=0.1)
    with pytest.raises(InputError, match=r"lower .* k, 0\.1 1/s.*min"):
        fmu_study(fmu, decay_data(), free={"k": (0.1, 4.0)}, step=0.1)
    setting = fmu_curve("set", TIMES, {"x": TIMES}, start={"k": 5.0})
    with pytest.raises(InputError, match=r" k, 5 1/s.*max"):
        fmu_study(fmu, setting, free={"x0": (0.5, 2.0)}, step=0.1)


def test_limits_of_a_declared_type_count_where_the_variable_states_none(decay_fmu, tmp_path):
    types = b'<TypeDefinitions><SimpleType name="Rate"><Real unit="1/s" max="4"/></SimpleType></TypeDefinitions>'
    typed = K.replace(b" start", b' declaredType="Rate" start')
    path = changed(decay_fmu, tmp_path, b"<ModelVariables>", types + b"<ModelVariables>")
    fmu = read_fmu(changed(path.rename(tmp_path / "given.fmu"), tmp_path, K, typed))
    assert (fmu.variables["k"].lower, fmu.variables["k"].upper) == (-np.inf, 4.0)


def test_an_input_beyond_its_limits_is_told_and_not_refused(decay_fmu, tmp_path):
    """A measured course has noise: a pressure that is never negative can be."""
    limited = changed(decay_fmu, tmp_path, b'<Real unit="m/s" start="0"/>', b'<Real unit="m/s" start="0" min="0"/>')
    inputs = FmuInputs(TIMES, {"u": np.where(TIMES < 1.0, -0.01, 0.0)})
    data = fmu_curve("forced", TIMES, {"x": TIMES}, inputs=inputs)
    (sentence,) = fmu_study(limited, data, free=FREE, step=0.1).notes
    assert [text in sentence for text in ("forced", " u,", "-0.01 m/s", "min", " 0 m/s")] == [True] * 5


def test_two_variables_of_one_name_are_refused(decay_fmu, tmp_path):
    path = changed(decay_fmu, tmp_path, b'name="mu"', b'name="x0"')
    with pytest.raises(InputError, match=r"\bx0\b"):
        read_fmu(path)


def test_a_communication_step_coarser_than_the_data_is_told(decay_fmu):
    """Samples every 100 ms: a step of 100 ms has a communication point for each, rounding of the times included."""
    assert fmu_study(decay_fmu, decay_data(), free=FREE, step=0.1).notes == ()
    (sentence,) = fmu_study(decay_fmu, decay_data(), free=FREE, step=0.25).notes
    assert [text in sentence for text in ("decay", "100 ms", "250 ms")] == [True] * 3
    fine = FmuInputs(np.linspace(0.0, 2.0, 201), {"u": np.zeros(201)})
    (sentence,) = fmu_study(decay_fmu, fmu_curve("forced", TIMES, {"x": TIMES}, inputs=fine), free=FREE, step=0.1).notes
    assert [text in sentence for text in ("forced", " 10 ms", "100 ms")] == [True] * 3


@pytest.mark.parametrize(
    ("free", "sentence"),
    [
        ({"kk": (0.0, 1.0)}, '"kk"'),
        ({"x": (0.0, 1.0)}, r"\bx\b.*causality"),
        ({"failing.kind": (0.0, 1.0)}, "type Integer"),
        ({"k": 1.0}, r"\(lower, upper\)"),
        ({"k": (2.0, 1.0)}, "lower bound"),
    ],
)
def test_a_wrong_parameter_is_refused_in_a_sentence(decay_fmu, free, sentence):
    with pytest.raises((InputError, ConfigurationError), match=sentence):
        fmu_study(decay_fmu, decay_data(), free=free, step=0.1)


def test_a_free_variable_with_a_measured_course_is_refused(decay_fmu):
    with pytest.raises(ConfigurationError, match=r"^u "):
        fmu_study(decay_fmu, forced(), free={"u": (0.0, 1.0)}, step=0.1)


def test_what_is_no_fmu_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "no.fmu"
    path.write_bytes(b"PK nothing")
    with pytest.raises(InputError, match=r"no\.fmu"):
        read_fmu(path)
