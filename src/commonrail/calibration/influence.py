"""Linear algebra of a fit near its best values: effective parameters, and combinations that the data determine."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import array
from commonrail.base.arrays import Floats
from commonrail.calibration.space import Space

SHOWN = 0.2  # weight in a combination from which a parameter is named
NEGLIGIBLE = 1e-12  # singular value relative to the largest, below which a direction counts as free


class Influence(NamedTuple):
    """Influence of the data on d parameters."""

    effective: float  # number of parameters: trace of J (JᵀJ + PᵀP)⁻¹ Jᵀ, with the derivatives P of the priors
    scatter: float  # s = sqrt(|r|²/(n − effective)) of the data's residuals, 1 where they have their tolerances
    # (d,), standard errors in positions between the bounds, with the priors: roots of the diagonal of
    # max(s², 1) (JᵀJ + PᵀP)⁻¹; +inf where nothing holds a parameter
    errors: Floats
    singular: Floats  # (k,), singular values of J, of residuals per width of the bounds, in falling order
    directions: Floats  # (k, d), unit vectors that belong to them
    residuals: int

    def record(self, names: tuple[str, ...]) -> dict[str, Any]:
        """JSON-able form; a combination names the parameters whose weight is `SHOWN` or more."""
        combinations = []
        for value, vector in zip(self.singular.tolist(), self.directions, strict=True):
            order = [i for i in np.argsort(-np.abs(vector), kind="stable").tolist() if abs(vector[i]) >= SHOWN]
            weights = {names[i]: round(float(vector[i]), 4) for i in order}
            combinations.append({"singular_value": value, "weights": weights})
        return {
            "residuals": self.residuals,
            "effective_parameters": self.effective,
            "scatter": self.scatter,
            "combinations": combinations,
        }


def influence_of(residuals: Floats, jacobian: Floats, priors: Floats, in_deviations: bool = True) -> Influence:
    """Influence on the parameters of data with residuals (n,), by their derivatives (n, d) at the best values.

    Derivatives are with respect to the positions between the bounds, zero columns where they are unknown; `priors`
    (p, d): of the residuals of the priors. With `in_deviations` residuals are multiples of a stated tolerance, and
    errors no smaller than that tolerance explains; else the scatter alone scales them.
    """
    all_values, all_directions = _singular(np.vstack([jacobian, priors]))
    determined = all_values > NEGLIGIBLE * max(all_values.max(initial=0.0), 1e-300)
    inverse = all_directions[determined].T / all_values[determined]  # root of the pseudo-inverse of JᵀJ + PᵀP
    effective = float(np.sum((jacobian @ inverse) ** 2))
    scatter = float(np.sqrt(np.sum(residuals**2) / max(len(residuals) - effective, 1.0)))
    errors = (max(scatter, 1.0) if in_deviations else scatter) * np.sqrt(np.sum(inverse**2, axis=1))
    loose = np.sum(all_directions[determined] ** 2, axis=0) < 1.0 - 1e-6
    values, directions = _singular(jacobian)
    signs = np.sign(directions[np.arange(len(directions)), np.argmax(np.abs(directions), axis=1)])
    return Influence(
        effective,
        scatter,
        np.where(loose, np.inf, errors),
        values,
        directions * signs[:, None],
        len(residuals),
    )


def _singular(matrix: Floats) -> tuple[Floats, Floats]:
    """Singular values (d,), the largest first, and right singular vectors (d, d), one a row, of a matrix (m, d)."""
    m, d = matrix.shape
    padded = np.vstack([matrix, np.zeros((max(d - m, 0), d))])
    _, values, directions = np.linalg.svd(padded, full_matrices=False)
    return values, directions


# Candidates about a point, and derivatives from what they give.

STEP = 5e-3  # of the range, to both sides: above the ripple of a PWM drive, below curvature


class Neighbourhood(NamedTuple):
    """A point with candidates below and above it in each parameter: values (1 + 2 d, d) [SI].

    `width` (d,) is the distance between the two candidates of a parameter, in positions between the bounds, less at a
    bound; `scale` (d,) the SI value per unit of position, which on a logarithmic scale is not the width of the range.
    """

    values: Floats
    width: Floats
    scale: Floats

    def slopes(self, figures: Floats) -> Floats:
        """Derivatives (m, d) with respect to the positions of figures (1 + 2 d, m) that the candidates give."""
        d = len(self.width)
        return np.asarray(((figures[1 + d :] - figures[1 : 1 + d]) / self.width[:, None]).T)


def around(space: Space, best: Floats) -> Neighbourhood:
    """Candidates `STEP` below and above a point (d,) [SI] in each parameter, within the bounds."""
    return around_position(space, space.to_unit(array(best, "1", "best values", 1)))


def around_position(space: Space, unit: Floats) -> Neighbourhood:
    """Candidates as `around` has them, about a position (d,) between the bounds."""
    step = STEP * np.eye(space.dimension)
    low, high = np.clip(unit - step, 0.0, 1.0), np.clip(unit + step, 0.0, 1.0)
    width = np.diag(high - low)
    scale = np.diag(space.from_unit(high) - space.from_unit(low)) / width
    return Neighbourhood(space.from_unit(np.vstack([unit, low, high])), width, scale)
