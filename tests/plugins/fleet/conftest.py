"""Small synthetic fleets, and one that was calibrated without a stop."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.record import StartAndBest
from commonrail.plugins.fleet.member import MemberParameter, MemberRecord
from commonrail.plugins.fleet.run import FleetRun
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from tests.cli.conftest import command  # noqa: F401
from tests.workers.forked import forked
from tools.make_fleet import make_fleet

COUNT = 6
SEARCH = {"members": 8, "generations": 3}

Edit = Callable[[str, str], None]


def small_fleet(folder: Path, layout: str = "files", table: str = "") -> Path:
    """Six injectors with a search of a few tenths of a second each."""
    return make_fleet(folder, COUNT, layout, table, **SEARCH)


def results(folder: Path) -> list[list[str]]:
    """Rows of results.csv with their head, without the processor times."""
    with (folder / "results.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#")))
    assert rows[0][-1] == "processor time [s]"
    return [row[:-1] for row in rows]


def calibrated(best: float, **values: float) -> MemberRecord:
    """Record of an injector with an objective, and values of parameters between 0 and 10."""
    parameters = {
        name: MemberParameter(value, 0.1, ParameterVerdict.DETERMINED, value / 10.0, False, 0.0, 10.0, None)
        for name, value in values.items()
    }
    return MemberRecord(
        seed=1,
        synthetic="",
        cost=StartAndBest(100.0, best),
        slots=8,
        simulated=8,
        failed=0,
        data=(),
        fixed=(),
        parameters=parameters,
        warnings=(),
    )


@pytest.fixture
def fleet_file(tmp_path: Path) -> Path:
    """File of a small fleet."""
    return small_fleet(tmp_path / "fleet")


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> FleetRun:
    """The small fleet, calibrated by one worker without a stop."""
    folder = tmp_path_factory.mktemp("whole")
    with forked():
        return run_fleet(load_fleet(small_fleet(folder / "fleet")), folder / "run", workers=1)


def edited(path: Path, old: str, new: str) -> Path:
    """The file with a part that stands in it once replaced."""
    text = path.read_text(encoding="utf-8")
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path
