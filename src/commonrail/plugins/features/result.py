"""Features of a trace: values, reasons, levels, and units for display."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from commonrail.base.record import to_record
from commonrail.engine.operating_point import Energising
from commonrail.plugins.features.injections import FeatureStatus
from commonrail.plugins.features.levels import Levels
from commonrail.plugins.features.rate_trace import RATE_UNITS
from commonrail.plugins.features.table import check_name, features_of_traces, find_feature

_DECIMALS = {"s": 1, "m3/s": 2, "kg/s": 2}


def choose_decimals(unit: str) -> int:
    """Decimals of a feature of an SI unit, in its `field_unit`."""
    return _DECIMALS.get(unit, 3)


@dataclass(frozen=True)
class Injection:
    """One injection of a trace.

    Attributes
    ----------
    values : mapping of str to float
        By feature [SI]; NaN if missing, with the reason in `statuses`.
    standard_errors : mapping of str to float
        By feature [SI], as far as the noise of the trace determines them.
    statuses : tuple of FeatureStatus
        Empty if no feature is missing.
    energising : int or None
        Number of its energising, from 1; None if unknown.
    """

    values: Mapping[str, float]
    standard_errors: Mapping[str, float]
    statuses: tuple[FeatureStatus, ...] = ()
    energising: int | None = None

    def __getitem__(self, name: str) -> float:
        """Value of a feature [SI]; `ConfigurationError` for an unknown name."""
        return self.values[check_name(name, self.values)]

    def record(self) -> dict[str, Any]:
        """JSON-able form [SI]; null for a missing number."""
        facts: dict[str, object] = {
            "energising": self.energising,
            "statuses": self.statuses,
            "messages": [status.sentence for status in self.statuses],
            "values": self.values,
            "standard_errors": self.standard_errors,
        }
        return to_record(facts)


@dataclass(frozen=True)
class Features:
    """Features of a trace.

    Attributes
    ----------
    injections : tuple of Injection
        In the order of time.
    status : FeatureStatus
        OK with injections, else the reason for their absence.
    quantity : float
        Sum over the whole trace [m³ or kg].
    noise : float
        Standard deviation of a sample [m³/s or kg/s].
    levels : Levels
        Applied threshold and averaging.
    unit : str
        Of rates, "m3/s" or "kg/s".
    energisings : tuple of Energising
        In order; empty if unknown.
    """

    injections: tuple[Injection, ...]
    status: FeatureStatus
    quantity: float
    noise: float
    levels: Levels
    unit: str
    energisings: tuple[Energising, ...]

    def of(self, injection: int) -> Injection | None:
        """Injection of an energising, from 1, or by order if energisings are unknown; None if absent."""
        if self.energisings:
            return next((candidate for candidate in self.injections if candidate.energising == injection), None)
        return self.injections[injection - 1] if 0 < injection <= len(self.injections) else None

    def value(self, name: str, injection: int = 1) -> float:
        """Feature of one injection [SI]; NaN if missing.

        Parameters
        ----------
        name : str
        injection : int
            As for `of`.
        """
        name, match = check_name(name, features_of_traces()), self.of(injection)
        return math.nan if match is None else match.values.get(name, math.nan)

    def reason(self, injection: int = 1) -> FeatureStatus:
        """Status that explains a missing feature of one injection, numbered as in `of`."""
        match = self.of(injection)
        if match is None:
            return FeatureStatus.NO_INJECTION if self.injections else self.status
        return match.statuses[0] if match.statuses else FeatureStatus.OK

    @property
    def silent(self) -> tuple[int, ...]:
        """Numbers of the energisings without an injection."""
        return tuple(i for i in range(1, len(self.energisings) + 1) if self.of(i) is None)

    def record(self) -> dict[str, Any]:
        """JSON-able form [SI]; null for a missing number."""
        facts: dict[str, object] = {
            "status": self.status,
            "message": self.status.sentence,
            "unit": self.unit,
            "quantity": self.quantity,
            "noise": self.noise,
            "threshold": self.levels.threshold,
            "averaging": self.levels.width,
            "energisings": self.energisings,
            "energisings_without_injection": self.silent,
            "injections": [injection.record() for injection in self.injections],
        }
        return to_record(facts)


def feature_unit(name: str, unit: str = "m3/s") -> str:
    """SI unit of a feature of a trace whose rate is in `unit`."""
    by_volume = find_feature(name).unit
    return {"m3/s": unit, "m3": RATE_UNITS[unit]}.get(by_volume, by_volume)
