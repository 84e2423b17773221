"""Fleet files: what is read, and one sentence with file and key for each fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base.errors import CommonrailError, InputError
from commonrail.plugins.fleet.study import load_fleet
from tests.plugins.fleet.conftest import COUNT, edited, small_fleet


def test_keys_and_defaults(fleet_file: Path) -> None:
    fleet = load_fleet(fleet_file)
    assert fleet.title == "Synthetic fleet of 6 injectors"
    assert (fleet.seed, fleet.attempts, fleet.time_limit) == (1, 3, 3600.0)
    assert fleet.supply.names == tuple(f"SN{i:06d}" for i in range(1, COUNT + 1))
    edited(fleet_file, "seed = 1", 'seed = 7\nattempts = 2\ntime_limit = "90 s"\nnote = "n"')
    fleet = load_fleet(fleet_file)
    assert (fleet.seed, fleet.attempts, fleet.time_limit, fleet.note) == (7, 2, 90.0, "n")


SEED = "seed = 1"
FAULTS = {
    "no format": ('format = "commonrail-fleet/1"', "", r"fleet\.toml: .*commonrail-fleet/1"),
    "unknown key": (SEED, "sead = 1", r'fleet\.toml: .*"sead" .*"seed"'),
    "kind": (SEED, 'seed = "1"', "fleet.toml, seed: .*'1'"),
    "truth value": (SEED, "seed = true", "fleet.toml, seed: .*True"),
    "seed": (SEED, "seed = -1", r"fleet\.toml, seed: .*-1"),
    "attempts": (SEED, "attempts = 0", r"fleet\.toml, attempts: .*1.*0"),
    "time limit": (SEED, 'time_limit = "0 s"', r"fleet\.toml, time_limit: "),
    "unit": (SEED, 'time_limit = "1 m"', r'fleet\.toml, time_limit: "1 m"'),
    "no title": ('title = "Synthetic fleet of 6 injectors"', "", r"fleet\.toml, title: "),
    "no study": ('study = "study.toml"', 'study = "stdy.toml"', r'stdy\.toml: .*"study\.toml"'),
    "no table": ('files = "injectors.csv"', "", r"fleet\.toml: .*files = .*rows = "),
    "both tables": (SEED, 'rows = "x.csv"', r"fleet\.toml: .*files = .*rows = "),
    "left out": (SEED, 'leave_out = ["80 Mpa"]', r'fleet\.toml, leave_out: .*study\.toml .*"80 Mpa" .*"80 MPa"'),
    "nothing to fit": (SEED, 'leave_out = ["160 MPa"]', r"fleet\.toml: .*study\.toml "),
    "list of numbers": (SEED, "leave_out = [80]", r"fleet\.toml, leave_out\[1\]: "),
    "column": (SEED, '[columns]\n"60 MPa" = "x"', r'fleet\.toml, columns: .*"60 MPa"'),
    "no column": (SEED, '[columns]\n"80 MPa" = "x"', r'injectors\.csv: .*"x".*"80 MPa"'),
    "dead times": (SEED, 'dead_times = "x"', r"fleet\.toml, dead_times: "),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(fleet_file: Path, fault: str) -> None:
    old, new, message = FAULTS[fault]
    edited(fleet_file, old, new)
    with pytest.raises(CommonrailError, match=message) as caught:
        load_fleet(fleet_file)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_a_fault_of_the_template_is_named_there(fleet_file: Path) -> None:
    edited(fleet_file.parent / "study.toml", "[optimiser]", "[optimizer]")
    with pytest.raises(InputError, match=r'study\.toml: .*"optimizer" .*"optimiser"'):
        load_fleet(fleet_file)


ROW_FAULTS = {
    "twice": ("SN000002,data/SN000002_1", "SN000001,data/SN000002_1", r'line 4: .*"SN000001"'),
    "no name": ("SN000002,data/SN000002_1", ",data/SN000002_1", "line 4: "),
    "no column": ("injector,160 MPa", "serial,160 MPa", '"injector".*"serial"'),
}


@pytest.mark.parametrize("fault", ROW_FAULTS)
def test_a_fault_of_the_table_is_named_with_its_line(fleet_file: Path, fault: str) -> None:
    old, new, message = ROW_FAULTS[fault]
    edited(fleet_file.parent / "injectors.csv", old, new)
    with pytest.raises(InputError, match=rf"injectors\.csv.*{message}"):
        load_fleet(fleet_file)


def test_a_table_without_rows(fleet_file: Path) -> None:
    (fleet_file.parent / "injectors.csv").write_text("injector,160 MPa,80 MPa\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"injectors\.csv: "):
        load_fleet(fleet_file)


def test_columns_may_be_called_otherwise(fleet_file: Path) -> None:
    edited(fleet_file.parent / "injectors.csv", "injector,160 MPa,80 MPa", "serial,evi,other [x]")
    columns = '[columns]\ninjector = "serial"\n"160 MPa" = "evi"\n"80 MPa" = "other"'
    fleet = load_fleet(edited(fleet_file, "seed = 1", columns))
    files = fleet.supply.deliver("SN000003", fleet_file.parent)
    assert {name: file.name for name, file in files.items()} == {
        "160 MPa": "SN000003_160MPa.csv",
        "80 MPa": "SN000003_80MPa.csv",
    }


def test_an_empty_cell_is_a_data_set_that_an_injector_lacks(fleet_file: Path) -> None:
    edited(fleet_file.parent / "injectors.csv", "data/SN000003_80MPa.csv", "")
    supply = load_fleet(fleet_file).supply
    assert list(supply.fingerprints("SN000003")) == ["160 MPa"]
    assert list(supply.fingerprints("SN000002")) == ["160 MPa", "80 MPa"]


def test_a_table_of_rows(tmp_path: Path) -> None:
    fleet = load_fleet(small_fleet(tmp_path, "rows"))
    assert len(fleet.supply.names) == COUNT
    with pytest.raises(InputError, match=r"fleet\.toml, dead_times: .*study\.toml "):
        load_fleet(edited(tmp_path / "fleet.toml", "seed = 1", 'dead_times = "x.csv"'))
