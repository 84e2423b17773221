"""Ctrl-C as a request to stop."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys

import pytest

from commonrail.base.hooks import hold_interrupts
from tests.waiting import PATIENCE


def test_a_signal_is_a_wish_that_is_heeded_when_asked() -> None:
    reached = False
    with hold_interrupts() as stop:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGTERM)
        reached = True
        assert stop.asked
        with pytest.raises(KeyboardInterrupt):
            stop.check()
    assert reached


def test_in_a_library_a_second_ctrl_c_interrupts_at_once() -> None:
    before = signal.getsignal(signal.SIGINT)
    reached = []

    def press_twice() -> None:
        with hold_interrupts():
            for number in (1, 2):
                os.kill(os.getpid(), signal.SIGINT)
                reached.append(number)

    with pytest.raises(KeyboardInterrupt):
        press_twice()
    assert reached == [1]
    assert signal.getsignal(signal.SIGINT) is before


# A command in a simulation that hands nothing back to Python: a second Ctrl-C must not wait for it.
COMMAND = """
import ctypes, os, signal, sys
from commonrail.cli.console import say_of_ending
from commonrail.base.hooks import end_at_second, hold_interrupts
end_at_second(say_of_ending)
with hold_interrupts() as stop:
    os.kill(os.getpid(), signal.SIGINT)
    print(stop.asked, flush=True)
    mutex = ctypes.create_string_buffer(128)
    for _ in range(2):  # the second waits for ever, whatever signals Python has noted
        ctypes.CDLL(None).pthread_mutex_lock(mutex)
"""


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="zeros are a mutex on Linux")
def test_in_a_command_a_second_ctrl_c_ends_at_once() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as command:
        assert command.stdout is not None
        assert command.stderr is not None
        assert command.stdout.readline() == "True\n"
        command.send_signal(signal.SIGINT)
        try:
            rest, said = command.communicate(timeout=PATIENCE)
        finally:
            command.kill()
    assert command.returncode == -signal.SIGINT
    assert rest == ""
    assert re.fullmatch("\ncommonrail: stopping .*Ctrl-C .*\n", said)


def test_an_inner_block_shares_the_outer_wish_and_leaves_its_handler() -> None:
    before = signal.getsignal(signal.SIGINT)
    with hold_interrupts() as outer:
        with hold_interrupts() as inner:
            os.kill(os.getpid(), signal.SIGTERM)
            assert inner is outer
        assert outer.asked
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_new_block_begins_without_a_wish() -> None:
    with hold_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
    with hold_interrupts() as stop:
        stop.check()


def test_a_signal_that_was_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with hold_interrupts() as stop:
            signal.raise_signal(signal.SIGHUP)
            assert not stop.asked
            signal.raise_signal(signal.SIGTERM)
            assert stop.asked
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
