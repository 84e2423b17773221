"""Progress in a terminal and in a file."""

from __future__ import annotations

import io

import pytest

from commonrail.base import hooks
from commonrail.calibration.search import Progress
from commonrail.cli import console as progress
from commonrail.cli import fit
from commonrail.cli.console import COMPILING

STATES = [
    *(Progress("evolution", g, 30, 400.0 / g, 900.0 / g, 50 * g, 0.5 * g) for g in range(1, 31)),
    Progress("refinement", 1, 1, 12.34, 30.0, 1600, 16.0),
]


def shown(monkeypatch: pytest.MonkeyPatch, terminal: bool) -> str:
    """Output of the progress of a study."""
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=120, markup=False)
    monkeypatch.setattr(progress, "stderr_console", lambda: console)
    with progress.Bar("[b]A study") as bar:
        for state in STATES:
            bar.show(fit.stage_of(state))
    return stream.getvalue()


def test_a_file_gets_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    shown(monkeypatch, terminal=False)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "[b]A study"
    assert lines[1] == "evolution 1/30: best 400, mean 900, 100 injections/s"
    assert lines[-1] == "refinement 1/1: best 12.34, mean 30, 100 injections/s"
    assert len(lines) == 1 + 11 + 1  # the first generation, then every tenth part; the refinement


def test_a_terminal_gets_a_bar_with_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    text = shown(monkeypatch, terminal=True)
    assert "best 12.34" in text
    assert "1/1" in text


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_told_while_it_lasts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], terminal: bool
) -> None:
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, force_terminal=terminal, width=200)
    monkeypatch.setattr(progress, "stderr_console", lambda: console)
    with progress.Bar("A study"):
        assert COMPILING not in stream.getvalue() + capsys.readouterr().err
        with hooks.compiling():
            pass
    assert COMPILING in stream.getvalue() + capsys.readouterr().err
    with hooks.compiling():  # the bar listens no more
        pass
    assert capsys.readouterr().err == ""
