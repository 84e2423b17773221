"""Calibration of a foreign FMU: known truths, failures by policy, nothing of which ends the search."""

from __future__ import annotations

import numpy as np
import pytest

import commonrail as cr
from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings
from commonrail.errors import ConfigurationError, InputError, SimulationError
from commonrail.foreign.data import Inputs, curve, values_of_rows
from commonrail.foreign.fit import calibrate_fmu
from commonrail.foreign.fmu import read_fmu
from commonrail.foreign.simulator import opened
from commonrail.foreign.statuses import FmuStatus
from commonrail.foreign.study import fmu_study
from tests.foreign.samples import TIMES, TRUTH, decay_data

pytestmark = pytest.mark.process

SHORT = cr.Method(EvolutionSettings(members=10, generations=6), 2)
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
    assert "no solution at k = " in fit.told["fmu_error"]
    assert fit.simulated["best"]["decay"] == pytest.approx(study.data[0].measured, rel=1e-6)


@pytest.fixture(scope="module")
def failing(decay_fmu):
    """Status and messages of a candidate whose run fails in each way, between two that succeed."""
    fmu = read_fmu(decay_fmu)
    kinds = (1, 2, 3, 4, 5, 6)
    data = [
        curve(str(kind), TIMES, {"x": TIMES}, start={"failing.share": 0.5, "failing.kind": float(kind)})
        for kind in kinds
    ]
    found = {}
    with opened(fmu, ["k"], data, 0.1, 3.0, 1) as simulator:
        for kind, one in zip(kinds, data, strict=True):
            simulated = simulator.simulate([one], np.array([[1.0008], [1.0001], [1.0009]]))
            found[kind] = (simulated, dict(simulator.told))
    return found


@pytest.mark.parametrize(
    ("kind", "status"),
    [
        (1, FmuStatus.FMU_DISCARDED),
        (2, FmuStatus.FMU_ERROR),
        (3, FmuStatus.FMU_FATAL),
        (4, FmuStatus.FMU_NOT_FINITE),
        (5, FmuStatus.FMU_CRASHED),
        (6, FmuStatus.FMU_TOO_LONG),
    ],
)
def test_a_failure_is_a_status_of_its_candidate_and_of_no_other(failing, kind, status):
    simulated, told = failing[kind]
    assert simulated.statuses.tolist() == [0, int(status), 0]
    assert np.isnan(simulated.values[1]).all()
    for row, k in ((0, 1.0008), (2, 1.0009)):
        assert simulated.values[row] == pytest.approx(np.exp(-k * TIMES), rel=1e-12)
    assert status in told
    assert status.sentence.endswith(".")


def test_where_all_candidates_fail_the_fmu_s_own_message_is_in_the_sentence(decay_fmu):
    study = fmu_study(decay_fmu, decay_data(1.0), free=FREE, step=0.1, method=SHORT)
    with pytest.raises(SimulationError, match=r'not one of .* status "error".*It said: .*no solution at k'):
        calibrate_fmu(study, processes=1)


def test_inputs_and_rows_of_values_are_simulated(decay_fmu):
    # with u held at 2 and k = 1 the solution is 2 - exp(-t); the rows start from different x0
    held = Inputs(np.array([0.0, 2.0]), {"u": np.array([2.0, 2.0])})
    forced = curve("forced", TIMES, {"x": 2.0 - np.exp(-TIMES)}, inputs=held)
    rows = values_of_rows("rows", [{"x0": 1.0}, {"x0": 3.0}], {"x": np.exp(-2.0) * np.array([1.0, 3.0])}, 2.0)
    with opened(read_fmu(decay_fmu), ["mu"], [forced, rows], 0.1, 60.0, 1) as simulator:
        simulated = simulator.simulate([rows, forced], np.array([[1.0]]))
    assert simulated.values[0] == pytest.approx(np.concatenate([rows.measured, forced.measured]), rel=1e-12)


def test_the_number_of_processes_does_not_change_the_result(decay_fmu):
    data = decay_data(0.2)
    found = []
    for processes in (1, 2):
        with opened(read_fmu(decay_fmu), ["k"], [data], 0.1, 60.0, processes) as simulator:
            simulated = simulator.simulate([data], np.linspace(0.5, 3.0, 9)[:, None])
        found.append((simulated.values.tobytes(), simulated.statuses.tobytes()))
    assert found[0] == found[1]


@pytest.mark.parametrize(
    ("free", "sentence"),
    [
        ({"kk": (0.0, 1.0)}, 'no variable "kk"'),
        ({"x": (0.0, 1.0)}, "x cannot be set"),
        ({"failing.kind": (0.0, 1.0)}, "of type Integer"),
        ({"k": 1.0}, r"must be \(lower, upper\)"),
        ({"k": (2.0, 1.0)}, "lower bound lies above"),
    ],
)
def test_a_wrong_parameter_is_refused_in_a_sentence(decay_fmu, free, sentence):
    with pytest.raises((InputError, ConfigurationError), match=sentence):
        fmu_study(decay_fmu, decay_data(), free=free, step=0.1)


def test_what_is_no_fmu_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "no.fmu"
    path.write_bytes(b"PK nothing")
    with pytest.raises(InputError, match="this is no FMU that can be read"):
        read_fmu(path)
