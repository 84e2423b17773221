"""Folders of libraries appear complete, or stay as they are."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.export import library
from commonrail.plugins.export.library import place_when_complete, write_library
from commonrail.plugins.export.object_files import find_target
from commonrail.readers.injector import load_injector
from tests.conftest import DRAWN


def entries(folder: Path) -> dict[str, str]:
    """Contents of all files below a folder, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_a_new_folder_appears_with_all_its_files(tmp_path: Path) -> None:
    folder, usual = tmp_path / "above" / "new", tmp_path / "usual"
    usual.mkdir()
    with place_when_complete(folder) as made:
        (made / "inner").mkdir()
        (made / "inner" / "one").write_text("1")
        assert not folder.exists()
    assert entries(tmp_path) == {"above/new/inner/one": "1"}
    assert stat.S_IMODE(folder.stat().st_mode) == stat.S_IMODE(usual.stat().st_mode)


def test_other_files_of_a_folder_stay(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    for name in ("own", "replaced", "inner/replaced"):
        (tmp_path / name).write_text("old")
    with place_when_complete(tmp_path) as made:
        (made / "inner").mkdir()
        for name in ("replaced", "inner/replaced", "inner/new"):
            (made / name).write_text("new")
    expected = {"own": "old", "replaced": "new", "inner/replaced": "new", "inner/new": "new"}
    assert entries(tmp_path) == expected


@pytest.mark.parametrize("exists", [True, False])
def test_an_export_that_fails_changes_nothing(
    exists: bool, own: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "library"
    if exists:
        folder.mkdir()
        (folder / "virtual_lino_2016.h").write_text("of an export before")
    before = entries(tmp_path)

    def fail(*_: object) -> None:
        raise ConfigurationError("The C compiler failed.")

    monkeypatch.setattr(library.object_files, "link_shared", fail)  # the last thing that is made of a platform
    with pytest.raises(ConfigurationError, match="failed"):
        write_library(load_injector(DRAWN), folder, [find_target(own)])
    assert entries(tmp_path) == before
    assert folder.exists() == exists
