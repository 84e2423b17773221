"""A claim of the paper, and the verdict over the seeds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["FAILS", "HOLDS", "OPEN", "Claim", "Sentence", "ClaimVerdict", "judged", "percent", "share", "signed"]

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
ClaimVerdict = str


class Claim(NamedTuple):
    """One claim.

    Attributes
    ----------
    id : str
    claim, where : str
        The paper's sentence in our words, and where it stands.
    measure, figure : str
        What is measured, and what came out.
    verdict : str
        "holds", "does not hold" or "cannot be told".
    true_in, of : int
        Seeds in which it is true, and all of them.
    interval : (float, float)
        95 % interval of that share (Clopper and Pearson).
    comment : str
        What else a reader must know, such as that the bench builds it in.
    chance : float or None
        Share of random feasible stiffnesses that satisfy the claim without any search; None where it is not of them.
    """

    id: str
    claim: str
    where: str
    measure: str
    figure: str
    verdict: ClaimVerdict
    true_in: int
    of: int
    interval: tuple[float, float]
    comment: str
    chance: float | None = None


class Sentence(NamedTuple):
    """Text, place and measure of a claim; see `Claim`."""

    id: str
    claim: str
    where: str
    measure: str


def judged(
    s: Sentence,
    figure: str,
    true: ArrayLike,
    *,
    comment: str = "",
    verdict: ClaimVerdict | None = None,
    valid: ArrayLike = True,
    chance: float | None = None,
) -> Claim:
    """Claim from what is true in each seed.

    It holds if the 95 % interval of the share lies above one half, and does not if it lies below.

    Parameters
    ----------
    s : Sentence
    figure, comment, chance
        As for `Claim`.
    true, valid : (seeds,) bool
        Whether it is true; seeds without a number, those that are not valid, are left out.
    verdict : str, optional
        Stands in place of that of the interval.
    """
    from scipy.stats import binomtest  # slow to import

    each = np.asarray(true, bool)
    each = each[np.broadcast_to(np.asarray(valid, bool), each.shape)]
    n, k = len(each), int(np.sum(each))
    if not n:
        return Claim(*s, figure, OPEN, 0, 0, (0.0, 1.0), comment, chance)
    interval = binomtest(k, n).proportion_ci(0.95)
    if verdict is None:
        verdict = HOLDS if interval.low > 0.5 else FAILS if interval.high < 0.5 else OPEN
    return Claim(*s, figure, verdict, k, n, (float(interval.low), float(interval.high)), comment, chance)


def share(value: float) -> str:
    """Percent of a share."""
    return f"{100.0 * value:.0f} %"


def percent(change: float) -> str:
    """Percent of a change, with its sign."""
    return f"{signed(100.0 * change, 0)} %"


def signed(value: float, decimals: int) -> str:
    """Number with its sign."""
    return f"{value:+.{decimals}f}".replace("-", "\N{MINUS SIGN}")
