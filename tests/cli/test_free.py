"""`calibrate --free`: parameters that a report advises to free, within their usual ranges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import commonrail as cr
from commonrail.base.errors import InputError
from commonrail.calibration.record import CalibrationRecord, read_as
from commonrail.calibration.study_file import edit_study
from commonrail.calibration.usual import BENCH
from commonrail.plugins.new.study import write_new
from commonrail.report.fit.verdict import verdict
from commonrail.runs.copies import study_of_run
from commonrail.runs.folder import read_result
from commonrail.runs.study_edits import free_in
from tests.cli.conftest import run_command

CASES = Path(__file__).resolve().parents[2] / "cases"


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """The study that `commonrail new` writes, of one curve without a meter."""
    write_new(tmp_path / "mine")
    return tmp_path / "mine" / "study.toml"


def freed(path: Path, *names: str) -> cr.Study:
    known = cr.load_study(path)
    return edit_study(path, free_in(known.injector, known.space.names, names))


def test_a_parameter_of_the_injector_has_a_prior_about_its_value(study: Path) -> None:
    before, text = cr.load_study(study), study.read_text(encoding="utf-8")
    found = freed(study, "valve.mass")
    assert found.space.names == (*before.space.names, "valve.mass")
    parameter, value = found.space.parameters[-1], before.injector.values["valve.mass"]
    assert parameter.lower < value < parameter.upper
    assert parameter.prior is not None
    assert parameter.prior.value == value  # bit by bit
    assert study.read_text(encoding="utf-8") == text


def test_a_value_of_zero_is_free_between_zero_and_what_is_usual(study: Path) -> None:
    parameter = freed(study, "plunger_needle.friction").space.parameters[-1]
    assert parameter.lower == parameter.reference == 0.0 < parameter.upper
    assert parameter.prior is None


def test_a_meter_that_is_added_shows_all_curves_that_have_none(study: Path) -> None:
    found = freed(study, "meter.bench.cutoff")
    assert found.space.names[-1] == "meter.bench.cutoff"
    assert [data.meter.name for data in found.data if data.meter] == [BENCH]


def test_a_stated_quantity_of_a_meter_is_where_the_search_starts(study: Path) -> None:
    text = study.read_text(encoding="utf-8")
    text = text.replace('role = "fit"', 'role = "fit"\nmeter = "evi"', 1)
    study.write_text(f'{text}\n[meters.evi]\nmark = "M"\nsource = "sheet"\ndelay = "700 us"\n', encoding="utf-8")
    parameter = freed(study, "meter.evi.delay").space.parameters[-1]
    assert parameter.reference == pytest.approx(700e-6)
    assert parameter.lower < 700e-6 <= parameter.upper


def test_what_a_type_frees_stays_free() -> None:
    """A study that names no parameter has those of its type: with one more table these are named too."""
    path = CASES / "family" / "164.toml"
    before, found = cr.load_study(path), freed(path, "sac.volume")
    assert set(found.space.names) == {*before.space.names, "sac.volume"}


def test_the_temperature_of_the_fuel_stays_within_its_laws(study: Path) -> None:
    found = freed(study, "fuel.temperature")
    parameter, (low, high) = found.space.parameters[-1], found.injector.fuel.temperature_range
    assert low <= parameter.lower < parameter.upper <= high


def test_a_value_that_the_study_fixes_is_free_from_there(study: Path) -> None:
    fixed = '\n[[fixed]]\nname = "valve.mass"\nvalue = "5 g"\nmark = "M"\nsource = "scales"\n'
    study.write_text(study.read_text(encoding="utf-8") + fixed, encoding="utf-8")
    assert freed(study, "valve.mass").space.parameters[-1].reference == pytest.approx(5e-3)


def test_parameters_that_are_written_inline_take_one_more(study: Path) -> None:
    text = study.read_text(encoding="utf-8")
    head, _, rest = text.partition("[[parameter]]")
    tail = rest[rest.index("[optimiser]") :]
    inline = 'parameter = [{ name = "nozzle.discharge_maximum", lower = 0.7, upper = 0.95 }]\n'
    study.write_text(head.replace("[[data]]", f"{inline}\n[[data]]", 1) + tail, encoding="utf-8")
    assert freed(study, "valve.mass").space.names == ("nozzle.discharge_maximum", "valve.mass")


def test_a_meter_that_no_data_of_the_kind_have_is_refused(study: Path) -> None:
    with pytest.raises(InputError, match="quantity_offset"):
        freed(study, "meter.bench.quantity_offset")  # curves do not see it


@pytest.mark.parametrize("name", ["valve.mas", "meter.bench.speed", "meter.delay", "nozzle.discharge_maximum"])
def test_what_cannot_be_freed_is_refused(study: Path, name: str) -> None:
    with pytest.raises(InputError, match=name):
        freed(study, name)


def test_the_command_frees_and_says_where_it_stands(study: Path, tmp_path: Path) -> None:
    done = run_command("calibrate", str(study), "--free", "valve.mass", "--out", str(tmp_path / "run"), "--no-live")
    assert done.status == 0
    assert "valve.mass" in (tmp_path / "run" / "study.toml").read_text(encoding="utf-8")
    assert Path(study_of_run(tmp_path / "run")) == tmp_path / "run" / "study.toml"  # where the next one is freed
    both = run_command("calibrate", str(study), "--free", "valve.mass", "--widen", str(tmp_path / "run"))
    assert both.status == 2


@pytest.mark.parametrize(
    ("test", "free"),
    [
        ({"name": "fixed values", "suspect": "valve.mass"}, "valve.mass"),
        ({"name": "fixed values", "suspect": "nozzle.discharge_maximum"}, ""),  # it is free
        ({"name": "160 MPa", "suspect": "bandwidth"}, "meter.bench.cutoff"),
        ({"name": "meter.unnamed.delay", "suspect": "beyond what is stated"}, "meter.bench.delay"),
        ({"name": "fixed values", "suspect": "fuel.temperature"}, "fuel.temperature"),
        ({"name": "discrepancy", "suspect": "discrepancy"}, ""),
    ],
)
def test_a_report_advises_to_free_what_a_test_suspects(
    study: Path, tmp_path: Path, test: dict[str, Any], free: str
) -> None:
    run = tmp_path / "run"
    cr.runs.calibrate_into(run, cr.load_study(study), threads=1)
    record = read_result(run)
    alarm = {"score": 1e-9, "size": None, "found": True, "sentence": "the residuals look like it"} | test
    record["certainty"]["tests"] = [alarm]
    advised = [
        step.command for step in verdict(read_as(CalibrationRecord, record), str(run)).steps if "--free" in step.command
    ]
    assert [command.split()[-1] for command in advised] == ([free] if free else [])
