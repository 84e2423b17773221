"""Likelihood of a study's data: each data set with a noise model of its own, so that their shares can be compared.

For residuals e of a data set (simulated − measured), its autoregression and its scale give standardised innovations u,
independent from value to value, and the logarithm of its likelihood is Σ (−ρ(u)/2 − ln scale) with the cost ρ of its
law. Weights of the objective are not used: the noise determines the weight of a data set. Priors are separate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Drive, Precision
from commonrail.base.hooks import check_stop
from commonrail.calibration.influence import around_position
from commonrail.calibration.objective import Goal
from commonrail.calibration.parameter import Priors
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study, objective_of
from commonrail.plugins.certainty.noise_fit import Block, FittedNoise, block_of, fit_noises, row_weights, with_shots

# Step of one-sided differences during the search, as a share of the bounds' width. With many parameters, valleys bend
# within 1e-3; a PWM drive needs a step as wide as its switching.
FORWARD, FORWARD_ROUGH = 1e-4, 1e-3
FINER = 4.0  # factor by which a shorter time step gives the error of the time step


class Likelihood:
    """Likelihood of data under a model whose parameters vary.

    `Likelihood.of(study)` makes the likelihood of a study. Points are arrays (m, d) in SI, columns in the order of
    `names`.

    Parameters
    ----------
    space : Space
        Free parameters.
    blocks : sequence of Block
        One block per data set; together they contain all residuals.
    residuals : function of (m, d)
        Residuals (m, n) of points [SI], simulated − measured, in the units of the blocks; NaN where a simulation fails.
    forward : float
        Step of one-sided differences, in positions between the bounds.
    finer : function of (m, d), optional
        Residuals with a finer time step.

    Attributes
    ----------
    names, units : tuple of str
        Of the parameters; SI units.
    size : int
        Number of residuals of all blocks.
    noises : tuple of FittedNoise
        Noises of the blocks, in order; empty in a new likelihood. `estimated` and `with_noises` set them.
    simulated, failed : int
        Number of simulated points, and number of failures.
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

        The result does not depend on the number of threads, by default all usable processors. Raises `StudyError` if
        the study has no data to fit.
        """
        goal, exact = Goal(conditions=study.conditions), replace(study, precision=Precision.F64)
        objective = objective_of(exact, threads, goal)
        blocks: list[Block] = []
        for data in objective.data:
            blocks.append(block_of(data, blocks[-1].rows.stop if blocks else 0))
        roots = np.sqrt(np.concatenate([row_weights(data) for data in objective.data]))
        rounding = np.concatenate([block.rounding for block in blocks])

        def residuals(points: Floats, time_step: float | None = None) -> Floats:
            other = None if time_step is None else replace(exact, time_step=time_step, same_bits=False)
            errors = (objective if other is None else objective_of(other, threads, goal)).residuals(points)
            errors = errors[:, : len(roots)] / roots
            return np.where(np.abs(errors) < rounding, 0.0, errors)

        rough = study.injector.variant.drive is Drive.PWM or not all(block.ordered for block in blocks)
        return cls(
            study.space,
            with_shots(blocks, objective.data),
            residuals,
            forward=FORWARD_ROUGH if rough else FORWARD,
            finer=lambda points: residuals(points, study.time_step / FINER),
        )

    @property
    def pairs(self) -> list[tuple[Block, FittedNoise]]:
        """Blocks with their noises."""
        return list(zip(self.blocks, self.noises, strict=True))

    def with_noises(self, noises: Sequence[FittedNoise]) -> Likelihood:
        """Copy with other noise and a new count of simulations."""
        other = copy(self)
        other.noises, other.simulated, other.failed = tuple(noises), 0, 0
        return other

    def with_residuals(self, residuals: Callable[[Floats], Floats]) -> Likelihood:
        """Copy with the same noise and another function that returns residuals (m, n) of points (m, d)."""
        other = self.with_noises(self.noises)
        other._residuals, other.finer = residuals, None
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
        """Copy with the noise estimated from residuals (n,) at the best values; arguments as for `fit_noises`."""
        fitted_courses = np.zeros((0, self.size)) if fitted_courses is None else fitted_courses
        return self.with_noises(fit_noises(self.blocks, errors, used, fitted_courses, correlated=correlated, like=like))

    def residuals(self, points: Floats) -> Floats:
        """Residuals (m, n) of points (m, d) [SI]. A failed simulation is counted; its row is NaN.

        `KeyboardInterrupt` if a stop was asked for, within `hold_interrupts`.
        """
        check_stop()
        errors = self._residuals(points)
        broken: Bools = np.asarray(~np.isfinite(errors).all(axis=1))
        self.simulated += len(points)
        self.failed += int(np.count_nonzero(broken))
        return np.where(broken[:, None], np.nan, errors)

    def whiten(self, errors: Floats) -> Floats:
        """Standardised innovations (…, n) of residuals or of their derivatives (…, n)."""
        innovations = np.empty_like(errors)
        for block, noise in self.pairs:
            innovations[..., block.rows] = noise.whiten(errors[..., block.rows])
        return innovations

    def block_costs(self, innovations: Floats) -> Floats:
        """−2 ln L of each block (…, blocks) for innovations (…, n), without constants; NaN if an innovation is NaN."""
        costs = [np.sum(noise.density.cost(innovations[..., block.rows]), axis=-1) for block, noise in self.pairs]
        return np.stack(costs, axis=-1)

    def weights(self, innovations: Floats) -> Floats:
        """Weights (…, n) that the laws give innovations (…, n)."""
        weights = np.ones_like(innovations)
        for block, noise in self.pairs:
            weights[..., block.rows] = noise.density.weight(innovations[..., block.rows])
        return weights

    def prior_residuals(self, unit: Floats) -> Floats:
        """Distances (…, p) from the priors at positions (…, d), in their standard deviations."""
        residuals = self.priors.residuals(self.space.from_unit(unit.reshape(-1, unit.shape[-1])))
        return residuals.reshape(*unit.shape[:-1], -1)

    def scaled(self, unit: Floats) -> Floats:
        """SI value per unit of position (d,) at a position (d,)."""
        return around_position(self.space, unit).scale


def central_slopes(likelihood: Likelihood, unit: Floats) -> Floats:
    """Derivatives (d, n) of the residuals with respect to positions, at a position (d,); zero if a candidate fails.

    Central differences, simulated in one batch.
    """
    near = around_position(likelihood.space, unit)
    below, above = likelihood.residuals(near.values[1:]).reshape(2, -1, likelihood.size)
    slopes = (above - below) / near.width[:, None]
    return np.where(np.isfinite(slopes), slopes, 0.0)


def prior_slopes_at(likelihood: Likelihood, unit: Floats) -> Floats:
    """Derivatives (p, d) of the residuals of the priors with respect to positions, at a position (d,)."""
    priors = likelihood.priors
    slopes = np.zeros((len(priors), len(unit)))
    if len(priors):
        slopes[np.arange(len(priors)), priors.columns] = likelihood.scaled(unit)[priors.columns] / priors.sigmas
    return slopes
