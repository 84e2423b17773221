"""The folder to start from: complete, loadable, labelled synthetic, never written over anything."""

from __future__ import annotations

from errno import ENOSPC
from pathlib import Path

import pytest

from commonrail.base.errors import InputError, OutputError
from commonrail.calibration.study_file import load_study
from commonrail.plugins.new.study import write_new
from tests.refused import refused


def test_files_are_written_and_load(tmp_path: Path) -> None:
    written = write_new(tmp_path / "a" / "new")
    names = [path.relative_to(tmp_path / "a" / "new").as_posix() for path in written]
    assert names == ["README.md", "injector.toml", "study.toml", "data/evi.csv"]
    study = load_study(written[2])
    assert study.space.names[0] == "control_chamber.z_hole_diameter"


def test_an_empty_folder_will_do(tmp_path: Path) -> None:
    assert len(write_new(tmp_path)) == 4


def test_everything_synthetic_says_so(tmp_path: Path) -> None:
    readme, _, study, curve = write_new(tmp_path)
    assert "**synthetic**" in readme.read_text(encoding="utf-8")
    assert curve.read_text(encoding="utf-8").startswith("# SYNTHETIC")
    assert load_study(study).data[0].synthetic


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    kept = tmp_path / "study.toml"
    kept.write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=rf"/{tmp_path.name}: .*overwritten"):
        write_new(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]
    assert kept.read_text(encoding="utf-8") == "mine"


def test_a_file_in_the_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"/new: .*overwritten"):
        write_new(tmp_path / "new")


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with refused(OutputError, "not-writable", "new"):
        write_new(tmp_path / "file" / "new")


@pytest.mark.parametrize("there", [False, True])
def test_a_failure_leaves_the_place_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, there: bool) -> None:
    folder = tmp_path / "new"
    if there:
        folder.mkdir()

    def full(path: Path, content: bytes) -> None:
        raise OSError(ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OutputError):
            write_new(folder)
    assert folder.exists() is there
    assert len(write_new(folder)) == 4
