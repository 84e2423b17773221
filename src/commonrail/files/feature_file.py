"""Features of traces as CSV and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from commonrail.display.text import FieldUnit, field_unit
from commonrail.files.atomic import write_csv
from commonrail.files.run_features import ComparedFeatures
from commonrail.signals.measures import FEATURES
from commonrail.signals.result import Features, unit_of
from commonrail.signals.shots import ShotStatistic

__all__ = ["compared_record", "features_record", "write_compared", "write_features"]


def write_features(path: Path, found: Mapping[str, Features]) -> None:
    """Write a row for each injection of each trace.

    Parameters
    ----------
    path : Path
    found : mapping of str to Features
        By the name of the trace; rates of one unit.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    (unit,) = {one.unit for one in found.values()}
    units = {name: field_unit(unit_of(name, unit)) for name in FEATURES}
    header = [
        "trace",
        "injection",
        "energising",
        *(f"{name} [{shown.name}]" for name, shown in units.items()),
        "status",
    ]

    def rows() -> Iterator[list[str]]:
        for trace, one in found.items():
            if not one.injections:
                yield [trace, "", "", *[""] * len(FEATURES), one.status.value]
            for i, injection in enumerate(one.injections, start=1):
                values = (_text(injection.values[name], shown) for name, shown in units.items())
                status = "; ".join(status.value for status in injection.statuses) or "ok"
                yield [trace, str(i), str(injection.energising or ""), *values, status]

    write_csv(path, [_note(name, one) for name, one in found.items()], header, rows())


def write_compared(path: Path, found: Sequence[ComparedFeatures]) -> None:
    """Write a row for each feature of each injection: measured, simulated, and their difference.

    Parameters
    ----------
    path : Path
    found : sequence of ComparedFeatures

    Raises
    ------
    OutputError
        If it cannot be written.
    """

    def rows() -> Iterator[list[str]]:
        for one in found:
            for i in range(1, len(one.measured.energisings) + 1):
                for name in FEATURES:
                    shown = field_unit(unit_of(name))
                    pair = one.measured.value(name, i), one.simulated.value(name, i)
                    texts = (_text(value, shown) for value in (*pair, pair[1] - pair[0]))
                    yield [one.name, str(i), name, shown.name, *texts]

    notes = [note for one in found for note in (_note(one.name, one.measured), *_synthetic(one))]
    write_csv(path, notes, ["data", "injection", "feature", "unit", "measured", "simulated", "difference"], rows())


def features_record(found: Mapping[str, Features], shots: Sequence[ShotStatistic]) -> dict[str, Any]:
    """Record of the features of a file [SI].

    Parameters
    ----------
    found : mapping of str to Features
        By the name of the trace.
    shots : sequence of ShotStatistic
        Over the traces; empty for one.
    """
    return {
        "schema": 1,
        "kind": "features",
        "traces": [{"name": name, **one.record()} for name, one in found.items()],
        **({"shots": [one.record() for one in shots]} if shots else {}),
    }


def compared_record(found: Sequence[ComparedFeatures]) -> dict[str, Any]:
    """Record of the features of a run [SI]."""
    return {
        "schema": 1,
        "kind": "features",
        "data": [
            {
                "name": one.name,
                "role": one.role,
                "synthetic": one.synthetic,
                "measured": one.measured.record(),
                "simulated": one.simulated.record(),
            }
            for one in found
        ],
    }


def _note(name: str, one: Features) -> str:
    shown, levels = field_unit(one.unit), one.levels
    threshold = f"{levels.threshold * shown.factor:.6g} {shown.name}"
    return f"{name}: threshold {threshold}, averaged over {levels.width * 1e6:.6g} us"


def _synthetic(one: ComparedFeatures) -> list[str]:
    return [f"{one.name}: synthetic, not measured: {one.synthetic}"] if one.synthetic else []


def _text(value: float, shown: FieldUnit) -> str:
    return f"{value * shown.factor:.9g}" if math.isfinite(value) else ""
