"""Prior knowledge of a parameter: a value, its standard deviation and its source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from commonrail.arguments import number, plain_text, settle
from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError

__all__ = ["Prior", "Priors"]


@dataclass(frozen=True)
class Prior:
    """Normal distribution that a parameter has before the data are seen.

    Parameters
    ----------
    value : float
        Mean, SI.
    sigma : float
        Standard deviation, SI, greater than zero.
    source : str
        Source of both.

    Raises
    ------
    ConfigurationError
        If a number is not finite, or sigma is not greater than zero.
    """

    value: float
    sigma: float
    source: str = "no source stated"

    def __post_init__(self) -> None:
        plain_text(self.source, "source of a prior")
        settle(
            self, value=number(self.value, "1", "value of a prior"), sigma=number(self.sigma, "1", "sigma of a prior")
        )
        if not self.sigma > 0.0:
            raise ConfigurationError(
                f"A prior needs a value and a sigma greater than zero, not {self.value:g} and {self.sigma:g}."
            )

    def pull(self, value: float) -> float:
        """Distance of a value from the prior's in standard deviations: (x - value)/sigma."""
        return (value - self.value) / self.sigma


class Priors:
    """Priors of the parameters of a space, as residuals (x - value)/sigma.

    Parameters
    ----------
    priors : sequence of Prior or None
        One for each parameter, in order; None where there is no prior.
    """

    def __init__(self, priors: Sequence[Prior | None] = ()) -> None:
        known = [(column, prior) for column, prior in enumerate(priors) if prior is not None]
        self.columns = np.array([column for column, _ in known], dtype=np.intp)
        self._value = np.array([prior.value for _, prior in known])
        self._sigma = np.array([prior.sigma for _, prior in known])

    @classmethod
    def of(cls, parameters: Sequence[Any]) -> Priors:
        """Priors of parameters that have the attribute `prior`."""
        return cls([parameter.prior for parameter in parameters])

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def sigmas(self) -> Floats:
        """Standard deviations (priors,), SI."""
        return self._sigma

    def residuals(self, x: Floats) -> Floats:
        """Residuals (n, priors) of points (n, d), SI."""
        return np.asarray((x[:, self.columns] - self._value) / self._sigma)

    def costs(self, x: Floats) -> Floats:
        """Sum (n,) of the squares of the residuals of points (n, d), SI."""
        return np.asarray(np.sum(self.residuals(x) ** 2, axis=1))
