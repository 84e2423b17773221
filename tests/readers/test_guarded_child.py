"""Files that would take memory or time without end are refused with a sentence, and honest ones are read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.plugins.formats import lvm
from commonrail.plugins.formats.lvm import LvmFile
from commonrail.plugins.formats.mat import MatFile
from commonrail.plugins.formats.records import MdfFile
from commonrail.readers import guarded, xlsx_child
from commonrail.readers.columns import Column
from commonrail.readers.grid import read_grid
from commonrail.readers.guarded import read_apart
from commonrail.readers.tables import read_columns
from tests.child_in_process import read_in_process
from tests.fuzz import bombs
from tests.refused import refused

START = "import sys; sys.path.insert(0, sys.argv[1]); from commonrail.readers import guarded as child; "
LIMIT = START + "child._limit(int(sys.argv[-2]), int(sys.argv[-1])); "


def written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_a_child_beyond_its_time_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "TIME", 0.1)
    monkeypatch.setattr(guarded, "_PROGRAM", LIMIT + "exec('while True: pass')")
    with refused(InputError, "too-costly", "b.mf4"):
        read_apart("commonrail.plugins.formats.mdf_child", Path("a/b.mf4"), b"no end")


def test_a_child_that_waits_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "WAIT", 0.01)
    monkeypatch.setattr(guarded, "_PROGRAM", "import time; time.sleep(1e4)")
    with refused(InputError, "too-costly"):
        read_apart("commonrail.plugins.formats.mdf_child", Path("a.mf4"), b"waits")


def test_a_child_that_a_fault_ends_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "_PROGRAM", "import os; os.kill(os.getpid(), 11)")
    with refused(InputError, "reader-failed", "a.mf4"):
        read_apart("commonrail.plugins.formats.mdf_child", Path("a.mf4"), b"a fault")


def test_the_child_is_of_the_same_package_from_every_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "commonrail").mkdir()
    (tmp_path / "commonrail" / "__init__.py").write_text("raise ImportError", encoding="utf-8")
    (tmp_path / "numpy.py").write_text("raise ImportError", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "commonrail"))
    with pytest.raises(InputError, match=r"a\.mat: .*version 5"):
        read_apart("commonrail.plugins.formats.mat_child", Path("a.mat"), b"from another folder")


def test_a_limit_of_the_process_holds_for_its_child(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever limits the program limits the child too, which may only take less."""
    resource = pytest.importorskip("resource", reason="no limits of POSIX")
    kind, wanted = resource.RLIMIT_DATA, guarded.MEMORY // 2
    script = f"import resource; resource.setrlimit({kind}, ({wanted}, {wanted})); " + START.replace(
        "sys.argv[1]", repr(guarded._ROOT)
    )
    script += f"child._limit({2 * wanted}, 5); print(resource.getrlimit({kind})[0])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert int(done.stdout) == wanted


def test_one_text_of_a_workbook_beyond_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    monkeypatch.setattr(guarded, "MEMORY", 200_000_000)
    path = written(tmp_path / "a.xlsx", bombs.text_cell(150_000_000))
    with refused(InputError, "too-costly", "a.xlsx"):
        read_grid(path)


def test_names_of_a_structure_beyond_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guarded, "MEMORY", 250_000_000)
    path = written(tmp_path / "a.mat", bombs.mat5_names(10_000_000))
    with refused(InputError, "too-costly", "a.mat"):
        MatFile(path)


def test_a_chunk_of_a_number_that_holds_many_is_not_unpacked(tmp_path: Path) -> None:
    pytest.importorskip("h5py", reason="the extra mat is not installed")
    path = written(tmp_path / "a.mat", bombs.mat73_chunk(20_000_000))
    with pytest.raises(InputError, match=r'"x" .*160 MB.*100 MB'):
        MatFile(path)


def test_a_record_of_huge_samples_beyond_the_memory(tmp_path: Path) -> None:
    pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    path = written(tmp_path / "a.mf4", bombs.mdf_record())
    with refused(InputError, "too-costly", "a.mf4"):
        MdfFile(path)


@pytest.mark.slow
def test_a_list_of_groups_without_end(tmp_path: Path) -> None:
    pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    path = written(tmp_path / "a.mf4", bombs.mdf_loop())
    with pytest.raises(InputError, match=r"a\.mf4: .* 5 s .*processor"):
        MdfFile(path)


def test_a_workbook_with_a_format_in_its_last_column_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    read_in_process(monkeypatch)
    seen = 0
    convert = xlsx_child._cell

    def count(value: object) -> str | float:
        nonlocal seen
        seen += 1
        return convert(value)

    monkeypatch.setattr(xlsx_child, "_cell", count)
    path = written(tmp_path / "a.xlsx", bombs.sheet(20))
    found = read_columns(path, [Column("time", "s", increasing=True), Column("rate", "m3/s")])
    np.testing.assert_allclose(found.columns["time"], 1e-6 * np.arange(2, 22))
    assert seen <= 21 * 1010  # of the 21 rows of 16,384 cells those that may hold a value


def test_cells_far_to_the_right_that_hold_a_value_are_not_omitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("openpyxl", reason="the extra excel is not installed")
    read_in_process(monkeypatch)
    path = written(
        tmp_path / "a.xlsx", bombs.xlsx([b'<row r="1"><c r="A1"><v>1</v></c><c r="XFD1"><v>1</v></c></row>'])
    )
    with pytest.raises(InputError, match=r"row 1: .*16384.*1000"):
        read_grid(path)


def test_a_long_row_of_a_text_is_refused_by_its_columns(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", bombs.thousands(1001, 3))
    with refused(InputError, "too-many"):
        assert read_grid(path).rows


def test_a_rectangle_that_short_rows_would_fill_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", bombs.thousands(900, 25_000))
    with refused(InputError, "too-many"):
        assert read_grid(path).rows


def test_too_many_channels_of_a_text_are_refused(tmp_path: Path) -> None:
    with refused(InputError, "too-many"):
        LvmFile(written(tmp_path / "a.lvm", bombs.lvm(1001)))


def test_tags_that_nobody_reads_are_not_kept_for_each_channel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = []
    raster = lvm._raster

    def note(own: dict[str, str], decimal: str, at: object) -> tuple[float, float]:
        kept.append(len(own))
        return raster(own, decimal, at)  # type: ignore[arg-type]

    monkeypatch.setattr(lvm, "_raster", note)
    file = LvmFile(written(tmp_path / "a.lvm", bombs.lvm(3, tags=100, blank=50)))
    assert file.names == ["c0", "c1", "c2"]
    assert max(kept) < 10


def test_cells_of_a_record_as_text_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lvm, "MOST_VALUES", 100)
    with pytest.raises(InputError, match="100 cells"):
        LvmFile(written(tmp_path / "a.lvm", bombs.lvm(3, blank=200)))
