"""Runs commands while plug-ins are not there: ``python -m tests.without_plugins FOLDER STAYING...``.

FOLDER gets the run. Each plug-in that does not stay has neither an entry nor a module, as if a distribution had left it
out.
"""

from __future__ import annotations

import sys
from pathlib import Path

from commonrail import plugins

STUDY = """
format = "commonrail-study/1"
title = "Without plug-ins"
injector = "virtual-lino-2016"
time_step = "1 us"

[[data]]
kind = "quantities"
name = "map"
role = "fit"
file = "map.csv"
cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"
source = "made up"

[[parameter]]
name = "nozzle.discharge_maximum"
lower = 0.7
upper = 0.95

[optimiser]
members = 4
generations = 2
"""
MAP = """rail_pressure [MPa],energising_time [us],quantity [mm3]
100,700,30
120,700,35
160,700,42
"""


def leave_out(staying: set[str], folder: Path) -> None:
    """Take all other plug-ins from the tables and from the folder that modules are searched in."""
    root = Path(plugins.__path__[0])
    for path in root.iterdir():
        if path.stem in staying:
            (folder / path.name).symlink_to(path)
    plugins.__path__[:] = [str(folder)]

    def stays(target: str) -> bool:
        _, package, name, *_ = f"{target.partition(':')[0]}..".split(".")
        return package != "plugins" or name in staying

    for table in [*plugins.SHIPPED.values(), plugins.ELSEWHERE]:
        for name in [name for name, target in table.items() if not stays(target)]:
            del table[name]


def main() -> None:
    """Simulate, calibrate, report and list; exit with the first status that is not zero."""
    folder, staying = Path(sys.argv[1]), set(sys.argv[2:])
    (folder / "plugins").mkdir()
    leave_out(staying, folder / "plugins")
    (folder / "study.toml").write_text(STUDY, encoding="utf-8")
    (folder / "map.csv").write_text(MAP, encoding="utf-8")
    point = ["virtual-lino-2016", "--rail-pressure", "160MPa", "--energising-time", "700us"]
    run = str(folder / "run")
    for line in (
        ["--help"],
        ["simulate", *point, "--report", str(folder / "simulation.html"), "--out", str(folder / "simulation.csv")],
        ["inspect", str(folder / "map.csv")],
        ["calibrate", str(folder / "study.toml"), "--out", run, "--no-live"],
        ["report", run],
        ["resume", run, "--generations", "2"],
        ["runs", str(folder)],
    ):
        _command(line)


def _command(line: list[str]) -> None:
    from commonrail.cli.start import main as command

    sys.argv = ["commonrail", "--traceback", *line]
    try:
        command()
    except SystemExit as end:
        if end.code:
            raise


if __name__ == "__main__":
    main()
