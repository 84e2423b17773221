"""Errors of `commonrail next` that are told before anything is simulated."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.conftest import Command


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--criterion", "w"), "--criterion"),
        (("--apart-time", "fast"), "--apart-time"),
        (("--out", "nowhere/plan.csv"), "folder nowhere"),
        (("--out", "one.html", "--report", "./one.html"), "two outputs"),
        ((), "result.json"),
    ],
)
def test_a_wrong_option_is_named(command: Command, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    done = command("next", tmp_path, *options)
    assert done.status == 2
    assert words in done.sentence
