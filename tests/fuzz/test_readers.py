"""Spoilt files are read or refused with one sentence that names a file; `tests/robustness/fuzz.py` feeds many more."""

from __future__ import annotations

import tempfile
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from commonrail.base.errors import InputError
from tests.child_in_process import read_in_process
from tests.fuzz import targets
from tests.fuzz.mutation import mutated
from tests.fuzz.targets import TARGETS, Broken, check, write_input

EXAMPLES = {
    "study": 150,
    "injector": 150,
    "truth": 100,
    "type": 100,
    "tolerances": 100,
    "run": 50,
    "report": 20,
    "journal": 50,
    "fleet": 50,
    "table": 60,
    "bench file": 15,
    "control unit": 60,
    "fleet journal": 30,
}

# No deadline: a first reading compiles and builds; derandomised: the same inputs on every machine.
FEW = settings(deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))


@pytest.fixture(autouse=True)
def _in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read workbooks and Parquet in this process, which is faster; a damaged MAT file may end it."""
    read_in_process(monkeypatch, "mat")


def written(folder: Path, files: targets.Files) -> Path:
    for file, data in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(data)
    return folder


@pytest.mark.parametrize("name", TARGETS)
def test_spoilt_files(name: str) -> None:
    @settings(FEW, max_examples=EXAMPLES[name])
    @given(random=st.randoms(use_true_random=False))
    def run(random: Random) -> None:
        with tempfile.TemporaryDirectory() as folder:
            write_input(random, name, Path(folder))
            check(name, Path(folder))

    run()


@pytest.mark.parametrize("name", TARGETS)
def test_bytes_of_no_file(name: str) -> None:
    files = TARGETS[name].files()[0]
    spoilt = next(file for file in files if file.endswith(TARGETS[name].spoilt))

    @settings(FEW, max_examples=30)
    @given(data=st.binary(max_size=300) | st.text(max_size=300).map(lambda text: text.encode("utf-8", "surrogatepass")))
    def run(data: bytes) -> None:
        with tempfile.TemporaryDirectory() as folder:
            refused = check(name, written(Path(folder), {**files, spoilt: data}))
            # any text is a table; to SQLite a file of a byte at most is a database that has just begun
            assert refused or name == "table" or (name == "fleet journal" and len(data) < 2)

    run()


@pytest.mark.parametrize("name", TARGETS)
def test_the_files_are_good_before_they_are_spoilt(name: str, tmp_path: Path) -> None:
    """Otherwise every input would be refused for one and the same reason."""
    for i, files in enumerate(TARGETS[name].files()):
        assert check(name, written(tmp_path / str(i), files)) == ""


def test_a_reader_that_fails_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(folder: Path) -> None:
        raise KeyError(folder)

    def mumbles(folder: Path) -> None:
        raise InputError("something is wrong.")

    def leaks(folder: Path) -> None:
        raise InputError(f"{folder}: {object()!r}.")

    for reader, words in ((fails, "KeyError"), (mumbles, "no file is named"), (leaks, "object at 0x")):
        monkeypatch.setitem(TARGETS, "study", TARGETS["study"]._replace(read=reader))
        with pytest.raises(Broken, match=words):
            check("study", tmp_path)


@pytest.mark.parametrize("name", TARGETS)
def test_some_inputs_are_read_and_some_refused(name: str, tmp_path: Path) -> None:
    """Faults that are all fatal, or none, would try little of what comes after the first check."""
    found = []
    for seed in range(30):
        folder = tmp_path / str(seed)
        folder.mkdir()
        write_input(Random(seed), name, folder)
        found.append(bool(check(name, folder)))
    assert 1 <= sum(found) <= 29


def test_inputs_repeat() -> None:
    data = b'a = "160 MPa"\nb = [1]\n'
    first, second = ([mutated(Random(seed), "a.toml", data) for seed in range(50)] for _ in range(2))
    assert first == second
    assert len(set(first)) > 40
