"""Parts of installed plug-ins, found by entry points of a distribution that lies on the path."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from commonrail import plugins
from commonrail.base import registry
from commonrail.base.errors import InputError, PluginError
from commonrail.plugins.doctor.run import find_plugins
from commonrail.readers.tables import open_sheet
from tests.cli.conftest import run_command
from tests.distribution import distribution


@pytest.fixture
def plugin(tmp_path: Path) -> Iterator[None]:
    """Distribution with a reader that works, two whose modules cannot be imported and one that does not exist."""
    modules = {
        "example_tpc": "SHEET = 'sheet of TPC'\n",
        "example_broken": "raise OSError('no driver')\n",
        "example_leaves": "import sys\nsys.exit(7)\n",
    }
    parts = (
        "[commonrail.readers]\ntpc = example_tpc:SHEET\nbroken = example_broken:SHEET\nabsent = example_tpc:OTHER\n"
        "leaves = example_leaves:SHEET\n"
    )
    with distribution(tmp_path, modules, parts):
        yield


@pytest.mark.usefixtures("plugin")
def test_a_part_of_an_installed_package_is_loaded_by_its_name() -> None:
    entry = registry.find("readers", "tpc")
    assert entry is not None
    assert (entry.distribution, entry.version, entry.load()) == ("example-plugin", "1.2", "sheet of TPC")
    assert "tpc" in registry.entries("readers")


@pytest.mark.usefixtures("plugin")
@pytest.mark.parametrize(("name", "reason"), [("broken", "no driver"), ("absent", "OTHER"), ("leaves", "sys.exit.7")])
def test_a_broken_plug_in_is_named_with_its_reason(name: str, reason: str) -> None:
    entry = registry.find("readers", name)
    assert entry is not None
    with pytest.raises(PluginError, match=rf"example-plugin 1\.2: \"{name}\".*{reason}"):
        entry.load()


def test_a_reader_that_fails_on_a_file_is_named_with_it(tmp_path: Path) -> None:
    modules = {"example_fails": "def SHEET(path, form): return 1 / 0\n"}
    (tmp_path / "site").mkdir()
    parts = "[commonrail.readers]\nnc = example_fails:SHEET\n"
    said = r'example-plugin 1\.2: "nc".*fails on .*bench\.nc \(ZeroDivision'
    with distribution(tmp_path / "site", modules, parts), pytest.raises(PluginError, match=said):
        open_sheet(tmp_path / "bench.nc")
    with pytest.raises(InputError, match="NetCDF"):
        open_sheet(tmp_path / "bench.nc")


def test_a_name_that_nobody_registers_has_no_part() -> None:
    assert registry.find("readers", "no-such-ending") is None


def test_a_part_that_another_one_displaces_is_named(tmp_path: Path) -> None:
    """One of the name of a shipped part, and the second of two packages with one name."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    parts = "[commonrail.readers]\ntpc = {0}:OPEN\n[commonrail.verbs]\nsimulate = {0}:OPEN\n"
    said = r'plug-in {0} 1\.2: "{1}" of commonrail.{2} is not used, because {3} has a part of the same name; [^.]*\.$'
    with (
        distribution(tmp_path / "b", {"two": "OPEN = 2\n"}, parts.format("two"), "one-two"),
        distribution(tmp_path / "a", {"one": "OPEN = 1\n"}, parts.format("one"), "one-one"),
    ):
        with pytest.warns(RuntimeWarning, match=said.format("one-two", "tpc", "readers", "one-one")):
            found = registry.find("readers", "tpc")
        assert found is not None
        assert (found.distribution, found.load()) == ("one-one", 1)
        assert registry.find("verbs", "simulate") == registry.find_shipped("verbs")["simulate"]
        first, second = sorted(entry.distribution for entry in registry.find_unused("verbs"))
        assert (first, second) == ("one-one", "one-two")
        broken = {plugin.distribution: " ".join(plugin.broken) for plugin in find_plugins()}
        assert re.search(r'"tpc" .*because one-one', broken["one-two"])
        assert re.search(r'"simulate" .*because commonrail', broken["one-one"])


def test_a_verb_of_a_package_that_fails_is_named_with_its_package(tmp_path: Path) -> None:
    text = "import click\n@click.command()\ndef fail():\n    raise ZeroDivisionError('of mine')\n"
    with distribution(tmp_path, {"example_verb": text}, "[commonrail.verbs]\nfail = example_verb:fail\n"):
        done = run_command("fail")
    assert done.status == 2
    assert re.search(r"verb fail .*example-plugin 1\.2 .*ZeroDivisionError", done.sentence)
    assert "internal fault" not in done.err


def test_a_plug_in_folder_needs_no_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its verb has the name of the folder, its record as well."""
    folder = tmp_path / "two_words"
    folder.mkdir()
    text = "import click\n@click.command()\ndef two_words():\n    click.echo('said')\n"
    (folder / "verb.py").write_text(text, encoding="utf-8")
    (folder / "page.py").write_text("RESULT = 'kind'\n", encoding="utf-8")
    monkeypatch.setattr(plugins, "__path__", [str(tmp_path), *plugins.__path__])
    registry.find_shipped.cache_clear()
    try:
        assert run_command("two-words").out == "said\n"
        assert registry.find_shipped("results")["two-words.json"].load() == "kind"
    finally:
        registry.find_shipped.cache_clear()
