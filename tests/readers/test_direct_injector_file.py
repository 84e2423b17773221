"""Files of a direct-acting injector: parts that it has, round trip, and a measured current with an offset."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.choices import Actuation, Body
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.registry import Catalogue
from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateData
from commonrail.physics.injector import parameter_quantities
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import dump_injector
from tests.refused import refused

TEXT = Catalogue("commonrail.physics", "catalogue/injectors", "{}").text("direct-acting-kr", "")

STUDY = """
format = "commonrail-study/1"
title = "Measured current"
injector = "own.toml"
time_step = "2 us"

[[data]]
kind = "rate"
name = "20 MPa"
role = "fit"
file = "own.csv"
rail_pressure = "20 MPa"
cylinder_pressure = "0.1 MPa"
return_pressure = "0.1 MPa"
energising_time = "50 us"
drive = { column = "current", zero_at_rest = true }

[[parameter]]
name = "armature.mass"
below = "10 %"
above = "10 %"
"""


@pytest.fixture
def study(tmp_path: Path) -> Callable[..., Path]:
    """Write injector, data and a study with some parts replaced; the current is 0.95 A off, from −30 us on."""

    def write(*replacements: tuple[str, str], first: int = -30) -> Path:
        (tmp_path / "own.toml").write_text(TEXT, encoding="utf-8")
        rows = [f"{t},{max(t, 0) / 100.0},{-0.95 + (t > 0) * 10.0}\n" for t in range(first, 100, 10)]
        (tmp_path / "own.csv").write_text("time [us],rate [mm3/ms],current [A]\n" + "".join(rows), encoding="utf-8")
        text = STUDY
        for old, new in replacements:
            assert text.count(old) == 1
            text = text.replace(old, new)
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        return tmp_path / "study.toml"

    return write


def test_an_injector_that_is_written_is_the_same_when_it_is_read(tmp_path: Path) -> None:
    injector = load_injector("direct-acting-kr")
    dump_injector(injector, tmp_path / "again.toml")
    again = load_injector(tmp_path / "again.toml")
    assert (again.values, again.variant) == (injector.values, injector.variant)
    assert (again.variant.actuation, again.variant.body) == (Actuation.DIRECT, Body.RIGID)
    assert set(again.values) == set(parameter_quantities(Actuation.DIRECT))


@pytest.mark.parametrize("room", ["valve", "control_chamber", "rail"])
def test_a_part_that_it_does_not_have_is_refused(tmp_path: Path, room: str) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"{TEXT}\n[{room}]\n", encoding="utf-8")
    with refused(InputError, f"unknown-part {room}"):
        load_injector(path)


def test_a_servo_injector_has_no_armature_of_its_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace('actuation = "direct"\n', ""), encoding="utf-8")
    with refused(InputError, "unknown-part flux_decay"):
        load_injector(path)


def test_a_parameter_of_the_other_kind_of_injector_is_refused(study: Callable[..., Path]) -> None:
    with refused(InputError, "unknown-name parameter[1].name"):
        load_study(study(('name = "armature.mass"', 'name = "valve.mass"')))


def test_a_current_may_take_its_zero_from_before_energising(study: Callable[..., Path]) -> None:
    (data,) = load_study(study()).data
    (raw,) = load_study(study((", zero_at_rest = true", ""))).data
    assert isinstance(data, RateData)
    assert data.point.drive is not None
    assert raw.points[0].drive is not None
    value = np.array(data.point.drive.value)
    assert value[:4] == pytest.approx([0.0] * 4, abs=1e-12)
    assert value[4:] == pytest.approx([10.0] * len(value[4:]))
    assert np.array(raw.points[0].drive.value) == pytest.approx(value - 0.95)


def test_a_current_without_samples_before_energising_has_no_zero(study: Callable[..., Path]) -> None:
    with refused(InputError, "no-zero data[1].drive.zero_at_rest"):
        load_study(study(first=0))


CONDITION = """
[[condition]]
wanted = "{}"
rail_pressure = ["20 MPa"]
energising_time = ["50 us"]
cylinder_pressure = "0.1 MPa"
return_pressure = "0.1 MPa"

[[parameter]]"""
RETURN = """
[[data]]
kind = "return quantities"
name = "return"
role = "fit"
file = "return.csv"
cylinder_pressure = "0.1 MPa"
return_pressure = "0.1 MPa"

[[parameter]]"""
FEATURE = RETURN.replace('kind = "return quantities"', 'kind = "features"').replace(
    'file = "return.csv"',
    'rail_pressure = "20 MPa"\nenergising_time = "50 us"\n'
    'features = [{ feature = "return_quantity", tolerance = "1 mm3", value = "5 mm3" }]',
)


@pytest.mark.parametrize(
    ("drive", "tables"),
    [
        ("pwm", CONDITION.format("needle reaches its stop")),
        ("pwm", CONDITION.format("valve stays off its stop")),
        ("current trace", CONDITION.format("succeeds")),
        ("pwm", RETURN),
        ("pwm", FEATURE),
    ],
)
def test_what_names_a_part_that_the_injector_lacks_is_refused_at_load(
    study: Callable[..., Path], drive: str, tables: str
) -> None:
    without = ('drive = { column = "current", zero_at_rest = true }\n', "")
    path = study(("\n[[parameter]]", tables), *([without] if drive == "pwm" else []))
    own = path.parent / "own.toml"
    own.write_text(TEXT.replace('drive_kind = "current trace"', f'drive_kind = "{drive}"'), encoding="utf-8")
    table = "rail_pressure [MPa],energising_time [us],return_quantity [mm3]\n20,50,5\n"
    (path.parent / "return.csv").write_text(table, encoding="utf-8")
    with pytest.raises(ConfigurationError):
        load_study(path)
