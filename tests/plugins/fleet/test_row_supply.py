"""One table for all: rows find their injector and their data set."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from commonrail.base.errors import InputError
from commonrail.data.curves.samples import RateModel
from commonrail.data.quantities.reading import QuantitiesModel
from commonrail.plugins.fleet.study import Layout, RowSupply, load_fleet
from commonrail.readers.location import Place
from tests.plugins.fleet.conftest import small_fleet

PRESSURES = {"cylinder_pressure": "5 MPa", "return_pressure": "1 MPa"}
CURVE = {"kind": "rate", "role": "fit", "file": "x", "rail_pressure": "80 MPa", "energising_time": "1 ms", **PRESSURES}
MAP = {"kind": "quantities", "role": "fit", "file": "x", **PRESSURES}


def layout(*data: RateModel | QuantitiesModel, left_out: tuple[str, ...] = (), **columns: str) -> Layout:
    return Layout(data, left_out, columns, Place("fleet.toml"), Path("study.toml"))


def curve(name: str) -> RateModel:
    return RateModel.model_validate({"name": name} | CURVE)


def quantities(name: str, **more: object) -> QuantitiesModel:
    return QuantitiesModel.model_validate({"name": name} | MAP | more)


def table(folder: Path, *lines: str, name: str = "all.csv") -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_rows_go_to_the_data_set_that_they_name(tmp_path: Path) -> None:
    lines = ["injector,data,time [us],rate [mm3/ms]", "A,hi,1,10", "B,hi,1,20", "A,lo,1,30", "A,hi,2,40"]
    supply = RowSupply(table(tmp_path, *lines), layout(curve("hi"), curve("lo")), None)
    assert supply.names == ("A", "B")
    files = supply.deliver("A", tmp_path)
    assert list(files) == ["hi", "lo"]
    assert files["hi"].read_text().splitlines() == ["# rows of all.csv", "time [us],rate [mm3/ms]", "1,10", "2,40"]
    assert files["lo"].read_text().splitlines()[2:] == ["1,30"]
    assert list(supply.deliver("B", tmp_path)) == ["hi"]


def test_maps_share_the_rows_of_an_injector(tmp_path: Path) -> None:
    lines = ["injector,p [bar],energising_time [us],quantity [mm3]", "A,800,500,10"]
    supply = RowSupply(table(tmp_path, *lines), layout(quantities("fit"), quantities("check"), rail_pressure="p"), None)
    files = supply.deliver("A", tmp_path)
    assert files["fit"] == files["check"]
    assert files["fit"].read_text().splitlines()[1] == "rail_pressure [bar],energising_time [us],quantity [mm3]"


def test_dead_times_come_from_a_second_table(tmp_path: Path) -> None:
    first = table(
        tmp_path, "injector,rail_pressure [MPa],energising_time [us],quantity [mm3]", "A,80,500,10", "B,80,500,9"
    )
    second = table(tmp_path, "injector,rail_pressure [MPa],energising_time [us]", "A,80,240", "C,80,1", name="dead.csv")
    dead = quantities("map", dead_times={"file": "x", "quantity": "0.5 mm3"})
    supply = RowSupply(first, layout(dead), second)
    assert supply.names == ("A", "B")
    assert supply.deliver("A", tmp_path)["map dead times"].read_text().splitlines()[2:] == ["80,240"]
    assert list(supply.deliver("B", tmp_path)) == ["map"]
    with pytest.raises(InputError, match=r'dead_times: .*"map" of study\.toml'):
        RowSupply(first, layout(dead), None)


def test_only_the_rows_of_an_injector_make_its_fingerprints(tmp_path: Path) -> None:
    head = "injector,data,time [us],rate [mm3/ms]"
    asked = layout(curve("hi"), curve("lo"))
    before = RowSupply(table(tmp_path, head, "A,hi,1,10", "A,lo,1,10", "B,hi,1,20"), asked, None)
    after = RowSupply(table(tmp_path, head, "C,hi,1,5", "A,hi,1,10", "A,lo,1,11", "B,hi,1,20"), asked, None)
    assert before.fingerprints("B") == after.fingerprints("B")
    assert before.fingerprints("A")["hi"] == after.fingerprints("A")["hi"]
    assert before.fingerprints("A")["lo"] != after.fingerprints("A")["lo"]


FAULTS = {
    "no column data": (["injector,time [us],rate [mm3/ms]", "A,1,1"], 'no column "data", which says to which data set'),
    "unknown data set": (
        ["injector,data,time [us]", "A,hi,1", "A,lO,2"],
        r'line 3: study\.toml .*"lO"',
    ),
    "no name": (["injector,data,time [us]", "A,hi,1", ",lo,2"], "line 3: "),
    "unknown column": (
        ["injector,data,tme [us]", "A,hi,1"],
        r'"t", .*fleet\.toml, columns .*time',
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(tmp_path: Path, fault: str) -> None:
    lines, message = FAULTS[fault]
    columns = {"time": "t"} if fault == "unknown column" else {}
    with pytest.raises(InputError, match=rf"all\.csv.*{message}"):
        RowSupply(table(tmp_path, *lines), layout(curve("hi"), curve("lo"), **columns), None)


def test_rows_of_what_is_left_out_are_passed_over(tmp_path: Path) -> None:
    path = table(tmp_path, "injector,data,time [us],rate [mm3/ms]", "A,hi,1,10", "A,lo,1,10")
    assert list(RowSupply(path, layout(curve("hi"), left_out=("lo",)), None).fingerprints("A")) == ["hi"]


def test_a_fleet_in_parquet_is_the_same_as_in_csv(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow.parquet")
    files = [small_fleet(tmp_path / name, "rows", name) for name in ("m.csv", "m.parquet")]
    first, second = (load_fleet(file).supply for file in files)
    assert first.names == second.names
    for name in first.names:
        # 80 and 80.0 are the same number
        own = [np.loadtxt(s.deliver(name, tmp_path)["map"], delimiter=",", skiprows=2) for s in (first, second)]
        np.testing.assert_array_equal(own[0], own[1])
