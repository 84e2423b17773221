"""The command as a test calls it, and a small study that is calibrated once."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import click
import pytest
from click.testing import CliRunner

from commonrail.cli.grammar import cli
from commonrail.plugins.new.study import write_new
from tests.readers.conftest import injector_file  # noqa: F401


class Done(NamedTuple):
    """End of a command."""

    status: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """The one line that an error has."""
        lines = [line for line in self.err.splitlines() if line.startswith("commonrail: ")]
        assert len(lines) == 1, self.err
        assert "Traceback" not in self.err
        return lines[0].removeprefix("commonrail: ")

    @property
    def record(self) -> dict[str, Any]:
        """The one JSON object on stdout."""
        loaded: dict[str, Any] = json.loads(self.out, parse_constant=pytest.fail)
        return loaded


Command = Callable[..., Done]


# Below click 8.2 stderr is part of stdout unless it is taken apart, and from there always apart.
APART: Any = {"mix_stderr": False} if "mix_stderr" in inspect.signature(CliRunner).parameters else {}


def invoke(command: click.Command, *arguments: object) -> Done:
    """Run a command of click with arguments."""
    result = CliRunner(**APART).invoke(command, [str(a) for a in arguments], prog_name=command.name)
    return Done(result.exit_code, result.stdout, result.stderr)


def run_command(*arguments: object) -> Done:
    """Run ``commonrail`` with arguments."""
    return invoke(cli, *arguments)


def check_made_again(command: Command, folder: Path) -> None:
    """The report of a folder is made again to the same bytes, and its place is told."""
    report = folder / "report.html"
    before = report.read_text(encoding="utf-8")
    report.unlink()
    assert command("report", folder).out == f"{report}\n"
    assert report.read_text(encoding="utf-8") == before


@pytest.fixture
def command() -> Command:
    """The command, for tests."""
    return run_command


def small_study(folder: Path) -> Path:
    """The study of ``commonrail new`` with a search of a second."""
    write_new(folder)
    study = folder / "study.toml"
    text = study.read_text(encoding="utf-8")
    small = {"members = 24": "members = 8", "generations = 30": "generations = 2"}
    small["polish = 3"] = "polish = 0"
    for old, new in small.items():
        assert old in text
        text = text.replace(old, new)
    study.write_text(text, encoding="utf-8")
    return study


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Study file of a small study."""
    return small_study(tmp_path / "small")
