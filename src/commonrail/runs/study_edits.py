"""Changes to a study file after a run: start values, priors, and wider bounds where parameters have met them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from commonrail.base.errors import InputError, StudyError, nearest
from commonrail.base.registry import read_installed
from commonrail.base.units import parse, to_text
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.record import CalibrationRecord, ParameterRecord, read_as
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import edit_study, load_study
from commonrail.calibration.usual import USUAL, USUAL_OF_METER, usual_parameter, with_usual_prior
from commonrail.data.registry import get_kind
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.meters import QUANTITIES, is_of_meter, known_quantity, parameter_name, parts_of
from commonrail.runs.folder import RESULT, read_result


def exact(value: float, unit: str) -> str | float:
    """Value [SI] as written in a study; reading it gives the same bits."""
    return float(value) if unit == "1" else f"{float(value)!r} {unit}"


def complete(document: Any, free: Sequence[str]) -> None:
    """Write the values of a type and of installed packages into a document, to make them editable.

    `free`: names of all free parameters of the study.
    """
    import tomlkit  # slow to import

    for name in dict.fromkeys(block.get("meter") for block in document["data"]):
        if name and name not in document.get("meters", {}) and (text := read_installed("meters", name)):
            meters = document.setdefault("meters", tomlkit.table(is_super_table=True))
            meters[name] = tomlkit.parse(text)["meters"][name]
    if "type" in document and not document.get("parameter"):
        for name in free:
            if not is_of_meter(name):
                append(document, "parameter", {"name": name})


def append(document: Any, key: str, values: Mapping[str, Any]) -> None:
    """Append a table to an array in a document; the table is inline if the array is inline."""
    import tomlkit  # slow to import

    items = document.setdefault(key, tomlkit.aot())
    table = tomlkit.inline_table() if isinstance(items, tomlkit.items.Array) else tomlkit.table()
    table.update(values)
    items.append(table)


def parameter_table(document: Any, parameter: ParameterRecord) -> Any:
    """Table of a free parameter in a `complete` document, its bounds stated outright.

    `parameter`: its record in result.json.
    """
    name, meters = parameter.name, document.get("meters", {}).items()
    tables = [meter[key] for label, meter in meters for key in meter if parameter_name(label, key) == name]
    table = next(table for table in [*tables, *document.get("parameter", ())] if table.get("name", name) == name)
    if "lower" not in table:
        for key in ("below", "above"):
            table.pop(key, None)
        table.update({key: exact(getattr(parameter, key), parameter.unit) for key in ("lower", "upper")})
    return table


class MovedBound(NamedTuple):
    """Bound of a parameter, "lower" or "upper", before and after [SI]."""

    name: str
    side: str
    unit: str
    before: float
    after: float


def widen_bound(parameter: ParameterRecord, is_log: bool = False) -> MovedBound:
    """Move the bound that a parameter has met by the width of its range, or on a logarithmic scale by its ratio.

    The new bound stays in the usual range of built injectors, unless the old bound lay outside. A move out of the
    domain is halved until the bound lies inside. `parameter`: record of the parameter in result.json.
    """
    q, lower, upper = known_quantity(parameter.name), parameter.lower, parameter.upper
    side, bound = ("upper", upper) if parameter.position > 0.5 else ("lower", lower)
    factor, width = upper / lower if is_log else 1.0, 0.0 if is_log else upper - lower
    after = bound * factor + width if side == "upper" else bound / factor - width
    if q.usual is not None and q.usual[0] <= bound <= q.usual[1]:
        after = min(max(after, q.usual[0]), q.usual[1])
    while after != bound and not q.domain.admits(after):  # a bound itself may lie outside in a record that was changed
        after = 0.5 * (after + bound)
    return MovedBound(parameter.name, side, parameter.unit, bound, after)


def can_widen(parameter: ParameterRecord) -> bool:
    """True if the bound that a parameter has met can be moved: it is not an end of the domain or of the usual range."""
    name = parameter.name
    if not is_of_meter(name) and name not in parameter_quantities():
        return True  # parameter of a plug-in that is not installed: its domain is unknown
    moved = widen_bound(parameter)
    return moved.name != FUEL_TEMPERATURE and abs(moved.after - moved.before) > 1e-9 * abs(moved.before)


def widen_study(path: Path, run: Path) -> tuple[Study, list[MovedBound]]:
    """Read a study with the bounds of a run, after moving the bounds that were met; the file is unchanged.

    Raises `StudyError` if the run belongs to another study or has not met a movable bound, and `InputError` as
    `read_result` and `load_study` do.
    """
    study, parameters = load_study(path), read_as(CalibrationRecord, read_result(run), run / RESULT).parameters
    free = {parameter.name: parameter for parameter in study.space.parameters}
    if {row.name for row in parameters} != set(free):
        raise StudyError(f"{run}: this run has other parameters than {path}; name a run of that study.")
    met = [row for row in parameters if row.at_bound and can_widen(row)]
    moved = [widen_bound(row, free[row.name].scale == "log") for row in met]
    if not moved:
        raise StudyError(f"{run}: no parameter has met a bound that can be widened; calibrate without --widen.")

    def change(document: Any) -> None:
        complete(document, list(free))
        for parameter in parameters:
            moved_bounds = {bound.side: bound.after for bound in moved if bound.name == parameter.name}
            for side in ("lower", "upper"):
                before, after = getattr(free[parameter.name], side), moved_bounds.get(side, getattr(parameter, side))
                if after < before if side == "lower" else after > before:
                    table, unit = parameter_table(document, parameter), parameter.unit
                    table[side] = to_text(after, unit)
                    if not is_of_meter(parameter.name):
                        table[side].comment(f"widened from {to_text(before, unit)}, which a run has met")

    return edit_study(path, change), moved


def free_in(injector: Injector, free: Sequence[str], names: Sequence[str]) -> Callable[[Any], None]:
    """Edit for `edit_study` that frees parameters within their usual ranges; injector parameters get a prior.

    `free`: names of free parameters in the study; `names`: dotted names of parameters, or of quantities of meters as
    "meter.bench.delay". A new meter applies to all data without a meter that depend on the quantity. Raises
    `InputError` for a name that is unknown or already free.
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
        complete(document, free)
        existing = set(document.get("meters", {}))
        for name in names:
            if is_of_meter(name):
                _free_of_meter(document, *parts_of(name), is_new=parts_of(name)[0] not in existing)
            else:
                _free_of_injector(document, with_usual_prior(injector, usual_parameter(injector, name)))

    return change


def _free_of_injector(document: Any, parameter: Parameter) -> None:
    import tomlkit  # slow to import

    values: dict[str, Any] = {"name": parameter.name}
    values |= {key: exact(getattr(parameter, key), parameter.unit) for key in ("lower", "upper")}
    if parameter.prior is not None:
        value, sigma = (exact(size, parameter.unit) for size in (parameter.prior.value, parameter.prior.sigma))
        values["prior"] = tomlkit.inline_table() | {"value": value, "sigma": sigma, "source": USUAL}
    fixed = document.get("fixed", [])
    for i in reversed([i for i, table in enumerate(fixed) if table["name"] == parameter.name]):
        del fixed[i]  # the injector already contains this value
    append(document, "parameter", values)


def _free_of_meter(document: Any, meter: str, key: str, *, is_new: bool) -> None:
    import tomlkit  # slow to import

    meters = document.setdefault("meters", tomlkit.table(is_super_table=True))
    if meter not in meters:
        meters[meter] = tomlkit.table() | {"mark": "E", "source": USUAL}
    seeing = [block for block in document["data"] if key in get_kind(block["kind"]).meter_inputs]
    if is_new:
        for block in seeing:
            block.setdefault("meter", meter)
    if not any(block.get("meter") == meter for block in seeing):
        raise InputError(f"--free {parameter_name(meter, key)}: no data of this meter depend on it; name another one.")
    quantity = tomlkit.inline_table() | USUAL_OF_METER[key]
    stated = meters[meter].get(key)  # the search starts from the stated value
    if stated is not None:
        value = stated["value"] if isinstance(stated, Mapping) else stated
        at, unit = parse(value, QUANTITIES[key].unit), QUANTITIES[key].unit
        low, high = (parse(quantity[side], unit) for side in ("lower", "upper"))
        quantity |= {"start": value, "lower": exact(min(low, at), unit), "upper": exact(max(high, at), unit)}
    meters[meter][key] = quantity
