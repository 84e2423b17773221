"""Words of `tools.attack`: a misspelt one must not pass for an attack that held."""

from __future__ import annotations

import sys

import pytest

from tools.attack.__main__ import main


def test_words_that_name_no_attack_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["attack", "no attack of this name"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    printed = capsys.readouterr()
    assert "no attack of this name" in printed.err
    assert "held" not in printed.out
