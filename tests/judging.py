"""Fits in tests are judged from fewer draws: those of the user take longer than the short searches of the tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import pytest

from commonrail.plugins.certainty import draws

# Simulated positions for each coefficient, rounds, draws, draws that weights must be worth, steps of walkers, checks.
FEW = {"EACH": 5, "ROUNDS": 2, "DRAWS": 1000, "LEAST_SIZE": 50.0, "STEPS": 200, "THINNED": 5, "CHECKS": 48}
WHOLE = {name: getattr(draws, name) for name in FEW}


@contextmanager
def judged_by(settings: Mapping[str, float]) -> Iterator[None]:
    """Fits of this process are judged by settings of the draws."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setattr(draws, name, value)
        yield
