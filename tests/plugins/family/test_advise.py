"""Advice on reference points: a point that tells of the others, against a point that does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.family.adapt import advise, read_candidates
from commonrail.plugins.family.drawn import FLOW
from tests.plugins.family.samples import INJECTOR, PRELOAD, injected, small_type

POINTS = tuple(cr.OperatingPoint(160e6, time * 1e-6, horizon=time * 1e-6 + 3e-3) for time in (300, 500, 700, 900))


def exact_type() -> cr.parts.InjectorType:
    """A type whose parts differ in nothing but their flow, to a millionth."""
    return small_type(spread=1e-6)


def test_parts_that_differ_in_their_flow_alone_are_predicted_from_any_point() -> None:
    advice = advise(exact_type(), POINTS, draws=32)
    assert advice.draws == 32
    assert advice.usable.tolist() == [1.0] * 4
    # 3 % of quantities of 20 to 80 mm3 without a reference; with one, interpolation between flow factors 0.025 apart
    assert advice.without > 0.5e-9
    assert np.max(advice.expected) < 0.02 * advice.without


def test_the_expected_error_is_that_of_adapt_on_parts_drawn_alike() -> None:
    known = small_type(spread=0.05)
    advice = advise(known, POINTS, draws=128)
    assert advice.order[0] == int(np.argmin(advice.expected))
    assert np.all(advice.expected < advice.upper)
    rng = np.random.default_rng(3)
    errors = []
    for pull, flow in rng.normal(size=(6, 2)):
        values = {p.name: p.value for p in known.parameters}
        values[PRELOAD] += 2.0 * pull * known.by_name[PRELOAD].spread  # one parameter, twice as far: the same in sum
        truth = INJECTOR.with_values(values | {FLOW: INJECTOR.values[FLOW] * (1.0 + 0.015 * flow)})
        wanted = injected(truth, *((160.0, 1e6 * p.pulses[0].duration) for p in POINTS))
        one = injected(truth, (160.0, 900.0))
        adapted = cr.parts.adapt(known, one)
        found = cr.simulate_batch(adapted.injector, POINTS, time_step=1e-6).injected_volume[0]
        errors.append(np.sqrt(np.mean((found - wanted.quantity)[:3] ** 2)))
    # six parts tell a standard deviation to about 30 %; a wrong unit or reference is off by far more
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) / advice.expected[3] < 3.0


def test_the_scatter_between_parts_is_drawn_and_not_the_error_of_the_value() -> None:
    wide = small_type(spread=0.1)
    none = replace(wide, parameters=tuple(replace(p, between=0.0) for p in wide.parameters))
    some = replace(
        none, parameters=(replace(none.parameters[0], between=0.02 * none.parameters[0].value), *none.parameters[1:])
    )
    alike, apart, all_of_it = (advise(known, POINTS, draws=64) for known in (none, some, wide))
    assert np.max(alike.expected) < 0.02 * alike.without  # only the flow is left, which any point gives
    assert np.max(alike.expected) < np.min(apart.expected)
    assert np.all(apart.expected < all_of_it.expected)


def test_a_point_at_which_drawn_parts_stay_shut_is_not_advised() -> None:
    shut = replace(POINTS[0], energisings=(cr.Energising(0.0, 100e-6),), horizon=3.1e-3)
    advice = advise(small_type(), (shut, *POINTS[1:]), draws=16)
    assert advice.usable[0] == 0.0
    assert np.isnan(advice.expected[0])
    assert 0 not in advice.order


def test_one_candidate_is_refused() -> None:
    with pytest.raises(cr.errors.InputError, match="points"):
        advise(small_type(), POINTS[:1])


def test_candidates_need_no_quantity(tmp_path: Path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("rail_pressure [MPa],energising_time [us],note\n80,500,\n160,700,\n", encoding="utf-8")
    found = read_candidates(file, "0.5 MPa", "0.1 MPa")
    assert [p.initial_pressures()[0] for p in found] == [80e6, 160e6]
    assert [p.pulses[0].duration for p in found] == pytest.approx([5e-4, 7e-4])
    assert found[0].initial_pressures()[1] == 0.5e6
