"""Targets that a fleet was computed on: its table need not be that of one target alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from commonrail.calibration.search import objective_of
from commonrail.calibration.study import Study
from commonrail.errors import CommonrailError
from commonrail.fleet.journal import FINISHED, Entry, Journal
from commonrail.store.targets import TARGET, differing, other_bits

__all__ = ["target_warnings"]


Warnings = list[dict[str, Any]]


def target_warnings(journal: Journal, entries: Sequence[Entry], study_of: Callable[[str], Study] | None) -> Warnings:
    """Warning, in the form of those of a fleet's record, that injectors were calibrated on different targets.

    The first finished injector is simulated again and compared bit for bit.

    Parameters
    ----------
    journal : Journal
        Its last target is the one of this process, if this process calibrates.
    entries : sequence of Entry
        Injectors that were done before.
    study_of : function of str, optional
        Study of an injector by its name; None if this process calibrates nothing, so that its bits do not matter.
    """
    finished = [entry for entry in entries if entry.status == FINISHED]
    if not finished:
        return []
    first = finished[0]
    again = (0.0, 0.0) if study_of is None else _again(first, study_of)
    text = other_bits(differing(journal.targets), f"the best values of {first.name}", *again)
    if not text:
        return []
    sentence = (
        f"{text}: the table need not be that of a fleet that was never stopped; take a new folder for one target."
    )
    return [{"code": TARGET, "injectors": len(finished), "first": first.name, "sentence": sentence}]


def _again(entry: Entry, study_of: Callable[[str], Study]) -> tuple[float, float]:
    """Objective of an injector's best values in the journal and here; equal if it cannot be simulated here."""
    with suppress(CommonrailError):
        study = study_of(entry.name)
        best = np.array([[entry.record["parameters"][name]["best"] for name in study.space.names]])
        return entry.record["J"]["best"], float(objective_of(study, 1).costs(best).costs[0])
    return 0.0, 0.0
