"""A fleet with `same_bits`: its workers may be of another processor than the process that calls them."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base.choices import Body, Drive
from commonrail.base.errors import StudyError
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.study_file import load_study
from commonrail.physics.variants import Variant
from commonrail.plugins.fleet.member import MemberRecord, calibrate_study, write_study
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from commonrail.readers.injector_writer import dump_injector
from tests.conftest import wired
from tests.plugins.fleet.conftest import SEARCH, edited
from tests.runs.test_same_bits import LEVEL_3
from tests.runs.test_same_bits import pytestmark as runs_here
from tools.make_fleet import make_fleet

pytestmark = [pytest.mark.process, runs_here]


def rigid_fleet(folder: Path, same_bits: bool) -> Path:
    """Two injectors with the rigid body, whose kernels other tests compile too; returns the fleet's file."""
    file = make_fleet(folder, 2, **SEARCH)
    dump_injector(wired(Variant(Body.RIGID, drive=Drive.PWM)), folder / "rigid.toml")
    chosen = f'injector = "rigid.toml"\nsame_bits = {str(same_bits).lower()}'
    edited(folder / "study.toml", 'injector = "virtual-lino-2016"', chosen)
    return file


def bits(record: MemberRecord) -> MemberRecord:
    """Record without what LAPACK judges of the fit."""
    parameters = {
        name: p._replace(standard_error=None, verdict=ParameterVerdict.DETERMINED)
        for name, p in record.parameters.items()
    }
    return record._replace(parameters=parameters)


def test_workers_of_another_processor_find_the_bits_of_this_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, value in LEVEL_3.variables.items():
        monkeypatch.setenv(name, value)
    file = rigid_fleet(tmp_path / "fleet", same_bits=True)
    studies = [write_study(load_fleet(file), name, tmp_path / name) for name in ("SN000001", "SN000002")]
    run = run_fleet(load_fleet(file), tmp_path / "run", workers=1)
    assert [bits(entry.result) for entry in run.entries] == [bits(calibrate_study(load_study(s))) for s in studies]


def test_without_it_they_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    monkeypatch.setenv("NUMBA_CPU_FEATURES", "+avx2")
    file = rigid_fleet(tmp_path / "fleet", same_bits=False)
    with pytest.raises(StudyError, match="cpu generic"):
        run_fleet(load_fleet(file), tmp_path / "run", workers=1)
