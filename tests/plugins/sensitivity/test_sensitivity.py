"""Sensitivity studies: policy for failures on a made-up model, and features of the virtual injector."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.typing import NDArray

from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.space import Space
from commonrail.calibration.study import study
from commonrail.data.base import Role
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.status import OK, Status
from commonrail.physics.injector import Injector
from commonrail.plugins.features.table import FEATURES
from commonrail.plugins.sensitivity.file import Effect, OutputSensitivity, Range, Sensitivity
from commonrail.plugins.sensitivity.run import CONSTRAINTS, Progress, sensitivity, study_of_model
from commonrail.plugins.sensitivity.settings import SensitivitySettings
from commonrail.plugins.sensitivity.study import (
    NO_EVENT,
    Evaluated,
    Output,
    default_names,
    make_codes,
    parameters_within,
    reason,
)

Floats = NDArray[np.float64]

POINT = OperatingPoint("160 MPa", "700 us")
SPACE = Space([Parameter(n, 0.5, 0.0, 1.0, "1", mark="E", source="made up", signed=True) for n in ("a", "b")])


class Steep:
    """y = 3 a + b, with no value above a limit of a."""

    outputs = (Output("y", "m3", "made up"),)
    injections = 1

    def __init__(self, limit: float) -> None:
        self.limit = limit

    def evaluate(self, values: Floats) -> Evaluated:
        bad = values[:, :1] > self.limit
        y = 3.0 * values[:, :1] + values[:, 1:]
        return Evaluated(np.where(bad, np.nan, y), np.where(bad, Status.RAN_AWAY, OK).astype(np.int8))


def studied(limit: float, **settings: object) -> Sensitivity:
    how = SensitivitySettings(samples=64, **settings)  # type: ignore[arg-type]
    empty = Sensitivity("made up", "none", "made up", tuple(map(Range.of, SPACE.parameters)), how)
    return study_of_model(Steep(limit), SPACE, empty)


def _of(output: OutputSensitivity, name: str) -> Effect:
    return next(effect for effect in output.parameters if effect.name == name)


@pytest.mark.parametrize("design", ["sobol", "morris"])
def test_failed_simulations_are_counted_with_their_reason_and_their_place(design: str) -> None:
    found = studied(0.95 if design == "sobol" else 0.9, design=design, most_failed=0.6)
    (output,) = found.outputs
    assert output.failed.number > 0
    assert output.failed.reasons == {Status.RAN_AWAY.sentence: output.failed.number}
    assert output.failed.where == "high a"
    assert output.estimated
    ends = {effect.name: effect.high for effect in output.parameters}
    assert ends == {"a": None, "b": 2.5}  # a = 1 fails, and says so
    assert output.missing == Status.RAN_AWAY.sentence
    json.dumps(found.record(), allow_nan=False)
    assert all(value == value for row in found.rows() for value in row.values())


def test_above_the_largest_share_of_failures_there_are_no_indices_and_the_record_says_why() -> None:
    record = studied(0.5, most_failed=0.1).record()["outputs"][0]
    assert record["estimated"] is False
    assert "10%" in record["why_not"]
    assert record["failed"]["share"] == pytest.approx(0.5, abs=0.05)
    assert [row["name"] for row in record["parameters"]] == ["b", "a"]  # by swing: that of a has no upper end


def test_the_study_is_refused_where_the_policy_says_so() -> None:
    with pytest.raises(SimulationError, match=r"^\d+ .*\by, .*high a, .*refuse"):
        studied(0.9, on_failure="refuse")
    assert studied(2.0, on_failure="refuse").outputs[0].failed.number == 0


def test_the_reference_that_fails_leaves_no_tornado() -> None:
    record = studied(0.4, most_failed=0.9).record()["outputs"][0]
    assert (record["base"], record["missing"]) == (None, Status.RAN_AWAY.sentence)


def test_features_are_those_of_single_simulations(pwm: Injector) -> None:
    names = ("nozzle.hole_diameter", "control_chamber.a_hole_diameter")
    features = ("quantity", "return_quantity", "opening_delay", "closing_delay", "duration", "lift", "steady_rate")
    found = sensitivity(
        pwm, parameters_within(pwm, names, "2 %"), [POINT], features, settings=SensitivitySettings(samples=4)
    )
    upper = {names[0]: pwm.values[names[0]] * 1.02}
    for alone, ends in ((simulate(pwm, POINT), "base"), (simulate(pwm.with_values(upper), POINT), "high")):
        late = (alone.rate_time > 560e-6) & (alone.rate_time < 700e-6)
        expected = [
            alone.injected_volume,
            alone.returned_volume,
            alone.opening,
            alone.closing - 700e-6,
            alone.closing - alone.opening,
            float(np.max(alone.channels["needle_lift"])),
            float(np.mean(alone.rate[late])),
        ]
        values = [o.base if ends == "base" else _of(o, names[0]).high for o in found.outputs]
        # a batch ends when the needle has rested, which leaves leakage out of the return: see simulate_batch
        assert [values[i] for i in (0, 2, 3, 4, 5)] == pytest.approx([expected[i] for i in (0, 2, 3, 4, 5)], rel=1e-9)
        assert values[6] == pytest.approx(expected[6], rel=1e-6)


def test_the_result_does_not_depend_on_threads_and_progress_is_told(pwm: Injector) -> None:
    seen: list[Progress] = []
    ranges = parameters_within(pwm, ["nozzle.hole_diameter"], "2 %")
    studies = [
        sensitivity(
            pwm, ranges, [POINT], ["quantity"], settings=SensitivitySettings(samples=8), threads=n, progress=seen.append
        )
        for n in (1, 2)
    ]
    first, second = (study.record() | {"clock": None} for study in studies)
    assert first == second
    assert seen[-1].done == seen[-1].total == first["injections"]


def test_the_objective_of_a_study_is_that_of_its_fitted_data(pwm: Injector) -> None:
    fit = QuantityData("fit", Role.FIT, (POINT,), np.array([5e-8]), 1e-9, 0.03, np.zeros(1, bool), 1.0, "test", "all")
    seen = fit.changed(name="seen", role=Role.VALIDATION, quantity=np.array([2e-8]))
    settings = SensitivitySettings(samples=8)
    studies = [study(pwm, data, free={"nozzle.hole_diameter": "2 %"}) for data in ([fit], [fit, seen])]
    alone, both = (sensitivity(one, settings=settings).outputs[0] for one in studies)
    assert (both.base, both.parameters) == (alone.base, alone.parameters)


def test_a_needle_that_never_opens_is_counted_and_not_a_number(pwm: Injector) -> None:
    short = OperatingPoint("160 MPa", "60 us")
    found = sensitivity(
        pwm,
        parameters_within(pwm, ["nozzle.hole_diameter"]),
        [short],
        ["quantity", "opening_delay"],
        settings=SensitivitySettings(samples=4),
    )
    record = found.record()
    quantity, delay = record["outputs"]
    assert quantity["failed"]["number"] == 0
    assert quantity["base"] == pytest.approx(0.0, abs=1e-15)
    assert delay["failed"]["reasons"] == {reason(NO_EVENT): 4 * 3}
    assert delay["base"] is None
    json.dumps(record, allow_nan=False)


def test_a_needle_still_open_has_its_opening_and_nothing_that_is_final() -> None:
    statuses = np.array([Status.STILL_INJECTING, OK, Status.RAN_AWAY])
    for name, expected in (("opening_delay", [OK, OK]), ("quantity", [Status.STILL_INJECTING, OK])):
        found = make_codes(FEATURES[name], np.ones(3), statuses)
        assert found.tolist() == [*expected, Status.RAN_AWAY]


def test_the_default_parameters_are_those_that_are_not_zero_counts_or_temperature(pwm: Injector) -> None:
    names = default_names(pwm)
    assert "nozzle.hole_diameter" in names
    assert not {"nozzle.holes", "solenoid.turns", "fuel.temperature", "valve.damping"} & set(names)
    ranges = parameters_within(pwm, within="5 %", ranges=None)
    assert [p.name for p in ranges] == list(names)
    wide = parameters_within(pwm, ["control_chamber.a_hole_discharge"], 0.5)[0]
    assert wide.upper == 1.0  # 0.82 · 1.5 leaves the domain


def test_ranges_may_be_given_with_their_units(pwm: Injector) -> None:
    (lift,) = parameters_within(pwm, ranges={"valve.lift": ("50 um", "60 um")})
    assert (lift.lower, lift.upper, lift.reference) == pytest.approx((50e-6, 60e-6, 55e-6))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"names": ["valve.lft"]}, '"valve.lft".*"valve.lift"|valve.lft.*valve.lift'),
        ({"names": ["rail.volume"]}, r"rail\.volume.*@volume"),
        ({"ranges": {"rail.volume": ("1 cm3", "2 cm3")}}, r"rail\.volume.*@volume"),
        ({"names": ["valve.damping"]}, "valve.damping .*zero .*virtual-lino-2016"),
        ({"names": ["valve.lift"], "within": 1.5}, "not 1.5"),
        ({"ranges": {"valve.lift": "55 um"}}, "range of valve.lift .*pair"),
        ({"ranges": {"valve.lift": ("-5 um", "60 um")}}, "-5e-06 to 6e-05"),
        ({"ranges": {"valve.lift": ("60 um", "50 um")}}, "valve.lift.*lower bound"),
    ],
)
def test_a_range_that_cannot_be_is_refused(pwm: Injector, arguments: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        parameters_within(pwm, **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"samples": 100}, "128, not 100"),
        ({"confidence": 1.0}, "confidence .*0.5 and 0.999"),
        ({"design": "fast"}, 'design .*"sobol" or "morris"'),
        ({"most_failed": -0.1}, "failures .*0 and 0.9.* -0.1"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        SensitivitySettings(**settings)  # type: ignore[arg-type]


def test_an_injector_needs_points_and_parameters(pwm: Injector) -> None:
    with pytest.raises(ConfigurationError, match=r"commonrail\.parameters_within"):
        sensitivity(pwm, points=[POINT])
    with pytest.raises(ConfigurationError, match="points"):
        sensitivity(pwm, parameters_within(pwm, ["valve.lift"]))


def test_the_note_on_constraints_is_a_sentence() -> None:
    assert CONSTRAINTS.endswith("its whole range.")
