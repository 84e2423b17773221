"""Every way in which a verb can end badly is one sentence and a status."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner, Result

from commonrail import errors
from commonrail.cli.app import app
from commonrail.cli.guard import MEMORY, guarded, show_traceback


def end_with(error: BaseException) -> Result:
    """Run a verb that raises."""

    def verb() -> None:
        raise error

    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(guarded(verb))
    return CliRunner().invoke(app, [])


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (errors.InputError("a.toml: no such file."), 2, "a.toml: no such file."),
        (errors.ConfigurationError("x contradicts y."), 2, "x contradicts y."),
        (errors.StudyError("no data."), 2, "no data."),
        (errors.OutputError("disk full."), 3, "disk full."),
        (errors.SimulationError("failed."), 4, "failed."),
        (errors.InputError("two\n  lines."), 2, "two lines."),
        (PermissionError(13, "Permission denied", "x.csv"), 2, "x.csv: Permission denied."),
        (KeyboardInterrupt(), 130, "interrupted."),
        (
            ModuleNotFoundError("No module named 'llvmlite.binding'", name="llvmlite.binding"),
            2,
            "this needs machine code that no library of this installation holds, and the package llvmlite, which "
            "compiles it, is not installed: pip install 'commonrail[jit]'.",
        ),
        (
            ModuleNotFoundError("No module named 'scipy'", name="scipy"),
            2,
            "the package scipy, which this needs, is not installed: pip install scipy.",
        ),
        (MemoryError(), 2, "not enough memory; close other programs or take a machine with more."),
    ],
)
def test_an_error_is_one_line_on_stderr(error: BaseException, status: int, sentence: str) -> None:
    result = end_with(error)
    assert result.exit_code == status
    assert result.stdout == ""
    assert result.stderr == f"commonrail: {sentence}\n"


@pytest.mark.parametrize("error", [ZeroDivisionError("a\nb"), ModuleNotFoundError("a b", name="commonrail.absent")])
def test_a_fault_of_the_program_asks_for_a_report(error: Exception) -> None:
    result = end_with(error)
    assert result.exit_code == 1
    assert result.stderr.startswith(f"commonrail: internal fault ({type(error).__name__}: a b); please")
    assert result.stderr.count("\n") == 1


def wish_by_option(patch: pytest.MonkeyPatch) -> None:
    """As the option --traceback does."""
    patch.setattr("commonrail.cli.guard.show_traceback", _Always())


def wish_by_variable(patch: pytest.MonkeyPatch) -> None:
    """As a user's environment does."""
    patch.setenv("COMMONRAIL_TRACEBACK", "1")


class _Always:
    def get(self) -> bool:
        return True


@pytest.mark.parametrize("wish", [wish_by_option, wish_by_variable])
def test_a_traceback_is_shown_on_demand(
    monkeypatch: pytest.MonkeyPatch, wish: Callable[[pytest.MonkeyPatch], None]
) -> None:
    wish(monkeypatch)
    result = end_with(ZeroDivisionError("a"))
    assert "Traceback (most recent call last)" in result.stderr
    assert result.stderr.splitlines()[-1].startswith("commonrail: internal fault")


def test_the_option_is_heard() -> None:
    from commonrail.cli.app import options

    options(traceback=True)
    assert show_traceback.get()
    options(traceback=False)
    assert not show_traceback.get()


@pytest.mark.parametrize("error", [typer.Exit(5), typer.BadParameter("no")])
def test_what_typer_raises_is_left_to_typer(error: Exception) -> None:
    assert "commonrail:" not in end_with(error).stderr


@pytest.mark.parametrize("name", MEMORY)
def test_the_cure_of_too_little_memory_is_one_that_the_verb_has(name: str) -> None:
    options = {option for part in get_command(app).commands[name].params for option in part.opts}  # type: ignore[attr-defined]
    assert set(re.findall(r"--[a-z-]+", MEMORY[name])) <= options
    assert ("--workers" in MEMORY[name]) == ("--workers" in options)


def test_the_cure_of_too_little_memory_is_that_of_the_verb() -> None:
    def fleet() -> None:
        raise MemoryError

    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(guarded(fleet))
    assert MEMORY["fleet"] in CliRunner().invoke(app, []).stderr
