"""Packages of work: taken up by a worker of the same software and the same bits alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base.errors import StudyError
from commonrail.workers.task import failure, pack, unpack
from tests.workers.crews import Deed, Deeds, with_other


def test_work_that_is_unpacked_gives_the_same_answer(tmp_path: Path) -> None:
    work = Deeds(tmp_path)
    assert unpack(pack(work))(Deed(3)) == work(Deed(3))


def test_a_worker_with_other_software_or_other_bits_is_refused(tmp_path: Path) -> None:
    package = pack(Deeds(tmp_path))
    for name, words in (("numpy", r"numpy [0-9.]+"), ("llvmlite", r"llvmlite [0-9.]+"), ("cpu", r"cpu [\w-]+")):
        with pytest.raises(StudyError, match=rf": {words} .*other"):
            unpack(package._replace(software=with_other(package, name, "other")))
    with pytest.raises(StudyError, match="without sse0"):
        unpack(
            package._replace(software=with_other(package, "features", dict(package.software)["features"] + ",+sse0"))
        )
    with pytest.raises(StudyError, match="another objective"):
        unpack(package._replace(probe=b"other"))


def test_work_with_the_same_bits_everywhere_asks_for_versions_alone(tmp_path: Path) -> None:
    work = Deeds(tmp_path)
    work.same_bits = True
    package = pack(work)
    assert not {"cpu", "features", "triple", "settings"} & dict(package.software).keys()
    with pytest.raises(StudyError, match=r": numpy [0-9.]+ .*other"):
        unpack(package._replace(software=with_other(package, "numpy", "other")))
    assert unpack(package)(Deed(3)) == work(Deed(3))


def test_the_words_of_a_failure_are_one_line() -> None:
    assert failure(MemoryError()).reason == "met MemoryError"
    assert failure(ValueError("a\n  b")).reason == "met ValueError: a b"
