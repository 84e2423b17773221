"""Start of the command: Ctrl-C while it is still being imported."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest

from commonrail.cli import guard
from commonrail.cli.start import leave_out_warnings

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


@pytest.mark.parametrize("module", ["click", "commonrail.plugins.new.verb"])
def test_an_interrupt_before_a_verb_runs_is_a_sentence(module):
    done = _run(module)
    assert (done.returncode, done.stdout) == (guard.INTERRUPTED, "")
    assert done.stderr.split("\n") == ["", "commonrail: interrupted.", ""]


def test_an_interrupt_that_is_ignored_stays_ignored():
    done = _run("click", "signal.SIG_IGN")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_verb_alone_meets_an_interrupt_as_an_exception():
    before = signal.signal(signal.SIGINT, guard.end_process)
    try:
        with guard.guarded():
            guard.raise_interrupts()
            assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        assert signal.getsignal(signal.SIGINT) is guard.end_process
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


@pytest.mark.process
@pytest.mark.skipif(os.name != "posix", reason="a closed pipe is told by a signal or an error on POSIX alone")
def test_a_reader_that_closes_the_pipe_ends_it_quietly():
    reading, writing = os.pipe()
    os.close(reading)
    words = [sys.executable, "-m", "commonrail", "catalogue", "parameters"]
    done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (done.returncode, done.stderr) == (1, "")


def test_warnings_of_numpy_are_left_out_of_the_terminal(monkeypatch):
    monkeypatch.setattr(sys, "warnoptions", [])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        leave_out_warnings()
        np.array([1e308]) * np.array([10.0])
    assert not caught
