"""Command lines that repeat a calibration or use what it found."""

from __future__ import annotations

import shlex

from commonrail.kinds import KINDS
from commonrail.kinds.records import Record
from commonrail.units import to_text

__all__ = ["point_options", "rerun_lines"]

_PRESSURES = {"cylinder_pressure": "Pa", "return_pressure": "Pa"}
_POINT = {"rail_pressure": "Pa", "energising_time": "s"} | _PRESSURES


def point_options(record: Record, boundary: bool = False) -> str:
    """Options that state the operating point of the first data set, or the pressures at its boundary alone."""
    data = record["data"][0]
    point = KINDS[data["kind"]].view.operating_point(data)
    return " ".join(
        f"--{key.replace('_', '-')} {to_text(point[key], unit).replace(' ', '')}"
        for key, unit in (_PRESSURES if boundary else _POINT).items()
        if key in point
    )


def rerun_lines(record: Record, run: str) -> list[tuple[str, str]]:
    """Purpose and command line, for the run folder of that name."""
    folder, injector = shlex.quote(run), shlex.quote(f"{run}/calibrated.toml")
    return [
        ("Calibrate again", f"commonrail calibrate {shlex.quote(f'{run}/study.toml')}"),
        ("Add generations", f"commonrail resume {folder} --generations 50"),
        ("Judge on other data", f"commonrail validate OTHER-STUDY.toml --run {folder}"),
        (
            "Simulate the calibrated injector",
            f"commonrail simulate {injector} {point_options(record)}",
        ),
        (
            "Move the parameters and see the injection change",
            f"commonrail report {folder} --page",
        ),
        ("Make this report again", f"commonrail report {folder}"),
    ]
