"""Types of a file's tables: units, marks and sources, forms, and one sentence with the dotted key for each fault."""

from __future__ import annotations

from typing import Annotated, Any

import pytest
from pydantic import Field

from commonrail.base.choices import Body
from commonrail.base.errors import InputError
from commonrail.physics.injector import Source
from commonrail.physics.law import Domain, Q
from commonrail.readers.location import Place
from commonrail.readers.toml import (
    FileModel,
    Number,
    OneOf,
    ParameterTable,
    Quantities,
    Stated,
    Unit,
    choice,
    read_model,
)
from tests.refused import refused

MASS = Q("kg", "mass of the part", Domain.POSITIVE)


class Round(FileModel):
    form: str
    diameter: Annotated[float, Unit("m")]


class Square(FileModel):
    form: str
    side: Annotated[float, Unit("m")]


class Part(FileModel):
    pressure: Annotated[float, Unit("Pa")] = 1e5
    mass: Annotated[Number, Stated(MASS)] | None = None
    room: Annotated[ParameterTable, Quantities({"mass": MASS})] = ParameterTable()
    body: Annotated[Body, choice(Body)] = Body.FLEXIBLE
    holes: list[Annotated[Any, OneOf("form", {"round": Round, "square": Square})]] = Field(default=[])


def read(**tables: Any) -> Part:
    return read_model(Part, tables, Place("part.toml"))


def test_numbers_become_si_with_their_sources() -> None:
    table = {"mass": {"value": "5 g", "mark": "M"}, "source": "data sheet"}
    part = read(pressure="1600 bar", room=table, body="rigid", holes=[{"form": "square", "side": "2 mm"}])
    assert (part.pressure, part.body, part.holes[0].side) == (160e6, Body.RIGID, 2e-3)
    assert part.room.values() == {"mass": (5e-3, Source("M", "data sheet"))}
    assert read(mass="5 g").mass.with_source(Source("E", "estimate")) == (5e-3, Source("E", "estimate"))  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"pressure": 5}, "no-unit pressure"),
        ({"pressure": ["1 Pa"]}, "not-a-number pressure"),
        ({"presure": "1 Pa"}, "unknown-key"),
        ({"mass": "-5 g"}, "out-of-range mass"),
        ({"mass": {"mark": "M"}}, "missing mass"),
        ({"room": {"mass": {"value": "5 g", "mark": "X"}}}, "unknown-mark room.mass.mark"),
        ({"room": {"mark": "M", "mas": "5 g"}}, "unknown-key room"),
        ({"room": 3}, "model_type room"),
        ({"body": ["rigid"]}, "unknown-name body"),
        ({"holes": [{"form": "oval"}]}, "unknown-name holes[1]"),
        ({"holes": [{"form": "round"}]}, "missing holes[1].diameter"),
    ],
)
def test_a_fault_is_one_sentence_with_its_key(tables: dict[str, Any], words: str) -> None:
    with refused(InputError, words):
        read(**tables)
