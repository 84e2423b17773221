"""Parts of installed plug-ins, found by entry points of a distribution that lies on the path."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail.base import registry
from commonrail.base.errors import InputError, PluginError
from commonrail.readers.tables import open_sheet
from tests.distribution import distribution


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[None]:
    """Distribution with a reader that works, one whose module cannot be imported and one that does not exist."""
    modules = {"example_tdms": "SHEET = 'sheet of TDMS'\n", "example_broken": "raise OSError('no driver')\n"}
    parts = (
        "[commonrail.readers]\ntdms = example_tdms:SHEET\nbroken = example_broken:SHEET\nabsent = example_tdms:OTHER\n"
    )
    with distribution(tmp_path, modules, parts):
        yield


@pytest.mark.usefixtures("plugin")
def test_a_part_of_an_installed_package_is_loaded_by_its_name() -> None:
    entry = registry.find("readers", "tdms")
    assert entry is not None
    assert (entry.distribution, entry.version, entry.load()) == ("example-plugin", "1.2", "sheet of TDMS")
    assert "tdms" in registry.entries("readers")


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(("name", "reason"), [("broken", "no driver"), ("absent", "OTHER")])
def test_a_broken_plug_in_is_named_with_its_reason(name: str, reason: str) -> None:
    entry = registry.find("readers", name)
    assert entry is not None
    with pytest.raises(PluginError, match=rf"example-plugin 1\.2: \"{name}\".*{reason}"):
        entry.load()


def test_a_reader_that_fails_on_a_file_is_named_with_it(tmp_path: Path) -> None:
    modules = {"example_fails": "def SHEET(path, form): return 1 / 0\n"}
    (tmp_path / "site").mkdir()
    parts = "[commonrail.readers]\ntdms = example_fails:SHEET\n"
    said = r'example-plugin 1\.2: "tdms".*fails on .*bench\.tdms \(ZeroDivision'
    with distribution(tmp_path / "site", modules, parts), pytest.raises(PluginError, match=said):
        open_sheet(tmp_path / "bench.tdms")
    with pytest.raises(InputError, match="TDMS files are not read"):
        open_sheet(tmp_path / "bench.tdms")


def test_a_name_that_nobody_registers_has_no_part() -> None:
    assert registry.find("readers", "no-such-ending") is None
