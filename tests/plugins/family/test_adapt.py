"""A part's model from its type and reference quantities: known parts are found again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.family.drawn import FLOW, describe_shut_points
from tests.cli.conftest import Command
from tests.plugins.family.samples import INJECTOR, MASS, PRELOAD, injected, small_type

FOUR = (80.0, 400.0), (80.0, 1000.0), (160.0, 400.0), (160.0, 1000.0)


def with_flow(factor: float) -> cr.Injector:
    return INJECTOR.with_values({FLOW: INJECTOR.values[FLOW] * factor**0.5})


@pytest.mark.parametrize("factor", [0.93, 1.08])
def test_one_exact_quantity_returns_the_flow_factor(factor: float) -> None:
    adapted = cr.parts.adapt(small_type(), injected(with_flow(factor), (120.0, 700.0)))
    # the descent meets one quantity to rounding; the quantity has about one significant digit less than the factor
    assert adapted.flow_factor == pytest.approx(factor, rel=1e-9)
    assert adapted.after == pytest.approx(adapted.points.quantity, rel=1e-9)
    assert abs(adapted.before[0] - adapted.points.quantity[0]) > 0.02 * adapted.points.quantity[0]
    assert set(adapted.calibration.best) == {FLOW}


@pytest.mark.parametrize("count", [2, 3, 4])
def test_more_than_one_quantity_moves_the_type_too(count: int) -> None:
    truth = with_flow(1.05).with_values({PRELOAD: 1.06 * INJECTOR.values[PRELOAD]})
    adapted = cr.parts.adapt(small_type(), injected(truth, *FOUR[:count]))
    assert set(adapted.calibration.best) == {FLOW, PRELOAD, MASS}
    assert not adapted.limits
    assert adapted.flow_factor > 1.0
    assert adapted.injector.values[PRELOAD] > INJECTOR.values[PRELOAD]


def test_a_quantity_that_was_not_given_is_nearer_than_by_the_flow_alone() -> None:
    truth = with_flow(1.02).with_values({PRELOAD: 1.1 * INJECTOR.values[PRELOAD]})
    three = cr.parts.adapt(small_type(), injected(truth, *FOUR[:2], FOUR[3]))
    one = cr.parts.adapt(small_type(), injected(truth, FOUR[3]))
    true, *found = (injected(i, FOUR[2]).quantity[0] for i in (truth, three.injector, one.injector))
    assert abs(found[0] - true) < 0.5 * abs(found[1] - true)  # the tolerance and the priors leave 0.38


def test_what_an_adapted_model_misses_is_announced() -> None:
    """A flow that the stated spread hardly allows."""
    data = injected(with_flow(0.8), *FOUR)
    with pytest.warns(RuntimeWarning) as warned:
        missing = cr.parts.adapt(small_type(1e-3), data, flow_spread="0.5 %")
    (limit,) = missing.limits
    assert any(limit in str(warning.message) for warning in warned)
    assert not cr.parts.adapt(small_type(), injected(with_flow(1.02), *FOUR)).limits


def test_a_point_where_an_adapted_model_injects_nothing_is_announced() -> None:
    """Of 0.8 mm³, which a model may miss by 1 mm³ and more than half: 0 mm³ would be delivered in silence."""
    points = injected(INJECTOR, (80.0, 60.0), (80.0, 1000.0), (160.0, 1000.0))
    points = replace(points, quantity=np.array([0.8e-9, *points.quantity[1:]]))
    with pytest.warns(RuntimeWarning) as warned:
        adapted = cr.parts.adapt(small_type(), points)
    assert adapted.after[0] == 0.0
    missed, shut = adapted.limits
    assert "80 MPa and 60 µs" in shut
    assert any(shut in str(warning.message) for warning in warned)
    assert "80 MPa and 60 µs" in missed
    stiff = adapted.injector.with_values({PRELOAD: 20.0 * adapted.injector.values[PRELOAD]})
    reasons = [describe_shut_points(adapted.calibration, part, points.points) for part in (adapted.injector, stiff)]
    assert ["coil" in sentence for (sentence,) in reasons] == [False, True]


def test_a_type_without_spread_holds_its_values() -> None:
    truth = with_flow(1.05).with_values({PRELOAD: 1.06 * INJECTOR.values[PRELOAD]})
    held = cr.parts.adapt(small_type(spread=1e-7), injected(truth, *FOUR))
    # a pull of 0.05 mm3/1.5 % residuals, some ten in size, against spreads of 1e-7
    for name in (PRELOAD, MASS):
        assert held.injector.values[name] == pytest.approx(INJECTOR.values[name], rel=1e-5)


def test_values_that_were_measured_on_the_part_stay_and_the_others_are_the_types() -> None:
    own = replace(
        INJECTOR.with_values({PRELOAD: 61.0, MASS: 0.0042}),
        sources={
            **INJECTOR.sources,
            PRELOAD: cr.models.Source("M", "spring tester"),
            MASS: cr.models.Source("E", "guess"),
        },
    )
    adapted = cr.parts.adapt(small_type(), injected(with_flow(1.02), (120.0, 700.0)), injector=own)
    assert adapted.injector.values[PRELOAD] == 61.0
    assert adapted.injector.values[MASS] == INJECTOR.values[MASS]
    assert adapted.injector.sources[MASS] == ("F", "made up")
    assert adapted.injector.sources[FLOW].mark == "F"
    assert "flow factor" in adapted.injector.sources[FLOW].text


def test_what_is_synthetic_of_injector_and_type_is_stated_once() -> None:
    of_run = f"{INJECTOR.synthetic} The curves are simulated."  # as a type from runs states it
    adapted = cr.parts.adapt(replace(small_type(), synthetic=of_run), injected(INJECTOR, (120.0, 700.0)))
    assert adapted.injector.synthetic == of_run


def test_quantities_that_no_nozzle_injects_are_refused() -> None:
    far = injected(INJECTOR, (120.0, 700.0))
    with pytest.raises(cr.errors.InputError, match=r"0\.6 to 1\.6"):
        cr.parts.adapt(small_type(), replace(far, quantity=3.0 * far.quantity))


def test_a_reference_at_which_the_type_stays_shut_is_refused() -> None:
    points = injected(INJECTOR, (80.0, 400.0))
    shut = replace(points, points=(replace(points.points[0], energisings=60e-6),))
    with pytest.raises(cr.errors.InputError, match=r"80 MPa and 60 µs.* 0\.000 mm³"):
        cr.parts.adapt(small_type(), shut)


def test_a_type_without_an_injector_needs_the_parts(tmp_path: Path) -> None:
    unknown = replace(small_type(), injector=None)
    with pytest.raises(cr.errors.InputError, match="--injector MODEL"):
        cr.parts.adapt(unknown, injected(INJECTOR, (120.0, 700.0)))


def test_points_are_read_with_their_units(tmp_path: Path) -> None:
    data = injected(with_flow(1.04), (120.0, 700.0))
    path = tmp_path / "points.csv"
    head = "rail_pressure [bar],energising_time [ms],quantity [mm3]\n"
    path.write_text(f"{head}1200,0.7,{data.quantity[0] * 1e9!r}\n".replace("np.float64(", "").replace(")", ""))
    adapted = cr.parts.adapt(small_type(), path, cylinder_pressure="50 bar", return_pressure=0.5e6)
    assert adapted.flow_factor == pytest.approx(1.04, rel=1e-6)  # twelve digits of the file, and its units


def test_a_sound_part_lies_in_the_band_of_its_type_and_is_not_doubted() -> None:
    found = cr.parts.adapt(small_type(), injected(with_flow(1.02), *FOUR))
    assert found.doubts.sentences == ()
    assert ((found.doubts.low < found.points.quantity) & (found.points.quantity < found.doubts.high)).all()
    assert ((found.doubts.low < found.before) & (found.before < found.doubts.high)).all()


def test_the_stated_spread_of_the_flow_decides_whether_a_flow_is_doubted() -> None:
    data = injected(with_flow(0.92), *FOUR)
    strict, wide = (cr.parts.adapt(small_type(1e-3), data, flow_spread=share) for share in ("1 %", "5 %"))
    assert strict.doubts.sentences
    assert wide.doubts.sentences == ()
    assert abs(wide.flow_factor - 0.92) < abs(strict.flow_factor - 0.92)
    assert wide.doubts.freedom == len(FOUR)
    with pytest.raises(cr.errors.ConfigurationError, match="flow_spread"):
        cr.parts.adapt(small_type(), data, flow_spread=3.0)


def test_a_coked_nozzle_is_doubted_and_named() -> None:
    """15 % of the flow are five times the 3 % by which nozzles scatter."""
    found = cr.parts.adapt(small_type(), injected(with_flow(0.85), *FOUR))
    assert -5.0 < found.doubts.pulls[FLOW] < -3.5  # the other parameters take some of it
    assert any(FLOW in sentence for sentence in found.doubts.sentences)
    assert found.doubts.change.startswith("coked nozzle (nozzle.hole_diameter")
    share = float(found.doubts.change.split("(−")[1].split(" %")[0])
    assert share == pytest.approx(100.0 * (1.0 - 0.85**0.5), abs=1.0)  # within what the other parameters take


def test_a_part_that_no_scatter_of_the_type_explains_is_doubted() -> None:
    """Four fifths of the valve's lift, which the type fixes: springs would have to differ by 8 spreads."""
    lift = INJECTOR.values["valve.lift"]
    fixed = (cr.parts.FixedValue("valve.lift", lift, "M", "gauge"),)
    known = replace(small_type(), fixed=fixed)
    found = cr.parts.adapt(known, injected(INJECTOR.with_values({"valve.lift": 0.8 * lift}), *FOUR))
    assert found.doubts.sentences
    change, value, unit, *_ = found.doubts.change.split()
    assert (change, unit) == ("valve.lift", "µm")
    assert float(value) == pytest.approx(0.8e6 * lift, rel=0.02)


def test_a_valve_that_sticks_at_half_lift_is_named_where_the_part_stays_shut() -> None:
    lift = INJECTOR.values["valve.lift"]
    known = replace(small_type(), fixed=(cr.parts.FixedValue("valve.lift", lift, "E", "estimate"),))
    points = injected(INJECTOR.with_values({"valve.lift": 0.5 * lift}), (80.0, 700.0), (160.0, 400.0), (160.0, 1000.0))
    assert points.quantity[1] == 0.0
    with pytest.raises(cr.errors.InputError, match=r"160 MPa and 400 µs.*valve\.lift .* \(−50 %\)"):
        cr.parts.adapt(known, points)
    with pytest.raises(cr.errors.InputError, match="80 MPa and 700 µs") as refused:
        cr.parts.adapt(known, replace(points, quantity=np.zeros(3)))
    assert "valve.lift" not in str(refused.value)  # whatever keeps a part shut explains it alike


def test_one_quantity_beyond_the_band_is_doubted() -> None:
    """A flow factor meets any quantity: only the scatter of the type tells that 20 % more is no sound part."""
    sound, odd = (cr.parts.adapt(small_type(), injected(with_flow(f), (160.0, 1000.0))) for f in (1.02, 1.2))
    assert sound.doubts.sentences == ()
    assert odd.doubts.sentences
    assert not odd.doubts.low[0] < odd.points.quantity[0] < odd.doubts.high[0]


@pytest.mark.parametrize(("option", "value"), [("--tolerance", "0%"), ("--flow-spread", "100%")])
def test_a_share_at_an_end_is_refused_by_its_option(option: str, value: str, command: Command) -> None:
    done = command("adapt", "type.toml", option, value)
    assert done.status == 2
    assert option in done.sentence
