"""Records of test plans: each test with the quantities of models, by label, and of the bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, NamedTuple

from commonrail.base.record import Key
from commonrail.plugins.plans.study import Measure, State


class JudgedQuantity(NamedTuple):
    """Quantity of a test [m³], NaN if missing, its distance in half bands, and its place in the band."""

    value: float
    distance: float
    state: State


class SecondEnergising(NamedTuple):
    """Time from the end of the first energising to the second, and duration of the second [s]."""

    dwell: float
    energising_time: float


class PlanRow(NamedTuple):
    """Test of a plan [SI], with the quantities of models by label, and of the bench if it measured one.

    `reason`: why the only model has no number; empty if it has one.
    """

    rail_pressure: float
    cylinder_pressure: float
    return_pressure: float
    energising_time: float
    second: SecondEnergising | None
    name: Annotated[str, Key("test")]
    measure: Measure
    stroke_rate: float | None
    nominal: float | None
    lower: float | None
    upper: float | None
    band: str
    models: Annotated[Mapping[str, JudgedQuantity], Key("found")]
    bench: JudgedQuantity | None
    reason: str | None = None


class PlanRecord(NamedTuple):
    """Tests of a plan; by label, the root mean square distance in half bands and the number of tests inside."""

    name: str
    rows: tuple[PlanRow, ...]
    rms: Mapping[str, float]
    inside: Mapping[str, int]

    @property
    def verdict(self) -> str | None:
        """Verdict on the part on the bench: fail, pass, or open if a test has no result; None without any result."""
        states = [row.bench.state for row in self.rows if row.bench is not None]
        if not states:
            return None
        if any(state is not State.INSIDE for state in states):
            return "fail"
        return "pass" if len(states) == len(self.rows) else "open"
