"""Start of the command: Ctrl-C while it is still being imported."""

from __future__ import annotations

import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest

from commonrail.cli import start
from commonrail.cli.command import leave_out_warnings
from commonrail.cli.guard import guarded
from commonrail.cli.interrupt import INTERRUPTED, end_process

# Ctrl-C arrives when a module is looked for, which no sleeping and no clock could hit as surely.
PROGRAM = """
import signal, sys
class Key:
    def find_spec(self, name, path=None, target=None):
        if name == "{module}":
            signal.raise_signal(signal.SIGINT)
sys.meta_path.insert(0, Key())
signal.signal(signal.SIGINT, {handler})
from commonrail.cli.start import main
main()
"""


def _run(module: str, handler: str = "signal.default_int_handler") -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-c", PROGRAM.format(module=module, handler=handler), "new", "--help"]
    return subprocess.run(words, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("module", ["typer", "commonrail.cli.new"])
def test_an_interrupt_before_a_verb_runs_is_a_sentence(module):
    done = _run(module)
    assert (done.returncode, done.stdout) == (INTERRUPTED, "")
    assert done.stderr.split("\n") == ["", "commonrail: interrupted.", ""]


def test_an_interrupt_that_is_ignored_stays_ignored():
    done = _run("typer", "signal.SIG_IGN")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_verb_meets_an_interrupt_as_an_exception():
    before = signal.signal(signal.SIGINT, end_process)
    try:
        guarded(lambda: None)()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


LATE = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from commonrail.cli.start import main
try:
    main()
finally:
    os.kill(os.getpid(), signal.SIGINT)
"""


def test_an_interrupt_after_the_verb_has_ended_does_not_kill_the_process():
    words = [sys.executable, "-c", LATE, "catalogue", "injectors", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "cri2-16" in done.stdout


def test_an_interrupt_between_the_verb_and_the_end_has_its_status(monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    ended = []
    monkeypatch.setattr("commonrail.cli.command.main", interrupted)
    monkeypatch.setattr(start, "end_process", lambda number, frame: ended.append(number))
    before = signal.getsignal(signal.SIGINT)
    try:
        start.main()
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended == [signal.SIGINT]


def test_warnings_of_numpy_are_left_out_of_the_terminal(monkeypatch):
    monkeypatch.setattr(sys, "warnoptions", [])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        leave_out_warnings()
        np.array([1e308]) * np.array([10.0])
    assert not caught
