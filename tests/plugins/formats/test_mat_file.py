"""MAT files of version 5 and of version 7.3, and quantity maps in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from commonrail.base.errors import InputError
from commonrail.plugins.formats import mat_child as mat
from commonrail.plugins.formats.mat import MatFile
from commonrail.plugins.maps.file import write_map_file
from commonrail.readers.columns import Column
from commonrail.readers.overview import survey
from commonrail.readers.quantity_matrix import GivenUnits
from commonrail.readers.tables import read_columns
from tests.child_in_process import read_in_process
from tests.plugins.maps.tables import table

TIME = np.arange(0.0, 500.0, 5.0)
RATE = 0.1 * TIME
UNITS = {"time": "us", "rate": "mm3/ms"}


def mat5(path: Path, **more: Any) -> Path:
    savemat(path, {"run": {"time": TIME, "rate": np.column_stack([RATE, 2.0 * RATE]), "units": UNITS}} | more)
    return path


def mat73(path: Path) -> Path:
    """As MATLAB writes it: a block of 512 bytes in front, columns together, texts as numbers."""
    h5py = pytest.importorskip("h5py", reason="the extra mat is not installed")
    with h5py.File(path, "w", userblock_size=512) as file:
        run = file.create_group("run")
        run["time"], run["rate"] = TIME[None, :], np.stack([RATE, 2.0 * RATE])
        for name, text in UNITS.items():
            letters = run.create_dataset(f"{name}_unit", data=np.array([[ord(c)] for c in text], np.uint16))
            letters.attrs["MATLAB_class"] = np.bytes_("char")
        file["elsewhere"] = h5py.ExternalLink("/etc/passwd", "/")
    return path


@pytest.mark.parametrize("write", [mat5, mat73])
def test_fields_and_columns_are_read_with_the_units_beside_them(tmp_path: Path, write: Any) -> None:
    path = write(tmp_path / "a.mat")
    wanted = [Column("run.time", "s", increasing=True), Column("run.rate(:,2)", "m3/s")]
    found = read_columns(path, wanted)
    np.testing.assert_allclose(found.columns["run.time"], TIME * 1e-6)
    np.testing.assert_allclose(found.columns["run.rate(:,2)"], 2e-6 * RATE)
    assert sorted(MatFile(path).names) == ["run.rate(:,1)", "run.rate(:,2)", "run.time"]


def test_what_cannot_be_read_of_a_mat_file_is_named_with_the_reason(tmp_path: Path) -> None:
    """Objects of MATLAB 7.3 are references, six numbers each; cells are lists of anything."""
    h5py = pytest.importorskip("h5py", reason="the extra mat is not installed")
    with h5py.File(tmp_path / "b.mat", "w", userblock_size=512) as file:
        for name, kind in (("T", "timetable"), ("S", "string"), ("c", "cell")):
            data = file.create_dataset(name, data=np.array([[3707764736, 2, 1, 1, 1, 1]], np.uint32))
            data.attrs["MATLAB_class"] = np.bytes_(kind)
            if kind != "cell":
                data.attrs["MATLAB_object_decode"] = np.int32(3)
        empty = file.create_dataset("e", data=np.array([0, 0], np.uint64))
        empty.attrs["MATLAB_empty"] = np.uint8(1)
    with pytest.raises(InputError, match="table2struct"):
        MatFile(tmp_path / "b.mat")
    cells = np.array([[1.0, 2.0], "a"], dtype=object)
    path = mat5(tmp_path / "a.mat", c=cells, z=np.array([1.0 + 2.0j, 2.0]))
    assert set(MatFile(path).unread) == {"c", "z"}
    assert {"c", "z"} <= set(survey(path).facts)


def test_variables_of_unlike_length_and_bad_numbers_are_named(tmp_path: Path) -> None:
    path = mat5(tmp_path / "a.mat", short=np.arange(3.0), gap=np.where(TIME == 10.0, np.nan, TIME))
    with pytest.raises(InputError, match=r'"run\.time" 100, "short" 3'):
        read_columns(path, [Column("run.time", "s"), Column("short", "m", "m")])
    with pytest.raises(InputError, match=r'value 3, column "gap": .*finite'):
        read_columns(path, [Column("gap", "m", "m")])
    with pytest.raises(InputError, match=r'column "gap": .*\bunit\b'):
        read_columns(path, [Column("gap", "m", required=False)])


def test_damaged_and_huge_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "b.mat").write_bytes(b"nothing of that kind" * 20)
    with pytest.raises(InputError, match=r"b\.mat: .*version 5"):
        MatFile(tmp_path / "b.mat")
    (tmp_path / "b.mat").write_bytes(mat5(tmp_path / "a.mat").read_bytes()[:900])
    with pytest.raises(InputError, match=r"b\.mat: .*MAT .*\(\w+\)"):
        MatFile(tmp_path / "b.mat")
    savemat(tmp_path / "c.mat", {"zeros": np.zeros(200_000)}, do_compression=True)
    read_in_process(monkeypatch)
    monkeypatch.setattr(mat, "MOST_VALUES", 1000)
    with pytest.raises(InputError, match=r'"zeros" .*200000 .* 1000 '):
        MatFile(tmp_path / "c.mat")


def test_columns_beyond_the_limit_are_refused_before_they_are_looked_at(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {f"v{i}": np.zeros((2, 1000), np.int8) for i in range(11)}, do_compression=True)
    with pytest.raises(InputError):
        MatFile(tmp_path / "a.mat")


@pytest.mark.parametrize("turned", [False, True])
def test_a_map_is_found_by_names_or_units_either_way_round(tmp_path: Path, turned: bool) -> None:
    cells = np.arange(6.0).reshape(2, 3)
    savemat(tmp_path / "m.mat", {"p": [80.0, 120.0], "et": [300.0, 500.0, 700.0], "q": cells.T if turned else cells})
    found = MatFile(tmp_path / "m.mat").quantity_map(GivenUnits("MPa", "us", "mm3"))
    assert found.rail_pressure.tolist() == [80.0] * 3 + [120.0] * 3
    assert found.quantity.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    with pytest.raises(InputError, match=r'unit .*\("p"\) .*energising time'):
        MatFile(tmp_path / "m.mat").quantity_map(GivenUnits(quantity="mm3"))


def test_two_variables_that_fit_are_named(tmp_path: Path) -> None:
    savemat(tmp_path / "m.mat", {"a": [8.0, 12.0], "b": [3.0, 5.0], "q": np.ones((2, 2))})
    with pytest.raises(InputError, match=r'rail pressure; .*"a", "b"'):
        MatFile(tmp_path / "m.mat").quantity_map(GivenUnits())


def test_a_map_that_commonrail_wrote_is_read_back(tmp_path: Path) -> None:
    written = table()
    write_map_file(tmp_path / "own.mat", [written])
    file = MatFile(tmp_path / "own.mat")
    values = next(array for name, array in file.arrays.items() if name.endswith(".values"))
    np.testing.assert_array_equal(values, written.values)
    assert file.unit(next(name for name in file.arrays if name.endswith(".values"))) == written.unit


@pytest.mark.parametrize("compressed", [False, True])
def test_what_is_read_of_a_file_and_what_is_omitted(tmp_path: Path, compressed: bool) -> None:
    content = {
        "double": np.linspace(-1.0, 1.0, 7),
        "matrix": np.arange(6.0).reshape(2, 3),
        "small": np.arange(3, dtype=np.int8),
        "single": np.float32([1.5, 2.5]),
        "large": np.array([2**40], np.int64),
        "double_unit": "µs",
        "s": {"a": np.arange(4.0), "inner": {"b": np.array([3.0, 4.0]), "b_unit": "mm3"}},
        "runs": np.array([([1.0, 2.0],), ([5.0, 6.0],)], [("x", object)]),
        "z": np.array([1.0 + 2.0j]),
        "cell": np.array(["a", np.arange(3)], object),
    }
    savemat(tmp_path / "a.mat", content, do_compression=compressed)
    file = MatFile(tmp_path / "a.mat")
    assert set(file.arrays) == {
        "double",
        "matrix",
        "small",
        "single",
        "large",
        "s.a",
        "s.inner.b",
        "runs(1).x",
        "runs(2).x",
    }
    for name in ("double", "matrix", "small", "single", "large"):
        np.testing.assert_array_equal(file.arrays[name], content[name])
    assert file.unit("double") == "µs"
    assert file.unit("s.inner.b") == "mm3"
    np.testing.assert_array_equal(file.arrays["s.inner.b"], [3.0, 4.0])
    np.testing.assert_array_equal(file.arrays["runs(2).x"], [5.0, 6.0])


def test_links_in_circles_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    h5py = pytest.importorskip("h5py", reason="the extra mat is not installed")
    with h5py.File(tmp_path / "a.mat", "w") as file:
        for i in range(20):
            file[f"to_{i}"] = file["/"]
        file["rate"] = [1.0, 2.0]
    read_in_process(monkeypatch)
    monkeypatch.setattr(mat, "MOST_VARIABLES", 1000)
    with pytest.raises(InputError, match=r"\b1000 variables"):
        MatFile(tmp_path / "a.mat")
