"""Options and arguments from annotated signatures, and verbs of installed packages."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from enum import StrEnum
from inspect import cleandoc
from pathlib import Path
from typing import Annotated, Any

import click
import pytest

from commonrail.base import registry
from commonrail.cli.grammar import Argument, Option, cli, verb
from commonrail.plugins import SHIPPED
from tests.cli.conftest import Command, invoke


@pytest.mark.parametrize("name", SHIPPED["verbs"])
def test_the_examples_of_the_help_are_accepted(name: str) -> None:
    command = cli.get_command(click.Context(cli), name)
    words_of_name = len(name.split())
    lines = cleandoc(command.help).replace("\\\n", " ").splitlines()
    examples = [
        shlex.split(line.partition(" > ")[0]) for line in lines if line.strip().startswith(f"commonrail {name}")
    ]
    assert examples
    for words in examples:
        command.make_context(name, words[1 + words_of_name :])


class Colour(StrEnum):
    """A choice whose members have other names than values."""

    RED = "red"
    DARK_BLUE = "dark-blue"


passed: dict[str, Any] = {}


@verb
def everything_(
    place: Annotated[Path, Argument(metavar="PLACE", help="A place.")],
    others: Annotated[tuple[str, ...], Argument(help="More places.")] = (),
    *,
    size: Annotated[str, Option(help="A size.")],
    colour: Annotated[Colour, Option(help="A colour.")] = Colour.RED,
    shade: Annotated[Colour | None, Option(help="A shade.")] = None,
    share: Annotated[float | None, Option(min=0.0, help="A share.")] = None,
    count: Annotated[int, Option(min=1, max=7, help="A number.")] = 3,
    some_file: Annotated[Path | None, Option(help="A file.")] = None,
    set_: Annotated[tuple[str, ...], Option("--set", help="A value; repeatable.")] = (),
    quick: Annotated[bool, Option("--quick", help="Be quick.")] = False,
) -> None:
    """Take one of each kind."""
    passed.update(locals())


DEFAULTS = {"place": Path("a"), "others": (), "size": "2 mm", "colour": Colour.RED, "shade": None, "share": None}
DEFAULTS |= {"count": 3, "some_file": None, "set_": (), "quick": False}


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ([], {}),
        (["b", "c"], {"others": ("b", "c")}),
        (["--set", "x=1", "--quick", "--set=y=2"], {"set_": ("x=1", "y=2"), "quick": True}),
        (["--colour", "dark-blue", "--shade", "red"], {"colour": Colour.DARK_BLUE, "shade": Colour.RED}),
        (["--share", "1e-3", "--count", "7", "--some-file", "f"], {"share": 1e-3, "count": 7, "some_file": Path("f")}),
    ],
)
def test_a_function_gets_the_values_of_its_annotations(words: list[str], values: dict[str, Any]) -> None:
    passed.clear()
    done = invoke(everything_, "a", "--size", "2 mm", *words)
    assert done.status == 0, done.err
    assert passed == DEFAULTS | values
    assert {name: type(value) for name, value in passed.items()} == {
        name: type(value) for name, value in (DEFAULTS | values).items()
    }


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--size", "1"], "PLACE"),
        (["a"], "--size"),
        (["a", "--size"], "--size"),
        (["a", "--size", "1", "--count", "8"], "--count"),
        (["a", "--size", "1", "--share=-1"], "--share"),
        (["a", "--size", "1", "--colour", "DARK_BLUE"], "dark-blue"),
        (["a", "--size", "1", "--colours", "red"], "--colour"),
        (["a", "--size", "1", "--size=2"], "--size"),
    ],
)
def test_what_does_not_fit_is_named(words: list[str], named: str) -> None:
    done = invoke(everything_, *words)
    assert done.status == 2
    assert named in done.err.splitlines()[-1]


def test_the_help_has_the_text_of_each_argument() -> None:
    text = " ".join(invoke(everything_, "--help").out.split())
    assert "PLACE A place." in text
    assert "[OTHERS]... More places." in text


VERBS = """
import click
from commonrail.base.errors import InputError

@click.command()
@click.option("--bins", default=10, help="Number of bins.")
def histogram(bins):
    "Draw a histogram."
    if bins < 1:
        raise InputError("--bins: at least one.")
    click.echo(f"{bins} bins")

def function():
    "No command of click."
"""


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Distribution with a verb, one whose module cannot be imported and one that is no command of click."""
    (tmp_path / "example_verbs.py").write_text(VERBS, encoding="utf-8")
    (tmp_path / "example_broken_verb.py").write_text("raise OSError('no driver')\n", encoding="utf-8")
    info = tmp_path / "example_verbs-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: example-verbs\nVersion: 1.2\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(
        "[commonrail.verbs]\nhistogram = example_verbs:histogram\nbroken = example_broken_verb:histogram\n"
        "plain = example_verbs:function\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    registry.find_installed.cache_clear()
    yield
    registry.find_installed.cache_clear()


@pytest.mark.usefixtures("installed")
def test_a_verb_of_an_installed_package_works_as_those_that_ship(command: Command) -> None:
    assert command("histogram", "--bins", "3").out == "3 bins\n"
    assert "Number of bins." in command("histogram", "-h").out
    refused = command("histogram", "--bins", "0")
    assert (refused.status, refused.sentence) == (2, "--bins: at least one.")
    assert '"histogram"' in command("histogramm").err


@pytest.mark.usefixtures("installed")
def test_the_help_lists_the_others_beside_a_broken_verb(command: Command) -> None:
    done = command("--help")
    assert done.status == 0
    headings = done.out.split("exit.\n")[1].split("\n\n")
    listed = [line.split()[0] for part in headings for line in part.strip().splitlines()[1:]]
    assert sorted(listed[:-1]) == sorted(name for name in SHIPPED["verbs"] if " " not in name)
    assert listed[-1] == "histogram"
    broken, plain = done.err.splitlines()
    assert broken.startswith('commonrail: plug-in example-verbs 1.2: "broken" of commonrail.verbs cannot be loaded')
    assert plain.startswith('commonrail: plug-in example-verbs 1.2: "plain" of commonrail.verbs is to be a command of')


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("name", ["broken", "plain"])
def test_a_broken_verb_that_is_called_ends_with_2(command: Command, name: str) -> None:
    done = command(name)
    assert (done.status, done.out) == (2, "")
    assert f'"{name}" of commonrail.verbs' in done.sentence
