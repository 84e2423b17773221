"""Certainty of a fit, and the JSON-able record that result.json keeps of it under the key "certainty"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.display import Shown, load_library
from commonrail.base.record import to_record
from commonrail.calibration.optimisers.least_squares import FeasibleSet
from commonrail.plugins.certainty.draws import Draws
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.lack_of_fit import LackOfFit
from commonrail.plugins.certainty.verdict import Assessment


@dataclass(frozen=True, repr=False)
class Certainty(Shown):
    """Certainty of a fit.

    Attributes
    ----------
    estimate : Estimate
        Most likely values of the study's parameters, then of the uncertain quantities of the bench; its `likelihood`
        has the fitted noise.
    point : (d,)
        Calibrated values [SI]: the most likely ones, or those of the search where they stay.
    draws : Draws
        From the posterior of all of these.
    d : int
        Number of the study's parameters.
    level : float
        Share of intervals that hold the truth.
    low, high : (d,)
        Ends of the intervals [SI].
    correlation : (d + k, d + k)
        Of the draws.
    tests : list of LackOfFit
    withdrawn : str
        Reason why no parameter is called determined, empty if there is none.
    verdicts : list of Assessment
    combinations : mapping of str to (float, float, float)
        Value and ends of the interval [SI] of each stated combination.
    widening : float
        Share of the error that wider bounds are expected to take away, where bounds were met.
    """

    presenter = "commonrail.plugins.certainty.notebook:CERTAINTY"

    estimate: Estimate
    point: Floats
    draws: Draws
    d: int
    level: float
    low: Floats
    high: Floats
    correlation: Floats
    tests: list[LackOfFit]
    withdrawn: str
    verdicts: list[Assessment]
    combinations: Mapping[str, tuple[float, float, float]]
    widening: float = 0.0

    def plot(self, ax: Any = None, kind: str = "corner") -> Any:  # type: ignore[override]
        """Draw the draws of the posterior with matplotlib.

        Parameters
        ----------
        ax : array of matplotlib.axes.Axes, optional
            Axes (d, d) of a corner plot, (d,) of traces; by default those of a new figure.
        kind : "corner" or "trace"
            Each parameter against each other, or over the number of the draw.

        Returns
        -------
        array of matplotlib.axes.Axes

        Raises
        ------
        ConfigurationError
            If matplotlib is missing, the kind is unknown, or the axes are too many or too few.
        """
        load_library("matplotlib")
        return import_module("commonrail.plugins.certainty.draws_plot").draw_posterior(self, ax, kind)

    def to_arviz(self) -> Any:
        """Draws as the group "posterior" of an ArviZ DataTree, one chain, by the names of the parameters [SI].

        Raises `ConfigurationError` if arviz-base is missing.
        """
        arviz = load_library("arviz_base", "posterior")
        return arviz.from_dict({"posterior": dict(zip(self.names, self.points.T[:, None, :], strict=True))})

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the study's parameters."""
        return self.estimate.likelihood.names[: self.d]

    @property
    def values(self) -> dict[str, float]:
        """Calibrated values [SI] of the study's parameters."""
        return dict(zip(self.names, self.point.tolist(), strict=True))

    @cached_property
    def points(self) -> Floats:
        """Draws (m, d) [SI] of the study's parameters, equally likely, about the calibrated values.

        Where these stay those of the search, the draws are moved to them, within bounds and constraints.
        """
        space, unit = self.estimate.likelihood.space, self.draws.unit
        move = space.to_unit(np.append(self.point, self.estimate.point[self.d :])) - self.estimate.unit
        if move.any():
            unit = FeasibleSet.of(space).within(np.tile(self.estimate.unit + move, (len(unit), 1)), unit + move)
        return space.from_unit(unit)[:, : self.d]

    def record(self) -> dict[str, Any]:
        """JSON-able form, the key "certainty" of a result."""
        estimate, draws = self.estimate, self.draws
        record: dict[str, Any] = to_record(
            {
                "level": self.level,
                "starts": estimate.starts,
                "agreeing": estimate.agreeing,
                "settled": estimate.settled,
                "simulated": estimate.simulated,
                "draws": {
                    "k_hat": draws.k_hat,
                    "effective": draws.effective,
                    "gap": draws.gap,
                    "rounds": draws.rounds,
                    "converged": draws.converged,
                    "walked": draws.walked,
                    "checked": draws.checked,
                    "refused": draws.refusal,
                },
                "withdrawn": self.withdrawn,
                "parameters": [self._parameter(i) for i in range(self.d)],
                "bench": [self._bench_quantity(i) for i in range(self.d, len(estimate.unit))],
                "combinations": [
                    {"sum": text, "value": value, "lower": low, "upper": high}
                    for text, (value, low, high) in self.combinations.items()
                ],
                "noise": self._noise(),
                "discrepancy": max(noise.share for noise in estimate.likelihood.noises),
                "widening": self.widening,
                "tests": self.tests,
            }
        )
        return record

    def _parameter(self, i: int) -> dict[str, Any]:
        likelihood, shares = self.estimate.likelihood, self.estimate.covariance.shares
        sources = [block.name for block in likelihood.blocks] + (["priors"] if len(likelihood.priors) else [])
        value, low, high, judged = float(self.point[i]), self.low[i], self.high[i], self.verdicts[i]
        return {
            "name": self.names[i],
            "value": value,
            "most_likely": self.estimate.point[i],
            "lower": low,
            "upper": high,
            "percent": 50.0 * (high - low) / abs(value) if value else None,
            "standard_error": np.std(self.points[:, i]),
            "verdict": judged.verdict,
            "sentence": judged.sentence,
            "cure": judged.cure,
            "shares": dict(zip(sources, shares[:, i], strict=False)),
        }

    def _bench_quantity(self, i: int) -> dict[str, Any]:
        """Uncertain quantity of the bench: as stated, and by the data."""
        space = self.estimate.likelihood.space
        parameter = space.parameters[i]
        return {
            "name": parameter.name,
            "unit": parameter.unit,
            "stated": parameter.prior and parameter.prior.value,
            "deviation": parameter.prior and parameter.prior.sigma,
            "source": parameter.source,
            "value": self.estimate.point[i],
            "standard_error": np.std(space.from_unit(self.draws.unit)[:, i]),
            "correlations": dict(zip(self.names, self.correlation[i], strict=False)),
        }

    def _noise(self) -> list[dict[str, Any]]:
        """Fitted noise of each data set, and the share of the data set in −2 ln L."""
        likelihood, used = self.estimate.likelihood, self.estimate.covariance.used
        costs = likelihood.block_costs(likelihood.whiten(self.estimate.errors))
        total = max(float(costs.sum()), 1e-300)
        return [
            {
                "name": block.name,
                "law": noise.law,
                "order": noise.autoregression.order,
                "sigma": noise.sigma,
                "relative": noise.relative,
                "innovation": noise.scale * noise.density.deviation,
                "unit": block.unit,
                "stated": noise.stated,
                "values": block.size,
                "share": costs[i] / total,
                "parameters": used[i],
                "discrepancy": block.noise.discrepancy,
            }
            for i, (block, noise) in enumerate(likelihood.pairs)
        ]
