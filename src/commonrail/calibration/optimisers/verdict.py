"""Verdict of a search on itself: converged or not, by which rule, and with which figures."""

from __future__ import annotations

from typing import Any, NamedTuple

__all__ = ["AGREEING", "ALIKE", "SMALL_GAIN", "Convergence", "noise_of"]

# Restarts agree if at least so many of them end within so much of the best 2 ln L, and the search has arrived if a full
# step from there is predicted to gain less than SMALL_GAIN of it.
AGREEING, ALIKE, SMALL_GAIN = 3, 0.5, 0.01


class Convergence(NamedTuple):
    """Verdict on convergence.

    Attributes
    ----------
    converged : bool
    sentence : str
        Rule and figures for the user, without its full stop.
    figures : dict
        JSON-able numbers that the rule was applied to.
    """

    converged: bool
    sentence: str
    figures: dict[str, Any]

    @classmethod
    def of(cls, converged: bool, sentence: str, figures: dict[str, Any]) -> Convergence:
        """Convergence whose sentence opens with the result.

        Parameters
        ----------
        converged : bool
        sentence : str
            Rule and figures.
        figures : dict
        """
        return cls(converged, f"{'' if converged else 'not '}converged: {sentence}", figures)

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        return {"converged": self.converged, "sentence": self.sentence, **self.figures}


def noise_of(cost: float, residuals: int, parameters: int, units: float) -> float:
    """Change of an objective that changes 2 ln L by 1, by the objective's own residual noise.

    The objective is read as the likelihood of errors whose size is what it leaves: Gaussian for sums of squares,
    Laplacian for sums of absolute errors. Then 2 ln L changes by `units` (N − d) times its relative change.

    Parameters
    ----------
    cost : float
        Objective of the best.
    residuals : int
        Number N of residuals.
    parameters : int
        Number d of free parameters.
    units : float
        1 for squares, 2 for absolute errors.
    """
    return max(cost, 1e-300) / (units * max(residuals - parameters, 1))
