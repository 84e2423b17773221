"""Progress in a terminal and in a file."""

from __future__ import annotations

import html
import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import pytest

from commonrail.base import hooks
from commonrail.base.table import Cell, Table
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.calibration.search import Progress
from commonrail.cli import console as progress
from commonrail.cli import fit
from commonrail.cli.console import COMPILING
from commonrail.report.fit.rules import CARE, TITLES
from commonrail.report.fit.verdict import verdict
from commonrail.report.page import report_html
from tests.report.samples import map_record, rate_record

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


def test_a_line_tells_the_time_left_by_that_of_the_steps_so_far(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = iter(range(0, 1000, 2))  # two seconds from a step to the next
    monkeypatch.setattr(progress, "monotonic", lambda: time)
    with progress.Bar("A study") as bar:
        for done in range(1, 11):
            time = next(clock)
            bar.show(progress.Stage("evolution", done, 10, "best 1"))
    assert "evolution 4/10: best 1, 12.0 s left" in capsys.readouterr().err.splitlines()


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


def be_narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make standard output a terminal of 80 columns."""
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "80")


@pytest.mark.parametrize("record", [rate_record(), map_record()])
def test_a_terminal_ends_in_the_verdict_and_what_to_do(
    record: dict[str, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    be_narrow(monkeypatch)
    with click.Context(click.Command("calibrate")) as context:
        context.meta[progress.SHORT] = progress.ShortForm()
        fit.print_outcome(fit.Outcome(Path("runs/a"), Path("runs/a/report.html"), record), json=False)
    lines = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out).splitlines()
    assert len(lines) <= 25  # a screen of a terminal
    assert lines[-1] == "report: runs/a/report.html"
    commands = [line for line in lines if line.startswith("  commonrail ")]
    assert 1 <= len(commands) <= 3
    assert max(len(line) for line in lines if line not in commands) <= 80
    assert any(line.startswith(f"┃ {TITLES[CARE]}") for line in lines)


def test_terminal_page_and_json_have_one_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    record = map_record()
    outcome = fit.Outcome(Path("runs/a"), Path("runs/a/report.html"), record)
    fit.print_outcome(outcome, json=True)
    told = json.loads(capsys.readouterr().out)["verdict"]
    found = verdict(read_as(CalibrationRecord, record), "runs/a")
    assert (told["level"], told["title"], told["reasons"]) == (found.level, found.title, found.reasons)
    fit.print_outcome(outcome, json=False)
    for text in (re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out), html.unescape(report_html(record, {}, "runs/a"))):
        assert found.headline in text


WIDE = Table("Title", ("name", "a", "b"), ((Cell("first"), Cell("1" * 40), Cell("2" * 40)),), "A note. " * 20)


@pytest.mark.parametrize("mark", ["", " ●"])  # which has no width of its own in plain text
def test_a_narrow_terminal_divides_a_table_rather_than_lose_its_results(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], mark: str
) -> None:
    be_narrow(monkeypatch)
    progress.print_table(replace(WIDE, rows=((Cell("first"), Cell("1" * 40), Cell("2" * 40 + mark)),)))
    text = capsys.readouterr().out
    assert "1" * 40 in text
    assert "2" * 40 in text
    assert text.count("first") == 2  # each part says whose row it is
    assert max(map(len, re.sub(r"\x1b\[[\d;]*m", "", text).splitlines())) <= 80


def test_a_file_gets_all_columns(capsys: pytest.CaptureFixture[str]) -> None:
    progress.print_table(WIDE)
    assert "2" * 40 in capsys.readouterr().out
