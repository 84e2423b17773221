"""Start of the command: Ctrl-C while it is still being imported."""

from __future__ import annotations

import os
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


# A library that loses the interrupt, and goes on with half of what it was reading.
LOST = """
import os, signal
import click
from commonrail.base.output import write_text
from commonrail.cli.grammar import Verbs
from commonrail.cli.start import main
from pathlib import Path
def verb():
    try:
        os.kill(os.getpid(), signal.{signal})
    except BaseException:
        pass
    {following}
Verbs.get_command = lambda *_: click.Command("runs", callback=verb)
signal.signal(signal.SIGINT, signal.default_int_handler)
main()
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
@pytest.mark.parametrize("following", ["pass", 'write_text(Path("result"), "")'])
def test_a_stop_that_a_library_loses_is_no_success(tmp_path, name, following):
    program = LOST.format(signal=name, following=following)
    words = [sys.executable, "-c", program, "runs"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == guard.INTERRUPTED
    assert not list(tmp_path.iterdir())


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
