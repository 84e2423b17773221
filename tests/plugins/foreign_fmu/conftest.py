"""A foreign FMU, compiled once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.exporting import usable_platform
from tests.plugins.foreign_fmu.samples import write_decay

pytest.importorskip("fmpy", reason="FMPy is not installed: pip install 'commonrail[fmi]'")


@pytest.fixture(scope="session")
def decay_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """FMU of Dahlquist's and van der Pol's equations."""
    return write_decay(tmp_path_factory.mktemp("decay"), usable_platform())
