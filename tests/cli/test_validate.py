"""commonrail validate: labels, and drives that the data do not have."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from commonrail.base.choices import Drive
from commonrail.readers.injector.file import dump_injector, load_injector
from tests.cli.conftest import Command

NAME = "virtual-lino-2016"
CASE = Path(__file__).resolve().parents[2] / "cases" / "paper" / "study.toml"


def test_validate_calls_an_injector_by_its_name(command: Command) -> None:
    found = command("validate", CASE, "--injector", NAME)
    assert found.status == 0
    assert NAME in found.out
    assert "calibrated" not in found.out


def test_validate_refuses_a_drive_that_the_data_do_not_have(command: Command, tmp_path: Path) -> None:
    own = load_injector(NAME)
    dump_injector(replace(own, variant=own.variant._replace(drive=Drive.VOLTAGE)), tmp_path / "driven.toml")
    found = command("validate", CASE, "--injector", tmp_path / "driven.toml")
    assert (found.status, found.out) == (2, "")
    assert 'driven by a voltage trace, and the data set "160 MPa" has none' in found.sentence
