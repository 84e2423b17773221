"""Two repetitions on the virtual test bench, run once."""

from __future__ import annotations

import pytest

from commonrail.files.injector_file import load_injector
from commonrail.files.truth_file import load_truth
from commonrail.reproduction.repetition import Bench
from commonrail.reproduction.run import Reproduction, reproduce


def bench(truth: str) -> Bench:
    """Bench of a packaged truth."""
    declared = load_truth(truth)
    return Bench(declared, load_injector(declared.injector), 1e-6)


@pytest.fixture(scope="session")
def done() -> Reproduction:
    """Two repetitions on two threads."""
    return reproduce(bench("virtual-lino-2016"), (1, 2), threads=2)
