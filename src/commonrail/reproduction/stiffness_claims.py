"""Claims of the paper on the stiffnesses that a search finds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from commonrail.arrays import Bools, Floats
from commonrail.reproduction import paper
from commonrail.reproduction.figures import Figures
from commonrail.reproduction.measures import spread
from commonrail.reproduction.verdict import Claim, Sentence, judged, percent, share

__all__ = ["stiffness_claims"]


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
    theory, optimal = paper.TABLE1_THEORETICAL, paper.TABLE1_OPTIMAL
    change = {name.rpartition(".")[2]: abs(optimal[name] / theory[name] - 1.0) for name in paper.NAMES}

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
