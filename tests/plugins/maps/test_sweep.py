"""Sweeps: order of the axes, what the dwell is, the second of two injections, fusion, and compensation."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.engine.solution import Batch
from commonrail.engine.status import Status
from commonrail.plugins.maps.axes import MapAxes
from commonrail.plugins.maps.choices import CellState
from commonrail.plugins.maps.compensation import compensation, fusion_dwell
from commonrail.plugins.maps.response import Conditions
from commonrail.plugins.maps.sweep import (
    OPERATING,
    Base,
    Variable,
    _first_alone,
    explain,
    find_fused,
    most_frequent,
    resolve_variable,
    sweep,
    without_number,
)
from commonrail.plugins.maps.sweep_file import sweep_record
from commonrail.plugins.maps.sweep_page import sweep_lines
from commonrail.plugins.maps.table import tables_at_quantities

INJECTOR = cr.load_injector("virtual-lino-2016")
CONDITIONS = Conditions(threads=1)
SINGLE = Base(160e6, 500e-6, 0.0, 0.0, CONDITIONS)
TWO = Base(160e6, 400e-6, 300e-6, 1e-3, CONDITIONS)


def test_the_dwell_runs_from_the_end_of_the_first_energising_to_the_start_of_the_second() -> None:
    pulses = TWO.point({"dwell": 700e-6}).pulses
    assert [tuple(p) for p in pulses] == [(0.0, 300e-6), (pytest.approx(1000e-6), 400e-6)]
    assert [tuple(p) for p in TWO.point({}, alone=True).pulses] == [(0.0, 300e-6)]
    assert [tuple(p) for p in SINGLE.point({"energising_time": 600e-6}).pulses] == [(0.0, 600e-6)]


def test_the_axes_keep_the_order_of_the_variables() -> None:
    """A parameter and a variable of the operating point, each against simulations of its own."""
    holes, times = np.array([6.0, 7.0]), np.array([400e-6, 500e-6, 600e-6])
    variables = [Variable("energising_time", "s", times), Variable("nozzle.holes", "1", holes)]
    found = sweep(INJECTOR, variables, SINGLE)
    turned = sweep(INJECTOR, variables[::-1], SINGLE)
    assert found.volume.shape == (3, 2)
    assert np.array_equal(turned.volume, found.volume.T)
    for i, j in ((0, 1), (2, 0)):
        one = cr.simulate(INJECTOR.with_values({"nozzle.holes": holes[j]}), cr.OperatingPoint(160e6, times[i]))
        assert found.volume[i, j] == pytest.approx(one.injected_volume, rel=1e-6)
        assert found.opening[i, j] == pytest.approx(one.opening, rel=1e-6)
    assert not found.two
    assert not found.fused.any()


def test_the_second_quantity_is_the_total_less_the_first_alone() -> None:
    found = sweep(INJECTOR, [Variable("dwell", "s", np.array([1.5e-3]))], TWO)
    both = cr.simulate(INJECTOR, cr.OperatingPoint(160e6, [(0.0, 300e-6), (1.8e-3, 400e-6)]))
    first = cr.simulate(INJECTOR, cr.OperatingPoint(160e6, 300e-6))
    assert found.second[0] == pytest.approx(both.injected_volume - first.injected_volume, rel=1e-6)
    assert not found.fused[0]


def test_energisings_without_a_pause_are_fused_and_have_no_second_quantity() -> None:
    found = sweep(INJECTOR, [Variable("dwell", "s", np.array([0.0, 2e-3]))], TWO)
    assert found.fused.tolist() == [True, False]
    assert np.isnan(found.second[0])
    both = cr.simulate(INJECTOR, cr.OperatingPoint(160e6, [(0.0, 300e-6), (300e-6, 400e-6)]))
    assert found.volume[0] == pytest.approx(both.injected_volume, rel=1e-6)


def test_each_distinct_first_injection_is_simulated_once() -> None:
    given = [(p, d, t) for p in (80e6, 100e6) for d in (1e-3, 2e-3) for t in (3e-4, 4e-4)]
    columns = dict(zip(("rail_pressure", "dwell", "energising_time"), np.array(given).T, strict=True))
    distinct, which = _first_alone(TWO, columns, len(given))
    assert [point.rail_pressure for point in distinct] == [80e6, 100e6]
    assert which.tolist() == [0] * 4 + [1] * 4
    for place, (rail, _, _) in zip(which.tolist(), given, strict=True):
        assert distinct[place] == TWO.point({"rail_pressure": rail}, alone=True)
    alone, which = _first_alone(TWO, {"dwell": np.array([1e-3, 2e-3])}, 2)
    assert (alone, which.tolist()) == ([TWO.point({}, alone=True)], [0, 0])


@pytest.mark.parametrize("base", [SINGLE, TWO])
@pytest.mark.parametrize("alone", [False, True])
def test_many_points_are_those_that_are_made_one_by_one(base: Base, alone: bool) -> None:
    """Equal to the last digit, and printed alike: no value is of NumPy's types."""
    if alone and base is SINGLE:
        base = base._replace(first_energising_time=200e-6)
    rng = np.random.default_rng(3)
    columns = {
        "rail_pressure": rng.uniform(20e6, 200e6, 50),
        "dwell": rng.uniform(0.0, 3e-3, 50),
        "energising_time": rng.uniform(0.0, 2e-3, 50),
        "return_pressure": rng.uniform(0.1e6, 1e6, 50),
    }
    made = base.points(columns, alone)
    for i, point in enumerate(made):
        one = base.point({name: float(values[i]) for name, values in columns.items()}, alone)
        assert point == one
        assert repr(point) == repr(one)
        assert [type(pulse) for pulse in point.pulses] == [type(pulse) for pulse in one.pulses]


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [
        ("rail_pressure", 80.0, "rail pressure must lie"),
        ("rail_pressure", np.nan, "rail pressure .*finite"),
        ("cylinder_pressure", 90e6, "cylinder pressure .*rail pressure"),
        ("return_pressure", 90e6, "return pressure .*rail pressure"),
        ("cylinder_pressure", 1.0, "cylinder pressure must lie"),
        ("dwell", -1e-6, "or after"),
        ("energising_time", 0.2, "duration of an energising"),
        ("dwell", 0.995, "horizon"),
    ],
)
def test_one_bad_point_of_many_is_refused_with_its_sentence(name: str, value: float, word: str) -> None:
    columns = {"rail_pressure": np.full(5, 80e6)}
    usual = {"rail_pressure": 80e6, "cylinder_pressure": 5e6, "return_pressure": 5e5, "dwell": 1e-3}
    columns[name] = np.full(5, usual.get(name, 4e-4))
    columns[name][3] = value
    with pytest.raises(cr.errors.ConfigurationError, match=word):
        TWO.points(columns)


def test_points_are_simulated_some_at_a_time_to_the_same_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    """None is left out, and none changes place."""
    variables = [
        Variable("dwell", "s", np.array([3e-4, 1e-3])),
        Variable("rail_pressure", "Pa", np.array([60e6, 80e6, 100e6, 120e6])),
    ]
    whole = sweep(INJECTOR, variables, TWO)
    monkeypatch.setattr("commonrail.plugins.maps.response.AT_A_TIME", 3)
    parts = sweep(INJECTOR, variables, TWO)
    for name in ("volume", "second", "fused", "opening"):
        assert getattr(parts, name).tobytes() == getattr(whole, name).tobytes(), name
    assert len(set(whole.volume.ravel().tolist())) == 8


def test_a_point_that_the_fuel_does_not_cover_is_refused_wherever_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("commonrail.plugins.maps.response.AT_A_TIME", 1)
    too_high = Variable("rail_pressure", "Pa", np.array([60e6, 80e6, 900e6]))
    with pytest.raises(cr.errors.ConfigurationError, match="900 MPa"):
        sweep(INJECTOR, [too_high], TWO)


# A value that lets the engine fail, and one that does not; the spring's stiffness bounds the time step.
STIFF = Variable("plunger_needle.k1", "N/m", np.array([1e14, 3e8]))


def test_missing_numbers_are_told_with_their_reasons_and_the_first_of_each() -> None:
    """Two reasons: a step too long for the stiffest spring, and a needle that is still open at the end."""
    times = Variable("energising_time", "s", np.array([300e-6, 400e-6, 500e-6]))
    found = sweep(INJECTOR, [times, STIFF], SINGLE)
    assert found.status.tolist() == [[Status.STEP_UNSTABLE, Status.OK]] * 3
    (group,) = without_number(found)
    assert (group.status, group.combinations, group.alone) == (Status.STEP_UNSTABLE, 3, False)
    assert group.first == {"energising_time": 300e-6, "plunger_needle.k1": 1e14}
    still = found.status.copy()
    still[1, 1] = Status.STILL_INJECTING
    more = without_number(replace(found, status=still))
    assert [(g.status.name, g.combinations) for g in more] == [("STEP_UNSTABLE", 3), ("STILL_INJECTING", 1)]
    lines = sweep_lines(replace(found, status=still))
    assert lines[-2].startswith("3 of 6 combinations ")
    assert "energising time 300 µs" in lines[-2]
    assert lines[-1].startswith("1 of 6 combinations ")
    assert "energising time 400 µs" in lines[-1]
    assert "horizon" not in lines[-1]  # which a sweep does not have
    kept = sweep_record(found)["without_number"]
    assert [(one["status"], one["combinations"], one["first"]) for one in kept] == [
        ("STEP_UNSTABLE", 3, dict(group.first))
    ]


def test_no_dwell_is_told_where_simulations_fail() -> None:
    """Not a dwell of 0, which says that nothing fuses."""
    stiff = INJECTOR.with_values({"plunger_needle.k1": 1e14})
    assert np.isnan(fusion_dwell(stiff, TWO, np.array([160e6]), 1e-3)).all()


def test_a_first_injection_that_failed_alone_is_told() -> None:
    found = sweep(INJECTOR, [Variable("dwell", "s", np.array([1e-3, 2e-3]))], TWO)
    assert not without_number(found)
    alone = replace(found, first_status=np.full(2, int(Status.RAN_AWAY)))
    (group,) = without_number(alone)
    assert (group.combinations, group.alone) == (2, True)
    assert "dwell 1 ms" in sweep_lines(alone)[-1]


def test_where_nothing_can_be_simulated_the_most_frequent_reason_is_told() -> None:
    with pytest.raises(cr.errors.SimulationError, match=re.escape(explain(Status.STEP_UNSTABLE))):
        sweep(INJECTOR, [STIFF._replace(values=np.array([1e14, 2e14]))], SINGLE)
    statuses = np.array([[Status.RAN_AWAY, Status.NOT_FINITE, Status.NOT_FINITE]])
    assert most_frequent(statuses) == explain(Status.NOT_FINITE)


@pytest.mark.parametrize(
    ("name", "unit", "value"), [("fuel.temperature", "K", 666.0), ("valve.mass", "kg", -1.0), ("valve.mass", "kg", 0.0)]
)
def test_a_value_is_refused_with_the_sentence_that_a_simulation_has(name: str, unit: str, value: float) -> None:
    sound = INJECTOR.values[name]
    with pytest.raises((cr.errors.ConfigurationError, cr.errors.InputError)) as alone:
        cr.simulate(INJECTOR.with_values({name: value}), cr.OperatingPoint(160e6, 500e-6))
    with pytest.raises(type(alone.value)) as swept:
        sweep(INJECTOR, [Variable(name, unit, np.array([sound, value]))], SINGLE)
    assert str(swept.value) == str(alone.value)


def test_a_count_is_swept_over_whole_numbers() -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=r"nozzle\.holes .*6\.5"):
        sweep(INJECTOR, [Variable("nozzle.holes", "1", np.array([6.0, 6.5, 7.0]))], SINGLE)


def test_a_parameter_of_another_kind_of_injector_is_refused() -> None:
    name = next(n for n in cr.models.parameter_quantities() if n not in INJECTOR.quantities)
    with pytest.raises(cr.errors.ConfigurationError, match=re.escape(name)):
        sweep(INJECTOR, [Variable(name, "1", np.array([1.0]))], SINGLE)


def test_a_first_injection_of_no_length_is_refused() -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=r"energising times .*\bfirst\b"):
        sweep(INJECTOR, [Variable("first_energising_time", "s", np.array([0.0, 3e-4]))], TWO)


def batch(first_closing: float, closing: float) -> Batch:
    """Batch of one simulation that has these instants [us]."""
    blank = np.zeros((1, 1))
    instants = {"first_closing": first_closing, "closing": closing}
    given = {name: np.full((1, 1), value * 1e-6) for name, value in instants.items()}
    return Batch(**({name: blank for name in Batch.__dataclass_fields__} | given))


@pytest.mark.parametrize(
    ("instants", "fused"),
    [
        ((200, 600, 1500), False),  # closes before 800 + 200 us
        ((200, 1400, 1400), True),
        ((200, 1400, 1450), True),  # and bounces
        ((200, 600, 620), False),  # bounces after the first, the second stays shut
        ((np.nan, 1400, 1400), False),  # the first stays shut
        ((np.nan, np.nan, np.nan), False),
    ],
)
def test_fusion_is_a_needle_that_is_open_when_the_second_would_open_it(
    instants: tuple[float, float, float], fused: bool
) -> None:
    delay, first, last = instants
    found = find_fused(batch(first, last), np.array([800e-6]), np.array([[delay * 1e-6]]))
    assert found.tolist() == [[fused]]


def test_the_longest_dwell_that_fuses_separates_fused_from_apart() -> None:
    (dwell,) = fusion_dwell(INJECTOR, TWO, np.array([160e6]), 2e-3).tolist()
    around = sweep(INJECTOR, [Variable("dwell", "s", np.array([dwell - 2e-6, dwell + 2e-6]))], TWO)
    assert around.fused.tolist() == [True, False]


def test_compensated_times_hold_the_second_quantity() -> None:
    axes = MapAxes(np.array([160e6]), np.array([5e-9]), np.array([1e-3]))
    found = compensation(INJECTOR, axes, 300e-6, np.array([800e-6, 2e-3]), CONDITIONS)
    first = cr.simulate(INJECTOR, cr.OperatingPoint(160e6, 300e-6)).injected_volume
    for dwell, (time,) in zip(found.condition.values.tolist(), found.energising_time[:, 0], strict=True):
        pulses = [(0.0, 300e-6), (300e-6 + dwell, float(time))]
        second = cr.simulate(INJECTOR, cr.OperatingPoint(160e6, pulses)).injected_volume - first
        assert second == pytest.approx(5e-9, abs=0.02e-9)
    tables = tables_at_quantities(found, "tiSecond", change=False)
    assert [t.label for t in tables] == ["tiSecond_800us", "tiSecond_2000us"]
    assert tables[0].values[0, 0] == pytest.approx(found.energising_time[0, 0, 0] * 1e6, abs=6e-4)


def test_energising_times_over_a_condition_deliver_the_quantity_under_it() -> None:
    """A parameter, and a pressure of the operating point."""
    for name, values in {"fuel.temperature": [300.0, 340.0], "return_pressure": [0.1e6, 1e6]}.items():
        found = cr.maps.hold(INJECTOR, {name: values, "rail_pressure": [120e6]}, ["2 mm3"], longest="500 us")
        assert found.energising_time.shape == (2, 1, 1)
        for value, time in zip(values, found.energising_time.ravel().tolist(), strict=True):
            of_point: dict[str, Any] = {name: value} if name in OPERATING else {}
            injector = INJECTOR if of_point else INJECTOR.with_values({name: value})
            delivered = cr.simulate(injector, cr.OperatingPoint(120e6, time, **of_point)).injected_volume
            assert delivered == pytest.approx(2e-9, abs=0.02e-9)
        assert len(set(found.energising_time.ravel().tolist())) == 2


def test_where_the_injections_always_fuse_there_is_no_time() -> None:
    axes = MapAxes(np.array([160e6]), np.array([5e-9]), np.array([200e-6]))
    long_first = compensation(INJECTOR, axes, 1e-3, np.array([0.0]), CONDITIONS)
    assert long_first.inverses[0].state.tolist() == [[CellState.FAILED]]


def test_names_of_variables_are_those_of_the_operating_point_and_of_parameters() -> None:
    assert resolve_variable("rail-pressure") == ("rail_pressure", "Pa")
    assert resolve_variable("temperature") == ("fuel.temperature", "K")
    assert resolve_variable("valve.spring_preload") == ("valve.spring_preload", "N")
    with pytest.raises(cr.errors.ConfigurationError, match=r'"dwel".*"dwell"'):
        resolve_variable("dwel")


@pytest.mark.parametrize(
    ("names", "base", "word"),
    [
        ([], SINGLE, "1 to 3"),
        (["dwell", "dwell"], TWO, "variable dwell"),
        (["dwell"], SINGLE, "dwell"),
    ],
)
def test_a_sweep_that_makes_no_sense_is_refused(names: list[str], base: Base, word: str) -> None:
    variables = [Variable(name, "s", np.array([1e-3])) for name in names]
    with pytest.raises(cr.errors.ConfigurationError, match=word):
        sweep(INJECTOR, variables, base)


def test_a_sweep_without_a_sound_simulation_is_refused() -> None:
    base = SINGLE._replace(conditions=CONDITIONS._replace(time_step=50e-6))
    with pytest.raises(cr.errors.SimulationError, match=re.escape(explain(Status.STEP_UNSTABLE))):
        sweep(INJECTOR, [Variable("rail_pressure", "Pa", np.array([160e6]))], base)


def test_a_parameter_that_the_variant_does_not_read_is_refused() -> None:
    volume = Variable("rail.volume", "m3", np.array([10e-6, 20e-6]))  # of an ideal rail: both would give the same
    with pytest.raises(cr.errors.ConfigurationError, match=r"rail\.volume.*@volume"):
        sweep(INJECTOR, [volume], SINGLE)
    direct = cr.load_injector("direct-acting-kr")
    back = Variable("return_pressure", "Pa", np.array([0.5e6, 1e6]))
    with pytest.raises(cr.errors.ConfigurationError, match="return_pressure"):
        sweep(direct, [back], SINGLE)
