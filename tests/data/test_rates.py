"""Injection curves that cannot be what they say."""

from __future__ import annotations

from pathlib import Path

import pytest

import commonrail as cr
from commonrail.plugins.new.study import write_new


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("rate [mm3/ms]", "rate [m3/s]"),  # more than any injector has
        ("\n1600,", "\n١٦٠٠,"),  # a digit of another script
        ("\n1600,", "\n1_600,"),
    ],
)
def test_a_curve_that_cannot_be_is_refused(tmp_path: Path, old: str, new: str) -> None:
    write_new(tmp_path / "own")
    data = tmp_path / "own" / "data" / "evi.csv"
    text = data.read_text(encoding="utf-8")
    assert old in text
    data.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(cr.CommonrailError, match=r"(study\.toml|evi\.csv)"):
        cr.load_study(tmp_path / "own" / "study.toml")
