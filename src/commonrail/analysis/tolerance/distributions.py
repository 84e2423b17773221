"""Distributions of a dimension over parts, as values at shares of the parts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from commonrail.arguments import number, settle
from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError

__all__ = ["Distribution", "Normal", "Triangular", "Uniform"]


class Distribution(Protocol):
    """Distribution of a dimension, SI."""

    def at(self, shares: Floats) -> Floats:
        """Value below which a share of the parts lies, for shares between 0 and 1."""

    def record(self) -> dict[str, Any]:
        """JSON-able form: kind and numbers."""


def _finite(values: dict[str, object], what: str) -> dict[str, float]:
    return {name: number(value, "1", f"{name} of {what}") for name, value in values.items()}


@dataclass(frozen=True)
class Normal:
    """Normal distribution, cut at two limits if they are given: parts beyond them are sorted out.

    Parameters
    ----------
    mean, sigma : float
        Mean and standard deviation before the cut; sigma is greater than zero.
    lower, upper : float
        Limits of the cut, infinite for none.

    Raises
    ------
    ConfigurationError
        If a number is not finite, sigma is not greater than zero, or nothing is left between the limits.
    """

    mean: float
    sigma: float
    lower: float = -math.inf
    upper: float = math.inf

    def __post_init__(self) -> None:
        settle(self, **_finite({"mean": self.mean, "sigma": self.sigma}, "a normal distribution"))
        if not self.sigma > 0.0:
            raise ConfigurationError(
                f"The sigma of a normal distribution must be greater than zero, not {self.sigma:g}."
            )
        if not self.lower < self.upper or not self._span[1] > self._span[0]:
            raise ConfigurationError(
                f"A normal distribution with mean {self.mean:g} and sigma {self.sigma:g} has nothing between "
                f"{self.lower:g} and {self.upper:g}; correct the limits."
            )

    @property
    def _span(self) -> tuple[float, float]:
        """Shares of the uncut distribution below its limits."""
        from scipy.special import ndtr  # slow to import

        low, high = (float(ndtr((end - self.mean) / self.sigma)) for end in (self.lower, self.upper))
        return low, high

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        from scipy.special import ndtri  # slow to import

        low, high = self._span
        found = self.mean + self.sigma * ndtri(low + (high - low) * shares)
        return np.asarray(np.clip(found, self.lower, self.upper))

    def record(self) -> dict[str, Any]:
        """As `Distribution`; a limit that is not there is None."""
        ends = {"lower": self.lower, "upper": self.upper}
        cut = {name: end if math.isfinite(end) else None for name, end in ends.items()}
        return {"kind": "normal", "mean": self.mean, "sigma": self.sigma, **cut}


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution between two limits.

    Parameters
    ----------
    lower, upper : float

    Raises
    ------
    ConfigurationError
        If a limit is not finite, or they are crossed.
    """

    lower: float
    upper: float

    def __post_init__(self) -> None:
        settle(self, **_finite({"lower": self.lower, "upper": self.upper}, "a uniform distribution"))
        if not self.lower < self.upper:
            raise ConfigurationError(
                f"The lower limit of a uniform distribution must be below the upper, not {self.lower:g} and "
                f"{self.upper:g}."
            )

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        return np.asarray(self.lower + (self.upper - self.lower) * shares)

    def record(self) -> dict[str, Any]:
        """As `Distribution`."""
        return {"kind": "uniform", "lower": self.lower, "upper": self.upper}


@dataclass(frozen=True)
class Triangular:
    """Triangular distribution between two limits, most parts at the mode.

    Parameters
    ----------
    lower, mode, upper : float
        In rising order; the mode may be a limit.

    Raises
    ------
    ConfigurationError
        If a number is not finite, or they are not in order.
    """

    lower: float
    mode: float
    upper: float

    def __post_init__(self) -> None:
        given = {"lower": self.lower, "mode": self.mode, "upper": self.upper}
        settle(self, **_finite(dict(given), "a triangular distribution"))
        if not (self.lower <= self.mode <= self.upper and self.lower < self.upper):
            raise ConfigurationError(
                f"The mode of a triangular distribution must lie between its limits, not {self.mode:g} between "
                f"{self.lower:g} and {self.upper:g}."
            )

    def at(self, shares: Floats) -> Floats:
        """As `Distribution`."""
        width = self.upper - self.lower
        rising = self.lower + np.sqrt(shares * width) * np.sqrt(self.mode - self.lower)
        falling = self.upper - np.sqrt((1.0 - shares) * width) * np.sqrt(self.upper - self.mode)
        return np.asarray(np.where(shares * width < self.mode - self.lower, rising, falling))

    def record(self) -> dict[str, Any]:
        """As `Distribution`."""
        return {"kind": "triangular", "lower": self.lower, "mode": self.mode, "upper": self.upper}
