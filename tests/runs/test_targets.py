"""Another target of the compiler, or other bits: said at resume, and in the result."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.compiler.target import describe
from commonrail.runs.fit import Listener, resume
from commonrail.runs.journal import Journal
from commonrail.runs.tables import put
from tests.runs.conftest import Stop, Stopped, Whole, stop_after, timeless

OTHER = describe()._replace(cpu="znver9", features="+avx9,-avx")


def told_by(run: Path, stop: int = 0) -> list[str]:
    """Warnings of the target that resuming gives, to its end or until some steps were done."""
    notes: list[str] = []
    if stop:
        with pytest.raises(Stopped):
            resume(run, threads=1, listener=Listener(stop_after(stop).progress, notes.append))
    else:
        resume(run, threads=1, listener=Listener(note=notes.append))
    return [note for note in notes if "simulated again" in note]


def warned(run: Path) -> list[str]:
    record: Any = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return [warning["sentence"] for warning in record["warnings"] if warning["code"] == "target"]


def test_the_same_target_is_not_worth_a_word(whole: Whole, stopped: Stop) -> None:
    run = stopped(3)
    assert told_by(run) == []
    assert timeless(run) == timeless(whole.run)
    assert json.loads(timeless(run))["target"] == describe().machine


def test_a_run_begun_on_another_target_says_so(stopped: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("commonrail.runs.journal.describe", lambda: OTHER)
        run = stopped(3)
    (text,) = told_by(run)
    assert f"begun with cpu znver9, now {describe().cpu}; instruction sets, now without avx9" in text
    assert "same bits" in text
    assert [f"warning: {sentence}" for sentence in warned(run)] == [text]


def test_a_session_between_is_not_forgotten(stopped: Stop, monkeypatch: pytest.MonkeyPatch) -> None:
    run = stopped(2)
    with monkeypatch.context() as patch:
        patch.setattr("commonrail.runs.journal.describe", lambda: OTHER)
        assert "now znver9" in told_by(run, 1)[0]
    (text,) = told_by(run)
    assert f"resumed as session 2 with cpu znver9, now {describe().cpu}" in text
    assert "begun with" not in text


def test_other_bits_of_the_best_candidates_are_seen(stopped: Stop) -> None:
    """One bit of a cost, of the best candidate or of one beside it, is another than this processor finds."""
    for place in (0, 1):
        run = stopped(3)
        with Journal(run) as journal:
            number, *others, costs, statuses = journal._table("generation")[-1]
            kept = np.frombuffer(costs).copy()
            which = np.argsort(kept)[place]
            right, wrong = float(kept[which]), float(np.nextafter(kept[which], 0.0))
            kept[which] = wrong
            journal._write(put("generation", number, *others, kept.tobytes(), statuses))
            assert journal.best_step()[1].tobytes() == kept.tobytes()
        (text,) = told_by(run, 1)
        assert f"have other bits here, {right!r} in place of {wrong!r}" in text
        shutil.rmtree(run)
