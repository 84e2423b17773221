"""The library of the virtual injector, linked once for this machine."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from commonrail.plugins.export.fmu import write_fmu
from commonrail.plugins.export.library import Library, write_library
from commonrail.plugins.export.object_files import find_target
from commonrail.readers.injector import load_injector
from tests.cli.conftest import command  # noqa: F401
from tests.conftest import DRAWN
from tests.exporting import usable_platform
from tests.plugins.export.native import Native


@pytest.fixture(scope="session")
def own() -> str:
    """Name of this machine's target, where it has one and a compiler for it."""
    return usable_platform()


@pytest.fixture(scope="session")
def library(own: str, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Library of the virtual injector."""
    return write_library(load_injector(DRAWN), tmp_path_factory.mktemp("library"), [find_target(own)])


@pytest.fixture(scope="session")
def native(library: Library, own: str) -> Native:
    """Its functions."""
    return Native(library, own)


@pytest.fixture(scope="session")
def fmu(own: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """FMU of the virtual injector for this machine."""
    path = tmp_path_factory.mktemp("fmu") / "injector.fmu"
    write_fmu(load_injector(DRAWN), path, [find_target(own)])
    return path


@pytest.fixture(scope="session")
def fmu3(own: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same by version 3.0."""
    path = tmp_path_factory.mktemp("fmu") / "injector.fmu"
    write_fmu(load_injector(DRAWN), path, [find_target(own)], 3)
    return path


@pytest.fixture(scope="session")
def binary(fmu: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its shared library."""
    folder = tmp_path_factory.mktemp("binary")
    with zipfile.ZipFile(fmu) as archive:
        (name,) = (n for n in archive.namelist() if n.startswith("binaries/"))
        archive.extract(name, folder)
    return folder / name
