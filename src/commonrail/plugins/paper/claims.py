"""The paper's claims, each as a measure on every repetition and a verdict over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arrays import Bools, Floats
from commonrail.plugins.paper import study
from commonrail.plugins.paper.figures import PHASES, Figures, spread

# A claim of the paper, and the verdict over the seeds.

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
ClaimVerdict = str


class Claim(NamedTuple):
    """One claim: the paper's sentence in our words and where it stands, what is measured, and what came out.

    `verdict` is "holds", "does not hold" or "cannot be told"; it is true in `true_in` seeds `of` all, and `interval` is
    the 95 % interval of that share (Clopper and Pearson). `comment` is what else a reader must know, such as that the
    bench builds it in. `chance` is the share of random feasible stiffnesses that satisfy the claim without any search;
    None where it is not of them.
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
    """Claim from what is true in each seed; those that are not `valid` have no number and are left out.

    It holds if the 95 % interval of the share lies above one half, and does not if it lies below; `verdict` stands in
    its place.
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


# Claims of the paper on the search: how fast it converges, and with which settings.

RAPID = 0.5  # of the generations: convergence is rapid if 90 % of the gain is reached before
SIGNIFICANT = 0.05


def search_claims(f: Figures) -> list[Claim]:
    """Claims on Fig. 4 and Table 3."""
    return [_rapid(f), _best_configuration(f), _cheap_configuration(f)]


def _rapid(f: Figures) -> Claim:
    s = spread(f.ninety)
    limit = RAPID * study.BEST.generations
    sentence = Sentence(
        "rapid",
        "Convergence is rapid.",
        "Sec. 5, Fig. 4",
        f"generation at which 90 % of the gain over the first population is reached, before {limit:.0f} "
        f"of {study.BEST.generations}",
    )
    return judged(sentence, f"generation {s.median:.0f} (quartiles {s.q1:.0f} to {s.q3:.0f})", f.ninety < limit)


def _best_configuration(f: Figures) -> Claim:
    sentence = Sentence(
        "best-configuration",
        "Of the nine (Gmax, Npop), (70, 50) gives the lowest J averaged over the three pressures.",
        "Sec. 5, Table 3",
        "(70, 50) has the lowest mean J; Friedman's test over the nine, Wilcoxon's against each (Holm)",
    )
    means = np.array([f.mean_j[c] for c in study.CONFIGURATIONS])
    at = study.CONFIGURATIONS.index(study.BEST)
    medians = np.median(means, axis=1)
    first = study.CONFIGURATIONS[int(np.argmin(medians))]
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
    cheapest = study.CONFIGURATIONS[0]
    a, b = f.validation_j[cheapest], f.validation_j[study.BEST]
    sentence = Sentence(
        "cheap-configuration",
        "Fewer generations and a smaller population can give higher errors, most of all in validation.",
        "Sec. 5, Table 3",
        "J of (50, 30), mean of 120 and 80 MPa, above that of (70, 50)",
    )
    figure = f"(50, 30): {spread(a).median:.0f}, (70, 50): {spread(b).median:.0f} (medians)"
    return judged(sentence, figure, a > b)


# Claims of the paper on the stiffnesses that a search finds.


def stiffness_claims(f: Figures) -> list[Claim]:
    """Claims on Table 1 and Fig. 5."""
    return [_stiffer(f), *(_stiffness(f, group) for group in _GROUPS), _k6_at_maximum(f)]


def _stiffer(f: Figures) -> Claim:
    lowest = spread(np.min(f.change, axis=1))
    sentence = Sentence(
        "stiffer",
        "The optimised stiffnesses are higher than the theoretical ones, because the model has no guide friction.",
        "Sec. 5, Table 1",
        "all of k1…k7 above theory",
    )
    low, q1, q3 = (percent(value) for value in lowest)
    figure = f"smallest change of the seven {low} (quartiles {q1} to {q3})"
    comment = f"{_TRUE_K} Whether friction alone would raise k is not tested here."
    chance = float(np.mean(np.all(f.random_change > 0.0, axis=1)))
    return judged(sentence, figure, np.all(f.change > 0.0, axis=1), comment=comment, chance=chance)


_TRUE_K = "It depends on the bench's true k, which the default truth takes from the paper's optimum."


def _changes(f: Figures, symbols: Sequence[str]) -> str:
    found = [f"{s} {percent(spread(f.change[:, _index(s)]).median)}" for s in symbols]
    return ", ".join(found) + " (medians)"


def _index(symbol: str) -> int:
    return int(symbol[1:]) - 1


def _pinned(f: Figures, symbols: Sequence[str]) -> bool:
    """True if the data say anything of these stiffnesses by themselves in most of the seeds."""
    return all(f.verdicts(_index(s)).get("pinned", 0) > 0.5 * len(f.seeds) for s in symbols)


class _Group(NamedTuple):
    """Stiffnesses that the paper compares with theory in one word, and how far from it they are then.

    The limits are the paper's own figures: a word reaches as far as the largest change in Table 1 that it is used of,
    and begins where the next weaker word ends.
    """

    id: str
    words: str
    symbols: tuple[str, ...]
    beyond: bool
    limit: float
    origin: str

    @property
    def measure(self) -> str:
        """Sentence of the report."""
        all_of = "both " if len(self.symbols) == 2 else ""
        relation = "more than" if self.beyond else "at most"
        return f"{all_of}{relation} {100.0 * self.limit:.1f} % from theory, {self.origin}"

    def true(self, change: Floats) -> Bools:
        """True where changes (..., 7) satisfy the claim."""
        own = np.abs(change[..., [_index(s) for s in self.symbols]])
        return np.asarray(np.all((own > self.limit) == self.beyond, axis=-1))


def _groups() -> tuple[_Group, ...]:
    theory, optimal = study.TABLE1_THEORETICAL, study.TABLE1_OPTIMAL
    change = {name.rpartition(".")[2]: abs(optimal[name] / theory[name] - 1.0) for name in study.NAMES}

    def largest(*symbols: str) -> float:
        return max(change[s] for s in symbols)

    coincide, close, significant = largest("k2", "k3"), largest("k5", "k7"), largest("k4")
    as_in = "as in the paper's Table 1"
    return (
        _Group("near-theory", "practically coincide with theory", ("k2", "k3"), False, coincide, as_in),
        _Group("close-to-theory", "are very close to theory", ("k5", "k7"), False, close, as_in),
        _Group(
            "k4-from-theory", "differs significantly from theory", ("k4",), True, close, "where very close ends there"
        ),
        _Group(
            "far-from-theory",
            "differ remarkably from theory",
            ("k1", "k6"),
            True,
            significant,
            "the significant difference there",
        ),
    )


def _stiffness(f: Figures, group: _Group) -> Claim:
    sentence = Sentence(
        group.id, f"The optimised {' and '.join(group.symbols)} {group.words}.", "Sec. 5, Table 1", group.measure
    )
    comment = _TRUE_K
    if not _pinned(f, group.symbols):
        comment += " The curve at 160 MPa does not determine them by themselves."
    chance = float(np.mean(group.true(f.random_change)))
    return judged(sentence, _changes(f, group.symbols), group.true(f.change), comment=comment, chance=chance)


_GROUPS = _groups()


def _k6_at_maximum(f: Figures) -> Claim:
    sentence = Sentence(
        "k6-at-maximum",
        "Most values of k6 in the search lie close to its maximum.",
        "Sec. 5, Fig. 5",
        "more than half of all members of the search in the upper fifth of k6's range",
    )
    s = spread(f.k6_high)
    comment = (
        "The paper's maximum is not printed; here it is 3 times the theoretical value. Of random feasible points "
        f"{share(f.k6_high_at_random)} lie there, because the ordering makes k6 the largest."
    )
    return judged(sentence, f"{share(s.median)} of the members (median)", f.k6_high > 0.5, comment=comment)


class _Rigid(NamedTuple):
    """A rigid body that the claims are judged on: its label, how to call it, what to know of it."""

    label: str
    text: str
    comment: str
    suffix: str = ""


RIGID = (
    _Rigid("rigid", "the rigid body", "The rigid body keeps the drawing's stop and control volume."),
    _Rigid(
        "rigid_fitted",
        "a rigid body with fitted stop and control volume",
        "Stop and control volume are fitted to the curve at 160 MPa, as k1…k7 are.",
        "-fitted",
    ),
)


def claims(f: Figures) -> list[Claim]:
    """Every claim, in the order of the paper's Sec. 5."""
    return [
        *(_ordering(f, name, rigid) for rigid in RIGID for name in study.RAIL_PRESSURES),
        *search_claims(f),
        *stiffness_claims(f),
        *(_rigid_late(f, rigid) for rigid in RIGID),
        *(_rigid_early(f, rigid) for rigid in RIGID),
        _theoretical_phases(f),
        _optimised_everywhere(f),
        _no_overfitting(f),
    ]


def _ordering(f: Figures, name: str, rigid: _Rigid) -> Claim:
    j = {label: f.j[name][label] for label in (rigid.label, "theoretical", "optimised")}
    medians = " / ".join(f"{spread(j[label]).median:.0f}" for label in j)
    fitted = "the fitted curve" if name == study.FIT else "an unseen curve"
    sentence = Sentence(
        f"ordering{rigid.suffix}-{name.replace(' ', '')}",
        f"At {name}, {fitted}, the optimised model beats the theoretical one, and both beat {rigid.text}.",
        "Sec. 5, Fig. 6",
        "J optimised < J theoretical < J rigid",
    )
    ordered = j["theoretical"] < j[rigid.label]
    return judged(
        sentence,
        f"rigid / theoretical / optimised: {medians} (medians)",
        (j["optimised"] < j["theoretical"]) & ordered,
        comment=f"The bench's truth is a flexible chain. {rigid.comment}",
        valid=np.isfinite(np.array(list(j.values()))).all(axis=0),
        chance=float(np.mean((f.random_j(name) < j["theoretical"][:, None]) & ordered[:, None])),
    )


def _edge(f: Figures, rigid: _Rigid, which: str, sentence: Sentence, comment: str) -> Claim:
    """Opening late, or closing early, by a model's edges less the experiment's (seeds, 3) [us]."""
    each = np.array([f.edge_errors(name, rigid.label, which) for name in study.RAIL_PRESSURES]).T * 1e6
    medians = (f"{signed(spread(e).median, 1)} µs at {n}" for e, n in zip(each.T, study.RAIL_PRESSURES, strict=True))
    true = np.all(each > 0.0 if which == "opening" else each < 0.0, axis=1)
    text = f"{rigid.comment} {comment}"
    return judged(sentence, ", ".join(medians), true, comment=text, valid=np.isfinite(each).all(axis=1))


def _rigid_late(f: Figures, rigid: _Rigid) -> Claim:
    sentence = Sentence(
        f"rigid-late{rigid.suffix}",
        f"{rigid.text.capitalize()} opens late.",
        "Sec. 5, Fig. 6",
        "its opening minus the experiment's > 0 at all three pressures; edges at 10 % of the greatest rate",
    )
    comment = (
        "A compressed chain must stretch before its tip leaves the seat, and displaces fuel while it "
        "does; a rigid body need not. The paper does not say how its rigid model was set up."
    )
    return _edge(f, rigid, "opening", sentence, comment)


def _rigid_early(f: Figures, rigid: _Rigid) -> Claim:
    sentence = Sentence(
        f"rigid-early{rigid.suffix}",
        f"{rigid.text.capitalize()} closes early.",
        "Sec. 5, Fig. 6",
        "its closing minus the experiment's < 0 at all three pressures; "
        "the last closing counts, that of a rebound included",
    )
    return _edge(f, rigid, "closing", sentence, "When a rigid body closes depends on its stop.")


def _theoretical_phases(f: Figures) -> Claim:
    parts = f.phases[study.FIT]["theoretical"]
    rise, middle, descent = (parts[:, PHASES.index(name)] for name in PHASES[1:])
    sentence = Sentence(
        "theoretical-phases",
        "At 160 MPa the theoretical model is off in the rise and in the descent.",
        "Sec. 5, Fig. 6",
        "J of 0–0.4 ms and of 0.8 ms to the end each above J of 0.4–0.8 ms",
    )
    figure = " / ".join(f"{spread(part).median:.0f}" for part in (rise, middle, descent))
    return judged(sentence, f"rise / middle / descent: {figure} (medians)", (rise > middle) & (descent > middle))


def _optimised_everywhere(f: Figures) -> Claim:
    sentence = Sentence(
        "optimised-everywhere",
        "The optimised model is the better one in every phase at every pressure.",
        "Sec. 5, Fig. 6",
        "J optimised < J theoretical in the rise, the middle and the descent at 160, 120 and 80 MPa",
    )
    better = np.array([f.phases[n]["optimised"] < f.phases[n]["theoretical"] for n in study.RAIL_PRESSURES])[:, :, 1:]
    each = np.moveaxis(better, 1, 0).reshape(len(f.seeds), -1)
    worst = np.mean(each, axis=0)
    at = int(np.argmin(worst))
    name = list(study.RAIL_PRESSURES)[at // 3]
    figure = (
        f"{share(float(np.mean(each)))} of all phases; rarest at {name}, {PHASES[1 + at % 3]}: "
        f"{share(worst[at])} of the seeds"
    )
    return judged(sentence, figure, np.all(each, axis=1))


def _no_overfitting(f: Figures) -> Claim:
    sentence = Sentence(
        "no-overfitting",
        "Fitting one pressure does not overfit: the others are predicted well.",
        "Sec. 5",
        "at 120 and 80 MPa at least half of the gain that a fit to that very curve would bring",
    )
    kept = np.array([f.gain_kept(name) for name in study.VALIDATION])
    figure = ", ".join(f"{share(spread(kept[i]).median)} at {name}" for i, name in enumerate(study.VALIDATION))
    return judged(sentence, f"share of the gain kept: {figure} (medians)", np.all(kept >= 0.5, axis=0))
