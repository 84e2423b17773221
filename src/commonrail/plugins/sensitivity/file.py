"""Result of a sensitivity study: values, rows for a table, and the record in its folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from commonrail.base.display import Shown
from commonrail.base.record import Interval, Key, to_record
from commonrail.calibration.parameter import Parameter
from commonrail.data.records import make_record
from commonrail.plugins.sensitivity.settings import SensitivitySettings
from commonrail.plugins.sensitivity.study import Output


class Range(NamedTuple):
    """Range of a parameter [SI], see `Parameter`."""

    name: str
    unit: str
    reference: float
    lower: float
    upper: float
    scale: str
    mark: str
    source: str

    @classmethod
    def of(cls, parameter: Parameter) -> Range:
        """Range of a parameter."""
        return cls(*(getattr(parameter, name) for name in cls._fields))


class Failed(NamedTuple):
    """Simulations without an output: number, share, number by reason, and the range end with most of them."""

    number: int
    share: float
    reasons: Mapping[str, int]
    where: str


class Effect(NamedTuple):
    """Effect of one parameter on an output, in the unit of the output.

    Attributes
    ----------
    name : str
    low, high : float, optional
        Output with only this parameter at its lower and its upper bound; None if the simulation failed.
    swing : float, optional
        Difference between them.
    first, total : Interval, optional
        Sobol' indices: share of the variance that the parameter explains alone, and with interactions.
    effect, magnitude : Interval, optional
        Of a Morris study: mean µ of the elementary effects, and mean µ* of their sizes.
    spread : float, optional
        Standard deviation σ of the elementary effects.
    used : int, optional
        Number of base points or trajectories with an effect.
    """

    name: str
    low: float | None
    high: float | None
    swing: float | None
    first: Interval | None = None
    total: Interval | None = None
    effect: Interval | None = None
    magnitude: Interval | None = None
    spread: float | None = None
    used: int | None = None

    @property
    def rank(self) -> float:
        """Figure by which the parameters are ranked: total index, mean size of the effects, or size of the swing."""
        interval = self.total or self.magnitude
        return abs(self.swing or 0.0) if interval is None else interval.value


@dataclass(frozen=True)
class OutputSensitivity:
    """Sensitivity of one output.

    Attributes
    ----------
    output : Output
    base : float, optional
        Output at the references; None if that simulation failed.
    missing : str
        Reasons for missing outputs at ends of ranges.
    failed : Failed
    estimated : bool
        False if too many simulations failed, or the output is constant; `why_not` says which.
    mean, variance : float, optional
        Of the output over the ranges, in a Sobol' study.
    parameters : tuple of Effect
        In order of rank.
    """

    output: Annotated[Output, Key("")]
    base: float | None
    missing: str
    failed: Failed
    estimated: bool
    why_not: str
    mean: float | None
    variance: float | None
    parameters: tuple[Effect, ...]


@dataclass(frozen=True, repr=False)
class Sensitivity(Shown):
    """Result of a sensitivity study.

    Attributes
    ----------
    title, injector : str
    synthetic : str
        Synthetic parts of the subject; empty if everything is measured.
    parameters : tuple of Range
    settings : SensitivitySettings
    outputs : tuple of OutputSensitivity
    injections : int
        Number of simulated injections.
    seconds : float
    notes : tuple of str
        Conditions that a reader must know.
    """

    presenter = "commonrail.plugins.sensitivity.page:SENSITIVITY"

    title: str
    injector: str
    synthetic: str
    parameters: Annotated[tuple[Range, ...], Key("ranges")]
    settings: Annotated[SensitivitySettings, Key("")]
    outputs: tuple[OutputSensitivity, ...] = ()
    injections: int = 0
    seconds: Annotated[float, Key("clock.seconds")] = 0.0
    notes: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each output and parameter in order of rank, SI; ``pandas.DataFrame(rows)`` takes them."""
        rows = []
        for sensitivity in self.outputs:
            output = sensitivity.output
            for effect in sensitivity.parameters:
                row = {"output": output.name, "point": output.point, "unit": output.unit}
                rows.append(row | _flat(to_record(effect)))
        return rows

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; absent values are None."""
        return make_record("sensitivity", self)


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            flat |= {key: value["value"], f"{key}_low": value["low"], f"{key}_high": value["high"]}
        else:
            flat[{"name": "parameter", "low": "at_low", "high": "at_high"}.get(key, key)] = value
    return flat
