"""The study of one injector."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateData
from commonrail.plugins.fleet.file import parameter_units
from commonrail.plugins.fleet.member import derive_seed, list_shared_files, name_folders, write_study
from commonrail.plugins.fleet.study import load_fleet
from tests.plugins.fleet.conftest import edited, small_fleet


def test_only_title_seed_and_data_differ_from_the_template(fleet_file: Path, tmp_path: Path) -> None:
    fleet = load_fleet(fleet_file)
    study = load_study(write_study(fleet, "SN000002", tmp_path / "own"))
    first = next(d for d in study.data if isinstance(d, RateData))
    rate = np.loadtxt(fleet_file.parent / "data" / "SN000002_160MPa.csv", delimiter=",", skiprows=2)[:, 1]
    np.testing.assert_allclose(first.rate * 1e6, rate, rtol=1e-12)  # rounding of the change of unit
    assert study.title.endswith(" SN000002")
    assert study.seed == derive_seed(1, "SN000002")
    assert [d.role.value for d in study.data] == ["fit", "validation"]
    assert study.method.evolution.members == 8
    assert first.synthetic


def test_seeds_come_from_the_names() -> None:
    seeds = {derive_seed(seed, name) for seed in (1, 2) for name in ("A", "B", "")}
    assert len(seeds) == 6
    # an agreed number: another one would change the results of every fleet
    assert derive_seed(1, "SN000001") == 692567847627884938


def test_a_data_set_without_file_is_left_out(fleet_file: Path, tmp_path: Path) -> None:
    edited(fleet_file.parent / "injectors.csv", "data/SN000003_80MPa.csv", "")
    study = load_study(write_study(load_fleet(fleet_file), "SN000003", tmp_path / "own"))
    assert [d.name for d in study.data] == ["160 MPa"]


def test_a_meter_goes_along_with_the_data_that_name_it(fleet_file: Path, tmp_path: Path) -> None:
    """One that no data set of an injector names is left out; bounds make a column of the fleet's table."""
    folder = fleet_file.parent
    edited(folder / "injectors.csv", "data/SN000003_80MPa.csv", "")
    edited(folder / "study.toml", 'role = "fit"', 'role = "fit"\nmeter = "first"')
    edited(folder / "study.toml", 'role = "validation"', 'role = "validation"\nmeter = "second"')
    with (folder / "study.toml").open("a", encoding="utf-8") as stream:
        stream.write("\n[meters.first]\ngain = { lower = 0.9, upper = 1.1 }\n[meters.second]\ngain = 1.02\n")
    fleet = load_fleet(fleet_file)
    both, one = (load_study(write_study(fleet, name, tmp_path / name)) for name in ("SN000002", "SN000003"))
    assert [meter.name for meter in both.meters] == ["first", "second"]
    assert [meter.name for meter in one.meters] == ["first"]
    assert one.space.names[-1] == both.space.names[-1] == list(parameter_units(fleet))[-1] == "meter.first.gain"


def test_files_of_the_template_are_found_from_anywhere(
    fleet_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = fleet_file.parent
    (folder / "rail.csv").write_text("time [us],p [MPa]\n0,160\n9,161\n99,162\n999,160\n", encoding="utf-8")
    edited(folder / "study.toml", 'rail_pressure = "160 MPa"', 'rail_pressure = { file = "rail.csv", column = "p" }')
    monkeypatch.chdir(folder)
    fleet = load_fleet(fleet_file.name)
    assert list(list_shared_files(fleet.template)) == ["rail.csv"]
    path = write_study(fleet, "SN000001", tmp_path / "deep" / "own")
    monkeypatch.chdir(tmp_path)
    assert load_study(os.path.relpath(path)).data[0].name == "160 MPa"


def test_rows_become_a_file_of_the_injectors_own(tmp_path: Path) -> None:
    fleet = load_fleet(small_fleet(tmp_path / "fleet", "rows"))
    study = load_study(write_study(fleet, "SN000004", tmp_path / "own"))
    assert len(study.data[0].points) == 12  # type: ignore[union-attr]
    assert (tmp_path / "own" / "rows-1.csv").is_file()


def test_folders_are_told_apart_and_stay_inside() -> None:
    names = ["SN 1/2", "SN_1_2", "a", "A", "..", "", "x" * 300, "plain-1.2"]
    folders = name_folders(names)
    assert folders["plain-1.2"] == "plain-1.2"
    assert folders["SN_1_2"] != "SN_1_2"  # another name would be written so
    assert len({folder.lower() for folder in folders.values()}) == len(names)
    assert all(folder.strip(".") and "/" not in folder and len(folder) < 100 for folder in folders.values())
