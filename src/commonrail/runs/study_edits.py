"""Changes to the text of a study after a run of it: starts, priors, and bounds that are wider where they were met."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import InputError, StudyError, nearest
from commonrail.base.units import parse, to_text
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import edit_study, load_study
from commonrail.calibration.usual import USUAL, USUAL_OF_METER, usual_parameter, with_usual_prior
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.meters import QUANTITIES, is_of_meter, known_quantity, parameter_name, parts_of
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


def free_in(injector: Injector, free: Sequence[str], names: Sequence[str]) -> Callable[[Any], None]:
    """Edit for `edit_study` that frees parameters within their usual ranges, those of the injector with a prior.

    `free`: names that the study has free; `names`: dotted names of parameters, or of quantities of meters as
    "meter.bench.delay". A meter that is not there is that of all data of a bench that state none. Raises `InputError`
    for a name that is unknown, or free before.
    """
    for name in names:
        if name in free:
            raise InputError(f"--free {name}: it is free already; widen its bounds in the study, or with --widen.")
        if is_of_meter(name):
            if name.count(".") != 2 or parts_of(name)[1] not in USUAL_OF_METER:
                quantities = ", ".join(parameter_name("NAME", key) for key in USUAL_OF_METER)
                raise InputError(f"--free {name}: the quantities of a meter that can be freed are {quantities}.")
        elif name not in injector.values:
            raise InputError(
                f"--free {name}: {injector.name} has no parameter of that name{nearest(name, injector.values)}."
            )
    injector.check_read([name for name in names if not is_of_meter(name)])

    def change(document: Any) -> None:
        for name in names:
            if is_of_meter(name):
                _free_of_meter(document, *parts_of(name))
            else:
                _free_of_injector(document, with_usual_prior(injector, usual_parameter(injector, name)))

    return change


def _free_of_injector(document: Any, parameter: Parameter) -> None:
    import tomlkit  # slow to import

    table = tomlkit.table()
    table["name"] = parameter.name
    table.update({key: exact(getattr(parameter, key), parameter.unit) for key in ("lower", "upper")})
    if parameter.prior is not None:
        value, sigma = (exact(size, parameter.unit) for size in (parameter.prior.value, parameter.prior.sigma))
        table["prior"] = tomlkit.inline_table() | {"value": value, "sigma": sigma, "source": USUAL}
    document.setdefault("parameter", tomlkit.aot()).append(table)


def _free_of_meter(document: Any, meter: str, key: str) -> None:
    import tomlkit  # slow to import

    meters = document.setdefault("meters", tomlkit.table(is_super_table=True))
    if meter not in meters:
        meters[meter] = tomlkit.table() | {"mark": "E", "source": USUAL}
        kind = "quantities" if key == "quantity_offset" else "rate"
        for block in document["data"]:
            if block["kind"] == kind:
                block.setdefault("meter", meter)
    quantity = tomlkit.inline_table() | USUAL_OF_METER[key]
    stated = meters[meter].get(key)  # the search starts from what is stated
    if stated is not None:
        value = stated["value"] if isinstance(stated, Mapping) else stated
        at, unit = parse(value, QUANTITIES[key].unit), QUANTITIES[key].unit
        low, high = (parse(quantity[side], unit) for side in ("lower", "upper"))
        quantity |= {"start": value, "lower": exact(min(low, at), unit), "upper": exact(max(high, at), unit)}
    meters[meter][key] = quantity
