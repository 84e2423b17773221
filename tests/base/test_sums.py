"""Checksums beside result files: a file that is not the one that was written is refused by whatever reads it."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from commonrail.base.errors import InputError, OutputError
from commonrail.base.input import SUMS, check_sum
from commonrail.base.output import write_set
from commonrail.cli.model_name import read_model_name
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import dump_injector
from commonrail.runs.folder import read_record, read_run, write_record
from commonrail.runs.traces import write_traces
from tests.refused import refused

FILES = ("result.json", "calibrated.toml", "traces.csv")
RECORD = {"schema": 1, "kind": "calibration", "best": 0.000257}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Result files with their checksums."""
    folder = tmp_path / "run"
    folder.mkdir()
    with write_set(folder):
        write_record(folder / "result.json", RECORD)
        dump_injector(load_injector("virtual-lino-2016"), folder / "calibrated.toml")
        write_traces(folder / "traces.csv", [], ("measured",), [])
    return folder


def test_files_as_they_were_written_are_read(run: Path) -> None:
    assert read_run(run)[0] == RECORD
    assert read_model_name(str(run)).label == "run"
    assert [line.split()[1] for line in (run / SUMS).read_text(encoding="utf-8").splitlines()] == [*FILES]


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="the system has no sha256sum")
def test_sha256sum_reads_them(run: Path) -> None:
    done = subprocess.run(["sha256sum", "-c", SUMS], cwd=run, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.count("OK")) == (0, len(FILES))


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("result.json", read_run),
        ("traces.csv", read_run),
        ("calibrated.toml", lambda run: load_injector(run / "calibrated.toml")),
        ("calibrated.toml", lambda run: read_model_name(str(run))),
    ],
)
def test_a_digit_that_has_changed_is_refused(run: Path, name: str, read: Callable[[Path], Any]) -> None:
    path = run / name
    text = path.read_text(encoding="utf-8")
    digit = max(text.rfind(c) for c in "0123456789") if name != "traces.csv" else len(text) - 1
    path.write_text(text[:digit] + chr(ord(text[digit]) ^ 1) + text[digit + 1 :], encoding="utf-8")
    with refused(InputError, "changed", name):
        read(run)


def test_a_file_changed_on_purpose_is_read_from_another_folder(run: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copy(run / "calibrated.toml", tmp_path / "mine.toml"))
    copy.write_text(copy.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
    assert load_injector(copy).values == load_injector(run / "calibrated.toml").values


def test_folders_of_earlier_versions_have_none_and_are_read(run: Path) -> None:
    (run / SUMS).unlink()
    path = run / "result.json"
    write_record(path, {"best": 0.000258})
    assert read_record(path, "commonrail calibrate") == {"best": 0.000258}


def test_damaged_checksums_never_pass_a_damaged_file(run: Path) -> None:
    sums = run / SUMS
    whole = sums.read_bytes()
    for bit in range(8 * len(whole)):  # a name or a digest: what is not listed any more was not damaged
        spoilt = bytearray(whole)
        spoilt[bit // 8] ^= 1 << bit % 8
        sums.write_bytes(spoilt)
        for name in FILES:
            try:
                check_sum(run / name)
            except InputError as error:
                words = "this is not the file that was written", "the checksums are damaged"
                assert any(word in str(error) for word in words)  # noqa: PT017 - only some bits are refused


def test_checksums_that_were_cut_are_refused(run: Path) -> None:
    """A file that is not listed any more may have been changed too."""
    sums = run / SUMS
    sums.write_bytes(sums.read_bytes()[:60])
    with refused(InputError, "damaged line 1"):
        check_sum(run / FILES[0])


def test_a_process_killed_while_it_writes_leaves_the_former_files(run: Path) -> None:
    writing = write_set(run)
    writing.__enter__()
    write_record(run / "result.json", {"best": 0.1})  # and nothing after it
    assert read_run(run)[0] == RECORD


def test_a_block_that_fails_leaves_the_former_files_alone(run: Path) -> None:
    with pytest.raises(TypeError), write_set(run, "traces.csv"):
        write_record(run / "result.json", {"best": object()})
    assert read_run(run)[0] == RECORD
    assert sorted(path.name for path in run.iterdir()) == sorted((*FILES, SUMS))


def _write_another(run: Path) -> None:
    with write_set(run):
        write_record(run / "result.json", {"best": 0.1})
        dump_injector(load_injector("virtual-lino-2016").with_values({"nozzle.holes": 9}), run / "calibrated.toml")


@pytest.mark.parametrize("moved", [1, 2])
def test_a_folder_with_files_of_two_results_is_refused(run: Path, monkeypatch: pytest.MonkeyPatch, moved: int) -> None:
    left, replace = iter(range(moved)), os.replace

    def killed(source: Path, target: Path) -> None:
        next(left)  # StopIteration in place of the end of the process
        replace(source, target)

    monkeypatch.setattr("commonrail.base.output.os.replace", killed)
    with pytest.raises(RuntimeError):
        _write_another(run)
    monkeypatch.undo()
    for read in (read_run, lambda folder: read_model_name(str(folder))):
        with pytest.raises(InputError):
            read(run)


def test_files_of_the_former_set_are_removed_with_their_checksums(run: Path) -> None:
    with write_set(run, "traces.csv"), write_set(run, "calibrated.toml"):
        write_record(run / "result.json", {"best": 0.1})
    assert sorted(path.name for path in run.iterdir()) == [SUMS, "result.json"]
    assert read_record(run / "result.json", "") == {"best": 0.1}


def test_a_link_in_place_of_the_checksums_is_not_followed(run: Path, tmp_path: Path) -> None:
    (run / SUMS).unlink()
    (run / SUMS).symlink_to(tmp_path / "elsewhere")
    with refused(OutputError, "symbolic-link"), write_set(run):
        raise AssertionError
