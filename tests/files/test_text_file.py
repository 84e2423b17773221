"""Text and TOML from disk: what is read, and one sentence for each way in which it is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.errors import InputError
from commonrail.files.text_file import read_text, read_toml


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "file.toml"
    path.write_bytes(data)
    return path


def test_byte_order_mark_and_foreign_line_ends_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, b"\xef\xbb\xbfa = 1\r\nb = 2\rc = 3\n")
    assert read_text(path, 100) == "a = 1\nb = 2\nc = 3\n"
    assert read_toml(path)[0] == {"a": 1, "b": 2, "c": 3}


def test_missing_file_proposes_the_nearest_name(tmp_path: Path) -> None:
    written(tmp_path, b"")
    with pytest.raises(InputError, match=r'fiel\.toml: there is no such file \(did you mean "file\.toml"\?\)\.'):
        read_text(tmp_path / "fiel.toml", 100)


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent/a\.toml: there is no such file\."):
        read_text(tmp_path / "absent" / "a.toml", 100)


def test_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="this is a folder, and a file is expected"):
        read_text(tmp_path, 100)


def test_name_that_no_system_takes() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_text(Path("a\0b"), 100)


def test_too_large(tmp_path: Path) -> None:
    path = written(tmp_path, b"x" * 3_000_001)
    with pytest.raises(InputError, match=r"file\.toml: the file has 3 MB, more than the 2 MB that are read"):
        read_text(path, 2_000_000)


def test_binary(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"file\.toml: this is not a text file"):
        read_text(written(tmp_path, b"PK\x03\x04\0\0"), 100)


def test_other_encoding_has_the_line(tmp_path: Path) -> None:
    path = written(tmp_path, "a = 1\nb = '3 µs'\n".encode("latin-1"))
    with pytest.raises(InputError, match=r"file\.toml, line 2: byte 0xb5 is not UTF-8 text"):
        read_text(path, 100)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ('a = 1\nb = 160 MPa\nc = "x"', 2, "expected newline"),
        ("a = 1\na = 2\n", 2, "cannot overwrite a value"),
        ("a = 1\n\nb = [1,\n", 3, "[Uu]nclosed array|invalid value"),  # Python's releases differ in the words
    ],
)
def test_toml_fault_has_the_line(tmp_path: Path, text: str, line: int, reason: str) -> None:
    with pytest.raises(InputError, match=rf"file\.toml, line {line}: this is not TOML \(.*({reason})"):
        read_toml(written(tmp_path, text.encode()))
