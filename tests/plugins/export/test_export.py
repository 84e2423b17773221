"""commonrail export."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from commonrail.plugins.export import object_files
from tests.cli.conftest import Command
from tests.exporting import usable_platform


def test_an_unknown_platform_is_a_sentence(command: Command, tmp_path: Path) -> None:
    done = command("export", "fmu", "virtual-lino-2016", "--platforms", "linux", "--out", str(tmp_path / "x.fmu"))
    assert done.status == 2
    assert '"linux"' in done.err
    assert "linux64" in done.err
    assert not (tmp_path / "x.fmu").exists()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--fmi", "1"), "version 2 and 3"),
        (("--platforms", "linux-arm64"), "version 3"),
        (("--platforms", "wasm32"), "wasm32"),
        (("--platforms", " , "), "Platforms: "),
        (("--out", "missing/x.fmu"), "folder missing"),
    ],
)
def test_what_cannot_be_written_is_refused_before_any_work(command: Command, monkeypatch, options, sentence) -> None:
    monkeypatch.setattr(
        "commonrail.plugins.export.fmu.make_model", lambda injector: pytest.fail("compiled before the check")
    )
    done = command("export", "fmu", "virtual-lino-2016", *options)
    assert done.status == 2
    assert sentence in done.err


def test_without_compiler_and_zig_the_sentence_says_what_to_install(
    command: Command, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setattr(object_files.shutil, "which", lambda name: None)
    monkeypatch.setattr(object_files.importlib.util, "find_spec", lambda name: None)
    for platform, words in (("linux64", "linux64"), ("win64", "zig")):
        done = command("export", "library", "virtual-lino-2016", "--platforms", platform, "--out", str(tmp_path / "x"))
        assert done.status == 2
        assert words in done.err
        assert "'commonrail[export]'" in done.err
        assert "Traceback" not in done.err


@pytest.fixture
def platform() -> str:
    """Name of this machine's platform, where there is a compiler for it."""
    return usable_platform()


def test_an_fmu_is_written_and_listed(command: Command, tmp_path: Path, platform: str) -> None:
    out = tmp_path / "injector.fmu"
    done = command("export", "fmu", "virtual-lino-2016", "--out", str(out), "--json", "--platforms", platform)
    assert done.status == 0, done.err
    record = json.loads(done.out)
    assert record["platforms"] == [platform]
    with zipfile.ZipFile(out) as archive:
        assert [f"{out}/{name}" for name in archive.namelist()] == record["files"]
        assert archive.testzip() is None


def test_a_library_is_written_below_the_current_folder(
    command: Command, tmp_path: Path, platform: str, monkeypatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("export", "library", "virtual-lino-2016", "--out", "lib", "--platforms", platform)
    assert done.status == 0, done.err
    assert (tmp_path / "lib" / "libvirtual_lino_2016.a").is_file()


def test_an_example_of_somebody_else_is_not_replaced(command: Command, tmp_path: Path) -> None:
    (tmp_path / "example.py").write_text("mine", encoding="utf-8")
    done = command("export", "library", "virtual-lino-2016", "--out", str(tmp_path))
    assert done.status == 2
    assert "example.py" in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["example.py"]
