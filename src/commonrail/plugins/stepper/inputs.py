"""Inputs set by the caller of a stepper, which replace those of the operating point."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from commonrail.base.arguments import sequence, shown
from commonrail.base.arrays import Floats
from commonrail.base.choices import Drive
from commonrail.base.errors import ConfigurationError
from commonrail.physics.injector import Injector
from commonrail.physics.variants import COMMAND, RAIL, RETURN, reader_of, unread_inputs

# Columns of `physics.model.Inputs` that a caller may set.
COLUMNS = {"rail_pressure": 0, "cylinder_pressure": 1, "return_pressure": 2, "voltage": 3, "current": 3}
UNITS = {"voltage": "V", "current": "A"}  # the others are pressures [Pa]
_PRESSURES = tuple(COLUMNS)[:3]
_TRACED = {Drive.VOLTAGE: "voltage", Drive.CURRENT: "current"}
_NEVER = -1.0  # clock value of an energising that has not begun or not ended [s]


@dataclass
class Overrides:
    """Inputs set by the caller until changed: values by column, and the command of the energising.

    `on` is None while the energisings of the operating point apply; `since` and `until` are the instants of the last
    rising and the last falling edge [s], NaN before them.
    """

    values: dict[int, float] = field(default_factory=dict)
    on: bool | None = None
    since: float = math.nan
    until: float = math.nan

    def copy(self) -> Overrides:
        """Return an independent copy."""
        return replace(self, values=dict(self.values))

    def command(self, on: bool, now: float, planned_since: float) -> None:
        """Switch the energising on or off.

        `now`: instant [s]; `planned_since`: elapsed time of the operating point's energising [s], negative without
        one.
        """
        if self.on is None and planned_since >= 0.0:
            self.on, self.since = True, now - planned_since
        if on and not self.on:
            self.since = now
        elif not on and self.on:
            self.until = now
        self.on = on

    def apply(self, inputs: Floats, now: Floats) -> None:
        """Replace planned inputs by those of the caller.

        `inputs`: (steps, 6); `now` (steps,): starts of the steps [s].
        """
        for column, value in self.values.items():
            inputs[:, column] = value
        if self.on is not None:
            begun, ended = not math.isnan(self.since), not (self.on or math.isnan(self.until))
            inputs[:, 4] = now - self.since if begun else _NEVER
            inputs[:, 5] = now - self.until if ended else _NEVER


def refuse_unread(injector: Injector, name: str) -> None:
    """Refuse (`ConfigurationError`) an input that this injector does not read, and name those that it reads."""
    unread = unread_inputs(injector.variant)
    if name in UNITS and name != _find_trace_input(injector):
        raise ConfigurationError(
            f"{injector.name} has a {injector.variant.drive.value} drive, which takes no {name}; give "
            f'command, or set the drive of the injector to "{name} trace".'
        )
    if name == RETURN and name in unread:
        raise ConfigurationError(f"{injector.name} is a direct injector, without a return: omit {name}.")
    if name == COMMAND and name in unread:
        raise ConfigurationError(
            f"{injector.name} is driven by a {injector.variant.drive.value} and does not read a command; give "
            f"{_find_trace_input(injector)}, or take {reader_of(COMMAND)}."
        )
    if name == RAIL and name in unread:
        raise ConfigurationError(
            f"{injector.name} is fed from a rail volume, whose pressure is simulated; set rail_boundary to "
            '"ideal" to give it.'
        )


def _find_trace_input(injector: Injector) -> str | None:
    """Input of an injector driven by a measured trace, "voltage" or "current"; else None."""
    return _TRACED.get(injector.variant.drive)


def refuse_pressures(injector: Injector, inputs: Floats) -> None:
    """Refuse boundary pressures outside the range of the fuel or the laws of the parts.

    `inputs`: (steps, 6). `ConfigurationError` if one lies outside the fuel's range, or cylinder or return pressure
    reach the rail pressure.
    """
    low, high = injector.fuel.pressure_range
    for name, column in zip(_PRESSURES, inputs.T, strict=False):
        words = name.replace("_", " ")
        least, most = column.min(), column.max()
        if not (low <= least and most <= high):
            worst = least if least < low else most
            raise ConfigurationError(
                f"The {words} is {worst * 1e-6:g} MPa, but the fuel {injector.fuel.name} is declared from "
                f"{low * 1e-6:g} to {high * 1e-6:g} MPa; give a pressure inside this range."
            )
        if name != _PRESSURES[0] and not (column < inputs[:, 0]).all():
            raise ConfigurationError(f"The {words} must stay below the rail pressure; correct one of them.")


def read_names(value: object, choices: tuple[str, ...], what: str) -> tuple[str, ...]:
    """Read a list of names; `choices`: to choose from; `what`: "input" or "output"."""
    names = sequence(value, f"{what}s", f'["{choices[0]}"]')
    for name in names:
        if not isinstance(name, str) or name not in choices:
            raise ConfigurationError(f"Unknown {what} {shown(name)}; choose from {', '.join(choices)}.")
    return tuple(names)
