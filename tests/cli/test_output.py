"""Places that cannot be written to are refused before the work."""

from __future__ import annotations

import errno
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from commonrail.base.errors import InputError, OutputError
from commonrail.cli.options import check_distinct, check_file, check_folder, check_report, free_run_folder
from tests.cli.conftest import Command
from tests.refused import refused


def refuse(*_: object, **__: object) -> None:
    """Behaviour of a folder without permission."""
    raise PermissionError(errno.EACCES, "Permission denied")


def test_a_good_place_is_left_as_it_was(tmp_path: Path) -> None:
    old = tmp_path / "old.csv"
    old.write_text("1", encoding="utf-8")
    check_file(old, "--out")
    check_file(tmp_path / "new.csv", "--out")
    check_file(None, "--out")
    check_folder(tmp_path / "a" / "b")
    assert [p.name for p in tmp_path.iterdir()] == ["old.csv"]
    assert old.read_text(encoding="utf-8") == "1"


def test_a_file_in_no_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--out: .*/nowhere;"):
        check_file(tmp_path / "nowhere" / "x.csv", "--out")


def test_a_folder_in_place_of_a_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--report: .*\bfolder"):
        check_report(tmp_path)
    with pytest.raises(InputError, match=r"--report: .*a\.txt: .*a\.html"):
        check_report(tmp_path / "a.txt")


def test_a_file_in_place_of_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"/file .*\bfolder"):
        check_folder(tmp_path / "file" / "new")


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with refused(OutputError, "not-writable", "x.csv"):
        check_file(tmp_path / "x.csv", "--out")
    with refused(OutputError, "not-writable", "new"):
        check_folder(tmp_path / "new")


def test_the_first_free_run_folder_is_taken(tmp_path: Path) -> None:
    (tmp_path / "s-1").mkdir()
    (tmp_path / "s-3").mkdir()
    assert free_run_folder("s", tmp_path) == tmp_path / "s-2"


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_a_closed_stream_is_no_fault(closed: str) -> None:
    line = f"exec {sys.executable} -m commonrail catalogue injectors {closed}"
    done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_stdout_ends_with_3() -> None:
    with Path("/dev/full").open("w") as full:
        line = [sys.executable, "-m", "commonrail", "catalogue", "injectors"]
        done = subprocess.run(line, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 3
    assert "standard output" in done.stderr


def test_two_outputs_of_one_place_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under any spelling: the later one would take the place of the first."""
    monkeypatch.chdir(tmp_path)
    check_distinct(Path("a.csv"), None, tmp_path / "b.csv", None)
    for other in (Path("a.csv"), tmp_path / "a.csv", tmp_path / "." / "a.csv"):
        with pytest.raises(InputError, match=r"a\.csv: two outputs"):
            check_distinct(Path("a.csv"), other)


@pytest.mark.parametrize(
    "line",
    [
        ("map", "--out", "a.json", "--quantity-out", "a.json"),
        ("sweep", "--vary", "rail_pressure=80MPa", "--out", "a.csv", "--out", "./a.csv"),
    ],
)
def test_a_verb_writes_no_two_outputs_to_one_place(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(line[0], "virtual-lino-2016", *line[1:])
    assert done.status == 2
    assert "two outputs" in done.sentence
    assert list(tmp_path.iterdir()) == []
