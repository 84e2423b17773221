"""The verb report: page, PDF, and one sentence where no browser is found."""

from __future__ import annotations

import json
import re
import shutil
import stat
from pathlib import Path

import pytest

from commonrail.report.pdf import BROWSERS
from tests.cli.conftest import Command
from tests.report.conftest import rate_run, write_run

__all__ = ["rate_run", "write_run"]


def test_without_a_browser_there_is_one_sentence_and_no_report(
    command: Command, rate_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    done = command("report", rate_run, "--pdf")
    assert done.status == 2
    assert re.search(r"\bnone\b.*report\.html .*browser", done.err)
    assert not (rate_run / "report.html").exists()


def fake(path: Path, script: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A program in place of the browser."""
    path.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr("commonrail.report.pdf.BROWSERS", (str(path),))


def test_a_browser_that_prints_nothing_is_told(
    command: Command, rate_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fake(tmp_path / "browser", "exit 3", monkeypatch)
    done = command("report", rate_run, "--pdf")
    assert done.status == 3
    assert "no PDF" in done.err


def test_the_browser_gets_the_page_and_its_pdf_is_kept(
    command: Command, rate_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = 'for a in "$@"; do case "$a" in --print-to-pdf=*) echo "$a $*" > "${a#--print-to-pdf=}";; esac; done'
    fake(tmp_path / "browser", script, monkeypatch)
    done = command("report", rate_run, "--pdf")
    assert done.out.split() == [str(rate_run / "report.html"), str(rate_run / "report.pdf")]
    assert (rate_run / "report.html").as_uri() in (rate_run / "report.pdf").read_text(encoding="utf-8")


@pytest.mark.process
@pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no Chromium, Chrome or Edge on this machine")
def test_a_real_browser_prints_a_pdf(command: Command, rate_run: Path) -> None:
    done = command("report", rate_run, "--pdf", "--json")
    assert Path(done.record["pdf"]).read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(("key", "value"), [("seed", float("nan")), ("parameters", [3])])
def test_a_result_that_somebody_has_spoilt_is_one_sentence(
    command: Command, rate_run: Path, key: str, value: object
) -> None:
    record = json.loads((rate_run / "result.json").read_text(encoding="utf-8"))
    (rate_run / "result.json").write_text(json.dumps(record | {key: value}), encoding="utf-8")
    (rate_run / "SHA256SUMS").unlink(missing_ok=True)
    done = command("report", rate_run)
    assert done.status == 2
    assert done.sentence


def test_the_tables_of_a_calibration_are_printed_again(command: Command, rate_run: Path, tmp_path: Path) -> None:
    """As `calibrate --full` printed them, without another fit."""
    short, full = command("report", rate_run, "--no-live"), command("report", rate_run, "--no-live", "--full")
    assert short.out.splitlines() == full.out.splitlines()[-1:] == [str(rate_run / "report.html")]
    assert "plunger_needle.k1" in full.out
    assert command("report", tmp_path, "--full").status == 2
