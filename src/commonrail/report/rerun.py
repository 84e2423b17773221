"""Command lines that repeat a calibration or use what it found."""

from __future__ import annotations

import shlex

from commonrail.kinds import KINDS
from commonrail.kinds.records import Record
from commonrail.units import to_text

__all__ = ["rerun_lines"]

_POINT = {"rail_pressure": "Pa", "energising_time": "s", "cylinder_pressure": "Pa"}
_POINT |= {"return_pressure": "Pa"}


def rerun_lines(record: Record, run: str) -> list[tuple[str, str]]:
    """Purpose and command line, for the run folder of that name."""
    data = record["data"][0]
    point = KINDS[data["kind"]].view.operating_point(data)
    options = [
        f"--{key.replace('_', '-')} {to_text(point[key], unit).replace(' ', '')}"
        for key, unit in _POINT.items()
        if key in point
    ]
    folder, injector = shlex.quote(run), shlex.quote(f"{run}/calibrated.toml")
    return [
        ("Calibrate again", f"commonrail calibrate {shlex.quote(f'{run}/study.toml')}"),
        ("Add generations", f"commonrail resume {folder} --generations 50"),
        ("Judge on other data", f"commonrail validate OTHER-STUDY.toml --run {folder}"),
        (
            "Simulate the calibrated injector",
            f"commonrail simulate {injector} {' '.join(options)}",
        ),
        (
            "Move the parameters and see the injection change",
            f"commonrail report {folder} --page",
        ),
        ("Make this report again", f"commonrail report {folder}"),
    ]
