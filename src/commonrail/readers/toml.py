"""TOML files: tables of moderate size, checked with types of their own, and text of tables to write."""

from __future__ import annotations

import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Generic, NamedTuple, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainValidator,
    SkipValidation,
    TypeAdapter,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)
from pydantic_core import CoreSchema, ErrorDetails, PydanticCustomError, core_schema

from commonrail.base.errors import InputError, nearest, nearest_key
from commonrail.base.units import parse, to_text
from commonrail.physics.injector import Source
from commonrail.physics.law import Q
from commonrail.readers.location import Place, Reach, read_text

# Types of values in the tables of a TOML file: numbers with their units, marks, sources and choices.
#
# A number with its unit is ``Annotated[float, Unit("Pa")]``. Where a file may add mark and source it is
# ``Annotated[Number, Stated(quantity)]``, and a table of such numbers ``Annotated[ParameterTable, Quantities(known)]``.

MARKS = ("M", "C", "F", "E")  # measured, ECU calibration, fitted, estimate: from the strongest to the weakest
UNSTATED = Source("E", "no source stated")


def fault(sentence: str, code: str = "") -> PydanticCustomError:
    """Error of a validator; the sentence follows the place and has no full stop."""
    return PydanticCustomError("sentence", "{sentence}", {"sentence": sentence, "code": code})


def read_mark(item: Any) -> str:
    """Mark of a source."""
    if item not in MARKS:
        raise fault(f'"{item}" is no mark; write one of {", ".join(MARKS)}', code="unknown-mark")
    return str(item)


Mark = Annotated[str, PlainValidator(read_mark)]
Text = Annotated[str, Field(min_length=1)]


class FileModel(BaseModel):
    """Table of a file: no key beyond its fields, no type converted in silence."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict) and cls.model_config["extra"] == "forbid":
            refuse_unknown_keys(data, [field.alias or name for name, field in cls.model_fields.items()])
        return data


def refuse_unknown_keys(table: Mapping[str, Any], keys: Collection[str]) -> None:
    """Raise a fault for the first key that is not known."""
    for key in table:
        if key not in keys:
            raise fault(f'there is no key "{key}"{nearest_key(key, keys)}', code="unknown-key")


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
            raise fault(str(error).removesuffix("."), error.code) from error


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

    def with_source(self, default: Source) -> Given:
        """Value and source; mark and source default to the surrounding table's."""
        return Given(self.value, self.origin(default))


@dataclass(frozen=True)
class Stated:
    """Type of a `Number`: ``"5 g"`` or ``{ value = "5 g", mark = "M", source = "weighed" }``."""

    quantity: Q

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        table = core_schema.no_info_before_validator_function(as_table, handler.generate_schema(Number))
        return core_schema.no_info_after_validator_function(self.read, table)

    def read(self, item: Number) -> Number:
        """The number in SI; a fault if it has no value, or one outside its domain."""
        if "value" not in item.model_fields_set:
            raise fault("the inline table has no value", code="missing")
        q, value = self.quantity, Unit(self.quantity.unit).read(item.value)
        if not q.domain.admits(value):
            raise fault(f"the {q.meaning} must be {q.domain.value}, not {to_text(value, q.unit)}", code="out-of-range")
        return item.model_copy(update={"value": value})


def as_table(item: Any) -> Any:
    """Inline table with the value alone, for one that states no more."""
    return item if isinstance(item, dict) else {"value": item}


def _number(item: tuple[Q, Any], read: ValidatorFunctionWrapHandler) -> Number:
    quantity, stated = item
    return Stated(quantity).read(read(as_table(stated)))


class ParameterTable(Sourced):
    """Table of numbers, with default mark and source of all its numbers."""

    numbers: dict[str, Annotated[Number, WrapValidator(_number)]] = Field(
        default={}, alias="<numbers>"
    )  # which no file can state

    def values(self) -> Values:
        """The numbers that are given, by name."""
        return {name: number.with_source(self.origin()) for name, number in self.numbers.items()}


@dataclass(frozen=True)
class Quantities:
    """Type of a `ParameterTable` with numbers of these names, units and domains.

    Tables of all components share one schema, which takes long to make: each number goes into it with its quantity.
    """

    quantities: Mapping[str, Q]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        keys = [key for key in source.model_fields if key != "numbers"]

        def parted(item: Any) -> Any:
            if not isinstance(item, dict):
                return item
            refuse_unknown_keys(item, [*keys, *self.quantities])
            numbers = {key: (self.quantities[key], value) for key, value in item.items() if key in self.quantities}
            return {key: item[key] for key in keys if key in item} | {"<numbers>": numbers}

        return core_schema.no_info_before_validator_function(parted, handler(source))


def choice(kind: type[Enum]) -> PlainValidator:
    """Type of a text that is the value of a member."""
    members = {str(member.value): member for member in kind}

    def member(item: Any) -> Enum:
        if not isinstance(item, str) or item not in members:
            raise fault(
                f'"{item}" is not known{nearest(str(item), members)}; write one of {", ".join(members)}',
                code="unknown-name",
            )
        return members[item]

    return PlainValidator(member)


@dataclass(frozen=True)
class OneOf:
    """Type of a table whose form follows from the value of a key.

    `more` returns further forms by name, or None.
    """

    key: str
    forms: Mapping[str, Any]
    more: Callable[[str], type[BaseModel] | None] = lambda _: None

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.read)

    def read(self, item: Any) -> Any:
        """The table in its form; a key that only other forms have is refused with those forms."""
        if isinstance(item, BaseModel):
            return item
        name = item.get(self.key) if isinstance(item, Mapping) else None
        *others, last = (f'"{form_name}"' for form_name in self.forms)
        expected = f"{self.key} must be {', '.join(others)} or {last}"
        if not isinstance(name, str):
            raise fault(expected, code="missing-form")
        if (form := self._form(name)) is None:
            raise fault(f'{expected}, not "{name}"{nearest(name, self.forms)}', code="unknown-name")
        for key in set(item).difference(getattr(form, "model_fields", ())):
            having = [
                form_name for form_name in self.forms if key in getattr(self._form(form_name), "model_fields", ())
            ]
            if having:
                those = " or ".join(f'"{form_name}"' for form_name in having)
                raise fault(
                    f'{self.key} = "{name}" has no key "{key}", but {self.key} = {those} has it',
                    code="key-of-other-form",
                )
        return TypeAdapter(form).validate_python(item)

    def _form(self, name: str) -> Any:
        return self.forms.get(name) or self.more(name)


# Checking the tables of a file: the first fault as one sentence with its dotted key.

_Model = TypeVar("_Model", bound=BaseModel)


def read_model(kind: type[_Model], document: Mapping[str, Any], at: Place) -> _Model:
    """Check the tables of a file.

    Raises `InputError` for the first fault; the message has the dotted key.
    """
    if "format" in kind.model_fields:
        at.check_format(document, get_args(kind.model_fields["format"].annotation)[0])
    try:
        return kind.model_validate(document)
    except ValidationError as error:
        raise _translate_error(kind, error.errors(include_url=False)[0], at) from error


def _translate_error(kind: type[BaseModel], details: ErrorDetails, at: Place) -> InputError:
    if details["type"] == "list_type" and not at.key and details["loc"] in _lists_of_tables(kind):
        key = details["loc"][0]
        return (at / str(key)).error(
            f"this must be a list, and a list of tables is written [[{key}]]", code="list_type"
        )
    for key_part in details["loc"]:
        if isinstance(key_part, int):
            at = at[key_part]
        elif not key_part.startswith("<"):  # a tag: which form of a key was tried
            at = at / key_part
    code = details["ctx"]["code"] if details["type"] == "sentence" else details["type"]
    return at.error(_sentence(details, at.key), code)


def _lists_of_tables(kind: type[BaseModel]) -> list[tuple[str]]:
    """Keys of a file that hold lists of tables."""
    items = {key: get_args(field.annotation) for key, field in kind.model_fields.items()}
    kinds = {key: (get_args(of[0]) or of)[0] for key, of in items.items() if of}  # of Annotated[…] the first
    return [(key,) for key, item in kinds.items() if isinstance(item, type) and issubclass(item, BaseModel)]


def _sentence(details: ErrorDetails, key: str) -> str:
    kind, message, value = details["type"], details["msg"], details["input"]
    last = key.rpartition(".")[2]
    if kind == "sentence":
        return message
    if kind == "missing":
        return f"this key is missing; add {_MISSING.get(last, 'it')}"
    if kind in ("model_type", "dict_type"):
        return "this must be a table" + ("" if not key or key.endswith("]") else f", written [{key}]")
    if kind == "list_type":
        return f"this must be a list in brackets{_LISTS.get(last, '')}"
    if kind in ("too_short", "too_long"):
        limit = details["ctx"].get("min_length") or details["ctx"].get("max_length")
        return f"this must be a list of {'at least' if kind == 'too_short' else 'at most'} {limit}"
    message = message.removeprefix("Input should be ").removeprefix("a valid ").removeprefix("must be ")
    shown = f"not {reprlib.repr(value)}" if isinstance(value, (str, int, float)) else "which it is not"
    return f"this must be {_TYPES.get(kind, message)}, {shown}"


_MISSING = {"injector": 'injector = "virtual-lino-2016"', "temperature": 'temperature = "80 degC"'}
_LISTS = {
    "window": ', such as ["0 us", "1600 us"]',
    "energisings": ', such as [{ start = "0 us", duration = "700 us" }]',
    "rail_pressure": ', such as ["80 MPa", "160 MPa"]',
    "energising_time": ', such as ["400 us", "700 us"]',
    "order": ', such as ["nozzle.lift_transition_slope < nozzle.lift_maximum_slope"]',
    "linear": ', such as ["2 plunger_needle.k1 > plunger_needle.k2"]',
    "factor": ", such as [0.4, 1.0]",
}
_TYPES = {
    "string_type": "a text in quotes",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_too_short": "a text that is not empty",
    "string_too_long": "a text of at most 200 characters",
}


# From disk: tables of moderate size, depth and texts, whatever was in the file.

LARGEST_TOML = 1_000_000  # [bytes]; a file of settings has some thousands. Its tables take up to 600 times as much.
LONGEST_LINE = 10_000  # [characters]
LONGEST_TEXT = 10_000
LONGEST_KEY = 200
DEEPEST = 20
LARGEST_INTEGER = 2**63 - 1  # all that TOML promises

# The reader copies a dotted key once for each of its parts, and each level of tables takes a kilobyte.
# Repetitions that give nothing back (++): otherwise a line of spaces is split in every possible way.
_DEEP_KEY = re.compile(rf"""\s*+\[*+\s*+(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')\s*+\.\s*+){{{DEEPEST}}}""")

# What moves a terminal's cursor or turns the direction of writing; tab and line end may stand in a text.
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def read_toml(path: Path) -> tuple[dict[str, Any], str]:
    """Tables and text of a TOML file.

    Raises `InputError` if it cannot be read or `parse_toml` refuses it.
    """
    text = read_text(path, LARGEST_TOML)
    return parse_toml(text, str(path)), text


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Tables of a TOML text.

    Raises `InputError` if it is not TOML, or a line, key, text or number in it is beyond its limit; the message has
    line or key.
    """
    _check_lines(text, where)
    try:
        tables = tomllib.loads(text)
    except RecursionError as error:
        raise InputError(
            f"{where}: tables and lists stand too deep in one another.", code="too-deep", file=where
        ) from error
    except ValueError as error:  # not TOML, or an integer of more digits than Python reads
        location = re.search(r"\(at line (\d+), column \d+\)", str(error))
        line = location[1] if location else text.rstrip().count("\n") + 1
        raise InputError(
            f"{where}, line {line}: this is not TOML ({_reason(error)}); {_cure(error)}.",
            code="syntax",
            file=where,
            place=f"line {line}",
        ) from error
    _check(tables, Place(where))
    return tables


def _reason(error: ValueError) -> str:
    if not isinstance(error, tomllib.TOMLDecodeError):
        return "an integer has too many digits"
    reason = re.sub(r"\s*\(at .*", "", str(error))
    return reason[:1].lower() + reason[1:]


def _cure(error: ValueError) -> str:
    if re.search("overwrite|twice|mutable", str(error)):
        return "a key and a table stand once each, and every table of a list is written [[name]]"
    return 'texts stand in quotes, as in key = "160 MPa"'


def _check_lines(text: str, where: str) -> None:
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > LONGEST_LINE:
            raise InputError(
                f"{where}, line {number}: the line has {len(line)} characters, and at most {LONGEST_LINE} are read; "
                "break it.",
                code="line-too-long",
                file=where,
                place=f"line {number}",
            )
        if _DEEP_KEY.match(line):
            raise InputError(
                f"{where}, line {number}: the key stands more than {DEEPEST} deep in tables.",
                code="too-deep",
                file=where,
                place=f"line {number}",
            )


def _check(tables: dict[str, Any], at: Place) -> None:
    """Refuse values beyond the limits; iterative, because the depth is not known."""
    waiting: list[tuple[Any, Place, int]] = [(tables, at, 0)]
    while waiting:
        value, place, depth = waiting.pop()
        if isinstance(value, dict | list):
            if depth == DEEPEST:
                raise place.error(f"tables and lists stand more than {DEEPEST} deep in one another", code="too-deep")
            waiting += [(inner, inside, depth + 1) for inner, inside in _inside(value, place)]
        else:
            _check_value(value, place)


def _inside(value: dict[str, Any] | list[Any], place: Place) -> Iterator[tuple[Any, Place]]:
    if isinstance(value, list):
        yield from ((inner, place[i]) for i, inner in enumerate(value))
        return
    for key, inner in value.items():
        if len(key) > LONGEST_KEY or _CONTROL.search(key) or not key.isprintable():
            start = "".join(sign if sign.isprintable() else "?" for sign in key[:40])
            raise place.error(f'the key "{start}" is too long or has a character that is not printed', code="bad-name")
        yield inner, place / key


def _check_value(value: Any, place: Place) -> None:
    if isinstance(value, str):
        if len(value) > LONGEST_TEXT:
            raise place.error(
                f"the text has {len(value)} characters, and at most {LONGEST_TEXT} are read; shorten it",
                code="text-too-long",
            )
        if match := _CONTROL.search(value):
            raise place.error(
                f"the text holds the control character U+{ord(match[0]):04X}; remove it", code="control-character"
            )
    elif isinstance(value, int) and abs(value) > LARGEST_INTEGER:
        raise place.error("the integer is larger than 64 bits hold", code="out-of-range")
    elif isinstance(value, float) and not math.isfinite(value):
        raise place.error("the number is not finite", code="not-finite")


# TOML file that names other files: read, checked, and with the folder that those may lie in.

_FileContent = TypeVar("_FileContent", bound=FileModel)


class ModelFile(NamedTuple, Generic[_FileContent]):
    """Content of a file."""

    model: _FileContent
    at: Place  # the file, for messages
    reach: Reach  # where the files that it names may lie
    text: str  # the file as given


def read_model_file(kind: type[_FileContent], file: Path) -> ModelFile[_FileContent]:
    """Read and check a file.

    `kind`: model of the file, with the key `allow_outside`. Raises `InputError` if it cannot be read, or something in
    it is unknown, missing or of the wrong kind.
    """
    document, text = read_toml(file)
    at = Place(str(file))
    model: Any = read_model(kind, document, at)
    return ModelFile(model, at, Reach(file, model.allow_outside), text)


# TOML text of tables: exact, and without a document that could be edited, which takes a hundred times as long.

_SHORT = {"\b": "\\b", "\t": "\\t", "\n": "\\n", "\f": "\\f", "\r": "\\r", '"': '\\"', "\\": "\\\\"}
_ESCAPED = re.compile(r'[\x00-\x1f\x7f"\\]')
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def value_text(value: Any) -> str:
    """A text, a number, true or false, or a list of them; numbers as the shortest decimals that are the same floats."""
    if isinstance(value, str):
        return f'"{_ESCAPED.sub(_escape, value)}"'
    if isinstance(value, list):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return repr(float(value)) if isinstance(value, float) else repr(value)  # a NumPy float writes its type


def _escape(match: re.Match[str]) -> str:
    sign = match.group()
    return _SHORT.get(sign) or f"\\u{ord(sign):04x}"


def key_text(key: str) -> str:
    """A key, quoted if it has to be."""
    return key if _BARE.fullmatch(key) else value_text(key)


def inline_table(values: Mapping[str, Any]) -> str:
    """``{key = value, …}`` in one line."""
    return "{" + ", ".join(f"{key_text(key)} = {value_text(value)}" for key, value in values.items()) + "}"


def table_lines(path: str, values: Mapping[str, Any]) -> Iterator[str]:
    """Lines of a table and of those in it, each below an empty line.

    The path is its dotted key; mappings follow texts, numbers and lists.
    """
    yield ""
    yield f"[{path}]"
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from table_lines(f"{path}.{key_text(key)}", value)
        else:
            yield f"{key_text(key)} = {value_text(value)}"
