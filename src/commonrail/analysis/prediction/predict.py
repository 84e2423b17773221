"""Predictions of a fit with bands, by its curvature (Laplace) or by draws from its posterior.

A band holds what the parameters may be, and the scatter of measured values about the best prediction: for kinds with
a stated tolerance that tolerance, or the residual level of the fit where it is larger; for others the residual level
with the stated discrepancy.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.certainty.covariance import covariance_of
from commonrail.analysis.certainty.estimate import Estimate, estimate, pulls_of
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.neighbourhood import around
from commonrail.analysis.posterior.proposals import bounded
from commonrail.analysis.prediction.band import Band, Scatter, band_from_draws, band_from_slopes
from commonrail.arguments import instance, instances, number, thread_count
from commonrail.calibration.study import Study
from commonrail.engine.operating_point import OperatingPoint
from commonrail.errors import ConfigurationError, SimulationError
from commonrail.kinds import DataSet, QuantityData, Role, of_role
from commonrail.kinds.simulator import Simulator

__all__ = ["LEVELS", "Prediction", "predict"]

Floats = NDArray[np.float64]

LEVELS = (0.5, 0.9)
PREDICTED = "prediction"  # name of the operating points that were asked for


@dataclass(frozen=True)
class Prediction:
    """Bands of data sets, or of operating points.

    Attributes
    ----------
    bands : list of Band
    levels : tuple of float
    estimator : str
    scatter : mapping of str to Scatter
        By the kind of the data.
    """

    bands: list[Band]
    levels: tuple[float, ...]
    estimator: str
    scatter: Mapping[str, Scatter]

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        return {
            "levels": list(self.levels),
            "estimator": self.estimator,
            "scatter": {kind: {"factor": one.factor} for kind, one in self.scatter.items()},
            "data": [band.record() for band in self.bands],
        }


class _Fit(NamedTuple):
    """Fit that predictions are made with: best values (d,), and draws (m, d) from the posterior if they are wanted."""

    simulator: Simulator
    estimate: Estimate
    point: Floats
    draws: Floats | None


def predict(
    study: Study,
    best: Mapping[str, float],
    points: Sequence[OperatingPoint] = (),
    *,
    draws: Floats | None = None,
    levels: Sequence[float] = LEVELS,
    threads: int | None = None,
) -> Prediction:
    """Predict quantities at operating points, or all data of a study, with bands.

    Parameters
    ----------
    study : Study
    best : mapping of str to float
        Values [SI] of the fit, as `Calibration.best`; predictions are made with them.
    points : sequence of OperatingPoint
        Of which quantities per stroke are predicted; none for the data of the study, fitted and validated.
    draws : (m, d), optional
        Parameters [SI] drawn from the posterior, in the order of the study's, see `Posterior.points`; by default the
        linear approximation about the best values.
    levels : sequence of float
        Shares of the measured values that bands are to hold.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, or quantities are wanted of a study that fits none.
    SimulationError
        If the best values cannot be simulated.
    """
    instance(study, Study, "study")
    wanted = instances(points, OperatingPoint, "points")
    shares = tuple(number(level, "1", "level") for level in levels)
    if not shares or not all(0.0 < share < 1.0 for share in shares):
        raise ConfigurationError("levels must be shares between 0 and 1, such as (0.5, 0.9).")
    sets: Sequence[DataSet] = [_asked(study, wanted)] if wanted else study.data
    threads = thread_count(threads)
    point = np.array([best[name] for name in study.space.names])
    own = Likelihood.of(study, threads)
    found = _floored(estimate(own, own.space.to_unit(point)[None]), of_role(study.data, Role.FIT))
    scatter = _scatter(found, of_role(study.data, Role.FIT))
    simulator = Simulator(study.injector, study.space.names, study.time_step, threads, same_bits=study.same_bits)
    fit = _Fit(simulator, found, point, draws)
    bands = []
    for data in sets:
        if data.kind not in scatter:
            raise ConfigurationError(
                f'{study.title}: no data of the kind "{data.kind}" are fitted, so nothing is known of the scatter of '
                f"{data.name}; fit some, or predict another kind."
            )
        bands.append(_band(data, fit, scatter[data.kind], shares, not wanted))
    label = "draws from the posterior" if draws is not None else "Laplace: linear about the best values"
    return Prediction(bands, shares, f"{label}; noise and discrepancy included", scatter)


def _floored(found: Estimate, fitted: Sequence[DataSet]) -> Estimate:
    """Estimate whose scales of noise are no smaller than the tolerances that data state."""
    own = found.likelihood
    noises = [
        replace(noise, scale=1.0, freedom=np.inf) if _stated(data) and not noise.known and noise.scale < 1.0 else noise
        for data, noise in zip(fitted, own.noises, strict=True)
    ]
    wide = own.with_noises(noises)
    covariance = covariance_of(wide, found.slopes, found.errors, found.shifts, pulls_of(wide, found.unit))
    return replace(found, likelihood=wide, covariance=covariance)


def _stated(data: DataSet) -> bool:
    return data.discrepancy(data.measured) is not None


def _scatter(found: Estimate, fitted: Sequence[DataSet]) -> dict[str, Scatter]:
    """Scatter of each kind of data: that of the fitted set that scatters most."""
    scatter: dict[str, Scatter] = {}
    for data, noise, block in zip(fitted, found.likelihood.noises, found.likelihood.blocks, strict=True):
        extra = block.noise.discrepancy if block.noise.length else 0.0
        one = Scatter(float(np.hypot(noise.sigma, extra)) / data.residual_scale, noise.freedom)
        if data.kind not in scatter or scatter[data.kind].factor < one.factor:
            scatter[data.kind] = one
    return scatter


def _asked(study: Study, points: Sequence[OperatingPoint]) -> QuantityData:
    """Quantities at operating points, as a map of the study without measured values."""
    maps = [one for one in of_role(study.data, Role.FIT) if type(one) is QuantityData]
    if not maps:
        raise ConfigurationError(
            f"{study.title}: no quantity map is fitted, so nothing is known of how far measured quantities lie from "
            "predicted ones; fit one, or ask for the bands of the study's own data."
        )
    nothing = np.zeros(len(points))
    density = maps[0].mass_density
    return replace(
        maps[0],
        name=PREDICTED,
        role=Role.VALIDATION,
        points=tuple(points),
        quantity=nothing,
        dead_time=nothing.astype(bool),
        mass_density=density if np.ndim(density) == 0 else float("nan"),
        sister=None,
    )


def _band(data: DataSet, fit: _Fit, scatter: Scatter, levels: tuple[float, ...], measured: bool) -> Band:
    """Band of one data set."""
    if fit.draws is not None:
        drawn = data.simulated(fit.simulator, np.vstack([fit.point, fit.draws]))
        deviations = scatter.deviations(data, drawn[0])
        return Band(data, drawn[0], band_from_draws(drawn[1:], deviations, scatter.freedom, levels), measured)
    place = around(fit.estimate.likelihood.space, fit.point)
    values = data.simulated(fit.simulator, place.values)
    if not np.isfinite(values[0]).any():
        raise SimulationError(f"{data.name} cannot be simulated with the best values, so it has no band.")
    deviations = scatter.deviations(data, values[0])
    edges = band_from_slopes(
        values[0], place.slopes(values), bounded(fit.estimate), deviations, scatter.freedom, levels
    )
    return Band(data, values[0], edges, measured)
