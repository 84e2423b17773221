"""The paper's claims, each as a measure on every repetition and a verdict over all of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.reproduction import paper
from commonrail.reproduction.figures import Figures
from commonrail.reproduction.measures import PHASES, spread
from commonrail.reproduction.search_claims import search_claims
from commonrail.reproduction.stiffness_claims import stiffness_claims
from commonrail.reproduction.verdict import Claim, Sentence, judged, share, signed

__all__ = ["claims"]


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
        *(_ordering(f, name, rigid) for rigid in RIGID for name in paper.RAIL_PRESSURES),
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
    fitted = "the fitted curve" if name == paper.FIT else "an unseen curve"
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
    each = np.array([f.edge_errors(name, rigid.label, which) for name in paper.RAIL_PRESSURES]).T * 1e6
    medians = (f"{signed(spread(e).median, 1)} µs at {n}" for e, n in zip(each.T, paper.RAIL_PRESSURES, strict=True))
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
    parts = f.phases[paper.FIT]["theoretical"]
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
    better = np.array([f.phases[n]["optimised"] < f.phases[n]["theoretical"] for n in paper.RAIL_PRESSURES])[:, :, 1:]
    each = np.moveaxis(better, 1, 0).reshape(len(f.seeds), -1)
    worst = np.mean(each, axis=0)
    at = int(np.argmin(worst))
    name = list(paper.RAIL_PRESSURES)[at // 3]
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
    kept = np.array([f.gain_kept(name) for name in paper.VALIDATION])
    figure = ", ".join(f"{share(spread(kept[i]).median)} at {name}" for i, name in enumerate(paper.VALIDATION))
    return judged(sentence, f"share of the gain kept: {figure} (medians)", np.all(kept >= 0.5, axis=0))
