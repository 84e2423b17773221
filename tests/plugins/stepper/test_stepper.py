"""An injector stepped by its caller against the same simulated in one piece, and its linear model against itself."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.choices import Actuation, Drive
from commonrail.physics.injector import Injector
from commonrail.physics.variants import Variant
from commonrail.plugins.stepper.inputs import refuse_unread
from tests.conftest import wired

POINT = cr.OperatingPoint("160 MPa", "700 us", horizon="1.2 ms")
ROUNDING = 1e-9  # of a channel's peak: the lanes contract products and sums in another order, and the needle bounces
INTERVAL = 10  # time steps between two looks


@pytest.fixture(scope="module")
def whole(pwm: Injector) -> cr.Solution:
    return cr.simulate(pwm, POINT)


def stepped(stepper: cr.Stepper, count: int) -> dict[str, np.ndarray]:
    """Outputs of so many calls, by name."""
    rows = [stepper.step("10 us") for _ in range(count)]
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_stepping_gives_what_simulating_in_one_piece_gives(pwm: Injector, whole: cr.Solution) -> None:
    found = stepped(cr.Stepper(pwm, POINT), 120)
    assert set(found) == {"time", "mass_rate", "injected_mass", "returned_mass", *whole.channels}
    assert found["time"] == pytest.approx(whole.time[INTERVAL::INTERVAL], abs=1e-15)
    expected = {name: values[INTERVAL::INTERVAL] for name, values in whole.channels.items()}
    expected["injected_mass"] = whole.injected[INTERVAL::INTERVAL]
    expected["mass_rate"] = np.mean(whole.mass_rate.reshape(-1, INTERVAL), axis=1)
    for name, values in expected.items():
        assert np.max(np.abs(found[name] - values)) <= ROUNDING * np.max(np.abs(values)), name
    assert found["returned_mass"][-1] == pytest.approx(whole.returned_mass, rel=ROUNDING)


def test_the_length_of_a_step_does_not_change_a_bit(pwm: Injector) -> None:
    fine, coarse = cr.Stepper(pwm, POINT), cr.Stepper(pwm, POINT)
    for _ in range(300):
        fine.step("1 us")
    coarse.step("300 us")
    assert fine.states == coarse.states


def test_a_command_is_the_energising_that_it_repeats(pwm: Injector) -> None:
    planned, commanded = cr.Stepper(pwm, POINT), cr.Stepper(pwm, POINT)
    commanded.step("700 us", command=True)
    commanded.step("400 us", command=False)
    planned.step("700 us")
    planned.step("400 us")
    assert commanded.states == planned.states


def test_a_command_takes_over_an_energising_that_has_begun(pwm: Injector) -> None:
    planned, commanded = cr.Stepper(pwm, POINT), cr.Stepper(pwm, POINT)
    for stepper in (planned, commanded):
        stepper.step("300 us")
    commanded.step("400 us", command=True)
    commanded.step("300 us", command=False)
    planned.step("400 us")
    planned.step("300 us")
    assert commanded.states == planned.states


def test_an_energising_that_is_ended_early_injects_less(pwm: Injector) -> None:
    stepper = cr.Stepper(pwm, POINT)
    stepper.step("450 us")
    early = stepper.step("750 us", command=False)["injected_mass"]
    shorter = cr.simulate(pwm, cr.OperatingPoint("160 MPa", "450 us", horizon="1.2 ms")).injected_mass
    assert early == pytest.approx(shorter, rel=ROUNDING)


def test_a_restored_state_continues_with_the_same_bits(pwm: Injector) -> None:
    stepper = cr.Stepper(pwm, POINT)
    stepper.step("350 us", rail_pressure="150 MPa")
    kept = stepper.save()
    first = stepper.step("400 us", command=False)
    stepper.restore(kept)
    assert stepper.time == pytest.approx(350e-6)
    assert stepper.step("400 us", command=False) == first
    other = cr.Stepper(pwm, POINT)
    other.restore(kept)
    assert other.step("400 us", command=False) == first


def test_a_stepper_travels_in_its_state(pwm: Injector) -> None:
    stepper = cr.Stepper(pwm, POINT, "0.5 us")
    stepper.step("300 us", command=True, cylinder_pressure="6 MPa")
    others = pickle.loads(pickle.dumps(stepper)), copy.deepcopy(stepper)
    expected = stepper.step("200 us")
    for other in others:
        assert other.step("200 us") == expected


def test_a_held_pressure_is_that_of_a_trace_with_a_step(pwm: Injector) -> None:
    held = cr.Stepper(pwm, POINT)
    held.step("300 us")
    found = held.step("500 us", rail_pressure="140 MPa")
    # the trace falls within a billionth of a step: its mean over the steps is the same
    fallen = cr.Trace((0.0, 300e-6, 300e-6 + 1e-15), (160e6, 160e6, 140e6))
    followed = cr.Stepper(pwm, cr.OperatingPoint(fallen, "700 us", horizon="1.2 ms"))
    assert followed.step("800 us")["injected_mass"] == pytest.approx(found["injected_mass"], rel=1e-8)
    assert found["rail_pressure"] == 140e6


def test_the_plan_holds_beyond_its_horizon(pwm: Injector) -> None:
    short = cr.Stepper(pwm, cr.OperatingPoint("160 MPa", "700 us", horizon="300 us"))
    long = cr.Stepper(pwm, POINT)
    assert short.step("1.1 ms") == long.step("1.1 ms")


def test_a_failed_step_leaves_the_state_as_it_was(pwm: Injector) -> None:
    stepper = cr.Stepper(pwm, POINT)
    stepper.step("100 us")
    before = stepper.states
    with pytest.raises(cr.errors.ConfigurationError, match=r"cylinder pressure .*rail pressure"):
        stepper.step("10 us", cylinder_pressure="170 MPa")
    with pytest.raises(cr.errors.ConfigurationError, match="900 MPa"):
        stepper.step("10 us", rail_pressure="900 MPa")
    assert stepper.states == before
    assert stepper.step("10 us")["rail_pressure"] == 160e6


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"duration": "1.5 us"}, "time steps .*1 µs.* 1.5 µs"),
        ({"duration": 0.0}, "time steps of 1 µs"),
        ({"duration": 1e300}, "1e\\+300 s"),
        ({"duration": "10 us", "current": "10 A"}, "pwm .*current.* command"),
        ({"duration": "10 us", "command": 1}, "command .*True or False"),
        ({"duration": "10 us", "rail_pressure": "1 m"}, "rail pressure"),
    ],
)
def test_what_cannot_be_used_is_a_sentence(pwm: Injector, given: dict[str, object], sentence: str) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=sentence):
        cr.Stepper(pwm, POINT).step(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("variant", "given", "words"),
    [
        (Variant("rigid", "volume", "pwm"), "rail_pressure", "rail_boundary"),
        (Variant("rigid", "volume", "pwm"), "current", "pwm .*current"),
        (Variant("rigid", "ideal", "current trace"), "command", "command.* current"),
        (Variant(drive="regulated", actuation="direct"), "return_pressure", "return_pressure"),
    ],
)
def test_an_input_that_the_variant_does_not_read_is_refused(variant: Variant, given: str, words: str) -> None:
    name = "direct-acting-kr" if variant.actuation is Actuation.DIRECT else "cri2-16"
    injector = replace(cr.load_injector(name), variant=variant)
    with pytest.raises(cr.errors.ConfigurationError, match=words):
        refuse_unread(injector, given)  # no kernel is needed


def test_a_step_that_is_too_long_for_the_injector_is_refused(pwm: Injector) -> None:
    with pytest.raises(cr.errors.SimulationError, match="time step"):
        cr.Stepper(pwm, POINT, "50 us")


def test_a_state_of_another_injector_is_refused(pwm: Injector) -> None:
    longer = pwm.with_values({"feed_pipe.length": "2 m"})
    kept = cr.Stepper(longer, POINT).save()
    with pytest.raises(cr.errors.ConfigurationError, match="variant"):
        cr.Stepper(pwm, POINT).restore(kept)


@pytest.mark.parametrize(
    "change",
    [
        {"memory": np.nan},
        {"steps": -1},
        {"steps": "3"},
        {"overrides": None},
    ],
)
def test_a_damaged_state_is_refused_and_the_stepper_keeps_its_own(pwm: Injector, change: dict[str, object]) -> None:
    stepper = cr.Stepper(pwm, POINT)
    stepper.step("50 us")
    kept, before = stepper.save(), stepper.states
    if "memory" in change:
        damaged = kept.memory.copy()
        damaged[-1] = np.nan  # the last slot of a wave, which no channel shows
        change = {"memory": damaged}
    with pytest.raises(cr.errors.ConfigurationError, match="save"):
        stepper.restore(kept._replace(**change))  # type: ignore[arg-type]
    assert stepper.states == before
    stepper.restore(kept)


# --- Linear model ---------------------------------------------------------------------------------------------------

OUTPUTS = ("mass_rate", "needle_lift", "accumulation_pressure")


@pytest.fixture(scope="module")
def open_needle(pwm: Injector) -> cr.Stepper:
    """In mid-flight: the needle is rising, between seat and stop."""
    stepper = cr.Stepper(pwm, POINT)
    stepper.step("420 us")
    return stepper


@pytest.fixture(scope="module")
def linear(open_needle: cr.Stepper) -> cr.models.LinearModel:
    return open_needle.linearise("5 us", ("rail_pressure", "cylinder_pressure"), OUTPUTS)


def test_linearising_leaves_the_state_as_it_was(pwm: Injector, open_needle: cr.Stepper) -> None:
    untouched = cr.Stepper(pwm, POINT)
    untouched.step("420 us")
    assert untouched.states == open_needle.states


def test_the_linear_model_predicts_a_small_change_to_second_order(
    open_needle: cr.Stepper, linear: cr.models.LinearModel
) -> None:
    kept = open_needle.save()

    def change(by: float) -> np.ndarray:
        outputs = []
        for sign in (1.0, -1.0):
            open_needle.restore(kept)
            out = open_needle.step("5 us", cylinder_pressure=5e6 + sign * by)
            outputs.append([out[name] for name in OUTPUTS])
        open_needle.restore(kept)
        return 0.5 * (np.array(outputs[0]) - np.array(outputs[1]))

    column = linear.inputs.index("cylinder_pressure")
    for by in (1e4, 1e5):
        predicted = linear.d[:, column] * by
        # an odd function: what the linear model leaves out is of third order
        assert np.abs(change(by) - predicted)[0] <= 1e-4 * (by / 1e5) ** 2 * abs(predicted[0]) + 1e-9 * abs(
            predicted[0]
        )


def test_two_samples_are_the_product_of_both(open_needle: cr.Stepper, linear: cr.models.LinearModel) -> None:
    # the chain rule: what one sample does to the state, the next one takes up, waves in the pipes included
    kept = open_needle.save()
    both = open_needle.linearise("10 us", linear.inputs, OUTPUTS[1:])
    open_needle.step("5 us")
    second = open_needle.linearise("5 us", linear.inputs, OUTPUTS[1:])
    open_needle.restore(kept)
    assert both.states == second.states == linear.states
    for found, expected in ((both.a, second.a @ linear.a), (both.c, second.c @ linear.a)):
        scale = np.max(np.abs(found), axis=1, keepdims=True)
        # rounding: a wave of 160 MPa moves by 2e-3 Pa with the mass of the SAC; found are 1e-4
        assert np.max(np.abs(found - expected) / np.where(scale > 0.0, scale, 1.0)) < 1e-3
    assert np.count_nonzero(both.c) > 30


def test_a_pulse_of_rail_pressure_arrives_with_its_whole_size(pwm: Injector) -> None:
    """Of an open injector, at rest but for the waves; the pulse crosses the feed pipe in the 15th sample."""
    stepper = cr.Stepper(pwm, cr.OperatingPoint("160 MPa", "4 ms"))
    stepper.step("3 ms")
    kept, pulse = stepper.save(), np.zeros((24, 1))
    pulse[0] = 1e4

    def course(change: np.ndarray) -> np.ndarray:
        stepper.restore(kept)
        return np.array([stepper.step("5 us", rail_pressure=160e6 + float(u))["mass_rate"] for (u,) in change])

    simulated = course(pulse) - course(0.0 * pulse)
    stepper.restore(kept)
    answer = stepper.linearise("5 us").respond(pulse)[:, 0]
    # 1 %: the injector is not quite at rest. A slot of the waves that is missing takes 11 %.
    assert answer.sum() == pytest.approx(simulated.sum(), rel=0.02)
    assert simulated.sum() > 0.0


def test_the_response_is_that_of_the_matrices(linear: cr.models.LinearModel) -> None:
    u = np.array([[0.0, 1e4], [0.0, 0.0], [0.0, 0.0]])
    found = linear.respond(u)
    b, d = linear.b @ u[0], linear.d @ u[0]
    assert found == pytest.approx(np.array([d, linear.c @ b, linear.c @ linear.a @ b]))


def test_a_reduced_model_responds_as_the_whole_one(linear: cr.models.LinearModel) -> None:
    """To inputs that it was not reduced with, a step and noise; its stated error is that of an impulse."""
    samples = 300
    small = linear.reduce(40, samples)
    assert len(small.states) == 40 < 0.1 * len(linear.states)
    assert len(repr(linear)) < 300
    impulse = np.zeros((samples, 2))
    impulse[0, 0] = 1.0
    change = np.abs(small.respond(impulse) - linear.respond(impulse)).max(axis=0)
    assert change == pytest.approx(small.errors["impulse"][:, 0], rel=1e-6, abs=1e-12 * np.abs(linear.d).max())
    rng = np.random.default_rng(1)
    coarse = linear.reduce(4, samples)
    # noise moves the pipes at all frequencies, of which 40 states hold fewer than a step needs
    for inputs, limit in ((np.full((samples, 2), 1e5), 0.02), (rng.normal(scale=1e5, size=(samples, 2)), 0.1)):
        whole = linear.respond(inputs)
        left, more = (
            np.abs(one.respond(inputs) - whole).max(axis=0) / np.abs(whole).max(axis=0) for one in (small, coarse)
        )
        assert left.max() < limit
        assert more.max() > 2.0 * left.max()
    for order in (0, 1.5, 10_000):
        with pytest.raises(cr.errors.ConfigurationError, match="order"):
            linear.reduce(order)  # type: ignore[arg-type]


def test_the_stated_errors_are_small_and_of_the_matrices_shape(linear: cr.models.LinearModel) -> None:
    n = len(linear.states)
    assert linear.a.shape == (n, n)
    assert linear.b.shape == (n, 2)
    assert linear.c.shape == (3, n)
    assert linear.d.shape == (3, 2)
    for name, errors in linear.errors.items():
        assert errors.shape == getattr(linear, name).shape
        assert np.all(errors >= 0.0)
    assert np.max(linear.errors["d"][0]) < 1e-6 * np.max(np.abs(linear.d[0]))


def test_the_stated_error_of_a_kink_is_as_large_as_the_element(pwm: Injector) -> None:
    """At rest the slopes to both sides of a kink differ; central differences agree on their mean."""
    closed = cr.Stepper(pwm, POINT).linearise("5 us")
    columns = [closed.states.index(name) for name in closed.kinks if name in closed.states]
    elements, errors = np.abs(closed.a[:, columns]), closed.errors["a"][:, columns]
    assert ((elements > 0.0) & (errors > 0.5 * elements)).any()


def test_waves_travel_through_the_linear_model(linear: cr.models.LinearModel) -> None:
    # five steps carry a wave five places on, unchanged
    names = [name for name in linear.states if name.startswith("waves.down[")]
    older, newer = names[9], names[4]
    a = linear.a[linear.states.index(older), linear.states.index(newer)]
    assert (older, newer) == ("waves.down[-10]", "waves.down[-5]")
    assert a == pytest.approx(1.0, abs=1e-9)


def test_unknown_inputs_and_outputs_are_named(open_needle: cr.Stepper) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=r'input "rail".* rail_pressure'):
        open_needle.linearise("5 us", ("rail",))
    with pytest.raises(cr.errors.ConfigurationError, match=r'output "rate".* mass_rate'):
        open_needle.linearise("5 us", outputs=("rate",))


@pytest.mark.slow  # one more wiring to compile
def test_a_current_that_the_caller_gives_is_that_of_a_trace() -> None:
    injector = wired(Variant(drive=Drive.CURRENT))
    time = np.arange(0.0, 1.2e-3, 10e-6)
    current = np.where(time < 700e-6, np.minimum(time / 100e-6, 1.0) * 20.0, 0.0)
    held = np.repeat(current, 2)
    edges = np.sort(np.concatenate([time, time + 10e-6 - 1e-15]))
    point = cr.OperatingPoint("160 MPa", [], drive=cr.Trace.of(edges, held), horizon="1.2 ms")
    whole = cr.simulate(injector, point)
    stepper = cr.Stepper(injector, cr.OperatingPoint("160 MPa", []))
    out = {}
    for amperes in current:
        out = stepper.step("10 us", current=float(amperes))
    assert out["injected_mass"] == pytest.approx(whole.injected_mass, rel=1e-8)
    assert out["injected_mass"] > 1e-5


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        ({"inputs": 3}, 'inputs .*"rail_pressure"'),
        ({"inputs": "rail_pressure"}, "inputs .*list"),
        ({"inputs": [["rail_pressure"]]}, r"input \['rail_pressure'\].* rail_pressure"),
        ({"outputs": None}, 'outputs .*"mass_rate"'),
        ({"outputs": ["rate"]}, 'output "rate".* mass_rate, needle_lift'),
    ],
)
def test_names_that_are_no_list_of_names_are_a_sentence(
    open_needle: cr.Stepper, names: dict[str, object], sentence: str
) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=sentence):
        open_needle.linearise("5 us", **names)  # type: ignore[arg-type]
