"""The library of the virtual injector, linked once for this machine."""

from __future__ import annotations

import pytest

from commonrail.export.library import Library, write_library
from commonrail.export.objects import target_named
from commonrail.files.injector_file import load_injector
from tests.conftest import DRAWN
from tests.export.native import Native
from tests.exporting import usable_platform


@pytest.fixture(scope="session")
def own() -> str:
    """Name of this machine's target, where it has one and a compiler for it."""
    return usable_platform()


@pytest.fixture(scope="session")
def library(own: str, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Library of the virtual injector."""
    return write_library(load_injector(DRAWN), tmp_path_factory.mktemp("library"), [target_named(own)])


@pytest.fixture(scope="session")
def native(library: Library, own: str) -> Native:
    """Its functions."""
    return Native(library, own)
