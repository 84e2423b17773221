"""The examples in the page on fleets are accepted as they stand."""

from __future__ import annotations

import re
from pathlib import Path

from commonrail.plugins.fleet.study import RowSupply, load_fleet
from tests.plugins.fleet.conftest import edited
from tests.plugins.fleet.test_row_supply import curve, layout

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "howto" / "fleet.md").read_text(encoding="utf-8")


def test_fleet_and_table_of_files(fleet_file: Path) -> None:
    (toml,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    (table,) = re.findall(r"```text\n(serial number.*?)```", PAGE, re.S)
    study = edited(fleet_file.parent / "study.toml", 'name = "80 MPa"', 'name = "120 MPa"')
    text = study.read_text(encoding="utf-8")
    first = text[text.index("[[data]]") : text.index("[[parameter]]")]
    third = first[first.rindex("[[data]]") :].replace('name = "120 MPa"', 'name = "80 MPa"')
    study.write_text(text.replace(first, first + third), encoding="utf-8")
    fleet_file.write_text(toml, encoding="utf-8")
    (fleet_file.parent / "injectors.csv").write_text(table, encoding="utf-8")
    supply = load_fleet(fleet_file).supply
    assert {name: list(supply.fingerprints(name)) for name in supply.names} == {
        "SN000412": ["160 MPa", "120 MPa"],
        "SN000413": ["160 MPa"],
    }


def test_table_of_samples(tmp_path: Path) -> None:
    (table,) = re.findall(r"```text\n(injector,data.*?)```", PAGE, re.S)
    path = tmp_path / "measurements.csv"
    path.write_text(table, encoding="utf-8")
    supply = RowSupply(path, layout(curve("160 MPa"), curve("80 MPa")), None)
    file = supply.deliver("SN000412", tmp_path)["160 MPa"]
    assert file.read_text(encoding="utf-8").splitlines()[1:] == ["time [us],rate [mm3/ms]", "0,0.02", "3,0.11"]
