"""Run folders and fleets as targets: what resume, runs and fleet do with spoilt journals, fleet files and tables."""

from __future__ import annotations

import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

from commonrail.base.errors import CommonrailError
from commonrail.calibration.search import Progress
from commonrail.calibration.study_file import load_study
from commonrail.plugins.fleet.file import RunClock, summarise_fleet, write_results
from commonrail.plugins.fleet.journal import Journal, load_entries
from commonrail.plugins.fleet.member import hash_common_inputs, hash_shared_files, list_shared_files, write_study
from commonrail.plugins.fleet.page import write_fleet_report
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from commonrail.runs.fit import Listener, calibrate_into, resume
from commonrail.runs.journal import read_about
from commonrail.runs.listing import DAMAGED, list_runs
from tools.make_fleet import make_fleet

__all__ = ["TITLE", "fleet_runs", "fleets", "read_fleet", "read_fleet_journal", "read_journal", "runs"]

Files = dict[str, bytes]

TITLE = "Small run"
STUDY = f"""format = "commonrail-study/1"
title = "{TITLE}"
injector = "virtual-lino-2016"
seed = 3
[[data]]
kind = "rate"
name = "160 MPa"
role = "fit"
file = "evi.csv"
rail_pressure = "160 MPa"
cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"
energising_time = "300 us"
window = ["0 us", "600 us"]
source = "made up for a test"
synthetic = "The curve is made up."
[[parameter]]
name = "nozzle.discharge_maximum"
below = "10 %"
above = "10 %"
[optimiser]
members = 6
generations = 3
polish = 3
polish_iterations = 1
"""
CURVE = "# SYNTHETIC: made up for a test\ntime [us],rate [mm3/ms]\n" + "".join(
    f"{3 * i},{min(max(i - 120, 0), 30)}\n" for i in range(201)
)


def read_journal(folder: Path) -> None:
    """List the run, read what is told of it, and go on with it."""
    (run,) = list_runs(folder) or [None]
    try:
        read_about(folder / "run")
    except CommonrailError:
        assert run is None or run.state == DAMAGED
    with suppress(KeyboardInterrupt):  # of a run with nothing in it yet
        resume(folder / "run", threads=1, listener=Listener(progress=_stop))


def _stop(_: Progress) -> None:
    raise KeyboardInterrupt  # a generation tells as much as ten


def read_fleet(folder: Path) -> None:
    """All that is done with a fleet before its injectors are calibrated."""
    fleet = load_fleet(folder / "fleet.toml")
    list_shared_files(fleet.template)
    for name in fleet.supply.names[:2]:
        fleet.supply.fingerprints(name)
        load_study(write_study(fleet, name, folder / "member"))


def read_fleet_journal(folder: Path) -> None:
    """Write the results of a fleet from its journal."""
    fleet = load_fleet(folder / "fleet.toml")
    with Journal(folder / "run") as journal:
        inputs = {name: entry.inputs for name, entry in journal.entries().items()}  # the tables are not beside it
        entries = load_entries(fleet, inputs, journal, hash_common_inputs(fleet, hash_shared_files(fleet.template)))
    known = tuple(entries[name] for name in fleet.supply.names if name in entries)
    result = summarise_fleet(fleet, known, "finished", RunClock(1.0, 0.5, 0, 1))
    record = write_results(folder / "run", fleet, known, result)
    write_fleet_report(folder / "run", record, "commonrail fleet fleet.toml")


def _bytes(folder: Path, *leave: str) -> Files:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.endswith(leave)]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@cache
def runs() -> list[Files]:
    """Run folders: one finished, one stopped in its evolution, one in its refinement."""
    found = []
    with tempfile.TemporaryDirectory() as place:
        for steps in (99, 2, 4):
            base = Path(place) / str(steps)
            base.mkdir()
            (base / "study.toml").write_text(STUDY, encoding="utf-8")
            (base / "evi.csv").write_text(CURVE, encoding="utf-8")
            calibrate_into(base / "run", load_study(base / "study.toml"), threads=1, listener=_until(steps))
            found.append(_bytes(base, "lock", "calibrated.toml", "traces.csv"))
    return found


def _until(steps: int) -> Listener:
    seen = []

    def progress(p: Progress) -> None:
        seen.append(p)
        if len(seen) == steps:
            raise KeyboardInterrupt

    return Listener(progress=progress)


@cache
def fleets() -> list[Files]:
    """A fleet with a file for each curve, and fleets whose tables hold all rows."""
    with tempfile.TemporaryDirectory() as place:
        return [
            _bytes(make_fleet(Path(place) / f"{layout}-{table}", 2, layout, table).parent)
            for layout, table in (("files", ""), ("rows", ""), ("rows", "all.parquet"))
        ]


@cache
def fleet_runs() -> list[Files]:
    """A fleet that has been calibrated, of three injectors one without success."""
    with tempfile.TemporaryDirectory() as place:
        file = make_fleet(Path(place) / "fleet", 3, members=4, generations=1)
        next((file.parent / "data").glob("*2_160*")).unlink()
        run_fleet(load_fleet(file), file.parent / "run", workers=1)
        kept = ("fleet.toml", "study.toml", "injectors.csv", "run/fleet.sqlite")
        return [{name: (file.parent / name).read_bytes() for name in kept}]
