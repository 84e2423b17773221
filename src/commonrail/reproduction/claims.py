"""The paper's claims, each as a measure on every repetition and a verdict over all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import binomtest, friedmanchisquare, wilcoxon

from commonrail.reproduction import paper
from commonrail.reproduction.figures import Figures
from commonrail.reproduction.measures import PHASES, spread

__all__ = ["Claim", "Verdict", "claims"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

NEAR, FAR = 0.2, 0.5  # a stiffness is near its theoretical value, or far from it, by these shares
RAPID = 0.5  # of the generations: convergence is rapid if 90 % of the gain is reached before
SIGNIFICANT = 0.05

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
Verdict = str


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
    """

    id: str
    claim: str
    where: str
    measure: str
    figure: str
    verdict: Verdict
    true_in: int
    of: int
    interval: tuple[float, float]
    comment: str


class _Sentence(NamedTuple):
    id: str
    claim: str
    where: str
    measure: str


def claims(f: Figures) -> list[Claim]:
    """Every claim, in the order of the paper's Sec. 5."""
    return [
        *(_ordering(f, name) for name in paper.RAIL_PRESSURES),
        _rapid(f),
        _best_configuration(f),
        _cheap_configuration(f),
        _stiffer(f),
        _near_theory(f),
        _far_from_theory(f),
        _k6_at_maximum(f),
        _rigid_late(f),
        _rigid_early(f),
        _theoretical_phases(f),
        _optimised_everywhere(f),
        _no_overfitting(f),
    ]


def _judged(
    s: _Sentence,
    figure: str,
    true: ArrayLike,
    comment: str = "",
    verdict: Verdict | None = None,
    valid: ArrayLike = True,
) -> Claim:
    """Claim from what is true in each seed; a verdict given stands, otherwise the interval of the share decides.

    It holds if the 95 % interval lies above one half, and does not if it lies below. Seeds without a number, those
    that are not `valid`, are left out.
    """
    each = np.asarray(true, bool)
    each = each[np.broadcast_to(np.asarray(valid, bool), each.shape)]
    n, k = len(each), int(np.sum(each))
    if not n:
        return Claim(*s, figure, OPEN, 0, 0, (0.0, 1.0), comment)
    interval = binomtest(k, n).proportion_ci(0.95)
    if verdict is None:
        verdict = HOLDS if interval.low > 0.5 else FAILS if interval.high < 0.5 else OPEN
    return Claim(*s, figure, verdict, k, n, (float(interval.low), float(interval.high)), comment)


def _ordering(f: Figures, name: str) -> Claim:
    j = {label: f.j[name][label] for label in ("rigid", "theoretical", "optimised")}
    medians = " / ".join(f"{spread(j[label]).median:.0f}" for label in j)
    fitted = "the fitted curve" if name == paper.FIT else "an unseen curve"
    sentence = _Sentence(
        f"ordering-{name.replace(' ', '')}",
        f"At {name}, {fitted}, the optimised model beats the theoretical one, and both beat the rigid body.",
        "Sec. 5, Fig. 6",
        "J optimised < J theoretical < J rigid",
    )
    return _judged(
        sentence,
        f"rigid / theoretical / optimised: {medians} (medians)",
        (j["optimised"] < j["theoretical"]) & (j["theoretical"] < j["rigid"]),
        "The bench's truth is a flexible chain; the rigid body keeps the drawing's stop.",
        valid=np.isfinite(np.array(list(j.values()))).all(axis=0),
    )


def _rapid(f: Figures) -> Claim:
    s = spread(f.ninety)
    limit = RAPID * paper.BEST.generations
    sentence = _Sentence(
        "rapid",
        "Convergence is rapid.",
        "Sec. 5, Fig. 4",
        f"generation at which 90 % of the gain over the first population is reached, before {limit:.0f} "
        f"of {paper.BEST.generations}",
    )
    return _judged(sentence, f"generation {s.median:.0f} (quartiles {s.q1:.0f} to {s.q3:.0f})", f.ninety < limit)


def _best_configuration(f: Figures) -> Claim:
    sentence = _Sentence(
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
    return _judged(sentence, figure, np.argmin(means, axis=0) == at, comment, verdict)


def _compared(means: Floats, at: int) -> tuple[Verdict, str]:
    """Whether row `at` of (configurations, seeds) is the lowest, by tests over the seeds."""
    if means.shape[1] < 2 or not np.isfinite(means).all():
        return OPEN, "too few seeds with a number for a test"
    p = float(friedmanchisquare(*means).pvalue)
    text = f"Friedman p = {p:.2g}"
    if not p < SIGNIFICANT:
        return OPEN, f"{text}: no difference found"
    others = [i for i in range(len(means)) if i != at]
    ps = np.array([_wilcoxon(means[at], means[i]) for i in others])
    better = [i for i, holm in zip(others, _holm(ps), strict=True) if holm < SIGNIFICANT]
    lower = [i for i in better if np.median(means[i] - means[at]) < 0.0]
    worse = [i for i in better if i not in lower]
    if lower:
        return FAILS, f"{text}; {len(lower)} of 8 are significantly lower, {len(worse)} significantly higher"
    verdict = HOLDS if len(worse) == len(others) else OPEN
    return verdict, f"{text}; significantly lower than {len(worse)} of 8, none is significantly lower"


def _wilcoxon(a: Floats, b: Floats) -> float:
    return 1.0 if np.all(a == b) else float(wilcoxon(a, b).pvalue)


def _holm(p: Floats) -> Floats:
    """p values corrected for their number, after Holm."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def _cheap_configuration(f: Figures) -> Claim:
    cheapest = paper.CONFIGURATIONS[0]
    a, b = f.validation_j[cheapest], f.validation_j[paper.BEST]
    sentence = _Sentence(
        "cheap-configuration",
        "Fewer generations and a smaller population can give higher errors, most of all in validation.",
        "Sec. 5, Table 3",
        "J of (50, 30), mean of 120 and 80 MPa, above that of (70, 50)",
    )
    figure = f"(50, 30): {spread(a).median:.0f}, (70, 50): {spread(b).median:.0f} (medians)"
    return _judged(sentence, figure, a > b)


def _stiffer(f: Figures) -> Claim:
    lowest = spread(np.min(f.change, axis=1))
    sentence = _Sentence(
        "stiffer",
        "The optimised stiffnesses are higher than the theoretical ones, because the model has no guide friction.",
        "Sec. 5, Table 1",
        "all of k1…k7 above theory",
    )
    low, q1, q3 = (_percent(value) for value in lowest)
    figure = f"smallest change of the seven {low} (quartiles {q1} to {q3})"
    comment = f"{_TRUE_K} Whether friction alone would raise k is not tested here."
    return _judged(sentence, figure, np.all(f.change > 0.0, axis=1), comment)


_TRUE_K = "It depends on the bench's true k, which the default truth takes from the paper's optimum."


def _changes(f: Figures, symbols: Sequence[str]) -> str:
    found = [f"{s} {_percent(spread(f.change[:, _index(s)]).median)}" for s in symbols]
    return ", ".join(found) + " (medians)"


def _index(symbol: str) -> int:
    return int(symbol[1:]) - 1


def _pinned(f: Figures, symbols: Sequence[str]) -> bool:
    """Whether the data say anything of these stiffnesses by themselves in most of the seeds."""
    return all(f.verdicts(_index(s)).get("pinned down", 0) > 0.5 * len(f.seeds) for s in symbols)


def _stiffness(f: Figures, sentence: _Sentence, symbols: Sequence[str], test: Callable[[Floats], Bools]) -> Claim:
    change = f.change[:, [_index(s) for s in symbols]]
    comment = _TRUE_K
    if not _pinned(f, symbols):
        comment += " The curve at 160 MPa pins them down only together with others."
    return _judged(sentence, _changes(f, symbols), np.all(test(change), axis=1), comment)


def _near_theory(f: Figures) -> Claim:
    sentence = _Sentence(
        "near-theory",
        "The optimised k2 and k3 practically coincide with theory.",
        "Sec. 5, Table 1",
        f"both within {100 * NEAR:.0f} % of theory",
    )
    return _stiffness(f, sentence, ("k2", "k3"), lambda change: np.abs(change) <= NEAR)


def _far_from_theory(f: Figures) -> Claim:
    sentence = _Sentence(
        "far-from-theory",
        "The optimised k1 and k6 differ remarkably from theory.",
        "Sec. 5, Table 1",
        f"both more than {100 * FAR:.0f} % from theory",
    )
    return _stiffness(f, sentence, ("k1", "k6"), lambda change: np.abs(change) > FAR)


def _k6_at_maximum(f: Figures) -> Claim:
    sentence = _Sentence(
        "k6-at-maximum",
        "Most values of k6 in the search lie close to its maximum.",
        "Sec. 5, Fig. 5",
        "more than half of all members of the search in the upper fifth of k6's range",
    )
    s = spread(f.k6_high)
    comment = "The paper's maximum is not printed; here it is 3 times the theoretical value."
    return _judged(sentence, f"{_share(s.median)} of the members (median)", f.k6_high > 0.5, comment)


def _edge(f: Figures, which: str) -> tuple[str, Floats]:
    """Rigid minus experiment at each pressure, as text and (seeds, 3) microseconds."""
    each = np.array([f.edge_errors(name, "rigid", which) for name in paper.RAIL_PRESSURES]).T * 1e6
    medians = ", ".join(
        f"{_signed(spread(each[:, i]).median, 1)} µs at {name}" for i, name in enumerate(paper.RAIL_PRESSURES)
    )
    return medians, each


def _rigid_late(f: Figures) -> Claim:
    text, each = _edge(f, "opening")
    sentence = _Sentence(
        "rigid-late",
        "The rigid body opens late.",
        "Sec. 5, Fig. 6",
        "its opening minus the experiment's > 0 at all three pressures; edges at 10 % of the greatest rate",
    )
    comment = (
        "A compressed chain must stretch before its tip leaves the seat, and displaces fuel while it does; a rigid "
        "body need not. The paper does not say how its rigid model was set up."
    )
    return _judged(sentence, text, np.all(each > 0.0, axis=1), comment, valid=np.isfinite(each).all(axis=1))


def _rigid_early(f: Figures) -> Claim:
    text, each = _edge(f, "closing")
    sentence = _Sentence(
        "rigid-early",
        "The rigid body closes early.",
        "Sec. 5, Fig. 6",
        "its closing minus the experiment's < 0 at all three pressures",
    )
    comment = "It depends on the rigid body's stop: with 60 to 100 µm more it closes late at the lower pressures."
    return _judged(sentence, text, np.all(each < 0.0, axis=1), comment, valid=np.isfinite(each).all(axis=1))


def _theoretical_phases(f: Figures) -> Claim:
    parts = f.phases[paper.FIT]["theoretical"]
    rise, middle, descent = (parts[:, PHASES.index(name)] for name in PHASES[1:])
    sentence = _Sentence(
        "theoretical-phases",
        "At 160 MPa the theoretical model is off in the rise and in the descent.",
        "Sec. 5, Fig. 6",
        "J of 0–0.4 ms and of 0.8 ms to the end each above J of 0.4–0.8 ms",
    )
    figure = " / ".join(f"{spread(part).median:.0f}" for part in (rise, middle, descent))
    return _judged(sentence, f"rise / middle / descent: {figure} (medians)", (rise > middle) & (descent > middle))


def _optimised_everywhere(f: Figures) -> Claim:
    sentence = _Sentence(
        "optimised-everywhere",
        "The optimised model is the better one in every phase at every pressure.",
        "Sec. 5, Fig. 6",
        "J optimised < J theoretical in the rise, the middle and the descent at 160, 120 and 80 MPa",
    )
    better = np.array([f.phases[n]["optimised"] < f.phases[n]["theoretical"] for n in paper.RAIL_PRESSURES])[:, :, 1:]
    each = np.moveaxis(better, 1, 0).reshape(len(f.seeds), -1)
    worst = np.mean(each, axis=0)
    at = int(np.argmin(worst))
    name = list(paper.RAIL_PRESSURES)[at // 3]
    figure = (
        f"{_share(float(np.mean(each)))} of all phases; rarest at {name}, {PHASES[1 + at % 3]}: "
        f"{_share(worst[at])} of the seeds"
    )
    return _judged(sentence, figure, np.all(each, axis=1))


def _no_overfitting(f: Figures) -> Claim:
    sentence = _Sentence(
        "no-overfitting",
        "Fitting one pressure does not overfit: the others are predicted well.",
        "Sec. 5",
        "at 120 and 80 MPa at least half of the gain that a fit to that very curve would bring",
    )
    kept = np.array([f.gain_kept(name) for name in paper.VALIDATION])
    figure = ", ".join(f"{_share(spread(kept[i]).median)} at {name}" for i, name in enumerate(paper.VALIDATION))
    return _judged(sentence, f"share of the gain kept: {figure} (medians)", np.all(kept >= 0.5, axis=0))


def _share(value: float) -> str:
    return f"{100.0 * value:.0f} %"


def _percent(change: float) -> str:
    return f"{_signed(100.0 * change, 0)} %"


def _signed(value: float, decimals: int) -> str:
    return f"{value:+.{decimals}f}".replace("-", "\N{MINUS SIGN}")
