"""Plain command lines are read as typer reads them, and everything else is left to it."""

from __future__ import annotations

import functools
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from enum import StrEnum
from inspect import getdoc
from pathlib import Path
from typing import Annotated, Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from commonrail.cli import typer_later
from commonrail.cli.direct import arguments_of
from commonrail.cli.names import VERBS, function_of
from commonrail.cli.typer_later import Argument, Option, with_typer


def by_typer(verb: Callable[..., Any], words: list[str]) -> dict[str, Any] | None:
    """Arguments with which typer calls a verb; None where it refuses the words."""
    found: dict[str, Any] = {}

    @functools.wraps(verb)
    def keep(**arguments: Any) -> None:
        found.update(arguments)

    app = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.command()(with_typer(keep))
    return found if CliRunner().invoke(app, words).exit_code == 0 and found else None


def check(verb: Callable[..., Any], words: list[str]) -> bool:
    """Compare the two readings; returns whether the words are plain."""
    directly = arguments_of(verb, words)
    assert directly is None or directly == by_typer(verb, words), words
    return directly is not None


OF_TYPER = {"reproduce", "virtual-bench"}  # they raise its errors


def examples(name: str) -> list[list[str]]:
    """Command lines in the help of a verb, without the words before the verb's own."""
    text = (getdoc(function_of(name)) or "").replace("\\\n", " ")
    lines = [shlex.split(line) for line in text.splitlines() if line.strip().startswith(f"commonrail {name} ")]
    return [words[2:] for words in lines]


@pytest.mark.parametrize("name", VERBS)
def test_the_examples_of_the_help_are_read_as_by_typer(name: str) -> None:
    plain = [check(function_of(name), words) for words in examples(name)]
    assert all(plain) or name in OF_TYPER, "an example that typer has to read takes a third of a second longer"


def test_most_verbs_have_an_example() -> None:
    assert sum(bool(examples(name)) for name in VERBS) > 20


class Colour(StrEnum):
    """A choice."""

    RED = "red"
    DARK_BLUE = "dark-blue"


def everything(
    place: Annotated[str, Argument(help="A place.")],
    others: Annotated[list[Path] | None, Argument(help="More places.")] = None,
    *,
    size: Annotated[str, Option(help="A size.")],
    colour: Annotated[Colour, Option(help="A colour.")] = Colour.RED,
    share: Annotated[float | None, Option(min=0.0, help="A share.")] = None,
    count: Annotated[int, Option(min=1, max=7, help="A number.")] = 3,
    some_file: Annotated[Path | None, Option(help="A file.")] = None,
    set_: Annotated[list[str] | None, Option("--set", help="A value; repeatable.")] = None,
    quick: Annotated[bool, Option("--quick", help="Be quick.")] = False,
) -> None:
    """Take one of each kind."""


WORDS = ["--size", "--size=1 m", "--colour", "--share", "--count", "--some-file", "--set", "--quick", "--colour=red"]
WORDS += [
    "2 mm",
    "red",
    "dark-blue",
    "RED",
    "0.5",
    "-1",
    "7",
    "0",
    "1e-3",
    "a=b",
    "a.csv",
    "",
    "-",
    "--",
    "-h",
    "--siz",
]
WORDS += ["--quick=1", "--no-quick", "1_000", " 7", "inf", "nan", "--share=-2", "--count=+4"]


@given(st.lists(st.sampled_from(WORDS), max_size=7))
def test_any_words_are_read_as_by_typer_or_left_to_it(words: list[str]) -> None:
    check(everything, ["a", "--size", "2 mm", *words])
    check(everything, words)


@pytest.mark.parametrize(
    ("words", "plain"),
    [
        (["a", "--size", "1"], True),
        (["--size=1", "a", "b", "c", "--set", "x=1", "--set", "y=2", "--quick"], True),
        (["a", "--size", "1", "--colour", "dark-blue", "--share", "1e-3", "--count", "7", "--some-file", "f"], True),
        (["a"], False),  # a missing option
        (["--size", "1"], False),  # a missing place
        (["a", "--size", "1", "--size", "2"], False),
        (["a", "--size", "-1"], False),  # could be an option
        (["a", "--size", "1", "--count", "0"], False),  # below the smallest
        (["a", "--size", "1", "--count", "8"], False),  # above the largest
        (["a", "--size", "1", "--colour", "green"], False),
        (["a", "--size", "1", "--unknown"], False),
        (["a", "--size"], False),
        (["--help"], False),
    ],
)
def test_what_is_plain(words: list[str], plain: bool) -> None:
    assert check(everything, words) is plain


def test_a_declaration_that_says_more_is_left_to_typer() -> None:
    def verb(*, size: Annotated[str, Option(envvar="SIZE")] = "") -> None: ...

    assert arguments_of(verb, []) is None


def test_what_is_printed_is_what_typer_prints(capsys: pytest.CaptureFixture[str]) -> None:
    for message in ("plain", "\x1b[31mred\x1b[0m", "µm", ""):
        typer.echo(message)
        wanted = capsys.readouterr()
        typer_later.echo(message)
        assert capsys.readouterr() == wanted
        typer.echo(message, err=True, nl=False)
        wanted = capsys.readouterr()
        typer_later.echo(message, err=True, nl=False)
        assert capsys.readouterr() == wanted


START = "import sys; sys.argv[0] = 'commonrail'\nfrom commonrail.cli.start import main\n"


def run(code: str, *words: str, **settings: Any) -> subprocess.CompletedProcess[str]:
    """Run the command in a process of its own."""
    done = [sys.executable, "-c", START + code, *words]
    return subprocess.run(done, capture_output=True, text=True, check=False, **settings)


LOADED = """
import atexit
atexit.register(lambda: print("LOADED", *sorted({"typer", "pydantic", "rich"} & set(sys.modules)), file=sys.stderr))
main()
"""


@pytest.mark.process
def test_a_plain_command_line_loads_no_typer() -> None:
    done = run(LOADED, "catalogue", "injectors")
    assert (done.returncode, "cri2-16" in done.stdout) == (0, True)
    assert "typer" not in done.stderr.split("LOADED")[1].split()
    done = run(LOADED, "catalogue", "--help")
    assert "typer" in done.stderr.split("LOADED")[1].split()


@pytest.mark.process
def test_an_error_ends_a_plain_command_line_as_it_ends_typers() -> None:
    words = ["simulate", "no-such-injector", "--rail-pressure", "160MPa", "--energising-time", "700us"]
    directly, by_name = run("main()", *words), run("import typer; main()", *words)
    assert directly.returncode == by_name.returncode == 2
    assert directly.stderr == by_name.stderr
    assert directly.stderr.startswith("commonrail: no-such-injector: there is no such file")


@pytest.mark.process
@pytest.mark.skipif(os.name != "posix", reason="a closed pipe is told by a signal or an error on POSIX alone")
def test_a_reader_that_closes_the_pipe_ends_it_quietly() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    words = [sys.executable, "-c", START + "main()", "catalogue", "parameters"]
    done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, "")
