"""Likelihood of a study's data: each data set with a noise model of its own, so that their shares can be compared.

For residuals e of a data set (simulated − measured), its autoregression and its scale give standardised innovations u,
independent from value to value, and the logarithm of its likelihood is Σ (−ρ(u)/2 − ln scale) with the cost ρ of its
law. Weights of the objective play no part: the noise says what a data set is worth. Priors are kept apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Drive, Precision
from commonrail.base.hooks import check_stop
from commonrail.calibration.influence import around_position
from commonrail.calibration.objective import Goal, Objective
from commonrail.calibration.optimisers.least_squares import answered, differences
from commonrail.calibration.parameter import Priors
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study, objective_of
from commonrail.plugins.certainty.noise_fit import Block, FittedNoise, block_of, fit_noises, row_weights, with_shots

# Step of a one-sided difference, in positions between the bounds, on the way to the optimum: valleys of many parameters
# bend within 1e-3; the switching of a PWM drive is that wide.
FORWARD, FORWARD_ROUGH = 1e-4, 1e-3
FINER = 4.0  # parts of the time step of a study with which its error is found


class Likelihood:
    """Likelihood of data under a model whose parameters vary.

    `Likelihood.of(study)` makes that of a study. Points are arrays (m, d) in SI, columns in the order of `names`.

    Parameters
    ----------
    space : Space
        Free parameters.
    blocks : sequence of Block
        One for each data set; their rows are all residuals.
    residuals : function of (m, d)
        Residuals (m, n) of points [SI], simulated − measured, in the units of the blocks; NaN where a simulation fails.
    forward : float
        Step of one-sided differences, in positions between the bounds.

    Attributes
    ----------
    names, units : tuple of str
        Of the parameters; SI units.
    size : int
        Number of residuals of all blocks.
    forward : float
    noises : tuple of FittedNoise
        Of the blocks, in order. Of a new likelihood they are unknown: `estimate` or `with_noises` sets them.
    simulated, failed : int
        Points simulated, and those that failed.
    """

    def __init__(
        self,
        space: Space,
        blocks: Sequence[Block],
        residuals: Callable[[Floats], Floats],
        *,
        forward: float = FORWARD,
        finer: Callable[[Floats], Floats] | None = None,
    ) -> None:
        self.space, self.blocks = space, tuple(blocks)
        self.names, self.size = space.names, int(self.blocks[-1].rows.stop)
        self.units = tuple(parameter.unit for parameter in space.parameters)
        self.priors, self.finer = Priors.of(space.parameters), finer
        self._residuals, self.forward = residuals, forward
        self.noises: tuple[FittedNoise, ...] = ()
        self.simulated = self.failed = 0

    @classmethod
    def of(cls, study: Study, threads: int | None = None) -> Likelihood:
        """Likelihood of the fitted data of a study, at its time step in f64.

        Parameters
        ----------
        study : Study
        threads : int, optional
            All usable processors by default; the result does not depend on it.

        Raises
        ------
        StudyError
            If the study has no data to fit.
        """
        goal, exact = Goal(conditions=study.conditions), replace(study, precision=Precision.F64)
        objective = objective_of(exact, threads, goal)
        blocks: list[Block] = []
        for data in objective.data:
            blocks.append(block_of(data, blocks[-1].rows.stop if blocks else 0))
        weights = np.concatenate([row_weights(data) for data in objective.data])
        rounding = np.concatenate([block.rounding for block in blocks])

        def residuals(points: Floats, objective: Objective = objective) -> Floats:
            errors = objective.residuals(points)[:, : len(weights)] / np.sqrt(weights)
            return np.where(np.abs(errors) < rounding, 0.0, errors)

        def finer(points: Floats) -> Floats:
            fine = replace(exact, time_step=study.time_step / FINER, same_bits=False)
            return residuals(points, objective_of(fine, threads, goal))

        rough = study.injector.variant.drive is Drive.PWM or not all(block.ordered for block in blocks)
        forward = FORWARD_ROUGH if rough else FORWARD
        return cls(study.space, with_shots(blocks, objective.data), residuals, forward=forward, finer=finer)

    def with_noises(self, noises: Sequence[FittedNoise]) -> Likelihood:
        """The same likelihood with other noise; it counts simulations of its own."""
        other = Likelihood(self.space, self.blocks, self._residuals, forward=self.forward, finer=self.finer)
        other.noises = tuple(noises)
        return other

    def with_residuals(self, residuals: Callable[[Floats], Floats]) -> Likelihood:
        """The same likelihood, with its noise, whose residuals (m, n) of points (m, d) another function gives."""
        other = Likelihood(self.space, self.blocks, residuals, forward=self.forward)
        other.noises = self.noises
        return other

    def estimated(
        self,
        errors: Floats,
        used: Sequence[float],
        fitted_courses: Floats | None = None,
        *,
        correlated: bool = True,
        like: Sequence[FittedNoise] | None = None,
    ) -> Likelihood:
        """The same likelihood with the noise that residuals (n,) at the best values show.

        `used`: parameters that each block pays for; `fitted_courses` (d, n): courses that the residuals may be
        off by, see `noise_fit.estimate`; `correlated`: estimate autocorrelations too; `like`: as for
        `fit_noises`.
        """
        fitted_courses = np.zeros((0, self.size)) if fitted_courses is None else fitted_courses
        return self.with_noises(fit_noises(self.blocks, errors, used, fitted_courses, correlated=correlated, like=like))

    def residuals(self, points: Floats) -> Floats:
        """Residuals (m, n) of points (m, d) [SI]; rows of NaN where a simulation failed, which are counted.

        `KeyboardInterrupt` if a stop was asked for, within `hold_interrupts`.
        """
        if not len(points):  # a profile of the only parameter has no other to fit
            return np.empty((0, self.size))
        check_stop()
        errors = self._residuals(points)
        broken: Bools = np.asarray(~np.isfinite(errors).all(axis=1))
        self.simulated += len(points)
        self.failed += int(np.count_nonzero(broken))
        return np.where(broken[:, None], np.nan, errors)

    def whiten(self, errors: Floats) -> Floats:
        """Standardised innovations (…, n) of residuals or of their derivatives (…, n)."""
        innovations = np.empty_like(errors)
        for block, noise in zip(self.blocks, self.noises, strict=True):
            innovations[..., block.rows] = noise.whiten(errors[..., block.rows])
        return innovations

    def block_costs(self, innovations: Floats) -> Floats:
        """−2 ln L of each block (…, blocks) of innovations (…, n), without its constants; NaN where one is."""
        parts = [
            np.sum(noise.density.cost(innovations[..., block.rows]), axis=-1)
            for block, noise in zip(self.blocks, self.noises, strict=True)
        ]
        return np.stack(parts, axis=-1)

    def scaled(self, unit: Floats) -> Floats:
        """SI value per unit of position (d,) at a position (d,)."""
        return around_position(self.space, unit).scale


def central_slopes(likelihood: Likelihood, unit: Floats) -> Floats:
    """Derivatives (k, d, n) of the residuals with respect to positions between the bounds, at positions (k, d).

    From differences to both sides, simulated in one batch. Zero where a candidate fails.
    """
    near = [around_position(likelihood.space, neighbours) for neighbours in unit]
    errors = likelihood.residuals(np.concatenate([neighbours.values[1:] for neighbours in near]))
    below, above = np.moveaxis(errors.reshape(len(unit), 2, -1, likelihood.size), 1, 0)
    slopes = (above - below) / np.array([neighbours.width for neighbours in near])[..., None]
    return np.where(np.isfinite(slopes), slopes, 0.0)


def forward_slopes(likelihood: Likelihood, unit: Floats, errors: Floats, free: Bools | None = None) -> Floats:
    """One-sided derivatives (k, d, n) at positions (k, d) with residuals (k, n), as `least_squares.differences`."""
    steps = np.full(len(unit), likelihood.forward)
    return answered(differences(likelihood.space, unit, errors, steps, free), likelihood.residuals)


def prior_slopes_at(likelihood: Likelihood, unit: Floats) -> Floats:
    """Derivatives (p, d) of the residuals of the priors with respect to positions, at a position (d,)."""
    priors = likelihood.priors
    slopes = np.zeros((len(priors), len(unit)))
    if len(priors):
        slopes[np.arange(len(priors)), priors.columns] = likelihood.scaled(unit)[priors.columns] / priors.sigmas
    return slopes


def weights_of(likelihood: Likelihood, innovations: Floats) -> Floats:
    """Weights (…, n) that the laws give innovations (…, n)."""
    weights = np.ones_like(innovations)
    for block, noise in zip(likelihood.blocks, likelihood.noises, strict=True):
        weights[..., block.rows] = noise.density.weight(innovations[..., block.rows])
    return weights
