"""Reasons for which a feature of a trace has no number, each with a sentence that says what to do."""

from __future__ import annotations

from enum import StrEnum

__all__ = ["FeatureStatus"]


class FeatureStatus(StrEnum):
    """Outcome of the search for the features of a trace, or of one injection in it."""

    OK = "ok"
    NO_INJECTION = "no injection"
    HIDDEN_IN_NOISE = "hidden in noise"
    CUT_AT_START = "cut at start"
    CUT_AT_END = "cut at end"
    FUSED = "fused"
    NO_PLATEAU = "no plateau"
    NO_ENERGISING = "no energising"
    REOPENED = "reopened"

    @property
    def sentence(self) -> str:
        """Meaning and cure in one sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    FeatureStatus.OK: "All features were found.",
    FeatureStatus.NO_INJECTION: "The rate does not rise above the threshold; lower the threshold if something is seen.",
    FeatureStatus.HIDDEN_IN_NOISE: (
        "The noise is too large for the threshold: four standard deviations exceed its hysteresis; raise the "
        "threshold or average over a longer time."
    ),
    FeatureStatus.CUT_AT_START: "The trace begins while fuel is injected; it has no opening.",
    FeatureStatus.CUT_AT_END: "The trace ends while fuel is injected; it has no closing.",
    FeatureStatus.FUSED: (
        "The rate does not fall below the threshold between this injection and the next or the previous one; they are "
        "divided where the rate is smallest."
    ),
    FeatureStatus.NO_PLATEAU: "The rate is near its largest value for less than half of the duration; none is steady.",
    FeatureStatus.NO_ENERGISING: "No energising starts before this injection; it has no delays.",
    FeatureStatus.REOPENED: "The injector opened again after the same energising.",
}
