"""Working rows of a block, each as wide as its lanes, laid out by the names of what they hold.

Coefficients, state, the waves that leave and that arrive, and what the loop keeps of a lane, behind one pointer.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any, NamedTuple

from commonrail.choices import Actuation
from commonrail.compile import physics
from commonrail.injector.layout import layout_of
from commonrail.injector.model import Inputs, Waves
from commonrail.injector.variants import MODELS, Variant, wiring


class Progress(NamedTuple):
    """Numbers that the loop keeps of each lane; instants are in steps, and zero is none.

    Attributes
    ----------
    injected_before, injected_at_sample, injected_at_lift, injected_at_check : float
        Mass injected [kg] before the step, at the end of the last sample, when the tip last left its seat, and at the
        last check.
    absolute, squared : float
        Sums of the samples' errors [m³/s], [(m³/s)²].
    density : float
        Makes a volume of a sample [kg/m³].
    greatest_lift, tip_before : float
        Lift of the tip [m], the greatest and before the step.
    opening, last_closing, first_closing : float
        Instants.
    is_open, has_ended : float
        1 while the needle counts as open, and once the lane has ended.
    checks_at_rest, longest_contact : float
        Checks for which it has rested, and longest contact of a bouncing needle or valve in steps.
    farthest_lift : float
        Lift beyond the stop [m].
    earliest_end, steps : float
        First step at which the injection may have ended, and number of steps.
    clock_turns : float
        Turns of the clocks so far.
    """

    injected_before: float
    injected_at_sample: float
    absolute: float
    squared: float
    density: float
    greatest_lift: float
    opening: float
    last_closing: float
    first_closing: float
    is_open: float
    injected_at_lift: float
    tip_before: float
    checks_at_rest: float
    injected_at_check: float
    has_ended: float
    longest_contact: float
    farthest_lift: float
    earliest_end: float
    steps: float
    clock_turns: float


class Working(NamedTuple):
    """All rows: a wave arrives between two slots of its ring, after a delay of whole steps and a fraction."""

    coefficients: Any
    state: Any
    leaving: Waves
    arriving: Waves
    arriving_before: Waves
    inputs: Inputs
    progress: Progress
    delay_steps: Waves
    delay_fraction: Waves


# rows that the loop itself reads: single ones of the state, first ones of groups
_BOTH = {
    "injected": "nozzle.injected",
    "returned": "cumulative_flows.returned",
    "supplied": "cumulative_flows.supplied",
    "sac_pressure": "sac.pressure",
    "accumulation_pressure": "accumulation.fuel.pressure",
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
    **{name: name for name in Working._fields if name not in ("coefficients", "progress")},
    **{name: f"inputs.{name}" for name in ("cylinder", "since_start", "since_end")},
    **{name: f"progress.{name}" for name in Progress._fields},
}


def _paths(actuation: Actuation) -> dict[str, str]:
    """Rows that the loop reads, by the names that it uses."""
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
