"""Command lines that repeat a calibration or use what it found."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Mapping, Sequence

from commonrail.kinds import KINDS
from commonrail.kinds.records import Record
from commonrail.units import to_text

__all__ = ["map_line", "rerun_lines"]

_PRESSURES = {"cylinder_pressure": "Pa", "return_pressure": "Pa"}
_POINT = {"rail_pressure": "Pa", "energising_time": "s"} | _PRESSURES
_STEP = {"time_step": "s"}


def map_line(record: Record, run: str) -> tuple[str, str]:
    """Purpose and command line of the control unit's map, at the pressures and with the step of a calibration.

    Where the data have several cylinder or return pressures, the most frequent are taken, and the purpose says so.

    Parameters
    ----------
    record : mapping
        Of the calibration.
    run : str
        Name of its folder.
    """
    counted = Counter(_options(point, _PRESSURES) for data in record["data"] for point in _points(data))
    ranked = [pressures for pressures, _ in counted.most_common()]
    pressures, others = ranked[0], ranked[1:]
    purpose = "Compute the map of the calibrated injector for the control unit."
    if others:
        more = f"{len(others)} other pair" + ("s" if len(others) > 1 else "")
        purpose += (
            " The cylinder and return pressures are those of most of the measured points; the data have "
            f"{more}: state those of the engine."
        )
    words = ["commonrail map", shlex.quote(run), pressures, _options(record, _STEP), "--out map.dcm"]
    return purpose, " ".join(filter(None, words))


def _points(data: Record) -> Sequence[Record]:
    return KINDS[data["kind"]].view.operating_points(data)


def _options(values: Record, units: Mapping[str, str]) -> str:
    """Options that state values."""
    return " ".join(
        f"--{key.replace('_', '-')} {to_text(values[key], unit).replace(' ', '')}"
        for key, unit in units.items()
        if key in values
    )


def rerun_lines(record: Record, run: str) -> list[tuple[str, str]]:
    """Purpose and command line, for the run folder of that name."""
    folder, injector = shlex.quote(run), shlex.quote(f"{run}/calibrated.toml")
    first = record["data"][0]
    point = _options(KINDS[first["kind"]].view.operating_point(first), _POINT)
    return [
        ("Calibrate again", f"commonrail calibrate {shlex.quote(f'{run}/study.toml')}"),
        ("Add generations", f"commonrail resume {folder} --generations 50"),
        ("Judge on other data", f"commonrail validate OTHER-STUDY.toml --run {folder}"),
        (
            "Simulate the calibrated injector",
            " ".join(filter(None, ["commonrail simulate", injector, point, _options(record, _STEP)])),
        ),
        (
            "Move the parameters and see the injection change",
            f"commonrail report {folder} --page",
        ),
        ("Make this report again", f"commonrail report {folder}"),
    ]
