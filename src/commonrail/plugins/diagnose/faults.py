"""Table of faults (changes of an injector's parameters) and of the scatter of sound parts."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo

from commonrail.base.arguments import file_path
from commonrail.base.arrays import Floats
from commonrail.base.text import quantity, to_signed
from commonrail.calibration.study_keys import known_parameter
from commonrail.physics.injector import Injector, Source, parameter_quantities
from commonrail.physics.variants import RETURN, unread_inputs, unread_parameters
from commonrail.readers.location import Place
from commonrail.readers.toml import UNSTATED, FileModel, Mark, Sourced, Text, Unit, fault, read_model_file

SEAT_LEAK = "valve.seat_leak"  # effective area of the leak of the closed valve [m²]; 0 for a sound part
TABLE = Path(__file__).with_name("faults.toml")


class Change(NamedTuple):
    """Change of a parameter between two sizes: shares of the sound part's value, or differences [SI]."""

    name: str
    least: float
    most: float
    relative: bool

    def of(self, values: Floats, size: Floats | float) -> Floats:
        """Values (n,) [SI] after a change of a size from 0 (the least) to 1 (the most)."""
        amount = self.least + (self.most - self.least) * np.asarray(size)
        return np.asarray(values * (1.0 + amount) if self.relative else values + amount)


class Fault(NamedTuple):
    """Fault of a part: name, meaning, changes, and the source of their ranges."""

    name: str
    meaning: str
    changes: tuple[Change, ...]
    source: Source = UNSTATED

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters that change."""
        return tuple(change.name for change in self.changes)

    def size_text(self, injector: Injector, size: float) -> str:
        """Value and change of the first parameter at a size, such as 50 µm (+25 %)."""
        first = self.changes[0]
        sound = injector.values.get(first.name, 0.0)
        value = float(first.of(np.array(sound), size))
        share = (
            f" ({to_signed(100.0 * (value / sound - 1.0), 0 if abs(value / sound - 1.0) > 0.1 else 1)} %)"
            if sound
            else ""
        )
        return f"{quantity(value, _unit(first.name), 3)}{share}"


class Parts(NamedTuple):
    """Parts: values (n, names) [SI] of the parameters that differ from the injector's."""

    names: tuple[str, ...]
    values: Floats

    def with_fault(self, injector: Injector, item: Fault, sizes: Floats | float) -> Parts:
        """Add a fault to the parts, with sizes (n,) between 0 and 1."""
        names = (*self.names, *(name for name in item.names if name not in self.names))
        added = [np.full(len(self.values), injector.values.get(name, 0.0)) for name in names[len(self.names) :]]
        values = np.column_stack([self.values, *added])
        for change in item.changes:
            j = names.index(change.name)
            values[:, j] = change.of(values[:, j], sizes)
        return Parts(names, values)


class FaultTable(NamedTuple):
    """Faults, and standard deviations of sound parts by parameter, as shares of the value."""

    faults: tuple[Fault, ...]
    scatter: dict[str, float]

    def of_model(self, injector: Injector) -> tuple[Fault, ...]:
        """Faults whose parameters the model reads and has values other than zero for."""
        return tuple(f for f in self.faults if all(_has(injector, name) for name in f.names))

    def deviations(self, injector: Injector) -> dict[str, float]:
        """Standard deviations [SI] of the parameters that the model reads and that are not zero in it."""
        return {name: s * abs(injector.values[name]) for name, s in self.scatter.items() if _has(injector, name)}


def _has(injector: Injector, name: str) -> bool:
    if name == SEAT_LEAK:
        return RETURN not in unread_inputs(injector.variant)
    return bool(injector.values.get(name)) and name not in unread_parameters(injector.variant)


def _unit(name: str) -> str:
    return "m2" if name == SEAT_LEAK else parameter_quantities()[name].unit


def _amount(item: Any, info: ValidationInfo) -> tuple[float, bool]:
    """Amount of a change, and whether it is a share (given in percent) or a difference [SI]."""
    relative = isinstance(item, str) and "%" in item
    if "name" not in info.data:
        return 0.0, relative  # pydantic refuses the name
    return Unit("1" if relative else _unit(info.data["name"])).read(item), relative


_Amount = Annotated[tuple[float, bool], PlainValidator(_amount)]


class _ChangeModel(FileModel):
    name: Annotated[str, AfterValidator(lambda name: name if name == SEAT_LEAK else known_parameter(name))]
    least: _Amount
    most: _Amount

    def change(self) -> Change:
        return Change(self.name, self.least[0], self.most[0], self.most[1])


def _check_change(item: _ChangeModel) -> _ChangeModel:
    if item.least[1] != item.most[1]:
        raise fault("least and most must both be in percent, or both be differences")
    if not 0.0 < item.least[0] / (item.most[0] or -1.0) < 1.0:
        raise fault("least must be nearer to zero than most, of the same sign, and not zero")
    if item.most[1] and (item.most[0] <= -1.0 or item.name == SEAT_LEAK):
        raise fault("a share must be above -100 %, and the leak of the seat must be an area")
    return item


class _FaultModel(Sourced):
    name: Text
    meaning: Text
    changes: list[Annotated[_ChangeModel, AfterValidator(_check_change)]] = Field(min_length=1, max_length=20)


class _ToleranceModel(FileModel):
    name: Annotated[str, AfterValidator(known_parameter)]
    sigma: Annotated[float, Unit("%")]


def _spread(item: _ToleranceModel) -> _ToleranceModel:
    if not 0.0 < item.sigma < 50.0:
        raise fault("sigma must lie between 0 and 50 % of the value, both excluded")
    return item


class _FaultsModel(FileModel):
    format: Literal["commonrail-faults/1"]
    allow_outside: bool = False
    mark: Mark = UNSTATED.mark
    fault: list[_FaultModel] = Field(min_length=1, max_length=100)
    tolerance: list[Annotated[_ToleranceModel, AfterValidator(_spread)]] = Field(min_length=1, max_length=200)


def _refuse_twice(names: list[str], at: Place) -> None:
    """Refuse a repeated parameter."""
    for i, name in enumerate(names):
        if name in names[:i]:
            raise at[i].error(f"{name} is repeated; keep one of the two")


@cache
def load_shipped_faults() -> FaultTable:
    """Read the table that ships with the package."""
    return load_faults(TABLE)


def load_faults(path: str | Path) -> FaultTable:
    """Read a table of faults and of the scatter of sound parts; `InputError` if it cannot be read or is wrong."""
    model, at, _, _ = read_model_file(_FaultsModel, file_path(path, "path of a table of faults"))
    names = [item.name for item in model.fault]
    for i, name in enumerate(names):
        if name in names[:i] or name == "sound":
            raise (at / "fault")[i].error(f'the name "{name}" is taken; give another')
        _refuse_twice([change.name for change in model.fault[i].changes], (at / "fault")[i] / "changes")
    _refuse_twice([item.name for item in model.tolerance], at / "tolerance")
    stated = Source(model.mark, UNSTATED.text)
    faults = tuple(
        Fault(m.name, m.meaning, tuple(c.change() for c in m.changes), m.origin(stated)) for m in model.fault
    )
    return FaultTable(faults, {item.name: item.sigma / 100.0 for item in model.tolerance})
