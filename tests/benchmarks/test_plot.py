"""Figures are drawn from the record, and only from what it holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.plot import draw, draw_methods

RECORD: dict[str, Any] = {
    "case": "the case",
    "date": "2026-01-02T03:04:05+00:00",
    "notes": ["The machine was busy."],
    "machine": {"processor": "a processor", "threads": 2},
    "methods": [
        {"method": "slow", "family": "SciPy", "seconds": 2.0, "L1_percent": 0.5},
        {"method": "fast", "family": "lanes", "seconds": 1e-4, "L1_percent": 0.02},
        {"method": "stuck", "family": "SciPy", "seconds": 9.0, "L1_percent": None},
    ],
}


def test_bars_are_the_times_and_errors_of_the_record() -> None:
    left, right = draw_methods(RECORD).axes
    assert [bar.get_width() for bar in left.patches] == pytest.approx([2000.0, 0.1])
    assert [bar.get_width() for bar in right.patches] == pytest.approx([0.5, 0.02])


def test_what_was_not_measured_is_not_drawn(tmp_path: Path) -> None:
    assert draw(RECORD, tmp_path) == [tmp_path / "bench-methods.svg"]
    drawn = (tmp_path / "bench-methods.svg").read_text(encoding="utf-8")
    assert "SYNTHETIC" in drawn
    assert "The machine was busy." in drawn


def test_the_same_record_gives_the_same_bytes(tmp_path: Path) -> None:
    (first,) = draw(RECORD, tmp_path)
    before = first.read_bytes()
    draw(RECORD, tmp_path)
    assert first.read_bytes() == before
