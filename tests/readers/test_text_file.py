"""Text from disk: what is read, and one sentence for each way in which it is not."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from commonrail.base.errors import InputError
from commonrail.readers.location import read_text
from commonrail.readers.text import LONGEST_LINE, number_lines, read_encoded
from tests.refused import refused


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "file.toml"
    path.write_bytes(data)
    return path


def test_byte_order_mark_and_foreign_line_ends_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, b"\xef\xbb\xbfa = 1\r\nb = 2\rc = 3\n")
    assert read_text(path, 100) == "a = 1\nb = 2\nc = 3\n"
    assert list(number_lines(path, read_encoded(path, 100)[0])) == [(1, "a = 1"), (2, "b = 2"), (3, "c = 3")]


def test_missing_file_proposes_the_nearest_name(tmp_path: Path) -> None:
    written(tmp_path, b"")
    with refused(InputError, "missing-file", "fiel.toml"):
        read_text(tmp_path / "fiel.toml", 100)


def test_missing_folder(tmp_path: Path) -> None:
    with refused(InputError, "missing-file", "a.toml"):
        read_text(tmp_path / "absent" / "a.toml", 100)


def test_folder(tmp_path: Path) -> None:
    with refused(InputError, "not-a-file"):
        read_text(tmp_path, 100)


def test_name_that_no_system_takes() -> None:
    with refused(InputError, "unreadable"):
        read_text(Path("a\0b"), 100)


def test_too_large(tmp_path: Path) -> None:
    path = written(tmp_path, b"x" * 3_000_001)
    with refused(InputError, "too-large", "file.toml"):
        read_text(path, 2_000_000)


def test_binary(tmp_path: Path) -> None:
    with refused(InputError, "not-text", "file.toml"):
        read_text(written(tmp_path, b"PK\x03\x04\0\0"), 100)


def test_other_encoding_has_the_line(tmp_path: Path) -> None:
    path = written(tmp_path, "a = 1\nb = '3 µs'\n".encode("latin-1"))
    with refused(InputError, "wrong-encoding line 2", "file.toml"):
        read_text(path, 100)


def test_lines_name_the_one_that_is_not_utf8(tmp_path: Path) -> None:
    with refused(InputError, "wrong-encoding line 3", "file.toml"):
        list(number_lines(tmp_path / "file.toml", b"a\nb\n\xb5\n"))


def test_longest_line(tmp_path: Path) -> None:
    data, path = b"a\n" + b"x" * LONGEST_LINE, tmp_path / "file.toml"
    with refused(InputError, "line-too-long line 2", "file.toml"):
        list(number_lines(path, data + b"x"))


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/null", "/dev/tty"])
def test_device_is_not_opened(device: str) -> None:
    if not Path(device).exists():
        pytest.skip("no such device here")
    with refused(InputError, "not-a-file", Path(device).name):
        read_text(Path(device), 100)


def test_link_to_a_device_is_a_device(tmp_path: Path) -> None:
    (tmp_path / "link.csv").symlink_to("/dev/zero")
    with refused(InputError, "not-a-file", "link.csv"):
        read_text(tmp_path / "link.csv", 100)


def test_pipe_without_a_writer_does_not_wait(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with refused(InputError, "not-a-file", "pipe"):
        read_text(tmp_path / "pipe", 100)


def test_socket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the address of a socket is short
    with socket.socket(socket.AF_UNIX) as own:
        own.bind("socket")
        with refused(InputError, "not-a-file", "socket"):
            read_text(Path("socket"), 100)


def test_links_that_lead_in_a_circle(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with refused(InputError, "unreadable", "a"):
        read_text(tmp_path / "a", 100)


def test_file_that_says_it_is_empty_and_is_not() -> None:
    """Files of the system have size zero: what counts is what is read."""
    path = Path("/proc/self/status")
    if not path.exists():
        pytest.skip("no such file here")
    with refused(InputError, "too-large"):
        read_text(path, 10)
