"""TOML from disk: what is read, and one sentence for each way in which it is not."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

from commonrail.base.errors import InputError
from commonrail.readers.location import Place
from commonrail.readers.toml import LARGEST_TOML, FileModel, parse_toml, read_model, read_toml
from tests.refused import refused


def written(tmp_path: Path, data: bytes) -> Path:
    path = tmp_path / "file.toml"
    path.write_bytes(data)
    return path


def test_byte_order_mark_and_foreign_line_ends_are_read(tmp_path: Path) -> None:
    tables, text = read_toml(written(tmp_path, b"\xef\xbb\xbfa = 1\r\nb = 2\rc = 3\n"))
    assert (tables, text) == ({"a": 1, "b": 2, "c": 3}, "a = 1\nb = 2\nc = 3\n")


class OwnFile(FileModel):
    """File of a plug-in."""

    format: Literal["commonrail-mything/1"]
    amount: int


def test_a_plug_in_has_a_format_of_its_own() -> None:
    good = {"format": "commonrail-mything/1", "amount": 2}
    assert read_model(OwnFile, good, Place("f")).amount == 2
    for other in ("commonrail-study/1", "other/7", "commonrail-mything/2", "\x1b/1", 3):
        with pytest.raises(InputError):
            read_model(OwnFile, good | {"format": other}, Place("f"))


def test_size_limit(tmp_path: Path) -> None:
    with refused(InputError, "too-large", "file.toml"):
        read_toml(written(tmp_path, b"#\n" * (LARGEST_TOML // 2 + 1)))


@pytest.mark.parametrize(
    ("text", "line"),
    [('a = 1\nb = 160 MPa\nc = "x"', 2), ("a = 1\na = 2\n", 2), ("a = 1\n\nb = [1,\n", 3)],
)
def test_toml_fault_has_the_line(tmp_path: Path, text: str, line: int) -> None:
    with refused(InputError, f"syntax line {line}", "file.toml"):
        read_toml(written(tmp_path, text.encode()))


HOSTILE = {
    "nested without end": ("a = " + "[" * 5000, "f: tables and lists stand too deep in one another"),
    "deep lists": ("a = " + "[" * 21 + "]" * 21, "stand more than 20 deep"),
    "deep keys": (".".join("a" * 30) + " = 1", "f, line 1: the key stands more than 20 deep in tables"),
    "deep header": ("[ 'a' . " + '"b".c-d . ' * 30 + "e]", "f, line 1: the key stands more than 20 deep"),
    "deep keys in a table": ("a = { " + ".".join("a" * 30) + " = 1 }", "stand more than 20 deep"),
    "long line": ("a = 1\n# " + "x" * 10_000, "f, line 2: the line has 10002 characters, and at most 10000 are read"),
    "long text": ('a = """' + ("x" * 99 + "\n") * 101 + '"""', "f, a: the text has 10100 characters"),
    "long key": ("x" * 201 + " = 1", "the key .* is too long"),
    "line end in a key": ('"a\\nb" = 1', r'f: the key "a\?b" is too long or has a character that is not printed'),
    "key without a name": ('"\\u202e" = 1', "not printed"),
    "cursor": ('[t]\na = ["x", "\\u001b[2J"]', r"f, t\.a\[2\]: the text holds the control character U\+001B"),
    "direction": ('a = "\\u202e"', r"U\+202E"),
    "digits without end": ("a = 1\nb = " + "9" * 5000, r"this is not TOML \(an integer has too many digits\)"),
    "more than 64 bits": ("a = 0x" + "f" * 500, "f, a: the integer is larger than 64 bits hold"),
    "beyond a float": ("a = 1e400", "f, a: the number is not finite"),
    "not a number": ("a = [nan]", r"f, a\[1\]: the number is not finite"),
}


@pytest.mark.parametrize("fault", HOSTILE)
def test_hostile_text_is_one_sentence(fault: str) -> None:
    text, message = HOSTILE[fault]
    with pytest.raises(InputError, match=message) as caught:
        parse_toml(text, "f")
    assert str(caught.value).isprintable()


def test_what_a_text_may_hold() -> None:
    text = 'a = "tab\\t, line\\n, µ, <b>, \u2028, 🙂"\n"b c" = -9223372036854775807'
    assert parse_toml(text, "f") == {"a": "tab\t, line\n, µ, <b>, \u2028, 🙂", "b c": -(2**63) + 1}


def test_lines_of_spaces_take_time_in_proportion() -> None:
    """A process may take 20 s of the processor: a pattern that tries every split takes 70, one that does not 0.5."""
    resource = pytest.importorskip("resource", reason="no limits of POSIX")
    limit = f"import resource; resource.setrlimit({resource.RLIMIT_CPU}, (20, 20))"
    parse = "from commonrail.readers.toml import parse_toml; print(parse_toml((' ' * 9998 + '#\\n') * 30, 'a'))"
    done = subprocess.run([sys.executable, "-c", f"{limit}; {parse}"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "{}\n")


class Nozzle(FileModel):
    hole: str


class Spray(FileModel):
    nozzle: list[Nozzle] = Field(default=[])
    places: list[str] = Field(default=[])


@pytest.mark.parametrize(("key", "cure"), [("nozzle", "[[nozzle]]"), ("places", "in brackets")])
def test_a_list_of_tables_is_told_from_other_lists_by_the_model(key: str, cure: str) -> None:
    with pytest.raises(InputError, match=re.escape(cure)):
        read_model(Spray, {key: {"hole": "a"}}, Place("spray.toml"))
