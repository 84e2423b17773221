"""Settings declared once: check, option, facts, docstring, and the record of a typed result."""

from __future__ import annotations

import dataclasses
import math
from enum import Enum
from typing import Annotated, NamedTuple

import click
import numpy as np
import pytest

from commonrail.base.arguments import Limits
from commonrail.base.arrays import Floats
from commonrail.base.declare import (
    Choice,
    Number,
    OptionalNumber,
    Setting,
    list_facts,
    read_declarations,
    setting,
    settings,
)
from commonrail.base.errors import ConfigurationError
from commonrail.base.record import BrokenRecordError, Interval, Key, from_record, to_record
from commonrail.cli.grammar import verb


class Kind(Enum):
    FAST = "fast"
    SLOW = "slow"


@settings
class Search:
    """Settings of a search."""

    kind: Choice[Kind] = setting(words="kind of search", default=Kind.FAST)
    share: Number = setting(words="share", default="10 %", limits=Limits(0.0, 0.5), text="Share that is kept.")
    step: OptionalNumber = setting(words="time step", unit="s", default=None, limits=Limits(1e-9, 1e-4))
    draws: int = setting(words="number of draws", default=4, limits=Limits(1, 100))
    exact: bool = setting(words="exactness", default=False)
    times: Setting[tuple[float, ...], list[str | float]] = setting(words="times", unit="s", default=(), option=False)

    def __post_init__(self) -> None:
        if self.kind is Kind.SLOW and self.draws > 50:
            raise ConfigurationError("A slow search has at most 50 draws.")


@settings(kw_only=False)
class Ordered:
    """Fields in order."""

    name: str = setting()
    share: Number = setting(words="share", default=0.5)
    before: Ordered | None = None


def test_fields_can_be_given_in_order() -> None:
    assert Ordered("a", "10 %") == Ordered(name="a", share=0.1)


def test_texts_are_read_in_si_units_defaults_too() -> None:
    search = Search(kind="slow", step="2 us", times=["1 ms", 2e-3])
    assert (search.kind, search.share, search.step, search.times) == (Kind.SLOW, 0.1, 2e-6, (1e-3, 2e-3))
    assert dataclasses.replace(search, share="20 %").share == 0.2


@pytest.mark.parametrize(
    "values",
    [
        {"kind": "quick"},
        {"share": "60 %"},
        {"step": "1 MPa"},
        {"step": 1.0},
        {"draws": 0},
        {"draws": 2.5},
        {"exact": 1},
        {"times": ["x"]},
        {"kind": "slow", "draws": 60},
    ],
)
def test_a_value_of_another_kind_or_beyond_its_limits_is_refused(values: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError):
        Search(**values)  # type: ignore[arg-type]


def test_a_command_has_an_option_for_each_setting() -> None:
    seen: list[Search] = []

    @verb
    def seek(*, search: Search) -> None:
        """Seek."""
        seen.append(search)

    assert [parameter.name for parameter in seek.params] == ["kind", "share", "step", "draws", "exact"]
    seek.main(["--kind", "slow", "--share", "20%", "--step", "2us", "--exact"], standalone_mode=False)
    seek.main([], standalone_mode=False)
    assert seen == [Search(kind="slow", share=0.2, step=2e-6, exact=True), Search()]
    with pytest.raises(click.UsageError):
        seek.main(["--draws", "101"], standalone_mode=False)


def test_facts_and_docstring_follow_from_the_declaration() -> None:
    assert list_facts(Search(step="2 us"), ("kind", "share", "step")) == [
        ("Kind of search", "fast"),
        ("Share", "10 %"),
        ("Time step", "2 us"),
    ]
    assert list_facts(Search(), ("step",)) == []
    assert read_declarations(Search)["step"].accepted == "quantity [s], 1 ns to 100 us"
    assert "0 to 0.5; 10 %" in (Search.__doc__ or "")


class Row(NamedTuple):
    """Row of a result."""

    name: str
    size: float
    interval: Interval | None = None


@dataclasses.dataclass(frozen=True)
class Result:
    """Result with settings that are merged into its record."""

    search: Annotated[Search, Key("")]
    rows: tuple[Row, ...]
    values: Floats
    best: float | None
    seconds: Annotated[float, Key("clock.seconds")] = 0.0


def test_a_result_is_its_record_and_back() -> None:
    rows = (Row("a", math.nan, Interval(1.0, 0.5, 2.0)), Row("b", 3.0))
    result = Result(Search(kind="slow"), rows, np.array([1.0, 2.0]), None, 5.0)
    record = to_record(result)
    assert record["kind"] == "slow"
    assert record["rows"] == [
        {"name": "a", "size": None, "interval": {"value": 1.0, "low": 0.5, "high": 2.0}},
        {"name": "b", "size": 3.0},
    ]
    assert (record["values"], record["best"], record["clock"]) == ([1.0, 2.0], None, {"seconds": 5.0})
    again = from_record(Result, record)
    assert (again.search, again.rows[1], again.seconds) == (result.search, rows[1], 5.0)
    assert to_record(again) == record


@pytest.mark.parametrize("change", [{"rows": None}, {"best": "x"}, {"rows": [{"size": 1.0}]}, {"clock": {}}])
def test_a_broken_record_is_no_result(change: dict[str, object]) -> None:
    record = to_record(Result(Search(), (), np.zeros(1), 1.0)) | change
    with pytest.raises((KeyError, TypeError, ValueError)):
        from_record(Result, record)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"rows": None}, "rows: a list was expected, and null was read"),
        ({"best": "x"}, 'best: a number was expected, and "x" was read'),
        ({"best": 10**400}, "best: a number was expected, and 1000"),
        ({"rows": [{"size": 1.0}]}, "rows[0].name: this key is missing"),
        ({"rows": [{"name": 3, "size": 1.0}]}, "rows[0].name: a text was expected, and 3 was read"),
        ({"clock": {}}, "clock.seconds: this key is missing"),
        ({"clock": [1]}, "clock: an object was expected, and [1] was read"),
    ],
)
def test_a_broken_record_names_its_key(change: dict[str, object], sentence: str) -> None:
    record = to_record(Result(Search(), (), np.zeros(1), 1.0)) | change
    with pytest.raises(BrokenRecordError) as found:
        from_record(Result, record)
    assert str(found.value).startswith(sentence)
