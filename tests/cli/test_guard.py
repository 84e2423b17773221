"""Every way in which a verb can end badly is one sentence and a status."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import typer
from typer.testing import CliRunner, Result

from commonrail import errors
from commonrail.cli.guard import guarded, show_traceback


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
        (MemoryError(), 2, "not enough memory; take a shorter horizon or a longer time step."),
    ],
)
def test_an_error_is_one_line_on_stderr(error: BaseException, status: int, sentence: str) -> None:
    result = end_with(error)
    assert result.exit_code == status
    assert result.stdout == ""
    assert result.stderr == f"commonrail: {sentence}\n"


def test_a_fault_of_the_program_asks_for_a_report() -> None:
    result = end_with(ZeroDivisionError("a\nb"))
    assert result.exit_code == 1
    assert result.stderr.startswith("commonrail: internal fault (ZeroDivisionError: a b); please")
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
