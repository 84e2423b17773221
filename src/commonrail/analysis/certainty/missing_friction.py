"""Friction of the guides that a model lacks: likelihood-ratio test by a fit with the friction free.

The parameters imitate most of what friction does to a curve, along a curved path, and the tests of the meter see little
of the rest. All parameters are therefore fitted anew with the friction free, from zero upwards, as in `missing_delay`.

Uncertain quantities are fitted beside it. Friction that a study states as uncertain about zero is no longer missing: it
is fitted within its statement, see `within`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from commonrail.analysis.certainty.ascent import Ascent, climb
from commonrail.analysis.certainty.estimate import Estimate
from commonrail.analysis.certainty.lack_of_fit import LackOfFit
from commonrail.analysis.certainty.likelihood import Likelihood
from commonrail.analysis.certainty.missing_delay import cost_of, covariance_at
from commonrail.analysis.certainty.uncertain import wider, with_uncertain_free
from commonrail.arrays import Floats
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.study import Study
from commonrail.units import to_text

__all__ = ["MissingFriction", "missing_friction"]


# Dry and viscous friction of each guide, and how much is looked for [N], [N s/m]; assumed, six times what is usual.
FRICTION = {"plunger_needle.friction": (30.0, "N"), "plunger_needle.viscous": (12.0, "N s/m")}
BEGINS = np.array([[0.1, 0.1], [0.3, 0.05]])  # shares of these that the search begins at
ROUNDS = 2  # of noise given residuals
TOLERANCE = 0.05  # of an ascent; a test at 1 % asks for falls of 9 and more
GUIDES = "guides"  # name of the test


class MissingFriction(NamedTuple):
    """Test of friction.

    Attributes
    ----------
    dry, viscous : float
        Most likely friction of each guide [N], [N s/m].
    probability : float
        Largest probability that noise alone gains as much by friction.
    point : (d,)
        Parameters [SI] that belong to it.
    simulated : int
        Points simulated.
    """

    dry: float
    viscous: float
    probability: float
    point: Floats
    simulated: int

    def judged(self, level: float) -> LackOfFit:
        """Test as those of the residuals, at a level."""
        found = self.probability < level
        size = f"{to_text(self.dry, 'N', 2)} and {to_text(self.viscous, 'N s/m', 2)}"
        sentence = f"friction in the guides of about {size}, which the model lacks, explains the curves better"
        return LackOfFit(GUIDES, self.probability, None, "friction", found, sentence if found else "")


def missing_friction(study: Study, estimate: Estimate, threads: int | None = None) -> MissingFriction | None:
    """Likelihood-ratio test of friction in the guides of plunger and needle.

    Parameters
    ----------
    study : Study
    estimate : Estimate
        Of its parameters.
    threads : int, optional
        All usable processors by default; the result does not depend on it.

    Returns
    -------
    MissingFriction or None
        None where no data set is a course in time, or the model has such friction: fixed, free or stated as uncertain.
    """
    own, unit = estimate.likelihood, estimate.unit
    if not _is_missing(study, own):
        return None
    if own.nuisances:
        free = with_uncertain_free(study)
        if free is None:
            return None
        study, own = free, Likelihood.of(free, threads).with_noises(own.noises)
        unit = np.append(unit, own.space.to_unit(own.space.reference)[len(unit) :])
    more = [
        Parameter(name, 0.0, 0.0, most, symbol, mark="E", source="test for lack of fit")
        for name, (most, symbol) in FRICTION.items()
    ]
    wide = Likelihood.of(replace(study, space=wider(own.space, more)), threads)
    found = _freed(wide, own, unit)
    if found is None:
        return None
    noisy, at, simulated = found
    before = noisy.simulated
    known, _ = covariance_at(noisy, at)
    without = own.with_noises(noisy.noises)
    held = climb(without, unit[None], errors=estimate.errors[None], tolerance=TOLERANCE)
    fall = max(cost_of(without, known, held) - cost_of(noisy, known, at), 0.0)
    freedom = min(noise.freedom for block, noise in zip(noisy.blocks, noisy.noises, strict=True) if block.ordered)
    point, d = wide.space.from_unit(at.unit)[0], len(estimate.unit)
    simulated += noisy.simulated - before + without.simulated
    dry, viscous = float(point[-2]), float(point[-1])
    return MissingFriction(dry, viscous, _probability(fall, freedom), point[:d], simulated)


def _is_missing(study: Study, own: Likelihood) -> bool:
    """True if the model has no friction, fixed, free or uncertain, and the study curves that it could be seen in."""
    known = {*own.names, *(nuisance.key for nuisance in own.nuisances)}
    none = all(name not in known and study.injector.values.get(name) == 0.0 for name in FRICTION)
    return none and any(block.ordered for block in own.blocks)


def _freed(wide: Likelihood, own: Likelihood, unit: Floats) -> tuple[Likelihood, Ascent, int] | None:
    """Likelihood with the noise that a fit with friction leaves, the end of that fit, and the points simulated.

    Parameters
    ----------
    wide : Likelihood
        With the friction as its last parameters.
    own : Likelihood
        Without, its noise known.
    unit : (d,)
        Position of the fit without friction.
    """
    noisy = wide.with_noises(own.noises)
    starts = np.column_stack([np.tile(unit, (len(BEGINS), 1)), BEGINS])
    ends = climb(noisy, starts, tolerance=TOLERANCE)
    if not np.isfinite(ends.cost).any():
        return None
    best, simulated = int(np.argmin(ends.cost)), 0
    at = Ascent(*(part[best : best + 1] for part in ends))
    for _ in range(ROUNDS):
        known, slopes = covariance_at(noisy, at)
        simulated += noisy.simulated
        noisy = wide.estimated(at.errors[0], known.used.tolist(), known.root.T @ slopes)
        at = climb(noisy, at.unit, errors=at.errors, slopes=slopes[None], turns=10, tolerance=TOLERANCE)
    return noisy, at, simulated + noisy.simulated


def _probability(fall: float, freedom: float) -> float:
    """Probability of a fall of the cost as large as this: F with two degrees of freedom.

    Friction is never negative, so that it is at most this.
    """
    if freedom > 1e6:
        return math.exp(-0.5 * fall)
    return float(special.fdtrc(2.0, freedom, 0.5 * fall))
