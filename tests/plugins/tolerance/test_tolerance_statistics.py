"""Pieces of a tolerance study: distributions, draws, spread, shares of the variance; against closed forms and SciPy."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from commonrail.base.errors import ConfigurationError
from commonrail.base.record import to_record
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.status import OK, Status
from commonrail.plugins.tolerance.statistics import GROUPS, Draws, Shares, VarianceShares, describe_spread
from commonrail.plugins.tolerance.study import (
    Correlation,
    Dimension,
    Distribution,
    Limit,
    Normal,
    SeriesTrim,
    TolerancePoint,
    Tolerances,
    Triangular,
    Uniform,
)
from commonrail.readers.injector import load_injector

Floats = NDArray[np.float64]

HOLE, LIFT, SPRING = "nozzle.hole_diameter", "valve.lift", "valve.spring_preload"
DIMENSIONS = (
    Dimension(HOLE, Normal(130e-6, 1e-6)),
    Dimension(LIFT, Uniform(50e-6, 60e-6)),
    Dimension(SPRING, Triangular(70.0, 72.0, 80.0)),
)
POINT = TolerancePoint("p", OperatingPoint("160 MPa", "700 us"))
SIGMAS = np.array([1e-6, 10e-6 / 12**0.5, (stats.triang(0.2, 70.0, 10.0).std())])


def tolerances(**changes: object) -> Tolerances:
    arguments = {"dimensions": DIMENSIONS, "points": (POINT,), **changes}
    return Tolerances("made up", load_injector("virtual-lino-2016"), **arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("own", "scipys"),
    [
        (Normal(3.0, 0.5), stats.norm(3.0, 0.5)),
        (Normal(3.0, 0.5, 2.8, 4.0), stats.truncnorm(-0.4, 2.0, 3.0, 0.5)),
        (Uniform(-1.0, 2.0), stats.uniform(-1.0, 3.0)),
        (Triangular(0.0, 1.0, 4.0), stats.triang(0.25, 0.0, 4.0)),
        (Triangular(0.0, 0.0, 4.0), stats.triang(0.0, 0.0, 4.0)),
        (Triangular(0.0, 1e200, 4e200), stats.triang(0.25, 0.0, 4e200)),  # its square is no number
    ],
)
def test_a_distribution_has_scipys_values_at_all_shares(own: Distribution, scipys: stats.rv_continuous) -> None:
    shares = np.concatenate(([1e-9], np.linspace(0.01, 0.99, 99), [1.0 - 1e-9]))
    assert own.at(shares) == pytest.approx(scipys.ppf(shares), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "numbers", "words"),
    [
        (Normal, (1.0, 0.0), r"\bsigma\b.* 0\."),
        (Normal, (1.0, 1.0, 3.0, 2.0), "between 3 and 2"),
        (Normal, (0.0, 1.0, 50.0, 60.0), "between 50 and 60"),
        (Uniform, (2.0, 1.0), "uniform.* 2 and 1"),
        (Triangular, (0.0, 5.0, 4.0), "5 between 0 and 4"),
        (Uniform, (float("nan"), 1.0), "lower of a uniform"),
    ],
)
def test_a_distribution_that_cannot_be_is_refused(kind: type, numbers: tuple[float, ...], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        kind(*numbers)


@pytest.mark.parametrize("sampling", ["random", "quasi-random"])
def test_parts_do_not_depend_on_how_many_are_drawn_at_a_time(sampling: str) -> None:
    study = tolerances(sampling=sampling)
    whole, split = Draws(study), Draws(study)
    parts = [split.take(n) for n in (256, 256, 100)]
    assert np.concatenate(parts).tolist() == whole.take(612).tolist()


@pytest.mark.parametrize("sampling", ["random", "quasi-random"])
def test_drawn_parts_have_their_distributions_and_correlation(sampling: str) -> None:
    study = tolerances(sampling=sampling, correlations=(Correlation(HOLE, LIFT, 0.6),))
    values = Draws(study).take(8192)
    # one in a thousand of the random samples of this size would have a larger distance
    for column, law in zip(values.T, (stats.norm(130e-6, 1e-6), stats.uniform(50e-6, 10e-6)), strict=False):
        assert stats.kstest(column, law.cdf).statistic < 1.95 / 8192**0.5
    scores = stats.norm.ppf(stats.rankdata(values, axis=0) / 8193.0)
    found = np.corrcoef(scores.T)
    assert found[0, 1] == pytest.approx(0.6, abs=4.0 * (1.0 - 0.36) / 8192**0.5)
    assert abs(found[0, 2]) < 4.0 / 8192**0.5


def shares_of(study: Tolerances, values: Floats, quantities: Floats) -> Shares:
    """Shares of parts that are collected in blocks."""
    sums = VarianceShares(study, quantities[:1])
    for group, rows in enumerate(np.array_split(np.arange(len(values)), GROUPS)):
        sums.add(group, values[rows], quantities[rows, None])
    found = sums.shares(0, 0.95)
    assert found is not None
    return found


def test_the_shares_of_a_sum_are_the_variances_of_its_terms() -> None:
    study = tolerances(sampling="random")
    values = Draws(study).take(4096)
    slopes = np.array([2.0, -0.3, 1e-6]) * np.array([1.0, 1.0, 0.5])
    found = shares_of(study, values, values @ slopes)
    # the sum is met exactly, so that only the variances of this sample differ from those of the distributions
    expected = (slopes * SIGMAS) ** 2 / np.sum((slopes * SIGMAS) ** 2)
    assert found.value == pytest.approx(expected, abs=0.02)
    assert found.rest == pytest.approx(0.0, abs=1e-6)
    assert ((found.low <= expected) & (expected <= found.high)).all()
    wide = np.array([dimension.distribution.at(np.array([0.025, 0.975])) for dimension in DIMENSIONS])
    assert found.swing == pytest.approx(slopes * (wide[:, 1] - wide[:, 0]), rel=1e-5)
    middles = values.mean(axis=0)
    for j in range(3):
        halved = values.copy()
        halved[:, j] = middles[j] + 0.5 * (values[:, j] - middles[j])
        assert found.halved[j] == pytest.approx(float(np.std(halved @ slopes)), rel=1e-4)


def test_an_interaction_is_in_the_rest() -> None:
    study = tolerances(sampling="random")
    values = Draws(study).take(8192)
    scaled = (values - values.mean(axis=0)) / values.std(axis=0)
    found = shares_of(study, values, scaled[:, 0] + scaled[:, 0] * scaled[:, 1])
    assert found.value == pytest.approx([0.5, 0.0, 0.0], abs=0.04)
    assert found.rest == pytest.approx(0.5, abs=0.04)


def test_shares_of_correlated_dimensions_sum_to_one() -> None:
    study = tolerances(sampling="random", correlations=(Correlation(HOLE, LIFT, 0.8),))
    values = Draws(study).take(4096)
    scaled = (values - values.mean(axis=0)) / values.std(axis=0)
    found = shares_of(study, values, scaled[:, 0] + scaled[:, 1])
    assert found.value.sum() + found.rest == pytest.approx(1.0, abs=1e-9)
    assert found.value == pytest.approx([0.5, 0.5, 0.0], abs=0.02)


def test_parts_without_a_quantity_do_not_count() -> None:
    study = tolerances(sampling="random")
    values = Draws(study).take(2048)
    quantities = values @ np.array([1.0, 0.1, 0.0])
    lost = np.random.default_rng(1).random(2048) < 0.2
    spoilt = shares_of(study, values, np.where(lost, np.nan, quantities))
    alone = shares_of(study, values[~lost], quantities[~lost])
    assert spoilt.value == pytest.approx(alone.value, rel=1e-9)
    assert not np.isnan(np.concatenate([spoilt.low, spoilt.high])).any()


def test_a_quantity_that_does_not_scatter_has_no_shares() -> None:
    study = tolerances()
    sums = VarianceShares(study, np.array([1.0]))
    sums.add(0, Draws(study).take(256), np.ones((256, 1)))
    assert sums.shares(0, 0.95) is None


def test_a_part_that_fails_is_out_of_limits_and_not_in_the_mean() -> None:
    quantities = np.array([1.0, 2.0, 3.0, 4.0, 5.0, np.nan])
    codes = np.array([OK] * 5 + [Status.RAN_AWAY], np.int8)
    found = describe_spread(quantities, codes, (1.5, 4.5), 0.95)
    assert found is not None
    assert (found.parts, found.failed, found.below, found.above) == (6, 1, 1, 1)
    assert found.reasons == {Status.RAN_AWAY.sentence: 1}
    assert found.out[0] == pytest.approx(3 / 6)
    assert found.mean == 3.0
    sigma = 2.5**0.5
    assert (found.cp, found.cpk) == pytest.approx((3.0 / (6.0 * sigma), 1.5 / (3.0 * sigma)))
    json.dumps(to_record(found), allow_nan=False)


def test_one_limit_has_no_cp_and_no_limit_has_no_cpk() -> None:
    quantities, codes = np.array([1.0, 2.0, 4.0]), np.full(3, OK, np.int8)
    one, none = (describe_spread(quantities, codes, limits, 0.95) for limits in ((None, 4.5), (None, None)))
    assert one is not None
    assert none is not None
    assert one.cp is None
    assert one.cpk == pytest.approx((4.5 - 7.0 / 3.0) / (3.0 * float(np.std(quantities, ddof=1))))
    assert (none.cp, none.cpk, none.out[0]) == (None, None, 0.0)


def test_limits_are_quantities_or_deviations() -> None:
    assert Limit(-0.04, True).at(50e-9) == pytest.approx(48e-9)
    assert Limit(48e-9).at(50e-9) == 48e-9


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"correlations": (Correlation(HOLE, "valve.mass", 0.5),)}, "dimension valve.mass"),
        ({"correlations": (Correlation(HOLE, LIFT, 1.0),)}, "-1 and 1, not 1"),
        (
            {"correlations": tuple(Correlation(a, b, -0.9) for a, b in ((HOLE, LIFT), (LIFT, SPRING), (HOLE, SPRING)))},
            "correlations",
        ),
        ({"dimensions": (DIMENSIONS[0], DIMENSIONS[0])}, "more than once"),
        ({"points": (POINT, POINT)}, "operating points"),
        ({"parts": 10}, "number of parts .*1000"),
        ({"trim": SeriesTrim(("q",))}, "trim .*point q"),
        (
            {
                "points": (POINT, TolerancePoint("q", OperatingPoint("80 MPa", "680 us"))),
                "trim": SeriesTrim(("p", "q")),
            },
            "trim .*10 %",
        ),
    ],
)
def test_a_study_that_cannot_be_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        tolerances(**changes)


def test_a_dimension_whose_parts_leave_its_domain_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"valve\.lift.* 0\.0001 .*domain"):
        Dimension("valve.lift", Normal(55e-6, 20e-6))
    Dimension("valve.lift", Normal(55e-6, 20e-6, 10e-6, 100e-6))  # cut
