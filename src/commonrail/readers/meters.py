"""Shape of the tables ``[meters.NAME]``: a meter's law, and its quantities, each known or fitted within bounds."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler, PlainValidator, TypeAdapter, create_model
from pydantic_core import CoreSchema, core_schema

from commonrail.base.registry import read_installed
from commonrail.physics.injector import Source
from commonrail.physics.law import Q
from commonrail.physics.meters import HIGHEST_ORDER, QUANTITIES, LowPass, Meter, parameter_name
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.toml import (
    UNSTATED,
    FileModel,
    Sourced,
    Text,
    Unit,
    as_table,
    choice,
    fault,
    key_text,
    parse_toml,
    read_model,
)

MOST_METERS = 100


class MeterPrior(FileModel):
    """Knowledge of a quantity besides the data: value (its start by default), standard deviation and source."""

    value: float | None = None
    sigma: float
    source: Text


class Amount(Sourced):
    """A known value, or bounds, a start and a prior."""

    value: float | None = None
    lower: float | None = None
    upper: float | None = None
    start: float | None = None
    prior: MeterPrior | None = None
    scale: Literal["linear", "log"] = "linear"

    @property
    def free(self) -> bool:
        """True if it is fitted."""
        return self.lower is not None

    def origin(self, default: Source = UNSTATED) -> Source:
        """Mark and source that are stated, else the prior's, else those of `default`."""
        return super().origin(default if self.prior is None else Source("F", self.prior.source))

    def at_start(self, q: Q) -> float:
        """Value [SI] before a fit: as stated, else the prior's, the neutral one within the bounds, or their middle."""
        stated = self.start if self.value is None else self.value
        if stated is None and self.prior is not None:
            stated = self.prior.value
        if stated is not None:
            return stated
        lower, upper = float(self.lower or 0.0), float(self.upper or 0.0)
        return q.default if q.default is not None and lower <= q.default <= upper else 0.5 * (lower + upper)


@dataclass(frozen=True)
class _Amounts:
    """Type of an `Amount` in the unit of a quantity: ``"5 us"``, or a table with a value or bounds."""

    quantity: Q

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number: Any = (Annotated[float, Unit(self.quantity.unit)] | None, None)
        keys: Any = dict.fromkeys(("value", "lower", "upper", "start"), number)
        sigma: Any = (Annotated[float, Unit(self.quantity.unit)], ...)
        prior: Any = create_model("MeterPrior", __base__=MeterPrior, value=number, sigma=sigma)
        keys["prior"] = (prior | None, None)
        model = handler.generate_schema(create_model("Amount", __base__=Amount, **keys))
        table = core_schema.no_info_before_validator_function(as_table, model)
        return core_schema.no_info_after_validator_function(self._checked, table)

    def _checked(self, item: Amount) -> Amount:
        is_fixed, lower, upper = item.value is not None, item.lower is not None, item.upper is not None
        if is_fixed == (lower or upper) or lower != upper or (is_fixed and item.start is not None):
            raise fault(
                "give either a value, or lower and upper (and a start) between which it is fitted, as in "
                "{ lower = …, upper = …, start = … }",
                code="conflict",
            )
        if is_fixed and item.prior is not None:
            raise fault(
                "a prior belongs to a quantity that is fitted; give lower and upper, or remove the prior",
                code="conflict",
            )
        stated = {key: getattr(item, key) for key in ("value", "lower", "upper", "start")}
        for value in (*stated.values(), None if item.prior is None else item.prior.value):
            if value is not None and not self.quantity.domain.admits(value):
                raise fault(
                    f"the {self.quantity.meaning} must be {self.quantity.domain.value}, not {value:g}",
                    code="out-of-range",
                )
        return item


class MeterHead(Sourced):
    """Keys of a meter besides its quantities."""

    law: Annotated[LowPass, choice(LowPass)] = LowPass.BUTTERWORTH
    order: int = Field(default=2, ge=1, le=HIGHEST_ORDER)

    def amounts(self) -> Iterator[tuple[str, Amount]]:
        """Quantities that are given, by name."""
        return ((key, item) for key, item in self if isinstance(item, Amount))


_quantities: Any = {key: (Annotated[Amount | None, _Amounts(q)], None) for key, q in QUANTITIES.items()}
MeterModel = create_model("MeterModel", __base__=MeterHead, **_quantities)


@cache
def _adapter() -> TypeAdapter[dict[str, MeterHead]]:
    return TypeAdapter(Annotated[dict[str, MeterModel], Field(max_length=MOST_METERS)])  # type: ignore[valid-type, arg-type]


def meter_tables(item: Any) -> dict[str, MeterHead]:
    """Tables ``[meters.NAME]`` by name; their models, which take long to make, are made where a file has some."""
    return _adapter().validate_python(item, strict=True)


class _MeterFile(FileModel):
    """File of an installed package."""

    meters: Annotated[Any, PlainValidator(meter_tables)]


def read_installed_meters(names: Iterable[str | None], described: Collection[str]) -> dict[str, MeterHead]:
    """Tables of the meters of installed packages among `names`, except the `described` ones.

    Raises `PluginError` and `InputError` if the file of one cannot be read, or has no meter of that name.
    """
    meters: dict[str, MeterHead] = {}
    for name in sorted({name for name in names if name and name not in described}):
        if text := read_installed("meters", name):
            at = Place(f"{name}.toml")
            tables: Mapping[str, MeterHead] = read_model(_MeterFile, parse_toml(text, at.file), at).meters
            if name not in tables:
                raise (at / "meters").error(f"there is no table [meters.{key_text(name)}]; add it", code="missing-key")
            meters[name] = tables[name]
    return meters


def load_installed_meter(name: str) -> Meter:
    """Meter of an installed package, with its start values; `PluginError` or `InputError` as "
    "`read_installed_meters`."""
    return meters_of_tables(read_installed_meters([name], ()), Place(f"{name}.toml"))[name]


def free_names(tables: Mapping[str, MeterHead]) -> list[str]:
    """Names of the parameters of a search that the tables give bounds, such as meter.bench.delay."""
    return [
        parameter_name(name, key) for name, table in tables.items() for key, amount in table.amounts() if amount.free
    ]


def meters_of_tables(tables: Mapping[str, MeterHead], at: Place) -> dict[str, Meter]:
    """Meters of a file by name, with their start values.

    Raises `ConfigurationError` if a name or the quantities together make no meter.
    """
    meters = {}
    for name, table in tables.items():
        with locate_errors(at / name):
            meters[name] = Meter(
                name,
                {key: amount.at_start(QUANTITIES[key]) for key, amount in table.amounts()},
                table.law,
                table.order,
                {key: amount.origin(table.origin()) for key, amount in table.amounts()},
            )
    return meters
