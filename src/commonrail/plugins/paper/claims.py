"""The paper's claims, each as a measure on every repetition and a verdict over all of them.

Their sentences are in claims.toml.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arrays import Bools, Floats
from commonrail.base.text import percent, to_signed
from commonrail.plugins.paper import study
from commonrail.plugins.paper.bench import SAMPLES
from commonrail.plugins.paper.figures import PHASES, WINDOWS, Figures, spread

# A claim of the paper, and the verdict over the seeds.

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
ClaimVerdict = str


class Claim(NamedTuple):
    """One claim: the paper's sentence in our words, its place in the paper, the measure, and the outcome.

    `verdict` is "holds", "does not hold" or "cannot be told"; the claim is true in `true_in` of `of` seeds, and
    `interval` is the 95 % interval of this share (Clopper and Pearson). `comment` adds what a reader must know, for
    example that the claim is built into the bench. `chance` is the share of random feasible stiffnesses that satisfy
    the claim without any search; None if the claim is not about stiffnesses.
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
    chance: float | None


@cache
def _texts() -> dict[str, dict[str, str]]:
    return tomllib.loads((files("commonrail.plugins.paper") / "claims.toml").read_text(encoding="utf-8"))


def judged(
    name: str,
    figure: str,
    true: ArrayLike,
    *,
    suffix: str = "",
    words: dict[str, object] | None = None,
    verdict: ClaimVerdict | None = None,
    valid: ArrayLike = True,
    chance: float | None = None,
) -> Claim:
    """Claim from its truth in each seed; seeds that are not `valid` have no number and are omitted.

    A claim holds if the 95 % interval of the share lies above one half, and does not hold if the interval lies below;
    `verdict` overrides this. The texts of `name` are filled with `words`; `suffix` is appended to the identifier.
    """
    from scipy.stats import binomtest  # slow to import

    texts = {key: text.format(**(words or {})) for key, text in ({"comment": ""} | _texts()[name]).items()}
    each = np.asarray(true, bool)
    each = each[np.broadcast_to(np.asarray(valid, bool), each.shape)]
    n, k = len(each), int(np.sum(each))
    low, high = map(float, binomtest(k, n).proportion_ci(0.95)) if n else (0.0, 1.0)
    if verdict is None or not n:
        verdict = HOLDS if low > 0.5 else FAILS if high < 0.5 else OPEN
    return Claim(
        name + suffix, **texts, figure=figure, verdict=verdict, true_in=k, of=n, interval=(low, high), chance=chance
    )


def _share(value: float) -> str:
    return f"{percent(value, 0)} %"


def _change(value: float) -> str:
    """Percent of a change, with its sign."""
    return f"{to_signed(100.0 * value, 0)} %"


# Claims on the search: how fast it converges, and with which settings.

RAPID = 0.5  # share of the generations: convergence is rapid if 90 % of the gain is reached earlier
SIGNIFICANT = 0.05


def _rapid(f: Figures) -> Claim:
    s = spread(f.ninety)
    limit = RAPID * study.BEST.generations
    figure = f"generation {s.median:.0f} (quartiles {s.q1:.0f} to {s.q3:.0f})"
    return judged("rapid", figure, f.ninety < limit, words={"limit": limit, "generations": study.BEST.generations})


def _best_configuration(f: Figures) -> Claim:
    means = np.array([f.mean_j[c] for c in study.CONFIGURATIONS])
    at = study.CONFIGURATIONS.index(study.BEST)
    medians = np.median(means, axis=1)
    first = study.CONFIGURATIONS[int(np.argmin(medians))]
    verdict, test = _compare(means, at)
    figure = (
        f"median of the mean J {medians[at]:.1f}; lowest {medians.min():.1f} "
        f"at ({first.generations}, {first.members}); {test}"
    )
    return judged("best-configuration", figure, np.argmin(means, axis=0) == at, verdict=verdict)


def _compare(means: Floats, at: int) -> tuple[ClaimVerdict, str]:
    """True if row `at` of (configurations, seeds) is the lowest, by tests over the seeds."""
    from scipy.stats import friedmanchisquare, wilcoxon  # slow to import

    if means.shape[1] < 2 or not np.isfinite(means).all():
        return OPEN, "too few seeds with a number for a test"
    p = float(friedmanchisquare(*means).pvalue)
    text = f"Friedman p = {p:.2g}"
    if not p < SIGNIFICANT:
        return OPEN, f"{text}: no difference found"
    others = [i for i in range(len(means)) if i != at]
    pairs = ((means[at], means[i]) for i in others)
    ps = np.array([1.0 if np.all(a == b) else float(wilcoxon(a, b).pvalue) for a, b in pairs])
    better = [i for i, corrected in zip(others, holm(ps), strict=True) if corrected < SIGNIFICANT]
    lower = [i for i in better if np.median(means[i] - means[at]) < 0.0]
    worse = [i for i in better if i not in lower]
    if lower:
        return FAILS, f"{text}; {len(lower)} of 8 are significantly lower, {len(worse)} significantly higher"
    verdict = HOLDS if len(worse) == len(others) else OPEN
    return verdict, f"{text}; significantly lower than {len(worse)} of 8, none is significantly lower"


def holm(p: Floats) -> Floats:
    """p values corrected for their number, after Holm."""
    order = np.argsort(p)
    steps = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    corrected = np.empty_like(p)
    corrected[order] = np.minimum(steps, 1.0)
    return corrected


def _cheap_configuration(f: Figures) -> Claim:
    a, b = f.validation_j[study.CONFIGURATIONS[0]], f.validation_j[study.BEST]
    figure = f"(50, 30): {spread(a).median:.0f}, (70, 50): {spread(b).median:.0f} (medians)"
    return judged("cheap-configuration", figure, a > b)


# Claims on the stiffnesses that a search finds.


def _stiffer(f: Figures) -> Claim:
    low, q1, q3 = map(_change, spread(np.min(f.change, axis=1)))
    figure = f"smallest change of the seven {low} (quartiles {q1} to {q3})"
    chance = float(np.mean(np.all(f.random_change > 0.0, axis=1)))
    return judged("stiffer", figure, np.all(f.change > 0.0, axis=1), chance=chance)


class _Group(NamedTuple):
    """Stiffnesses (places) that the paper compares with theory by one word, and the limit of change for the word.

    The limits are the paper's own figures: the upper limit of a word is the largest change in Table 1 that it
    describes; its lower limit is the upper limit of the next weaker word.
    """

    name: str
    places: tuple[int, ...]
    beyond: bool
    limit: float

    def true(self, change: Floats) -> Bools:
        """True if changes (..., 7) satisfy the claim."""
        size = np.abs(change[..., self.places])
        return np.asarray(np.all((size > self.limit) == self.beyond, axis=-1))


def _groups() -> tuple[_Group, ...]:
    change = [abs(study.TABLE1_OPTIMAL[name] / study.TABLE1_THEORETICAL[name] - 1.0) for name in study.NAMES]
    coincide, close, significant = max(change[1], change[2]), max(change[4], change[6]), change[3]
    return (
        _Group("near-theory", (1, 2), False, coincide),
        _Group("close-to-theory", (4, 6), False, close),
        _Group("k4-from-theory", (3,), True, close),
        _Group("far-from-theory", (0, 5), True, significant),
    )


def _stiffness(f: Figures, group: _Group) -> Claim:
    # whether the data say anything of these stiffnesses by themselves in most of the seeds
    determined = all(f.verdicts(i).get("determined", 0) > 0.5 * len(f.seeds) for i in group.places)
    comment = "" if determined else " The curve at 160 MPa does not determine them by themselves."
    changes = ", ".join(f"k{i + 1} {_change(spread(f.change[:, i]).median)}" for i in group.places)
    return judged(
        group.name,
        f"{changes} (medians)",
        group.true(f.change),
        words={"limit": 100.0 * group.limit, "pinned": comment},
        chance=float(np.mean(group.true(f.random_change))),
    )


SMALL_CLEARANCE = (0, 3, 5)  # k1, k4 and k6: cylinders with the most friction in the default truth


def _clearance(f: Figures) -> Claim:
    ratio, random_ratio = (
        np.min(np.abs(change[:, SMALL_CLEARANCE]), axis=1)
        / np.max(np.abs(np.delete(change, SMALL_CLEARANCE, axis=1)), axis=1)
        for change in (f.change, f.random_change)
    )
    s = spread(ratio)
    figure = f"least of the three over greatest of the four {s.median:.1f} (quartiles {s.q1:.1f} to {s.q3:.1f})"
    return judged("clearance", figure, ratio > 1.0, chance=float(np.mean(random_ratio > 1.0)))


def _k6_at_maximum(f: Figures) -> Claim:
    figure = f"{_share(spread(f.k6_high).median)} of the members (median)"
    return judged("k6-at-maximum", figure, f.k6_high > 0.5, words={"at_random": _share(f.k6_high_at_random)})


# Claims on the models beside the experiment.


class _Model(NamedTuple):
    """A model that the claims are judged on: its label, how to call it, what to know of it."""

    label: str
    text: str = ""
    setting: str = ""
    suffix: str = ""


RIGID = (
    _Model("rigid", "the rigid body", "The rigid body keeps the drawing's stop and control volume."),
    _Model(
        "rigid_fitted",
        "a rigid body with fitted stop and control volume",
        "Stop and control volume are fitted to the curve at 160 MPa, as k1…k7 are.",
        "-fitted",
    ),
)


def claims(f: Figures) -> list[Claim]:
    """Every claim, in the order of the paper's Sec. 5."""
    low = f.phases["80 MPa"]
    return [
        *(_ordering(f, name, rigid) for rigid in RIGID for name in study.RAIL_PRESSURES),
        _rapid(f),
        _best_configuration(f),
        _cheap_configuration(f),
        _stiffer(f),
        *(_stiffness(f, group) for group in _groups()),
        _clearance(f),
        _k6_at_maximum(f),
        *(_smooth(f, rigid) for rigid in RIGID),
        *(_edge(f, rigid, "rigid-late", "opening", 1.0) for rigid in RIGID),
        *(_edge(f, rigid, "rigid-early", "closing", -1.0) for rigid in RIGID),
        _by_phase("theoretical-phases", f.phases[study.FIT]["theoretical"], "0.4–0.8 ms"),
        _edge(f, _Model("theoretical"), "theoretical-late", "opening", 1.0, ("120 MPa",)),
        _by_phase("gains-by-phase", low["theoretical"] - low["optimised"], "0.8 ms to the end"),
        _is_optimised_everywhere(f),
        _no_overfitting(f),
        *(_after_window(f, i) for i in range(len(WINDOWS))),
    ]


def _ordering(f: Figures, name: str, rigid: _Model) -> Claim:
    j = {label: f.j[name][label] for label in (rigid.label, "theoretical", "optimised")}
    medians = " / ".join(f"{spread(values).median:.0f}" for values in j.values())
    ordered = j["theoretical"] < j[rigid.label]
    curve = "the fitted curve" if name == study.FIT else "an unseen curve"
    return judged(
        "ordering",
        f"rigid / theoretical / optimised: {medians} (medians)",
        (j["optimised"] < j["theoretical"]) & ordered,
        suffix=f"{rigid.suffix}-{name.replace(' ', '')}",
        words={"data": name, "curve": curve, "rigid": rigid.text, "setting": rigid.setting},
        valid=np.isfinite(np.array(list(j.values()))).all(axis=0),
        chance=float(np.mean((f.random_j(name) < j["theoretical"][:, None]) & ordered[:, None])),
    )


def _smooth(f: Figures, rigid: _Model) -> Claim:
    """Less oscillation than both flexible models, at every pressure."""
    labels = (rigid.label, "theoretical", "optimised")
    each = np.array([[f.oscillation[name][label] for label in labels] for name in study.RAIL_PRESSURES])
    medians = (" / ".join(f"{spread(values).median:.1f}" for values in models) for models in each)
    figure = ", ".join(f"{text} at {name}" for text, name in zip(medians, study.RAIL_PRESSURES, strict=True))
    return judged(
        "rigid-smooth",
        f"rigid / theoretical / optimised, mm³/ms: {figure} (medians)",
        np.all(each[:, :1] < each[:, 1:], axis=(0, 1)),
        suffix=rigid.suffix,
        words={"Rigid": rigid.text.capitalize(), "setting": rigid.setting},
        valid=np.isfinite(each).all(axis=(0, 1)),
    )


def _edge(
    f: Figures, model: _Model, claim: str, which: str, sign: float, names: Sequence[str] = tuple(study.RAIL_PRESSURES)
) -> Claim:
    """Claim of late opening or early closing: edges of a model minus edges of the experiment (seeds, data) [us]."""
    each = np.array([f.edge_errors(name, model.label, which) for name in names]).T * 1e6
    medians = (f"{to_signed(spread(e).median, 1)} µs at {n}" for e, n in zip(each.T, names, strict=True))
    return judged(
        claim,
        ", ".join(medians),
        np.all(sign * each > 0.0, axis=1),
        suffix=model.suffix,
        words={"Rigid": model.text.capitalize(), "setting": model.setting},
        valid=np.isfinite(each).all(axis=1),
    )


def _by_phase(claim: str, j: Floats, lowest: str) -> Claim:
    """Claim that one phase (rise, middle or descent) has the lowest part of J (seeds, phases), or of a gain in J."""
    figure = " / ".join(f"{spread(phase).median:.0f}".replace("-", "−") for phase in j[:, 1:].T)
    is_lowest = np.argmin(j[:, 1:], axis=1) == PHASES.index(lowest) - 1
    true = is_lowest & np.isfinite(j[:, 1:]).all(axis=1)  # argmin returns the position of a NaN
    return judged(claim, f"rise / middle / descent: {figure} (medians)", true)


def _is_optimised_everywhere(f: Figures) -> Claim:
    better = np.array([f.phases[n]["optimised"] < f.phases[n]["theoretical"] for n in study.RAIL_PRESSURES])[:, :, 1:]
    each = np.moveaxis(better, 1, 0).reshape(len(f.seeds), -1)
    shares = np.mean(each, axis=0)
    at = int(np.argmin(shares))
    name = list(study.RAIL_PRESSURES)[at // 3]
    figure = (
        f"{_share(float(np.mean(each)))} of all phases; rarest at {name}, {PHASES[1 + at % 3]}: "
        f"{_share(float(shares[at]))} of the seeds"
    )
    return judged("optimised-everywhere", figure, np.all(each, axis=1))


def _after_window(f: Figures, i: int) -> Claim:
    j = f.j[study.FIT]["optimised"]
    inside, samples = f.windows[study.FIT]["optimised"][:, i].T
    figure = f"J {spread(j).median:.1f} of {SAMPLES} samples, {spread(inside).median:.1f} of {np.median(samples):.0f}"
    true, valid = inside * SAMPLES < j * samples, np.isfinite(j) & (samples > 0) & (samples < SAMPLES)
    words: dict[str, object] = {"window": WINDOWS[i]}
    return judged("window", f"{figure} (medians)", true, suffix=("", "-energising")[i], words=words, valid=valid)


def _no_overfitting(f: Figures) -> Claim:
    gains_kept = np.array([f.gain_kept(name) for name in study.VALIDATION])
    figure = ", ".join(f"{_share(spread(gains_kept[i]).median)} at {name}" for i, name in enumerate(study.VALIDATION))
    return judged("no-overfitting", f"share of the gain kept: {figure} (medians)", np.all(gains_kept >= 0.5, axis=0))
