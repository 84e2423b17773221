"""Output is there whole or not at all, and nowhere else."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from commonrail.base.errors import OutputError
from commonrail.base.output import PART, replacing, write_text, writing
from tests.refused import refused


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_new_file_takes_the_place_of_the_old(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    write_text(path, "µ\n")
    assert path.read_bytes() == "µ\n".encode()
    assert names(tmp_path) == ["a.txt"]


def test_others_may_read_it_as_they_may_other_files(tmp_path: Path) -> None:
    write_text(tmp_path / "a.txt", "x")
    (tmp_path / "b.txt").write_text("x", encoding="utf-8")
    assert (tmp_path / "a.txt").stat().st_mode == (tmp_path / "b.txt").stat().st_mode


def write_half(path: Path, fault: BaseException) -> None:
    with replacing(path) as stream:
        stream.write("half of it")
        raise fault


@pytest.mark.parametrize("fault", [ValueError("no number"), KeyboardInterrupt(), OSError(errno.ENOSPC, "full")])
def test_a_fault_in_between_leaves_the_old_file_and_nothing_else(tmp_path: Path, fault: BaseException) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old", encoding="utf-8")
    with pytest.raises((type(fault), OutputError)):
        write_half(path, fault)
    assert path.read_text(encoding="utf-8") == "old"
    assert names(tmp_path) == ["a.txt"]


def test_nobody_sees_a_part_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old", encoding="utf-8")
    with replacing(path) as stream:
        stream.write("new")
        stream.flush()
        assert path.read_text(encoding="utf-8") == "old"


def test_a_symbolic_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("old", encoding="utf-8")
    (tmp_path / "a.txt").symlink_to(tmp_path / "precious")
    with refused(OutputError, "symbolic-link", "a.txt"):
        write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "precious").read_text(encoding="utf-8") == "old"


def test_a_device_a_pipe_and_a_folder_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (Path("/dev/null"), tmp_path / "pipe", tmp_path):
        with refused(OutputError, "not-a-file", path.name):
            write_text(path, "x")


def test_an_error_of_the_system_becomes_a_sentence(tmp_path: Path) -> None:
    with refused(OutputError, "not-writable"), writing(tmp_path, "--out"):
        raise OSError(errno.ENOSPC, "no room")


def test_where_nothing_may_be_written_no_room_is_asked_for(tmp_path: Path) -> None:
    with refused(OutputError, "not-writable"), writing(tmp_path):
        raise PermissionError(errno.EACCES, "Permission denied")


def test_a_link_in_place_of_the_part_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    victim = tmp_path / "victim"
    victim.write_text("mine")
    monkeypatch.setattr("secrets.token_hex", lambda _: "1234")
    (tmp_path / f".out.txt.1234{PART}").symlink_to(victim)
    with pytest.raises(OutputError, match="File exists"):
        write_text(tmp_path / "out.txt", "new")
    assert victim.read_text() == "mine"
    assert not (tmp_path / "out.txt").exists()


def test_names_that_are_not_utf_8_are_written(tmp_path: Path) -> None:
    name = os.fsdecode(b"run \xff")
    write_text(tmp_path / "page.html", name)
    assert "run " in (tmp_path / "page.html").read_text(encoding="utf-8")
