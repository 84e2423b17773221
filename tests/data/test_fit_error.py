"""Error of a data set that a verdict takes, by the record of the data set."""

from __future__ import annotations

import numpy as np
import pytest

import commonrail as cr
from commonrail.data.curves.data import RateScore
from commonrail.data.quantities.data import QuantityScore
from commonrail.report.data.view import FitError, view_of

POINT = cr.OperatingPoint(100e6, 500e-6)


def test_the_error_of_a_curve_lacks_the_noise_of_its_samples() -> None:
    bounds = np.linspace(0.0, 2e-3, 1001)
    model = 30e-6 * np.sin(np.pi * bounds[1:] / bounds[-1]) ** 2
    noise = 0.6e-6 * np.random.default_rng(1).standard_normal(len(model))
    data = cr.RateData("curve", cr.data.Role.FIT, POINT, bounds, model + noise, 1.0, "", "")
    for gain, share in ((1.0, 0.0), (1.08, 0.08)):
        record = data.record({"best": RateScore(data, gain * model)})
        error = view_of(data.kind).fit_error(record)
        assert error is not None
        assert record["J_relative"]["best"] > 0.03  # what noise alone makes
        assert error.size == pytest.approx(share, abs=0.01)


def test_the_error_of_a_map_has_the_tolerance_of_its_block() -> None:
    quantity = np.array([10e-9, 20e-9])
    data = cr.QuantityData(
        "map", cr.data.Role.FIT, (POINT, POINT), quantity, 1e-10, 0.05, np.zeros(2, bool), 1.0, "", "synthetic"
    )
    record = data.record({"best": QuantityScore(data, 1.04 * quantity, np.zeros(0))})
    error = view_of(data.kind).fit_error(record)
    assert error == FitError(pytest.approx(0.04), tolerance=0.05)
