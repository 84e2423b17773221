"""Injectors that the data of a study can drive."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from commonrail.base.choices import Drive
from commonrail.base.errors import ConfigurationError
from commonrail.calibration.scoring import check_drive
from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateData
from commonrail.engine.operating_point import OperatingPoint, Trace

CASES = Path(__file__).resolve().parents[2] / "cases"


@pytest.mark.parametrize(
    ("model", "fits"),
    [(Drive.CURRENT, True), (Drive.VOLTAGE, False), (Drive.REGULATED, True), (Drive.PWM, True)],
)
def test_a_measured_current_is_no_voltage(model: Drive, fits: bool) -> None:
    study = load_study(CASES / "paper" / "study.toml")
    data, injector = study.data[0], study.injector
    assert isinstance(data, RateData)
    point: OperatingPoint = replace(data.point, drive=Trace((0.0, 1e-3), (0.0, 20.0)))
    current, own = (replace(injector, variant=injector.variant._replace(drive=d)) for d in (Drive.CURRENT, model))
    study = replace(study, injector=current, data=(replace(data, point=point),))
    if fits:
        check_drive(own, study, "a")
    else:
        with pytest.raises(ConfigurationError, match="voltage trace"):
            check_drive(own, study, "a")
