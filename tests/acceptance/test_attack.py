"""The promises of docs/reliability.md hold under the short form of the attacks; ``make attack`` runs the long one."""

from __future__ import annotations

import sys

import pytest

from tests.robustness.attack import __main__ as command
from tests.robustness.attack.base import ATTACKS, Attack

SHORT = [one for one in ATTACKS if one.few]


@pytest.mark.process
@pytest.mark.parametrize("one", SHORT, ids=lambda one: one.run.__name__)
def test_the_promise_holds_under_attack(one: Attack) -> None:
    assert command.verdict(one, short=True) == ""


def test_what_fell_is_told_and_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    tried: list[int] = []
    holds = Attack("It holds", lambda folder, times: tried.append(times) or "", 9, 2)
    falls = Attack("It falls", lambda folder, times: "a reason", 9, 1)
    left_out = Attack("It holds at length", lambda folder, times: tried.append(times) or "", 7, 0)
    monkeypatch.setattr(command, "ATTACKS", [holds, falls, left_out])
    for arguments, status, last in ((["--short"], 1, "1 of 2 held"), (["holds"], 0, "2 of 2 held")):
        monkeypatch.setattr(sys, "argv", ["attack", *arguments])
        with pytest.raises(SystemExit) as ended:
            command.main()
        told = capsys.readouterr().out.splitlines()
        assert (ended.value.code, told[-1]) == (status, last)
        assert ("fell  It falls: a reason" in told) is bool(status)
    assert tried == [2, 9, 7]
