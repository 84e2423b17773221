"""A file of a study is read once, whatever is taken from it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from commonrail.calibration.study_file import load_study
from commonrail.readers import grid


def test_a_rate_and_the_drive_beside_it_are_read_and_split_once(monkeypatch: pytest.MonkeyPatch) -> None:
    counts: Counter[tuple[str, str]] = Counter()
    read, split = grid.read_encoded, grid.split_lines

    def reading(path: Path, *how: Any) -> Any:
        counts["read", path.name] += 1
        return read(path, *how)

    def splitting(path: Path, *how: Any) -> Iterator[Any]:
        yield from split(path, *how)
        counts["split", path.name] += 1

    monkeypatch.setattr(grid, "read_encoded", reading)
    monkeypatch.setattr(grid, "split_lines", splitting)
    study = load_study(Path(__file__).parents[2] / "cases/paper/study.toml")
    assert {what for what, _ in counts} == {"read", "split"}
    assert set(counts.values()) == {1}
    assert len(counts) == 2 * len(study.data)
