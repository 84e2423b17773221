"""Figures over the seeds and their record, worked out a second time from the repetitions."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from commonrail.base.choices import Body
from commonrail.calibration.objective import Objective
from commonrail.calibration.study import Method, Study
from commonrail.plugins.certainty.run import certainty as certify
from commonrail.plugins.paper import study as paper
from commonrail.plugins.paper.figures import Figures, box
from commonrail.plugins.paper.run import Reproduction, StiffnessCertainty
from commonrail.plugins.paper.study import Configuration

PRESSURES = list(paper.RAIL_PRESSURES)
K6 = 5


@pytest.fixture(scope="module")
def figures(done: Reproduction) -> Figures:
    return Figures(done.repetitions)


def test_changes_are_relative_to_theory(done: Reproduction, figures: Figures) -> None:
    first = done.repetitions[0].best.x
    expected = [k / done.bench.injector.values[name] - 1.0 for k, name in zip(first, paper.NAMES, strict=True)]
    assert figures.change[0] == pytest.approx(expected, rel=1e-12)


def test_the_means_of_table_3(figures: Figures) -> None:
    for c, js in figures.table3.items():
        assert figures.mean_j[c] == pytest.approx((js[:, 0] + js[:, 1] + js[:, 2]) / 3.0)
        assert figures.validation_j[c] == pytest.approx((js[:, 1] + js[:, 2]) / 2.0)


def test_k6_is_counted_in_the_upper_fifth_of_its_bounds(done: Reproduction, figures: Figures) -> None:
    reference = done.bench.injector.values[paper.NAMES[K6]]
    limit = (0.1 + 0.8 * 2.9) * reference  # bounds of -90 % and +200 %
    for share, r in zip(figures.k6_high, done.repetitions, strict=True):
        assert share == pytest.approx((r.best.members[:, :, K6] >= limit).mean())


def test_random_points_are_feasible_and_spread(done: Reproduction, figures: Figures) -> None:
    theory = np.array([done.bench.injector.values[name] for name in paper.NAMES])
    points = (1.0 + figures.random_change) * theory
    # on a face of the ordering rounding may tip a point that was divided and multiplied again
    assert done.repetitions[0].space.violation(points).max() < 1e-12
    k6 = points[:, K6] / theory[K6]
    assert figures.k6_high_at_random == pytest.approx((k6 >= 0.1 + 0.8 * 2.9).mean())


def test_a_model_that_closes_late_has_a_positive_error(done: Reproduction, figures: Figures) -> None:
    for i, name in enumerate(PRESSURES):
        found = figures.edge_errors(name, "theoretical", "closing")
        for r, error in zip(done.repetitions, found, strict=True):
            level = 0.1 * r.data[i].rate.max()
            last = [np.flatnonzero(rate > level)[-1] for rate in (r.rates["theoretical"][i], r.data[i].rate)]
            # the last sample above the level, 3 us long, without interpolation
            assert error == pytest.approx(3e-6 * (last[0] - last[1]), abs=3e-6)


def test_the_gain_kept_is_that_of_the_fit_at_160(figures: Figures) -> None:
    for name in paper.VALIDATION:
        j, own = figures.j[name], figures.own_j(name)
        # a fit to the curve itself is better on it than the fit at 160 MPa, and that one better than theory
        assert (own < j["optimised"]).all()
        assert (j["optimised"] < j["theoretical"]).all()
        expected = [(t - o) / (t - w) for t, o, w in zip(j["theoretical"], j["optimised"], own, strict=True)]
        assert figures.gain_kept(name) == pytest.approx(expected)
        assert (figures.gain_kept(name) < 1.0).all()


def test_the_fits_at_unseen_pressures_are_to_their_own_curves(done: Reproduction) -> None:
    first = done.repetitions[0]
    for data in first.data[1:]:
        found = first.own_curve_searches[data.name]
        objective = Objective(done.bench.injector, first.space.names, [data], done.bench.time_step)
        assert objective.costs(found.x[None, :]).costs[0] == found.cost


def test_the_nine_searches_are_independent(done: Reproduction) -> None:
    first = done.repetitions[0]
    short = first.table3[Configuration(50, 50)][0]
    # with one stream of random numbers (50, 50) would be the first fifty generations of (70, 50)
    assert short.cost != first.best.history[50].best
    assert len(short.history) == 51


def test_the_record_keeps_seed_and_all_apart(done: Reproduction, record: dict[str, Any]) -> None:
    shares = [r.best.members / [done.bench.injector.values[n] for n in paper.NAMES] for r in done.repetitions]
    for i, row in enumerate(record["search"]):
        assert list(row["seed"].values()) == pytest.approx(list(box(shares[0][..., i])))
        assert list(row["all"].values()) == pytest.approx(list(box(np.array(shares)[..., i])))
    assert record["shown_seed"] == 1


def test_verdicts_are_those_of_the_report_of_a_run(done: Reproduction, record: dict[str, Any]) -> None:
    """The study of one curve, by the function that writes a run's report; the table counts its verdicts."""
    counts: list[dict[str, int]] = [{} for _ in paper.NAMES]
    for r in done.repetitions:
        space, bench = r.space, done.bench
        method = Method(paper.BEST.settings)
        injector = replace(bench.injector, variant=bench.injector.variant._replace(body=Body.FLEXIBLE))
        study = Study("one run", injector, (r.data[0],), space, method, r.seed, bench.time_step)
        expected = certify(study, dict(zip(paper.NAMES, r.best.x.tolist(), strict=True)), threads=2)
        for i, one in enumerate(expected.verdicts):
            counts[i][one.verdict.value] = counts[i].get(one.verdict.value, 0) + 1
    assert [row["verdicts"] for row in record["table1"]] == counts


def test_no_seed_pins_k7_while_the_study_knows_no_meter(done: Reproduction, record: dict[str, Any]) -> None:
    """The delay of the meter moves k7 by a third, and an interval takes no more than a usual one into account."""
    k7 = record["table1"][6]
    assert k7["truth"] == pytest.approx(paper.TABLE1_OPTIMAL[paper.NAMES[6]])
    assert k7["covered"] < k7["intervals"] == len(done.repetitions)
    assert "determined" not in k7["verdicts"]


@pytest.mark.parametrize(("low", "high", "expected"), [
    (1.0, 3.0, (1, 1)),
    (2.1, 3.0, (0, 1)),
    (1.0, 1.9, (0, 1)),
    (None, 3.0, (1, 1)),
    (2.1, None, (0, 1)),
    (None, None, (0, 0)),
])  # fmt: skip
def test_an_interval_covers_the_truth_up_to_its_ends(
    monkeypatch: pytest.MonkeyPatch,
    done: Reproduction,
    low: float | None,
    high: float | None,
    expected: tuple[int, int],
) -> None:
    monkeypatch.setattr("commonrail.plugins.paper.figures.RANDOM_POINTS", 10)  # which say nothing of intervals
    certainty = StiffnessCertainty(low, high, None, "determined")
    one = replace(done.repetitions[0], identified={paper.NAMES[2]: certainty})
    assert Figures((one,)).covers(2, 2.0) == expected
