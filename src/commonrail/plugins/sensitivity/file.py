"""Result of a sensitivity study: values, rows for a table, and the record that its folder keeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.display import Shown
from commonrail.calibration.parameter import Parameter
from commonrail.data.records import record_head
from commonrail.plugins.sensitivity.estimates import Effects, Estimate, Indices
from commonrail.plugins.sensitivity.study import Output, SensitivitySettings

RANGE = ("name", "unit", "reference", "lower", "upper", "scale", "mark", "source")  # of a parameter, in the record


class Failed(NamedTuple):
    """Simulations without an output: number, share, number by reason, and the end of a range where most of them are."""

    number: int
    share: float
    reasons: Mapping[str, int]
    where: str


class Tornado(NamedTuple):
    """Output at the references, and with each parameter at its lower and its upper bound; None where it failed.

    `missing` holds the reasons for what is None.
    """

    base: float | None
    low: tuple[float | None, ...]
    high: tuple[float | None, ...]
    missing: str = ""


class OutputSensitivity(NamedTuple):
    """Sensitivity of one output.

    Of a Sobol' study it has indices, of a Morris study effects; neither where too many simulations failed or the output
    is constant.
    """

    output: Output
    tornado: Tornado
    indices: Indices | None
    effects: Effects | None
    failed: Failed

    @property
    def ranking(self) -> Estimate | None:
        """Estimate by which parameters are ranked: total index, or mean size of the effects."""
        if self.indices is not None:
            return self.indices.total
        return None if self.effects is None else self.effects.magnitude


@dataclass(frozen=True, repr=False)
class Sensitivity(Shown):
    """Result of a sensitivity study.

    Attributes
    ----------
    title, injector : str
    synthetic : str
        What about the subject is not measured; empty if nothing.
    parameters : tuple of Parameter
        With their ranges.
    settings : SensitivitySettings
    outputs : tuple of OutputSensitivity
    injections : int
        Single simulations that it took.
    seconds : float
    notes : tuple of str
        Conditions that a reader must know.
    """

    presenter = "commonrail.plugins.sensitivity.page:SENSITIVITY"

    title: str
    injector: str
    synthetic: str
    parameters: tuple[Parameter, ...]
    settings: SensitivitySettings
    outputs: tuple[OutputSensitivity, ...] = ()
    injections: int = 0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each output and parameter in order of rank, SI; ``pandas.DataFrame(rows)`` takes them."""
        record = self.record()
        return [
            {"output": o["name"], "point": o["point"], "unit": o["unit"], **_flat(row)}
            for o in record["outputs"]
            for row in o["parameters"]
        ]

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; what does not exist is None."""
        settings = {name: getattr(value, "value", value) for name, value in vars(self.settings).items()}
        del settings["time_step"]  # that of the study counts where none is set
        return {
            **record_head("sensitivity", self.title, self.synthetic),
            "injector": self.injector,
            **settings,
            "notes": list(self.notes),
            "ranges": [{key: getattr(p, key) for key in RANGE} for p in self.parameters],
            "outputs": [self._output(o) for o in self.outputs],
            "injections": self.injections,
            "clock": {"seconds": self.seconds},
        }

    def _output(self, found: OutputSensitivity) -> dict[str, Any]:
        output, failed, tornado = found.output, found.failed, found.tornado
        rows = []
        for j, parameter in enumerate(self.parameters):
            low, high = (ends[j] if ends else None for ends in (tornado.low, tornado.high))
            swing = None if low is None or high is None else high - low
            rows.append({"name": parameter.name, "low": low, "high": high, "swing": swing, **_estimates(found, j)})
        moments = found.indices and {"mean": found.indices.mean, "variance": found.indices.variance}
        return {
            **output._asdict(),
            "base": tornado.base,
            "missing": tornado.missing,
            "failed": failed._asdict() | {"reasons": dict(failed.reasons)},
            "estimated": found.ranking is not None,
            "why_not": self._why_not(found),
            **(moments or {"mean": None, "variance": None}),
            "parameters": _ranked(found, rows),
        }

    def _why_not(self, found: OutputSensitivity) -> str:
        if found.ranking is not None:
            return ""
        if found.failed.share > self.settings.most_failed:
            return (
                f"{found.failed.share:.1%} of the simulations have no value, more than the "
                f"{self.settings.most_failed:.0%} up to which indices are given; narrow the ranges."
            )
        return "The output is the same in all simulations, or too few of them have a value."


def _ranked(found: OutputSensitivity, rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows in order of rank; by their swing where nothing was estimated."""
    if found.ranking is not None:
        return [rows[int(j)] for j in np.argsort(-found.ranking.value, kind="stable")]
    return sorted(rows, key=lambda row: -abs(row["swing"] or 0.0))


def _estimates(found: OutputSensitivity, j: int) -> dict[str, Any]:
    if found.indices is not None:
        both = {"first": _interval(found.indices.first, j), "total": _interval(found.indices.total, j)}
        return both | {"used": int(found.indices.used[j])}
    if found.effects is not None:
        mean, magnitude, spread, used = found.effects
        both = {"effect": _interval(mean, j), "magnitude": _interval(magnitude, j)}
        return both | {"spread": float(spread[j]), "used": int(used[j])}
    return {}


def _interval(estimate: Estimate, j: int) -> dict[str, float]:
    return {key: float(values[j]) for key, values in estimate._asdict().items()}


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            flat |= {key: value["value"], f"{key}_low": value["low"], f"{key}_high": value["high"]}
        else:
            flat[{"name": "parameter", "low": "at_low", "high": "at_high"}.get(key, key)] = value
    return flat
