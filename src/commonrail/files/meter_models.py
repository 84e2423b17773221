"""Shape of the tables ``[meters.NAME]``: a meter's law, and its quantities, each known or fitted within bounds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler, create_model
from pydantic_core import CoreSchema, core_schema

from commonrail.observation.low_pass import LowPass
from commonrail.observation.meter import HIGHEST_ORDER, Meter
from commonrail.observation.quantities import QUANTITIES, parameter_name
from commonrail.parts.furniture import Q
from commonrail.reading.fields import Sourced, Unit, choice, fault
from commonrail.reading.place import Place, located

__all__ = ["Amount", "MeterModel", "MeterTables", "MeterHead", "free_names", "meters_of_tables"]

MOST_METERS = 100


class Amount(Sourced):
    """A known value, or bounds and a start."""

    value: float | None = None
    lower: float | None = None
    upper: float | None = None
    start: float | None = None
    scale: Literal["linear", "log"] = "linear"

    @property
    def free(self) -> bool:
        """True if it is fitted."""
        return self.lower is not None

    def at_start(self, q: Q) -> float:
        """Value [SI] before a fit: as stated, else the neutral one if it lies within the bounds, else their middle."""
        stated = self.start if self.value is None else self.value
        if stated is not None:
            return stated
        lower, upper = float(self.lower or 0.0), float(self.upper or 0.0)
        return q.default if q.default is not None and lower <= q.default <= upper else 0.5 * (lower + upper)


@dataclass(frozen=True)
class _Amounts:
    """Type of an `Amount` in the unit of a quantity: ``"5 us"``, or a table with a value or bounds."""

    quantity: Q

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = (Annotated[float, Unit(self.quantity.unit)] | None, None)
        keys: Any = dict.fromkeys(("value", "lower", "upper", "start"), number)
        model = handler.generate_schema(create_model("Amount", __base__=Amount, **keys))
        table = core_schema.no_info_before_validator_function(_as_table, model)
        return core_schema.no_info_after_validator_function(self._checked, table)

    def _checked(self, item: Amount) -> Amount:
        known, lower, upper = item.value is not None, item.lower is not None, item.upper is not None
        if known == (lower or upper) or lower != upper or (known and item.start is not None):
            raise fault(
                "give either a value, or lower and upper (and a start) between which it is fitted, as in "
                "{ lower = …, upper = …, start = … }"
            )
        for key in ("value", "lower", "upper", "start"):
            value = getattr(item, key)
            if value is not None and not self.quantity.domain.admits(value):
                raise fault(f"the {self.quantity.meaning} must be {self.quantity.domain.value}, not {value:g}")
        return item


def _as_table(item: Any) -> Any:
    return item if isinstance(item, dict) else {"value": item}


class MeterHead(Sourced):
    """Keys of a meter besides its quantities."""

    law: Annotated[LowPass, choice(LowPass)] = LowPass.BUTTERWORTH
    order: int = Field(default=2, ge=1, le=HIGHEST_ORDER)

    def amounts(self) -> Iterator[tuple[str, Amount]]:
        """Quantities that are given, by name."""
        return ((key, item) for key, item in self if isinstance(item, Amount))


_quantities: Any = {key: (Annotated[Amount | None, _Amounts(q)], None) for key, q in QUANTITIES.items()}
MeterModel = create_model("MeterModel", __base__=MeterHead, **_quantities)
MeterTables = Annotated[dict[str, MeterModel], Field(max_length=MOST_METERS)]  # type: ignore[valid-type]


def free_names(tables: Mapping[str, MeterHead]) -> list[str]:
    """Names of the parameters of a search that the tables give bounds, such as meter.bench.delay."""
    return [
        parameter_name(name, key) for name, table in tables.items() for key, amount in table.amounts() if amount.free
    ]


def meters_of_tables(tables: Mapping[str, MeterHead], at: Place) -> dict[str, Meter]:
    """Meters of a file by name, with their start values.

    Parameters
    ----------
    tables : mapping of str to MeterModel
    at : Place
        Of the table "meters".

    Raises
    ------
    ConfigurationError
        If a name or the quantities together make no meter.
    """
    found = {}
    for name, table in tables.items():
        with located(at / name):
            found[name] = Meter(
                name,
                {key: amount.at_start(QUANTITIES[key]) for key, amount in table.amounts()},
                table.law,
                table.order,
                {key: amount.origin(table.origin()) for key, amount in table.amounts()},
            )
    return found
