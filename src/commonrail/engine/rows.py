"""Working rows of a block, each as wide as its lanes, laid out by the names of what they hold.

Coefficients, state, the waves that leave and that arrive, and what the loop notes of a lane, behind one pointer.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from commonrail.choices import Actuation
from commonrail.compile import physics
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Inputs, Waves
from commonrail.injector.variants import MODELS, Variant, wiring


class Notes(NamedTuple):
    """Numbers that the loop keeps of each lane; instants are in steps, and zero is none.

    Mass injected [kg] before the step, at the end of the last sample, when the tip last left its seat and at the last
    look: `before`, `mark`, `lifted`, `seen`. Sums of the samples' errors [m³/s], [(m³/s)²]. Density that makes a volume
    of a sample [kg/m³]. Lift of the tip [m], the greatest and before the step. Instants of opening, last and first
    closing. 1 while the needle counts as open (`clear`), and once the lane has ended (`done`). Looks of rest, and
    longest touch of a bouncing needle or valve in steps. Lift that passes the stop [m] (`farthest`). First step at
    which the injection may have ended (`quiet`), number of steps (`steps`), turns of the clocks so far.
    """

    before: float
    mark: float
    absolute: float
    squared: float
    density: float
    greatest: float
    opened: float
    shut: float
    first_shut: float
    clear: float
    lifted: float
    tip_before: float
    rested: float
    seen: float
    done: float
    touch: float
    farthest: float
    quiet: float
    steps: float
    turned: float


class Working(NamedTuple):
    """All rows: a wave arrives between two slots of its ring, after a delay of a whole number of steps and a part."""

    coefficients: Any
    state: Any
    leaving: Waves
    late: Waves
    later: Waves
    inputs: Inputs
    notes: Notes
    whole: Waves
    part: Waves


# rows that the loop itself looks at: single ones of the state, first ones of groups
_BOTH = {
    "injected": "nozzle.injected",
    "returned": "cumulative_flows.returned",
    "supplied": "cumulative_flows.supplied",
    "sac_pressure": "sac.pressure",
    "store_pressure": "accumulation.fuel.pressure",
}
_STATE = {
    Actuation.SERVO: _BOTH
    | {
        "control_pressure": "control_chamber.fuel.pressure",
        "return_pressure": "return_line.pressure",
        "valve_lift": "valve.lift",
    },
    # The armature takes the valve's place. There is no control chamber that must refill before the injection has ended,
    # and no return line: its wave stands still.
    Actuation.DIRECT: _BOTH
    | {
        "control_pressure": "accumulation.fuel.pressure",
        "return_pressure": "accumulation.fuel.pressure",
        "valve_lift": "body.z.armature",
    },
}
_DELAYS = {
    Actuation.SERVO: {"feed_delay": "coefficients.delays.feed", "back_delay": "coefficients.delays.back"},
    Actuation.DIRECT: {"feed_delay": "coefficients.delays.feed", "back_delay": "coefficients.delays.feed"},
}
_LOOP = {
    **{name: name for name in ("state", "inputs", "leaving", "late", "later", "whole", "part")},
    **{name: f"inputs.{name}" for name in ("cylinder", "since_start", "since_end")},
    **{name: f"notes.{name}" for name in Notes._fields},
}


def _paths(actuation: Actuation) -> dict[str, str]:
    """Rows that the loop looks at, by the names that it uses."""
    return _LOOP | {name: f"state.{path}" for name, path in _STATE[actuation].items()} | _DELAYS[actuation]


Rows = namedtuple("Rows", ("lanes", *_paths(Actuation.SERVO), "tip", "top", "end"))  # type: ignore[misc]


def make_rows(variant: Variant, lanes: int) -> Any:
    """`Rows` of a variant: the number of lanes, the rows by name, and how many there are."""
    body, held = wiring(variant).body, MODELS[variant.actuation]
    choices = (("coefficients", held.Coefficients), ("state", held.State), ("body", body.State))
    rows = layout_of(Working, choices)
    ends = (rows.row(f"state.body.{name}") for name in (body.TIP, body.TOP))
    return Rows(lanes, *map(rows.row, _paths(variant.actuation).values()), *ends, len(rows.paths))  # type: ignore[call-arg]


@physics
def at(rows: Any, row: int, lane: int) -> int:
    """Index of a row's lane."""
    return row * rows.lanes + lane
