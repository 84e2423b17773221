"""Result of a tolerance study: figures of every point, rows for a table, and the record that its folder keeps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.display import Shown
from commonrail.compiler.target import describe, package_versions
from commonrail.engine.operating_point import OperatingPoint
from commonrail.physics.injector import parameter_quantities
from commonrail.plugins.tolerance.parts import Shares, Spread
from commonrail.plugins.tolerance.study import Tolerances
from commonrail.plugins.tolerance.trim import Trimmed

SCHEMA = 1


class PointResult(NamedTuple):
    """Quantity as drawn [m³], spread, and shares of the variance (None where nothing scatters) at one point."""

    name: str
    point: OperatingPoint
    nominal: float
    spread: Spread
    shares: Shares | None


@dataclass(frozen=True, repr=False)
class ToleranceResult(Shown):
    """Result of a tolerance study.

    Attributes
    ----------
    tolerances : Tolerances
    points : tuple of PointResult
    trim : Trimmed or None
    status : str
        "complete", or "interrupted" with the parts that were simulated.
    confidence : float
        Probability of the intervals.
    parts : int
        Number of parts simulated.
    injections : int
        Single simulations that it took.
    seconds : float
    """

    presenter = "commonrail.plugins.tolerance.page:TOLERANCE"

    tolerances: Tolerances
    points: tuple[PointResult, ...]
    trim: Trimmed | None
    status: str
    confidence: float
    parts: int
    injections: int
    seconds: float

    @property
    def synthetic(self) -> str:
        """Assumed parts of injector and tolerances; empty if nothing is assumed."""
        texts = (self.tolerances.synthetic, self.tolerances.injector.synthetic)
        return " ".join(dict.fromkeys(text for text in texts if text))

    def rows(self) -> list[dict[str, Any]]:
        """One flat row for each operating point and dimension, SI; ``pandas.DataFrame(rows)`` takes them."""
        flat = []
        for found in self.record()["points"]:
            spread = found["spread"]
            head = {"point": found["name"], "nominal": found["nominal"], "mean": spread["mean"]}
            head |= {"deviation": spread["deviation"], "out": spread["out"]["value"]}
            for row in found["dimensions"]:
                share = row["share"] or {"value": None, "low": None, "high": None}
                ends = {"share": share["value"], "share_low": share["low"], "share_high": share["high"]}
                flat.append(
                    {**head, "dimension": row["name"], **ends, "swing": row["swing"], "if_halved": row["if_halved"]}
                )
        return flat

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI; what does not exist is None."""
        t = self.tolerances
        return {
            "schema": SCHEMA,
            "kind": "tolerance",
            "software": package_versions(),
            "target": describe().machine,
            "title": t.title,
            "synthetic": self.synthetic,
            "injector": {"name": t.injector.name, "title": t.injector.title, "variant": t.injector.variant.label},
            "status": self.status,
            "asked": t.parts,
            "parts": self.parts,
            "injections": self.injections,
            "seed": t.seed,
            "sampling": t.sampling.value,
            "time_step": t.time_step,
            "precision": t.precision.value,
            "confidence": self.confidence,
            "dimensions": [_dimension(t, j) for j in range(len(t.dimensions))],
            "correlations": [c._asdict() for c in t.correlations],
            "points": [self._point(p) for p in self.points],
            "trim": self._trim(),
            "clock": {"seconds": self.seconds},
        }

    def _point(self, found: PointResult) -> dict[str, Any]:
        rows = [_shared(found, j, name) for j, name in enumerate(self.tolerances.names)]
        if found.shares is not None:
            rows = [rows[int(j)] for j in np.argsort(-found.shares.value, kind="stable")]
        pulses = [{"start": p.start, "duration": p.duration} for p in found.point.pulses]
        return {
            "name": found.name,
            "rail_pressure": found.point.at_start(found.point.rail_pressure),
            "energisings": pulses,
            "nominal": found.nominal,
            "spread": found.spread.record(),
            "dimensions": rows,
            "rest": None if found.shares is None else found.shares.rest,
        }

    def _trim(self) -> dict[str, Any] | None:
        trim, given = self.trim, self.tolerances.trim
        if trim is None or given is None:
            return None
        return {
            "test_points": list(given.points),
            "parts": trim.parts,
            "unmeasured": trim.unmeasured,
            "resolution": given.resolution,
            "scatter": given.scatter,
            "slopes": list(trim.slopes),
            "points": [point.record() for point in trim.points],
        }


def _dimension(t: Tolerances, j: int) -> dict[str, Any]:
    dimension = t.dimensions[j]
    quantity = parameter_quantities()[dimension.name]
    return {
        "name": dimension.name,
        "unit": quantity.unit,
        "drawn": t.injector.values[dimension.name],
        "distribution": dimension.distribution.record(),
        "mark": dimension.source.mark,
        "source": dimension.source.text,
    }


def _shared(found: PointResult, j: int, name: str) -> dict[str, Any]:
    """Share of a dimension, and the standard deviation if its own were halved and all else stayed."""
    shares = found.shares
    if shares is None:
        return {"name": name, "share": None, "swing": None, "if_halved": None}
    share = {key: float(getattr(shares, key)[j]) for key in ("value", "low", "high")}
    return {"name": name, "share": share, "swing": float(shares.swing[j]), "if_halved": float(shares.halved[j])}
