"""Free parameters of a search for the quantities of meters that a study gives bounds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from commonrail.base.arguments import file_path
from commonrail.base.errors import nearest
from commonrail.calibration.parameter import Parameter, Prior
from commonrail.calibration.study_file.keys import StudyModel
from commonrail.physics.injector import Source
from commonrail.physics.law import Domain, Q
from commonrail.physics.meters import QUANTITIES, Meter, parameter_name
from commonrail.readers.injector.file import load_meters
from commonrail.readers.injector.meters import Amount, MeterHead, meters_of_tables
from commonrail.readers.location import Place, located
from commonrail.readers.toml import read_model, read_toml

# One meter of a file that describes meters: a study, or the calibrated injector of a run.


def load_meter(path: str | Path, name: str) -> Meter:
    """Read one meter of a study, with its start values, or of ``calibrated.toml``, with its calibrated ones.

    Parameters
    ----------
    path : str or Path
        TOML file with a table ``[meters.NAME]``; the data of a study are not read.
    name : str

    Raises
    ------
    InputError
        If the file cannot be read, something in it is unknown or of the wrong kind, or there is no such meter.
    ConfigurationError
        If `path` is no path, or the quantities make no meter.
    """
    file = file_path(path, "path of a file with meters")
    at = Place(str(file))
    document = read_toml(file)[0]
    if str(document.get("format", "")).startswith("commonrail-study/"):
        meters = meters_of_tables(read_model(StudyModel, document, at).meters, at / "meters")
    else:
        meters = {meter.name: meter for meter in load_meters(file)}
    if name not in meters:
        known = f"it has {', '.join(meters)}" if meters else "it has none"
        raise (at / "meters").error(f'there is no meter "{name}"{nearest(name, meters)}; {known}')
    return meters[name]


def free_parameters(tables: Mapping[str, MeterHead], at: Place) -> list[Parameter]:
    """Parameters of a search for the quantities of meters that have bounds.

    `tables`, `at`: as for `meters_of_tables`. Raises `ConfigurationError` if bounds are crossed or do not hold the
    start value.
    """
    return [
        _parameter(parameter_name(name, key), amount, QUANTITIES[key], table.origin(), at / name / key)
        for name, table in tables.items()
        for key, amount in table.amounts()
        if amount.free
    ]


def _parameter(name: str, amount: Amount, q: Q, default: Source, at: Place) -> Parameter:
    source, start = amount.origin(default), amount.at_start(q)
    assert amount.lower is not None
    assert amount.upper is not None
    with located(at):
        found = Parameter(
            name,
            start,
            amount.lower,
            amount.upper,
            q.unit,
            mark=source.mark,  # type: ignore[arg-type]  # read as a mark
            source=source.text,
            scale=amount.scale,
            prior=_prior(amount, start, at / "prior"),
            signed=q.domain is Domain.ANY,
        )
    if not amount.lower <= start <= amount.upper:
        raise at.error(f"the start value {start:g} must lie between lower and upper")
    return found


def _prior(amount: Amount, start: float, at: Place) -> Prior | None:
    """The prior that a quantity states, about its start value unless it gives another."""
    if amount.prior is None:
        return None
    value = start if amount.prior.value is None else amount.prior.value
    with located(at):
        return Prior(value, amount.prior.sigma, amount.prior.source)
