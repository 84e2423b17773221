"""Changes to the text of a study after a run of it: starts, priors, and bounds that are wider where they were met."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import StudyError
from commonrail.base.units import to_text
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import edit_study, load_study
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.physics.meters import is_of_meter, known_quantity, parameter_name
from commonrail.runs.folder import read_result


def exact(value: float, unit: str) -> str | float:
    """Value [SI] as a study states it, which is read back bit by bit."""
    return float(value) if unit == "1" else f"{float(value)!r} {unit}"


def table_of(document: Any, parameter: Mapping[str, Any]) -> Any:
    """Table of a free parameter in a document, its bounds stated outright; of one that only a type frees, a new one.

    `parameter`: its record in result.json. An empty table for a meter that an installed package describes.
    """
    import tomlkit  # slow to import

    name, meters = parameter["name"], document.get("meters", {}).items()
    tables = [meter[key] for label, meter in meters for key in meter if parameter_name(label, key) == name]
    tables += [table for table in document.get("parameter", ()) if table["name"] == name]
    if not tables and not is_of_meter(name):
        tables.append(tomlkit.table())
        tables[0]["name"] = name
        document.setdefault("parameter", tomlkit.aot()).append(tables[0])
        return document["parameter"][-1]
    table = tables[0] if tables else {}
    if "below" in table:
        del table["below"], table["above"]
        table.update({key: exact(parameter[key], parameter["unit"]) for key in ("lower", "upper")})
    return table


class MovedBound(NamedTuple):
    """Bound of a parameter, "lower" or "upper", before and after [SI]."""

    name: str
    side: str
    unit: str
    before: float
    after: float


def widen_bound(parameter: Mapping[str, Any], is_log: bool = False) -> MovedBound:
    """Move the bound that a parameter has met by the width of its range, on a logarithmic scale by its ratio.

    It does not pass the usual range in built injectors unless it lay outside, and comes as near to the end of the
    domain as halving the move leads. `parameter`: its record in result.json.
    """
    q, lower, upper = known_quantity(parameter["name"]), float(parameter["lower"]), float(parameter["upper"])
    side, bound = ("upper", upper) if parameter["position"] > 0.5 else ("lower", lower)
    factor, width = upper / lower if is_log else 1.0, 0.0 if is_log else upper - lower
    after = bound * factor + width if side == "upper" else bound / factor - width
    if q.usual is not None and q.usual[0] <= bound <= q.usual[1]:
        after = min(max(after, q.usual[0]), q.usual[1])
    while not q.domain.admits(after):
        after = 0.5 * (after + bound)
    return MovedBound(parameter["name"], side, parameter["unit"], bound, after)


def widen_study(path: Path, run: Path) -> tuple[Study, list[MovedBound]]:
    """Read a study with the bounds that a run of it had, those that it has met moved; the file stays as it is.

    Raises `StudyError` if the run is of another study or has met no bound that can be moved, and `InputError` as
    `read_result` and `load_study`.
    """
    study, parameters = load_study(path), read_result(run)["parameters"]
    known = {parameter.name: parameter for parameter in study.space.parameters}
    if {one["name"] for one in parameters} != set(known):
        raise StudyError(f"{run}: this run has other parameters than {path}; name a run of that study.")
    met = [one for one in parameters if one["at_bound"] and one["name"] != FUEL_TEMPERATURE]
    moved = [
        one for one in (widen_bound(one, known[one["name"]].scale == "log") for one in met) if one.after != one.before
    ]
    if not moved:
        raise StudyError(f"{run}: no parameter has met a bound that can be widened; calibrate without --widen.")

    def change(document: Any) -> None:
        for parameter in parameters:
            own = {one.side: one.after for one in moved if one.name == parameter["name"]}
            for side in ("lower", "upper"):
                before, after = getattr(known[parameter["name"]], side), own.get(side, float(parameter[side]))
                if after < before if side == "lower" else after > before:
                    table, unit = table_of(document, parameter), parameter["unit"]
                    table[side] = to_text(after, unit)
                    if not is_of_meter(parameter["name"]):
                        table[side].comment(f"widened from {to_text(before, unit)}, which a run has met")

    return edit_study(path, change), moved
