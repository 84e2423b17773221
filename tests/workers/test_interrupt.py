"""Ctrl-C as a wish."""

from __future__ import annotations

import os
import signal

import pytest

from commonrail.workers.interrupt import held_interrupts


def test_a_signal_is_a_wish_that_is_heeded_when_asked() -> None:
    reached = False
    with held_interrupts() as wish:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)
        reached = True
        assert wish.asked
        with pytest.raises(KeyboardInterrupt):
            wish.heed()
    assert reached


def test_an_inner_block_shares_the_outer_wish_and_leaves_its_handler() -> None:
    before = signal.getsignal(signal.SIGINT)
    with held_interrupts() as outer:
        with held_interrupts() as inner:
            os.kill(os.getpid(), signal.SIGTERM)
            assert inner is outer
        assert outer.asked
        os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def test_a_new_block_begins_without_a_wish() -> None:
    with held_interrupts():
        os.kill(os.getpid(), signal.SIGINT)
    with held_interrupts() as wish:
        wish.heed()


def test_a_signal_that_was_ignored_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with held_interrupts() as wish:
            signal.raise_signal(signal.SIGHUP)
            assert not wish.asked
            signal.raise_signal(signal.SIGTERM)
            assert wish.asked
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
