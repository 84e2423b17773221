"""Fits in tests are judged from fewer draws: those of the user take longer than the short searches of the tests."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from commonrail.plugins.certainty import draws
from tests.judging.sitecustomize import FEW

WHOLE = {name: getattr(draws, name) for name in FEW}


@contextmanager
def judged_by(settings: Mapping[str, float]) -> Iterator[None]:
    """Fits of this process are judged by settings of the draws."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setattr(draws, name, value)
        yield


def judging_from_few(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment of a process that judges fits from few draws, and those that it starts too."""
    folders = [str(Path(__file__).parent), environment.get("PYTHONPATH", "")]
    return {**environment, "PYTHONPATH": os.pathsep.join(folder for folder in folders if folder)}
