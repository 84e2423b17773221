"""Claims of the paper on the search: how fast it converges, and with which settings."""

from __future__ import annotations

import numpy as np

from commonrail.arrays import Floats
from commonrail.reproduction import paper
from commonrail.reproduction.figures import Figures
from commonrail.reproduction.measures import spread
from commonrail.reproduction.verdict import FAILS, HOLDS, OPEN, Claim, ClaimVerdict, Sentence, judged

__all__ = ["holm", "search_claims"]


RAPID = 0.5  # of the generations: convergence is rapid if 90 % of the gain is reached before
SIGNIFICANT = 0.05


def search_claims(f: Figures) -> list[Claim]:
    """Claims on Fig. 4 and Table 3."""
    return [_rapid(f), _best_configuration(f), _cheap_configuration(f)]


def _rapid(f: Figures) -> Claim:
    s = spread(f.ninety)
    limit = RAPID * paper.BEST.generations
    sentence = Sentence(
        "rapid",
        "Convergence is rapid.",
        "Sec. 5, Fig. 4",
        f"generation at which 90 % of the gain over the first population is reached, before {limit:.0f} "
        f"of {paper.BEST.generations}",
    )
    return judged(sentence, f"generation {s.median:.0f} (quartiles {s.q1:.0f} to {s.q3:.0f})", f.ninety < limit)


def _best_configuration(f: Figures) -> Claim:
    sentence = Sentence(
        "best-configuration",
        "Of the nine (Gmax, Npop), (70, 50) gives the lowest J averaged over the three pressures.",
        "Sec. 5, Table 3",
        "(70, 50) has the lowest mean J; Friedman's test over the nine, Wilcoxon's against each (Holm)",
    )
    means = np.array([f.mean_j[c] for c in paper.CONFIGURATIONS])
    at = paper.CONFIGURATIONS.index(paper.BEST)
    medians = np.median(means, axis=1)
    first = paper.CONFIGURATIONS[int(np.argmin(medians))]
    verdict, test = _compared(means, at)
    figure = (
        f"median of the mean J {medians[at]:.1f}; lowest {medians.min():.1f} "
        f"at ({first.generations}, {first.members}); {test}"
    )
    comment = "Chance alone would make (70, 50) the best of nine in 11 % of the seeds."
    return judged(sentence, figure, np.argmin(means, axis=0) == at, comment=comment, verdict=verdict)


def _compared(means: Floats, at: int) -> tuple[ClaimVerdict, str]:
    """True if row `at` of (configurations, seeds) is the lowest, by tests over the seeds."""
    from scipy.stats import friedmanchisquare  # slow to import

    if means.shape[1] < 2 or not np.isfinite(means).all():
        return OPEN, "too few seeds with a number for a test"
    p = float(friedmanchisquare(*means).pvalue)
    text = f"Friedman p = {p:.2g}"
    if not p < SIGNIFICANT:
        return OPEN, f"{text}: no difference found"
    others = [i for i in range(len(means)) if i != at]
    ps = np.array([_wilcoxon(means[at], means[i]) for i in others])
    better = [i for i, corrected in zip(others, holm(ps), strict=True) if corrected < SIGNIFICANT]
    lower = [i for i in better if np.median(means[i] - means[at]) < 0.0]
    worse = [i for i in better if i not in lower]
    if lower:
        return FAILS, f"{text}; {len(lower)} of 8 are significantly lower, {len(worse)} significantly higher"
    verdict = HOLDS if len(worse) == len(others) else OPEN
    return verdict, f"{text}; significantly lower than {len(worse)} of 8, none is significantly lower"


def _wilcoxon(a: Floats, b: Floats) -> float:
    from scipy.stats import wilcoxon  # slow to import

    return 1.0 if np.all(a == b) else float(wilcoxon(a, b).pvalue)


def holm(p: Floats) -> Floats:
    """p values corrected for their number, after Holm."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def _cheap_configuration(f: Figures) -> Claim:
    cheapest = paper.CONFIGURATIONS[0]
    a, b = f.validation_j[cheapest], f.validation_j[paper.BEST]
    sentence = Sentence(
        "cheap-configuration",
        "Fewer generations and a smaller population can give higher errors, most of all in validation.",
        "Sec. 5, Table 3",
        "J of (50, 30), mean of 120 and 80 MPa, above that of (70, 50)",
    )
    figure = f"(50, 30): {spread(a).median:.0f}, (70, 50): {spread(b).median:.0f} (medians)"
    return judged(sentence, figure, a > b)
