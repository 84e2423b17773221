"""Types of what stands in the tables of a TOML file: numbers with their units, marks, sources and choices.

A number with its unit is ``Annotated[float, Unit("Pa")]``. Where a file may add mark and source it is
``Annotated[Number, Stated(quantity)]``, and a table of such numbers ``Annotated[ParameterTable, Quantities(known)]``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, NamedTuple

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainValidator,
    SkipValidation,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from commonrail.base.errors import InputError, nearest, nearest_key
from commonrail.base.units import parse, to_text
from commonrail.physics.injector import Source
from commonrail.physics.parameters import Q

MARKS = ("M", "C", "F", "E")  # measured, ECU calibration, fitted, estimate: from the strongest to the weakest
UNSTATED = Source("E", "no source stated")


def fault(sentence: str) -> PydanticCustomError:
    """Error of a validator; the sentence stands behind the place and has no full stop."""
    return PydanticCustomError("sentence", "{sentence}", {"sentence": sentence})


def _mark(item: Any) -> str:
    if item not in MARKS:
        raise fault(f'"{item}" is no mark; write one of {", ".join(MARKS)}')
    return str(item)


Mark = Annotated[str, PlainValidator(_mark)]
Text = Annotated[str, Field(min_length=1)]


class FileModel(BaseModel):
    """Table of a file: no key beyond its fields, no type converted in silence."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        for key in data if isinstance(data, dict) and cls.model_config["extra"] == "forbid" else ():
            if key not in cls.model_fields:
                raise fault(f'there is no key "{key}"{nearest_key(key, cls.model_fields)}')
        return data


@dataclass(frozen=True)
class Unit:
    """Type of a number that a file gives as text with its unit, ``"160 MPa"``, and the model holds in `unit`."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def read(self, item: Any) -> float:
        """Number in `unit`."""
        try:
            return parse(item, self.unit)
        except InputError as error:
            raise fault(str(error).removesuffix(".")) from error


class Given(NamedTuple):
    """Value [SI] and its source."""

    value: float
    source: Source


Values = dict[str, Given]


class Sourced(FileModel):
    """Table that may state mark and source of its numbers."""

    mark: Mark | None = None
    source: str | None = None

    def origin(self, default: Source = UNSTATED) -> Source:
        """Mark and source that are stated, else those of `default`."""
        return Source(
            default.mark if self.mark is None else self.mark, default.text if self.source is None else self.source
        )


class Number(Sourced):
    """Number [SI] with mark and source."""

    value: SkipValidation[float] = 0.0

    def given(self, default: Source) -> Given:
        """Value and source; what is not stated is that of the table around it."""
        return Given(self.value, self.origin(default))


@dataclass(frozen=True)
class Stated:
    """Type of a `Number`: ``"5 g"`` or ``{ value = "5 g", mark = "M", source = "weighed" }``."""

    quantity: Q

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        table = core_schema.no_info_before_validator_function(_as_table, handler.generate_schema(Number))
        return core_schema.no_info_after_validator_function(self._read, table)

    def _read(self, item: Number) -> Number:
        if "value" not in item.model_fields_set:
            raise fault("the inline table has no value")
        q, value = self.quantity, Unit(self.quantity.unit).read(item.value)
        if not q.domain.admits(value):
            raise fault(f"the {q.meaning} must be {q.domain.value}, not {to_text(value, q.unit)}")
        return item.model_copy(update={"value": value})


def _as_table(item: Any) -> Any:
    return item if isinstance(item, dict) else {"value": item}


class ParameterTable(Sourced):
    """Table of numbers, whose mark and source are those of every number that has none."""

    def values(self) -> Values:
        """The numbers that are given, by name."""
        return {name: number.given(self.origin()) for name, number in self if isinstance(number, Number)}


@dataclass(frozen=True)
class Quantities:
    """Type of a `ParameterTable` with numbers of these names, units and domains."""

    known: Mapping[str, Q]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        numbers: Any = {name: (Annotated[Number, Stated(q)], None) for name, q in self.known.items()}
        return handler.generate_schema(create_model("ParameterTable", __base__=source, **numbers))


def choice(kind: type[Enum]) -> PlainValidator:
    """Type of a text that is the value of a member."""
    known = {str(member.value): member for member in kind}

    def member(item: Any) -> Enum:
        if not isinstance(item, str) or item not in known:
            raise fault(f'"{item}" is not known{nearest(str(item), known)}; write one of {", ".join(known)}')
        return known[item]

    return PlainValidator(member)


@dataclass(frozen=True)
class OneOf:
    """Type of a table whose form follows from the value of a key; `more` finds further forms when they are met."""

    key: str
    forms: Mapping[str, Any]
    more: Callable[[str], type[BaseModel] | None] = lambda _: None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        *others, last = (f'"{name}"' for name in self.forms)
        return core_schema.tagged_union_schema(
            {f"<{name}>": self._schema(name, form, handler) for name, form in self.forms.items()}
            | {"<>": core_schema.no_info_plain_validator_function(self._other)},
            self._tag,
            custom_error_type="sentence",
            custom_error_message=f"{self.key} must be {', '.join(others)} or {last}",
        )

    def _schema(self, name: str, form: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema of a form, which refuses a key that only others have with the forms that have it."""

        def refuse(item: Any) -> Any:
            for key in item if isinstance(item, Mapping) else ():
                having = [other for other, one in self.forms.items() if key in getattr(one, "model_fields", ())]
                if having and name not in having:
                    others = " or ".join(f'"{other}"' for other in having)
                    raise fault(f'{self.key} = "{name}" has no key "{key}", but {self.key} = {others} has it')
            return item

        return core_schema.no_info_before_validator_function(refuse, handler.generate_schema(form))

    def _tag(self, item: Any) -> str | None:
        found = item.get(self.key) if isinstance(item, Mapping) else getattr(item, self.key, None)
        if not isinstance(found, str):
            return None
        return f"<{found}>" if found in self.forms else "<>" if self.more(found) else None

    def _other(self, item: Any) -> BaseModel:
        if isinstance(item, BaseModel):
            return item
        form = self.more(item[self.key])
        assert form is not None  # it was tagged
        return form.model_validate(item)
