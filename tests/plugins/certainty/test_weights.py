"""Weights of data sets: they move what a search seeks, and nothing of the likelihood."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from commonrail import RateData, load_study
from commonrail.calibration.objective import Objective
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.new.study import write_new


def test_a_weight_moves_the_optimum_of_the_search_and_not_the_likelihood(tmp_path: Path) -> None:
    """Two curves that pull apart, 3 % above and below one another: the heavier one decides in J alone."""
    write_new(tmp_path / "s")
    study = load_study(tmp_path / "s" / "study.toml")
    (curve,) = study.data
    assert isinstance(curve, RateData)
    high, low = (replace(curve, name=name, rate=share * curve.rate) for name, share in (("a", 1.03), ("b", 0.97)))
    points = np.array([study.space.reference * [1.0, 1.0, share] for share in (0.97, 1.03)])  # of the discharge
    costs, residuals = [], []
    for weights in ((1.0, 100.0), (100.0, 1.0)):
        data = tuple(replace(one, weight=weight) for one, weight in zip((high, low), weights, strict=True))
        weighted = replace(study, data=data)
        costs.append(Objective(weighted.injector, study.space.names, data, study.time_step).costs(points).costs)
        residuals.append(Likelihood.of(weighted, 1).residuals(points))
    assert [int(np.argmin(cost)) for cost in costs] == [0, 1]
    np.testing.assert_allclose(residuals[0], residuals[1], rtol=1e-12)  # rounding; their noise alone scales them
