"""`new` from Python: a study to start from, and arguments that belong together."""

from __future__ import annotations

from pathlib import Path

import pytest

import commonrail as cr


def test_it_writes_a_study_that_loads(tmp_path: Path) -> None:
    started = cr.new(tmp_path / "mine")
    assert cr.load_study(started.study).space.dimension > 0
    assert all(path.is_file() for path in started.files)


@pytest.mark.parametrize("arguments", [{"injector": "cri2-16"}, {"files": ["map.csv"]}])
def test_files_and_injector_belong_together(tmp_path: Path, arguments: dict[str, object]) -> None:
    with pytest.raises(cr.errors.ConfigurationError):
        cr.new(tmp_path / "mine", **arguments)  # type: ignore[arg-type]
    assert not (tmp_path / "mine").exists()
