"""The library of the virtual injector, linked once for this machine."""

from __future__ import annotations

import pytest

from commonrail.errors import ConfigurationError
from commonrail.export.library import Library, write_library
from commonrail.export.linker import compiler_for, own_platform
from commonrail.export.objects import target_named
from commonrail.files.injector_file import load_injector
from tests.conftest import DRAWN
from tests.export.native import Native


@pytest.fixture(scope="session")
def own() -> str:
    """Name of this machine's target, where it has one and a compiler for it."""
    names = own_platform()
    if not names:
        pytest.skip("this machine runs none of the platforms that libraries are made for")
    try:
        compiler_for(target_named(names[0]))
    except ConfigurationError as error:
        pytest.skip(str(error))
    return names[0]


@pytest.fixture(scope="session")
def library(own: str, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Library of the virtual injector."""
    return write_library(load_injector(DRAWN), tmp_path_factory.mktemp("library"), [target_named(own)])


@pytest.fixture(scope="session")
def native(library: Library, own: str) -> Native:
    """Its functions."""
    return Native(library, own)
