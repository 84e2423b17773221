"""Quantities over one to three variables: operating conditions, dwell, and any parameters of the injector.

With two injections the dwell is the time from the end of the first energising to the start of the second. The quantity
of the second injection is the total minus the quantity of the first alone. If the needle does not close in between,
the two are fused, and only the total is defined.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arguments import Limits, not_whole
from commonrail.base.arrays import Bools, Floats, IndexArray, Ints
from commonrail.base.display import Shown
from commonrail.base.errors import ConfigurationError, SimulationError, nearest
from commonrail.base.text import field_unit
from commonrail.base.units import to_text
from commonrail.engine import operating_point
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.engine.status import OK, Status
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_quantities
from commonrail.physics.variants import RETURN, reader_of, unread_inputs
from commonrail.plugins.maps.response import Conditions, simulate_many

# Operating point around which a sweep moves, and the points of many combinations at once.

TIMES = ("first_energising_time", "energising_time", "dwell")
AFTER = 5e-3  # simulated after the last energising; it ends early once the needle has closed [s]


class Base(NamedTuple):
    """Operating point around which a sweep moves.

    Rail pressure [Pa]; energising time of the injection, or of the second of two [s]; energising time of the first of
    two, 0 for a single injection [s]; dwell from the end of the first energising to the start of the second [s].
    """

    rail_pressure: float
    energising_time: float
    first_energising_time: float
    dwell: float
    conditions: Conditions

    def point(self, changed: Mapping[str, float], alone: bool = False) -> OperatingPoint:
        """Operating point with some variables changed, or with the first of two injections alone."""
        return OperatingPoint(**_arguments(self._rows(changed)[0].tolist(), alone))

    def points(self, changed: Mapping[str, Floats], alone: bool = False) -> Points:
        """Operating points as `point` builds them, in a tenth of the time, and built on demand.

        All values (points,) are compared with the limits of operating points at once. A point outside is built by
        `point`, whose message explains the fault.
        """
        rows = self._rows(changed)
        rail, cylinder, back, first, start, second = rows.T
        end = first if alone else start + second
        sound = (
            _within(rail, operating_point.RAIL_PRESSURES)
            & _within(first, operating_point.ENERGISING_TIMES)
            & (end + AFTER <= operating_point.LONGEST)
        )
        for pressure in (cylinder, back):
            sound &= _within(pressure, operating_point.OTHER_PRESSURES) & (pressure < rail)
        last = (
            first > 0.0
            if alone
            else _within(second, operating_point.ENERGISING_TIMES) & ((start >= first) | ~(first > 0.0))
        )
        others = {
            int(i): self.point({name: float(values[i]) for name, values in changed.items()}, alone)
            for i in np.flatnonzero(~(sound & last))
        }
        return Points(rows, alone, others)

    def _rows(self, changed: Mapping[str, Floats | float]) -> Floats:
        """Rows (points, 6): three pressures, energising time of the first of two, start and duration of the last."""
        current = self._asdict() | self.conditions._asdict() | dict(changed)
        names = ("rail_pressure", "cylinder_pressure", "return_pressure", *TIMES)
        values = (np.atleast_1d(np.asarray(current[name], float)) for name in names)
        *pressures, first, second, dwell = np.broadcast_arrays(*values)
        return np.stack([*pressures, first, np.where(first > 0.0, first + dwell, 0.0), second], axis=1)


class Points(Sequence[OperatingPoint]):
    """Operating points of many combinations, built when a slice is taken.

    Their rows (points, 6) are checked; `others` holds points that are not built from their rows.
    """

    def __init__(self, rows: Floats, alone: bool, others: Mapping[int, OperatingPoint]) -> None:
        self._rows, self._alone = rows, alone
        self._others = others

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, index: int) -> OperatingPoint: ...
    @overload
    def __getitem__(self, index: slice) -> list[OperatingPoint]: ...
    def __getitem__(self, index: int | slice) -> OperatingPoint | list[OperatingPoint]:
        if isinstance(index, int):
            return self[index : index + 1 or None][0]
        places = range(len(self))[index]
        rows = zip(places, self._rows[index].tolist(), strict=True)
        return [self._others.get(i) or _make_point(row, self._alone) for i, row in rows]

    @property
    def last_starts(self) -> Floats:
        """Starts of the last energisings [s]."""
        return np.asarray(self._rows[:, 4])


def _within(values: Floats, limits: Limits) -> Bools:
    return np.asarray((values >= limits.low) & (values <= limits.high))


def _make_point(row: Sequence[float], alone: bool) -> OperatingPoint:
    """Build an operating point from a checked row."""
    arguments = _arguments(row, alone)
    energisings = tuple(_energising(*pulse) for pulse in arguments["energisings"])
    point = object.__new__(OperatingPoint)
    point.__dict__.update(arguments | {"energisings": energisings, "drive": None, "start": 0.0})
    return point


def _arguments(row: Sequence[float], alone: bool) -> dict[str, Any]:
    """Arguments of an operating point from its row."""
    rail, cylinder, back, first, start, second = row
    pulses = [(0.0, first)] if first > 0.0 else []
    return {
        "rail_pressure": rail,
        "energisings": tuple(pulses if alone else [*pulses, (start, second)]),
        "cylinder_pressure": cylinder,
        "return_pressure": back,
        "horizon": (first if alone else start + second) + AFTER,
    }


_energising = functools.lru_cache(maxsize=10_000)(Energising)  # the points of a sweep share most of theirs


# Variables of the operating point: SI unit and default value.
OPERATING = {
    "rail_pressure": ("Pa", 100e6),
    "first_energising_time": ("s", 0.0),
    "dwell": ("s", 1e-3),
    "energising_time": ("s", 500e-6),
    "cylinder_pressure": ("Pa", 5e6),
    "return_pressure": ("Pa", 0.5e6),
}
SHORT = {"temperature": FUEL_TEMPERATURE}
OF_THE_SECOND = ("energising_time", "dwell")  # variables that do not affect the first of two injections

# Sentences without the usual advice: a sweep has no horizon and no bounds to change, see `explain`.
_SENTENCES = {
    Status.STILL_INJECTING: (
        f"The needle was still open {to_text(AFTER, 's')} after the last energising, so the quantity is not known."
    ),
}

MOST_VARIABLES = 3
MOST_SIMULATIONS = 200_000


class Variable(NamedTuple):
    """Swept variable: name, SI unit and values (n,)."""

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True, repr=False)
class Sweep(Shown):
    """Result of a sweep; arrays have an axis for each variable.

    Attributes
    ----------
    injector : Injector
    base : Base
    variables : tuple of Variable
    volume : array
        Injected volume of all injections at the reference density [m³]; NaN where the simulation failed.
    second : array
        Of the second injection: total minus the first alone [m³]; NaN for a single injection and for fused ones.
    fused : array of bool
        The needle does not close between the two injections.
    opening : array
        First opening of the needle after the start of energising [s]; NaN if it stays shut.
    status : array of int
        `Status` of each simulation.
    first_status : array of int
        Of the first of two injections alone; `OK` for a single injection.
    fusion : sequence of (float, float)
        Rail pressures [Pa] and the dwells below which two injections fuse [s], as far as searched.
    """

    presenter = "commonrail.plugins.maps.sweep_page:SWEEP"

    injector: Injector
    base: Base
    variables: tuple[Variable, ...]
    volume: Floats
    second: Floats
    fused: Bools
    opening: Floats
    status: Ints
    first_status: Ints
    fusion: Sequence[tuple[float, float]] = ()

    @property
    def two(self) -> bool:
        """True with two injections."""
        return _two(self.base, self.variables)


def explain(status: Status) -> str:
    """Sentence of a status, with the cure for a sweep."""
    return _SENTENCES.get(status, status.sentence.replace("narrow the bounds", "other values"))


def most_frequent(statuses: NDArray[np.integer]) -> str:
    """Sentence of the most frequent status."""
    kinds, counts = np.unique(statuses, return_counts=True)
    return explain(Status(int(kinds[np.argmax(counts)])))


def table_unit(unit: str) -> str:
    """Unit of a table for a variable by its SI unit; temperatures are in degrees Celsius."""
    return "degC" if unit == "K" else field_unit(unit).name


def resolve_variable(name: str) -> tuple[str, str]:
    """Full name and SI unit of a variable; `ConfigurationError` if it is neither a condition nor a parameter."""
    plain = name.replace("-", "_")
    if plain in OPERATING:
        return plain, OPERATING[plain][0]
    full, parameters = SHORT.get(plain, name), parameter_quantities()
    if full not in parameters:
        raise ConfigurationError(
            f'There is no variable "{name}"{nearest(name, [*OPERATING, *SHORT, *parameters])}; a variable is '
            f"{', '.join([*OPERATING, *SHORT])} or a parameter of the injector."
        )
    return full, parameters[full].unit


def sweep(injector: Injector, variables: Sequence[Variable], base: Base) -> Sweep:
    """Simulate all combinations of the values of one to three variables, starting from a base.

    `ConfigurationError` if there are too many variables or combinations, a variable is repeated, or a point or value is
    refused; `InputError` if the fuel is not defined at a temperature; `SimulationError` if all simulations failed.
    """
    _check(variables, base)
    check_values(injector, variables)
    operating = [v for v in variables if v.name in OPERATING]
    parameters = [v for v in variables if v.name not in OPERATING]
    columns = _columns(operating)
    values = np.stack(list(_columns(parameters).values()), axis=1) if parameters else None
    names = [v.name for v in parameters]

    def simulate_points(points: Sequence[OperatingPoint]) -> Batch:
        return simulate_many(injector, points, base.conditions, names, values)

    grid = base.points(columns)
    both = simulate_points(grid)
    two = _two(base, variables)
    total = np.where(both.status == OK, both.injected_volume, np.nan)
    if np.all(np.isnan(total)):
        why = most_frequent(both.status)
        raise SimulationError(f"{injector.name}: no point of the sweep could be simulated. {why}")
    alone, fused = np.full(total.shape, np.nan), np.zeros(total.shape, bool)
    first_status = np.full(total.shape, OK)
    if two:
        distinct, which = _first_alone(base, columns, len(grid))
        first = simulate_points(distinct)
        first_status = first.status[:, which]
        alone = np.where(first.status == OK, first.injected_volume, np.nan)[:, which]
        fused = find_fused(both, grid.last_starts, first.opening[:, which])
    second = np.where(fused, np.nan, total - alone)
    sizes = [len(v.values) for v in (*parameters, *operating)]
    order = [[v.name for v in (*parameters, *operating)].index(v.name) for v in variables]

    def arrange(table: NDArray[Any]) -> NDArray[Any]:
        """Reorder (candidates, points) to one axis for each variable."""
        return np.asarray(table.reshape(sizes).transpose(order))

    statuses = (status.astype(np.int64) for status in (both.status, first_status))
    arrays: list[Any] = list(map(arrange, (total, second, fused, both.opening, *statuses)))
    return Sweep(injector, base, tuple(variables), *arrays)


def _first_alone(base: Base, columns: Mapping[str, Floats], count: int) -> tuple[Sequence[OperatingPoint], IndexArray]:
    """Distinct points with the first of two injections alone, and the index of each point among them."""
    shared = {name: values for name, values in columns.items() if name not in OF_THE_SECOND}
    if not shared:
        return [base.point({}, alone=True)], np.zeros(count, np.intp)
    distinct, which = np.unique(np.stack(list(shared.values())), axis=1, return_inverse=True)
    changed = dict(zip(shared, distinct, strict=True))
    return base.points(changed, alone=True), np.asarray(which, np.intp).reshape(-1)


def _two(base: Base, variables: Sequence[Variable]) -> bool:
    return base.first_energising_time > 0.0 or any(v.name == "first_energising_time" for v in variables)


def _check(variables: Sequence[Variable], base: Base) -> None:
    names = [v.name for v in variables]
    if not 1 <= len(names) <= MOST_VARIABLES:
        raise ConfigurationError(f"A sweep has 1 to {MOST_VARIABLES} variables, not {len(names)}.")
    for name in names:
        if names.count(name) > 1:
            raise ConfigurationError(f"The variable {name} is stated twice; keep one.")
    if base.first_energising_time < 0.0:
        raise ConfigurationError(
            f"The energising time of the first of two injections is {base.first_energising_time:g} s; it must be "
            "greater than zero, or zero for a single injection."
        )
    if "dwell" in names and not _two(base, variables):
        raise ConfigurationError("A dwell lies between two injections; give the energising time of the first one too.")
    if any(v.name == "first_energising_time" and np.any(v.values <= 0.0) for v in variables):
        raise ConfigurationError(
            "The energising times of the first of two injections must be greater than zero; a single injection is a "
            "sweep of its own."
        )
    count = int(np.prod([len(v.values) for v in variables]))
    if count > MOST_SIMULATIONS:
        raise ConfigurationError(
            f"The sweep has {count} combinations, and at most {MOST_SIMULATIONS} are simulated; take fewer values."
        )


def check_values(injector: Injector, variables: Sequence[Variable]) -> None:
    """Refuse values of parameters that `simulate` would refuse, with the same message."""
    quantities = injector.quantities
    for name, _, values in variables:
        if name == RETURN and name in unread_inputs(injector.variant):
            raise ConfigurationError(
                f"{injector.name} has no return: all values of {name} would give the same; take a model with "
                f"{reader_of(name)}."
            )
        if name in OPERATING:
            continue
        injector.check_read([name])
        for value in values.tolist():
            if words := not_whole(name, value):
                raise ConfigurationError(f"{injector.name}: {words}.")
        if name in quantities:  # otherwise `with_values` names the parameters that the injector has
            values = values[~(np.isfinite(values) & quantities[name].domain.admits(values))]
        for value in values[:1].tolist():
            injector.with_values({name: value})
    for name, _, values in variables:
        if name == FUEL_TEMPERATURE:
            injector.fuel.vapour_pressure(values)


def _columns(variables: Sequence[Variable]) -> dict[str, Floats]:
    """Values of each variable in all combinations; the last variable changes fastest."""
    grids = np.meshgrid(*(v.values for v in variables), indexing="ij")
    return {v.name: grid.ravel() for v, grid in zip(variables, grids, strict=True)}


def find_fused(batch: Batch, starts: Floats, delay: Floats) -> Bools:
    """Mark simulations (candidates, points) whose needle is still open when the second energising would open it.

    `starts` (points,) are starts of the second energising [s], the first starts at 0; `delay` (candidates, points)
    is the opening delay of the first injection alone [s], NaN if it stays shut. A needle that bounces on closing
    counts as closing once.
    """
    return np.asarray(np.isfinite(delay) & (batch.first_closing > starts + delay))


# Combinations without a number: count, reasons, and the first of each.


class WithoutNumber(NamedTuple):
    """Combinations without a number for one reason: their count, and the variables [SI] of the first.

    `alone`: the first of two injections failed alone, which leaves the second quantity unknown.
    """

    status: Status
    combinations: int
    first: Mapping[str, float]
    alone: bool = False

    @property
    def sentence(self) -> str:
        """Reason and cure."""
        return explain(self.status)


def without_number(swept: Sweep) -> list[WithoutNumber]:
    """Reasons for missing numbers, the most frequent first."""
    groups = []
    for alone, statuses in enumerate((swept.status, np.where(swept.status == OK, swept.first_status, OK))):
        for status in np.unique(statuses[statuses != OK]).tolist():
            places = np.argwhere(statuses == status)
            first = {v.name: float(v.values[i]) for v, i in zip(swept.variables, places[0].tolist(), strict=True)}
            groups.append(WithoutNumber(Status(status), len(places), first, bool(alone)))
    return sorted(groups, key=lambda group: (group.alone, -group.combinations))
