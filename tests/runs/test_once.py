"""A run reads its study once and writes its result once: what is on the disk is what was in memory."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
import pytest

from commonrail.base.record import Key
from commonrail.calibration.record import (
    CalibrationRecord,
    CertainParameter,
    CertaintyRecord,
    LackOfFitRecord,
    NoiseRecord,
    ParameterRecord,
)
from commonrail.calibration.study_file import load_study
from commonrail.runs import folder as folders
from commonrail.runs.fit import STUDIES, Listener, calibrate_into
from commonrail.runs.folder import Results, read_result, read_results
from tests.runs.conftest import Whole


def test_a_run_goes_on_with_the_study_that_was_read(study_file: Path, tmp_path: Path) -> None:
    study = replace(load_study(study_file), seed=5)
    folder = tmp_path / "run"
    folder.mkdir()
    inputs, copied, content = replace(STUDIES, load=_refuse).copy(study, folder)
    assert len(inputs) == len(study.files)
    again = load_study(folder / STUDIES.file)
    assert (again.files, again.text) == (copied.files, copied.text)
    assert STUDIES.content(again) == STUDIES.content(copied) == content


def test_a_study_whose_text_was_changed_in_python_is_not_copied(study_file: Path, tmp_path: Path) -> None:
    study = load_study(study_file)
    assert STUDIES.copy(replace(study, text=study.text + "#"), tmp_path)[0] == []


def test_the_result_is_written_once_and_is_what_a_reader_gets(
    study_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Results] = []
    records: list[Path] = []
    write = folders.write_record
    monkeypatch.setattr(folders, "write_record", lambda path, record: records.append(path) or write(path, record))
    run = tmp_path / "run"
    calibrate_into(run, load_study(study_file), listener=Listener(written=written.append))
    assert records == [run / "result.json"]
    (results,) = written
    again = read_results(run, read_result(run))
    assert results.record == again.record
    assert results.draws.keys() == again.draws.keys()
    for name, curves in again.traces.items():
        for label, values in curves.items():
            np.testing.assert_allclose(results.traces[name][label], values, rtol=1e-12)


def _refuse(path: Path) -> None:
    raise AssertionError(f"{path} was read again")


def keys_of(kind: type[Any]) -> set[str]:
    """Keys of a record that a reader's fields are read from, nested ones by their path."""
    keys = set()
    for name, hint in get_type_hints(kind, include_extras=True).items():
        paths = [note.path for note in getattr(hint, "__metadata__", ()) if isinstance(note, Key)]
        keys.add(paths[0] if paths else name)
    return keys


def test_a_reader_has_every_key_that_is_written(whole: Whole) -> None:
    """A key that is renamed on one side alone would be read as its default."""
    record = read_result(whole.run)
    keys = {field.name for field in fields(CalibrationRecord)}
    assert keys - set(record) <= {"loss_scale", "meters", "refits"}
    assert set(ParameterRecord._fields) - set(record["parameters"][0]) <= {"prior", "pull"}
    assert keys_of(CertaintyRecord) - set(record["certainty"]) == {"draws.refused"}
    for kind, part in ((NoiseRecord, "noise"), (LackOfFitRecord, "tests"), (CertainParameter, "parameters")):
        assert keys_of(kind) - set(record["certainty"][part][0]) <= {"probability"}
