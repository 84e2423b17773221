"""Start of the command: Ctrl-C while it is still being imported."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from commonrail.cli import start
from commonrail.cli.guard import guarded

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
    assert (done.returncode, done.stdout) == (start.INTERRUPTED, "")
    assert done.stderr.split("\n") == ["", "commonrail: interrupted.", ""]


def test_an_interrupt_that_is_ignored_stays_ignored():
    done = _run("typer", "signal.SIG_IGN")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_verb_meets_an_interrupt_as_an_exception():
    before = signal.signal(signal.SIGINT, start._end)
    try:
        guarded(lambda: None)()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
