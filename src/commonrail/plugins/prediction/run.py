"""Predictions of a fit with bands, by draws of its parameters.

A band combines parameter uncertainty and the scatter of measured values about the best prediction: the residual level
of the fit, with the discrepancy of the model. If at least `scatter.LEAST` values of a map are fitted, the scatter is
scaled by predictions of values that are left out in turn; with fewer values, a stated tolerance is the least scatter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import array, fraction, instance, instances, thread_count
from commonrail.base.arrays import Bools, Floats
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, SimulationError
from commonrail.calibration.identifiability import FinishedFit
from commonrail.calibration.result import CERTAINTY
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Role
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import in_order, of_role
from commonrail.data.simulator import Simulator
from commonrail.engine.operating_point import OperatingPoint
from commonrail.plugins.certainty.estimate import Estimate, estimate
from commonrail.plugins.certainty.likelihood import Likelihood
from commonrail.plugins.certainty.noise_fit import coordinates_of
from commonrail.plugins.certainty.run import certainty as certify
from commonrail.plugins.certainty.uncertain import with_uncertain_free
from commonrail.plugins.prediction.band import Band, band_from_draws
from commonrail.plugins.prediction.scatter import Scatter, curve_scatter, scatter_of

LEVELS = (0.5, 0.9)
LEVEL = 0.9  # of the bands that a result keeps
DRAWS = 200  # simulated draws; their 5 % quantile scatters by a seventh of the half width of a 90 % band
SAME = 1e-9  # relative distance beyond the fitted range that counts as rounding
# Factor on the width of a band beyond the fitted energising times. Virtual benches of cri2-16, 230 to 285 us where 300
# to 1000 us are fitted: 90 % bands held 60 to 92 %, at the worst point 1.95 times too narrow (normal distribution).
BEYOND = 2.0
PREDICTED = "prediction"  # name of the operating points that were asked for


@dataclass(frozen=True, repr=False)
class Prediction(Shown):
    """Bands of data sets, or of operating points.

    Attributes
    ----------
    bands : list of Band
    levels : tuple of float
    estimator : str
    scatter : mapping of str to Scatter
        By the kind of the data.
    """

    presenter = "commonrail.plugins.prediction.page:PREDICTION"

    bands: list[Band]
    levels: tuple[float, ...]
    estimator: str
    scatter: Mapping[str, Scatter]

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        keys = "factor", "calibration", "left_out"
        return {
            "levels": list(self.levels),
            "estimator": self.estimator,
            "scatter": {kind: {key: getattr(s, key) for key in keys} for kind, s in self.scatter.items()},
            "data": [band.record() for band in self.bands],
        }


class _Fit(NamedTuple):
    """Fit that predictions are made with."""

    simulator: Simulator
    estimate: Estimate
    points: Floats  # (1 + m, d), calibrated values [SI], then draws
    scatter: Mapping[str, Scatter]  # by the kind of the data
    curves: Mapping[str, Scatter]  # of fitted curves, by their names

    def scatter_about(self, data: DataSet) -> Scatter:
        """Scatter of the measured values of a data set: its own if it is a fitted curve, else that of its kind."""
        of_curve = self.curves.get(data.name) if data.role is Role.FIT else None
        return self.scatter[data.kind] if of_curve is None else of_curve


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
        Points for which quantities per stroke are predicted; empty: all fitted and validation data of the study.
    draws : (m, d), optional
        Parameters [SI] drawn from the posterior, in the order of the study's, such as `Certainty.points`; by default
        new draws.
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
    requested = instances(points, OperatingPoint, "points")
    shares = tuple(fraction(level, "level") for level in levels)
    if not shares:
        raise ConfigurationError("levels must be shares between 0 and 1, such as (0.5, 0.9).")
    sets: Sequence[DataSet] = [_asked(study, requested)] if requested else study.data
    threads = thread_count(threads)
    if draws is None:
        fit = _fit_at(study, best, threads)
    else:
        fit = _fit(
            study, _estimated(study, best, threads), study.space.point(best), array(draws, "1", "draws", 2), threads
        )
    bands = [_band(data, fit, shares, not requested) for data in sets]
    return Prediction(bands, shares, _label(fit, bands), fit.scatter)


def predict_rate(
    study: Study, best: Mapping[str, float], point: OperatingPoint, bounds: Floats, *, level: float = LEVEL
) -> Band:
    """Predict the rate of injection [m³/s] at an operating point, without a meter, with the band of a level.

    `best` as for `predict`; `bounds` (n + 1,): of the samples [s]. Errors are those of `predict`; a study that fits no
    injection curve is refused.
    """
    curves = [curve for curve in of_role(study.data, Role.FIT) if type(curve) is RateData]
    if not curves:
        raise ConfigurationError(f"{study.title}: no injection curve is fitted, so nothing is known of its scatter.")
    data = replace(
        curves[0],
        name=PREDICTED,
        role=Role.VALIDATION,
        point=point,
        bounds=bounds,
        rate=np.zeros(len(bounds) - 1),
        mass_density=float("nan"),
        meter=None,
    )
    return _band(data, _fit_at(study, best, thread_count(None)), (level,), measured=False)


def _fit_at(study: Study, best: Mapping[str, float], threads: int | None) -> _Fit:
    """Fit with its best values [SI]."""
    certainty = certify(study, best, threads=threads, keep=True)
    return _fit(study, certainty.estimate, study.space.point(best), certainty.points, threads)


def _estimated(study: Study, best: Mapping[str, float], threads: int | None) -> Estimate:
    """Estimate about best values [SI] without draws, for the noise of the data."""
    free, d = with_uncertain_free(study), study.space.dimension
    likelihood = Likelihood.of(free, threads)
    begin = likelihood.space.to_unit(np.append(study.space.point(best), free.space.reference[d:]))
    return estimate(likelihood, np.clip(begin, 0.0, 1.0)[None], first=d)


def judge(fit: FinishedFit) -> None:
    """Add the bands of all data about the calibrated values, if the certainty of the fit is known."""
    if CERTAINTY not in fit.shared:
        return
    study, certainty = fit.calibration.study, fit.shared[CERTAINTY]
    best = fit.calibration.best if fit.identified.estimate is None else fit.identified.estimate
    finished = _fit(study, certainty.estimate, study.space.point(best), certainty.points, thread_count(fit.threads))
    for data in study.data:
        if data.kind in finished.scatter:
            with suppress(SimulationError):  # a data set that cannot be simulated has no band; the report says so of it
                band = _band(data, finished, (LEVEL,), measured=True)
                fit.identified.bands[data.name] = band.judgement(LEVEL, _label(finished, [band]))


def _fit(study: Study, estimate: Estimate, point: Floats, draws: Floats, threads: int | None) -> _Fit:
    fitted = in_order(of_role(study.data, Role.FIT))
    simulator = Simulator(study.injector, study.space.names, study.time_step, threads, same_bits=study.same_bits)
    points = np.vstack([point, draws[:: max(len(draws) // DRAWS, 1)]])
    return _Fit(simulator, estimate, points, scatter_of(estimate, fitted), curve_scatter(estimate, fitted))


def _label(fit: _Fit, bands: Sequence[Band]) -> str:
    """Name of the estimator of bands, with the number of quantities beyond the fitted energising times."""
    kinds = {band.data.kind for band in bands}
    label = "draws from the posterior; noise and discrepancy included"
    left_out = sum(scatter.left_out for kind, scatter in fit.scatter.items() if kind in kinds)
    if left_out:
        label += f", scaled by the predictions of {left_out} fitted values held out in turn"
    beyond = sum(int(np.count_nonzero(_is_beyond(fit, band.data))) for band in bands)
    if beyond:
        label += f"; {beyond} quantities beyond the fitted energising times, with bands {BEYOND:g} times as wide"
    return label


def _is_beyond(fit: _Fit, data: DataSet) -> Bools:
    """Mask (n,) of quantities beyond the energising times of all fitted ones; none of a curve."""
    fitted = [block.places[:, 0] for block in fit.estimate.likelihood.blocks if not block.ordered]
    if data.bounds is not None or not fitted:
        return np.zeros(len(data.measured), bool)
    times, fitted_times = coordinates_of(data)[:, 0], np.concatenate(fitted)
    return np.asarray((times < fitted_times.min() * (1.0 - SAME)) | (times > fitted_times.max() * (1.0 + SAME)))


def _asked(study: Study, points: Sequence[OperatingPoint]) -> QuantityData:
    """Quantities at operating points, as a map of the study without measured values."""
    maps = [data for data in of_role(study.data, Role.FIT) if type(data) is QuantityData]
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


def _band(data: DataSet, fit: _Fit, levels: tuple[float, ...], measured: bool) -> Band:
    """Band of one data set."""
    if data.kind not in fit.scatter:
        raise ConfigurationError(
            f'No data of the kind "{data.kind}" are fitted, so nothing is known of the scatter of {data.name}; fit '
            "some, or predict another kind."
        )
    scatter = fit.scatter_about(data)
    drawn = data.simulated(fit.simulator, fit.points)
    values = drawn[0]
    if not np.isfinite(values).any():
        raise SimulationError(f"{data.name} cannot be simulated with the best values, so it has no band.")
    spread = np.maximum(values + scatter.calibration * (drawn[1:] - values), np.minimum(drawn[1:], 0.0))
    deviations = scatter.calibration * scatter.deviations(data, values)
    edges, alone = (band_from_draws(spread, d, scatter.freedom, levels) for d in (deviations, 0.0 * deviations))
    factor = np.where(_is_beyond(fit, data), BEYOND, 1.0)
    for level, (low, high) in edges.items():  # below zero only where they were
        lower = np.maximum(values - factor * (values - low), np.minimum(low, 0.0))
        edges[level] = lower, values + factor * (high - values)
    return Band(data, values, edges, measured, alone)
