"""Test plan of an injector: tests with a nominal quantity per stroke and a band, read from a table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from os import PathLike
from typing import NamedTuple, Protocol

import numpy as np

from commonrail.base.arguments import (
    Limits,
    Quantity,
    amount,
    file_path,
    frozen,
    instances,
    sequence,
    settle,
    shown,
)
from commonrail.base.arrays import Floats
from commonrail.base.declare import Choice, Number, OptionalNumber, Setting, setting, settings
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.hooks import note
from commonrail.base.text import join_words
from commonrail.base.units import to_text
from commonrail.engine.operating_point import RAIL_PRESSURES, Energising, OperatingPoint, read_pulses
from commonrail.physics.law import Domain
from commonrail.readers.columns import PLAIN, Column, FileForm, Table
from commonrail.readers.location import Place, locate_errors
from commonrail.readers.overview import synthetic_mark
from commonrail.readers.tables import has_columns, open_sheet, take_columns

AFTER_ENERGISING = 3e-3  # simulated time after the end of energising, as for a quantity map [s]
# Pressures in the cylinder (bench of cases/cri2-16) and at the end of the return line (ambient) [Pa], [E].
BENCH_PRESSURES = (0.5e6, 0.1e6)
NO_INJECTION = 0.01  # share of the nominal quantity below which a test counts as without injection [1]; chosen
STROKE_RATES = Limits(0.01, 1e3, (0.1, 100.0), ("Hz",))  # [1/s]


class Measure(StrEnum):
    """Quantity that a test collects."""

    DELIVERY = "delivery"
    RETURN = "return"


class NamedTest(Protocol):
    """Test, or a row about it, with its name and measure."""

    @property
    def name(self) -> str: ...
    @property
    def measure(self) -> Measure: ...


def test_name(test: NamedTest) -> str:
    """Name of a test, with the measure if it is the return."""
    return f"{test.name} (return)" if test.measure is Measure.RETURN else test.name


def without_rate(names: Sequence[str]) -> str:
    """Sentence on returns without a stroke rate."""
    lack = "lacks" if len(names) == 1 else "lack"
    return f"Without a stroke rate {join_words(names)} {lack} what the guides leak until the next stroke."


class State(StrEnum):
    """Place of a quantity in the band of its test."""

    INSIDE = "inside"
    BELOW = "below"
    ABOVE = "above"
    NO_INJECTION = "no injection"
    FAILED = "no number"


@settings(kw_only=False)
class PlanTest:
    """One test of a plan; `ConfigurationError` for an impossible value, or limits that contradict the nominal one."""

    name: str = setting(words="name of a test", text="Name in the plan: VL, EM, LL, VE, leak.")
    rail_pressure: Number = setting(unit="Pa", limits=RAIL_PRESSURES)
    energisings: Setting[tuple[Energising, ...], Sequence[tuple[Quantity, Quantity]]] = setting(
        read=lambda value, _: read_pulses(value),
        text="One or two; a duration of zero: leakage of the closed injector.",
    )
    nominal: OptionalNumber = setting(words="nominal quantity", unit="m3", default=None, text="Per stroke [m³ or kg].")
    lower: OptionalNumber = setting(words="lower quantity", unit="m3", default=None, text="Lower limit, if any.")
    upper: OptionalNumber = setting(words="upper quantity", unit="m3", default=None, text="Upper limit.")
    measure: Choice[Measure] = setting(words="measure of a test", default=Measure.DELIVERY)
    stroke_rate: OptionalNumber = setting(
        unit="1/s", default=None, limits=STROKE_RATES, text="Of the bench, for the leakage between two strokes."
    )
    bench: OptionalNumber = setting(words="bench quantity", unit="m3", default=None, text="Measured on a part.")

    def __post_init__(self) -> None:
        if self.measure is Measure.DELIVERY and not all(pulse.duration > 0.0 for pulse in self.energisings):
            raise ConfigurationError(
                f'The energising time of the test {self.name} must be greater than zero; with measure = "return" it '
                "may be zero."
            )
        if self.upper is None and (self.lower is None or self.nominal is None):
            raise ConfigurationError(
                f"The test {self.name} has no band; state half_band, upper_limit, or lower_limit and nominal."
            )
        low, high = -math.inf if self.lower is None else self.lower, math.inf if self.upper is None else self.upper
        if not low < self.middle < high:
            raise ConfigurationError(
                f"The lower limit, nominal quantity and upper limit of the test {self.name} must increase."
            )

    @property
    def middle(self) -> float:
        """Origin of distances: the nominal quantity, else the middle of two limits, else zero for an upper limit."""
        if self.nominal is not None:
            return self.nominal
        return 0.0 if self.lower is None else 0.5 * (self.lower + (self.upper or 0.0))

    @property
    def half_bands(self) -> tuple[float, float]:
        """Half band below and above the middle; a single limit gives both."""
        below = None if self.lower is None else self.middle - self.lower
        above = None if self.upper is None else self.upper - self.middle
        return below or above or math.nan, above or below or math.nan

    @property
    def band(self) -> str:
        """Band as printed in plans [mm³]: 45.8 ± 4.2, 60 −5 +6, ≤ 60, ≥ 10."""
        middle, below, above = (1e9 * v for v in (self.middle, *self.half_bands))
        if self.lower is None or self.upper is None:
            limit = f"≥ {middle - below:.4g}" if self.upper is None else f"≤ {middle + above:.4g}"
            return limit if self.nominal is None else f"{middle:.4g}, {limit}"
        ends = f"± {above:.3g}" if math.isclose(below, above, rel_tol=1e-6) else f"−{below:.3g} +{above:.3g}"
        return f"{middle:.4g} {ends}"

    def state(self, value: float) -> State:
        """Place of a quantity in the band; FAILED for NaN."""
        if not math.isfinite(value):
            return State.FAILED
        if self.upper is not None and value > self.upper:
            return State.ABOVE
        if self.lower is not None and value < self.lower:
            nothing = self.measure is Measure.DELIVERY and value < NO_INJECTION * self.middle
            return State.NO_INJECTION if nothing else State.BELOW
        return State.INSIDE

    def point(self, cylinder_pressure: Quantity, return_pressure: Quantity) -> OperatingPoint:
        """Operating point of the test, simulated until `AFTER_ENERGISING`; pressures in [Pa]."""
        last = self.energisings[-1]
        end = last.start + last.duration + AFTER_ENERGISING
        return OperatingPoint(self.rail_pressure, self.energisings, cylinder_pressure, return_pressure, horizon=end)

    def scale(self, factor: float) -> PlanTest:
        """Multiply all quantities by a factor, for example to turn masses into volumes."""
        values = (self.nominal, self.lower, self.upper, self.bench)
        nominal, lower, upper, bench = (None if value is None else value * factor for value in values)
        return replace(self, nominal=nominal, lower=lower, upper=upper, bench=bench)


@dataclass(frozen=True)
class TestPlan:
    """Test plan: name, tests, unit of the quantities (m3 or kg), and note on synthetic data in its file."""

    name: str
    tests: tuple[PlanTest, ...]
    unit: str = "m3"
    synthetic: str = ""

    __test__ = False  # not a test of pytest in spite of its name

    def __post_init__(self) -> None:
        settle(self, tests=instances(self.tests, PlanTest, "tests of the plan"))
        if not self.tests:
            raise ConfigurationError(f"The plan {self.name} has no test; give at least one.")
        keys = [(test.name, test.measure) for test in self.tests]
        for i, key in enumerate(keys):
            if key in keys[:i]:
                raise ConfigurationError(f"There are two tests {key[0]} of the {key[1]}; rename one.")

    def select(self, names: Sequence[str]) -> TestPlan:
        """Return the plan with some of its tests; `ConfigurationError` for an unknown name."""
        test_names = [test.name for test in self.tests]
        for name in sequence(names, "names of tests", '["VL"]'):
            if name not in test_names:
                hint = f"it has {', '.join(test_names)}"
                raise ConfigurationError(
                    f"{self.name} has no test {shown(name)}{nearest(str(name), test_names)}; {hint}."
                )
        return replace(self, tests=tuple(test for test in self.tests if test.name in names))

    def at_stroke_rate(self, rate: Quantity | None) -> TestPlan:
        """Return the plan with a stroke rate [1/s] for tests without one."""
        if rate is None:
            return self
        default_rate = amount(rate, "1/s", "stroke rate", STROKE_RATES)
        tests = (t if t.stroke_rate is not None else replace(t, stroke_rate=default_rate) for t in self.tests)
        return replace(self, tests=tuple(tests))


def note_without_rate(name: str, tests: Sequence[PlanTest]) -> None:
    """Note returns of a plan without a stroke rate."""
    if names := [test_name(t) for t in tests if t.measure is Measure.RETURN and t.stroke_rate is None]:
        note(f"{name}: {without_rate(names)} State stroke_rate.")


class Bands(NamedTuple):
    """Bands of several tests (n,): middle, half bands below and above, and which limits exist (1 or 0)."""

    middle: Floats
    below: Floats
    above: Floats
    is_closed: Floats
    has_upper: Floats

    @classmethod
    def of(cls, tests: Sequence[PlanTest]) -> Bands:
        """Bands of tests."""
        rows = [(t.middle, *t.half_bands, None not in (t.lower, t.upper), t.upper is not None) for t in tests]
        return cls(*frozen(np.array(rows, float).T))

    def distance(self, values: Floats) -> Floats:
        """Distances of quantities (…, n) from the middle in half bands; −1 and 1 at the limits."""
        deviation = values - self.middle
        return np.asarray(deviation / np.where(deviation < 0.0, self.below, self.above))

    def excess(self, values: Floats) -> Floats:
        """Distances as in `distance`; for a band with one limit only the excess beyond it."""
        d = self.distance(values)
        beyond = np.where(self.has_upper > 0.0, np.maximum(d - 1.0, 0.0), np.minimum(d + 1.0, 0.0))
        return np.where(self.is_closed > 0.0, d, beyond)


# The table of a plan. Only the first three columns are required; other cells may be empty.

_NEEDED = (
    Column("test"),
    Column("rail_pressure", "Pa", domain=Domain.POSITIVE),
    Column("energising_time", "s", domain=Domain.NON_NEGATIVE),
)
_BAND = ("1", "m3", "kg")  # percent of the nominal quantity, or a quantity
_OPTIONAL = (
    Column("measure"),
    Column("second_energising_time", "s", domain=Domain.POSITIVE, required=False),
    Column("dwell", "s", domain=Domain.NON_NEGATIVE, required=False),
    Column("stroke_rate", "1/s", domain=Domain.POSITIVE, required=False),
    Column("nominal", _BAND[1:], domain=Domain.POSITIVE, required=False),
    Column("half_band", _BAND, domain=Domain.POSITIVE, required=False),
    Column("lower_limit", _BAND, domain=Domain.NON_NEGATIVE, required=False),
    Column("upper_limit", _BAND, domain=Domain.POSITIVE, required=False),
    Column("bench", _BAND[1:], domain=Domain.NON_NEGATIVE, required=False),
)

# Usual ranges of the numbers of a plan [SI], so wide that a number outside suggests a wrong unit. Petrol is injected at
# a few MPa, and series injectors are built for up to 300; a coil needs about 100 us to open a valve, and 10 ms exceed
# 60° of crank at 1000 1/min; injectors of ships deliver about 1 cm³, at 60 strokes a minute; the fastest engines of
# cars inject 50 times a second.
_ENERGISED = (50e-6, 10e-3)
_USUAL = {
    "rail_pressure": (1e6, 400e6),
    "energising_time": _ENERGISED,
    "second_energising_time": _ENERGISED,
    "stroke_rate": (0.5, 100.0),
    "m3": (0.0, 2e-6),
    "kg": (0.0, 2e-3),
}


def load_plan(path: str | PathLike[str], form: FileForm = PLAIN) -> TestPlan:
    """Read a test plan.

    Parameters
    ----------
    path : str or path
        Table with the columns test, rail_pressure and energising_time; measure, second_energising_time, dwell,
        stroke_rate, nominal, half_band, lower_limit, upper_limit and bench are optional. The heading states units; a
        warning names the first number of a column that is unusually small or large.
    form : FileForm
        Encoding, decimal sign and sheet.

    Raises
    ------
    InputError, ConfigurationError
        If the file cannot be read, a column or unit is missing, or a row is impossible; with line and column.
    """
    path = file_path(path, "path of a test plan")
    sheet = open_sheet(path, form)
    optional = [column for column in has_columns(sheet, [*_NEEDED, *_OPTIONAL]) if column in _OPTIONAL]
    table = take_columns(sheet, [*_NEEDED, *optional], 1)
    column_names = [column.name for column in (*_NEEDED, *_OPTIONAL)]
    for name in sheet.names:
        if name not in (*column_names, *table.headings.values()):
            hint = nearest(name, column_names)
            note(f'{path}: the column "{name}" does not belong to a test plan and is not read{hint}.')
    units = {name: unit for name, unit in table.units.items() if unit in ("m3", "kg")}
    for name, unit in units.items():
        if unit != next(iter(units.values())):
            at = Place(str(path), f'column "{name}"')
            raise at.error(f'volumes and masses are mixed, see column "{next(iter(units))}"; state only one of them')
    for name in table.columns:
        _warn_of_unusual(table, name)
    tests = tuple(_test(table, row) for row in range(len(table.rows)))
    mark = synthetic_mark((*table.comments, *(cell for texts in table.texts.values() for cell in texts)))
    with locate_errors(Place(str(path))):
        return TestPlan(path.name, tests, next(iter(units.values()), "m3"), mark)


def _warn_of_unusual(table: Table, name: str) -> None:
    """Warn of the first number of a column outside `_USUAL`; zero is allowed (energising time of a return)."""
    unit, values = table.units[name], table.columns[name]
    low, high = _USUAL.get(name) or _USUAL.get(unit) or (0.0, math.inf)
    slack = 1e-9  # rounding of a number that was converted
    outside = np.flatnonzero((values > high * (1.0 + slack)) | ((values < low * (1.0 - slack)) & (values != 0.0)))
    if len(outside):
        row = int(outside[0])
        usual = f"{to_text(low, unit)} to {to_text(high, unit)}" if low else f"at most {to_text(high, unit)}"
        value_text = to_text(float(values[row]), unit)
        note(f"{table.place(name, row)}: this is {value_text}; usual is {usual}; check the unit of the column.")


def _test(table: Table, row: int) -> PlanTest:
    """Test of a row."""
    cells = {name: None if math.isnan(values[row]) else float(values[row]) for name, values in table.columns.items()}
    name, word = (table.texts[key][row].strip() if key in table.texts else "" for key in ("test", "measure"))
    if not name:
        raise table.place("test", row).error("the cell is empty; state the name of the test")
    if word not in ("", *Measure):
        raise table.place("measure", row).error(f'unknown measure "{word}"; write delivery or return')
    measure = Measure(word or Measure.DELIVERY)
    with locate_errors(Place(str(table.path), f"{table.row} {table.rows[row]}")):
        return PlanTest(
            name,
            float(table.columns["rail_pressure"][row]),
            _energisings(float(table.columns["energising_time"][row]), cells),
            cells.get("nominal"),
            *_limits(table, cells, measure),
            measure,
            cells.get("stroke_rate"),
            cells.get("bench"),
        )


def _energisings(first: float, cells: dict[str, float | None]) -> tuple[Energising, ...]:
    second, dwell = cells.get("second_energising_time"), cells.get("dwell")
    if second is None and dwell is None:
        return (Energising(0.0, first),)
    if second is None or dwell is None:
        raise ConfigurationError("A second energising needs both second_energising_time and dwell; one is missing.")
    return Energising(0.0, first), Energising(first + dwell, second)


def _limits(table: Table, cells: dict[str, float | None], measure: Measure) -> tuple[float | None, float | None]:
    """Lower and upper limit of a row."""
    nominal = cells.get("nominal")

    def quantity(name: str) -> float | None:
        value = cells.get(name)
        if value is None or (table.units[name] != "1" and name != "half_band"):
            return value
        if nominal is None:
            raise ConfigurationError(f"The {name} needs the nominal quantity, which is missing; state nominal.")
        return value * nominal if table.units[name] == "1" else value

    half, lower, upper = (quantity(name) for name in ("half_band", "lower_limit", "upper_limit"))
    if half is None or nominal is None:
        return lower, upper
    if lower is not None or upper is not None:
        raise ConfigurationError("State half_band or limits, not both.")
    if measure is Measure.DELIVERY and half >= nominal * (1.0 - 1e-9):
        raise ConfigurationError(
            f"The half_band of a delivery is {100.0 * half / nominal:.4g} % of the nominal quantity, so a part "
            "without injection would pass; state less, or upper_limit if it may pass."
        )
    return nominal - half, nominal + half
