"""Truths of the virtual bench for the tests, whose fitted injector is the catalogue's, and the command."""

from __future__ import annotations

import pytest

from commonrail.plugins.paper.bench import Truth
from commonrail.plugins.paper.bench_file import load_truth
from tests.cli.conftest import command  # noqa: F401


@pytest.fixture(scope="session")
def truth() -> Truth:
    """With friction, sensors with limits, and scatter."""
    return load_truth("virtual-lino-2016")


@pytest.fixture(scope="session")
def ideal() -> Truth:
    """Without."""
    return load_truth("virtual-lino-2016-ideal")
