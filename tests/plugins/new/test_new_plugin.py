"""commonrail new --plugin: a package that works and whose tests pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.calibration.optimisers.registry import find_optimiser
from tests.cli.conftest import run_command
from tests.distribution import package, run_tests


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """Folder of a new package."""
    folder = tmp_path / "new"
    done = run_command("new", folder, "--plugin", "own-parts")
    assert done.status == 0, done.err
    return folder


def test_its_own_tests_pass(written: Path, tmp_path: Path) -> None:
    run_tests(written, tmp_path / "site")


def test_its_parts_are_found_once_it_is_installed(written: Path, tmp_path: Path) -> None:
    with package(written, tmp_path / "site"):
        assert find_optimiser("own-parts search") is not None
        assert run_command("own-parts", "--help").status == 0
        facts = run_command("--help").out
        assert "own-parts" in facts


def test_without_a_folder_it_is_written_to_one_of_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_command("new", "--plugin", "own-parts").status == 0
    assert (tmp_path / "own-parts" / "src" / "own_parts" / "verb.py").is_file()


@pytest.mark.parametrize("name", ["Own", "own_parts", "-own", "simulate", "class", "numpy"])
def test_a_name_that_cannot_be_is_refused(tmp_path: Path, name: str) -> None:
    done = run_command("new", tmp_path / "new", f"--plugin={name}")
    assert done.status == 2
    assert name in done.sentence
    assert not (tmp_path / "new").exists()


def test_options_of_a_study_are_refused_beside_it(tmp_path: Path) -> None:
    done = run_command("new", tmp_path / "new", "--plugin", "own-parts", "--injector", "crin")
    assert "--plugin" in done.sentence


def test_a_study_needs_a_folder() -> None:
    assert "folder" in run_command("new").sentence
