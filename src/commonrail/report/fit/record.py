"""Records of result.json and comparison.json, read by kinds of data and labels of models."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from commonrail.base.text import command, count_noun, join_words, quantity
from commonrail.base.units import to_text
from commonrail.calibration.record import CalibrationRecord
from commonrail.data.records import LABELS, Record, Texts
from commonrail.data.registry import get_kinds
from commonrail.report.data.view import Shown, View, view_of
from commonrail.runs.copies import study_of_run
from commonrail.runs.folder import STUDY, final_text

# Meters in reports: a sentence on each, from the record of a result.

_MARKS = {"F": "fitted", "M": "measured", "C": "from the ECU", "E": "estimate"}


def meter_lines(record: CalibrationRecord) -> list[str]:
    """One sentence for each meter through which simulated curves and quantities pass; often empty."""
    lines = []
    for meter in record.meters:
        parts = [
            f"{q.name.replace('_', ' ')} {quantity(q.value, q.unit)} [{_MARKS.get(q.mark, q.mark)}]"
            for q in meter.quantities
        ]
        if any(q.name.endswith("cutoff") for q in meter.quantities):
            parts.append(f"low-pass {meter.law} of order {meter.order}")
        sets = [d["name"] for d in record.data if d.get("meter") == meter.name]
        of = f" ({join_words(sets)})" if sets else ""
        lines.append(
            f"Simulated values are shown as the meter “{meter.name}”{of} sees them: {join_words(parts) or 'unchanged'}."
        )
    return lines


DASHES = ("solid", "dash", "dot", "dashdot")


def shown_of(texts: Texts, compared: bool = False) -> dict[str, Shown]:
    """Looks of models: the fixed ones of a calibration, or a colour, marker and dash for each of a comparison.

    `texts`: texts of the labels, in order.
    """
    if set(texts) <= set(LABELS) and not compared:
        return {label: Shown(text, label) for label, text in texts.items()}
    return {label: Shown(text, DASHES[i % len(DASHES)], i) for i, (label, text) in enumerate(texts.items())}


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Names without their component where they stay distinct, by full name."""
    last = Counter(name.rpartition(".")[2] for name in names)
    return {name: short if last[short := name.rpartition(".")[2]] == 1 else name for name in names}


def by_kind(data: Sequence[Record]) -> Iterator[tuple[View, list[Record]]]:
    """Data sets of each kind that there is, with what reports show of it."""
    for kind in get_kinds(d["kind"] for d in data):
        yield view_of(kind.kind), [d for d in data if d["kind"] == kind.kind]


def of_role(data: Sequence[Record], role: str) -> list[Record]:
    """Data sets of one role: "fit" or "validation"."""
    return [d for d in data if d["role"] == role]


# Command lines that repeat a calibration or use its result.

MORE = "--generations 50"  # option of `resume` in the advice to continue a search


class Advice(NamedTuple):
    """Commands that a report advises: names of the run folder and of the study file to edit and calibrate again."""

    run: str
    study: str

    @classmethod
    def of(cls, run: str, file: str = STUDY) -> Advice:
        """Advice on the run in a folder; `file`: name of the copy of the study in this folder."""
        return cls(run, final_text(study_of_run(run, file), Path(run)))

    def calibrate(self, *, widen: bool = False, free: str = "") -> str:
        """Command that calibrates the study again, with wider bounds where this run met them, or a parameter free."""
        options = ("--free", free) if free else ("--widen", self.run) if widen else ()
        return command("calibrate", self.study, *options)

    def of_run(self, verb: str, options: str = "") -> str:
        """Command of a verb that takes the run folder."""
        return command(verb, self.run, *options.split())


_PRESSURES = {"cylinder_pressure": "Pa", "return_pressure": "Pa"}
_POINT = {"rail_pressure": "Pa", "energising_time": "s"} | _PRESSURES


def map_line(record: CalibrationRecord, run: str) -> tuple[str, str]:
    """Purpose and command line of the control unit's map, at the pressures and with the step of a calibration.

    Where the data have several cylinder or return pressures, the most frequent are taken, and the purpose says so.
    `run` is the name of the calibration's folder.
    """
    points = (point for data in record.data for point in view_of(data["kind"]).operating_points(data))
    counts = Counter(_options(point, _PRESSURES) for point in points)
    ranked = [pressures for pressures, _ in counts.most_common()]
    pressures, others = ranked[0], ranked[1:]
    purpose = "Compute the map of the calibrated injector for the control unit."
    if others:
        purpose += (
            " The cylinder and return pressures are those of most of the measured points; the data have "
            f"{count_noun(len(others), 'other pair')}: state those of the engine."
        )
    words = [command("map", run), pressures, _step(record), "--out map.dcm"]
    return purpose, " ".join(filter(None, words))


def _options(values: Record, units: Mapping[str, str]) -> str:
    """Options that state values."""
    return " ".join(
        f"--{key.replace('_', '-')} {to_text(values[key], unit).replace(' ', '')}"
        for key, unit in units.items()
        if key in values
    )


def _step(record: CalibrationRecord) -> str:
    return _options({"time_step": record.time_step}, {"time_step": "s"})


def rerun_lines(record: CalibrationRecord, run: str) -> list[tuple[str, str]]:
    """Purpose and command line, for the run folder of that name."""
    advice, simulate = Advice.of(run), command("simulate", f"{run}/calibrated.toml")
    first = record.data[0]
    point = _options(view_of(first["kind"]).operating_point(first), _POINT)
    return [
        ("Calibrate again", advice.calibrate()),
        ("Add generations", advice.of_run("resume", MORE)),
        ("Judge on other data", advice.of_run("compare", "--data OTHER-STUDY.toml")),
        (
            "Simulate the calibrated injector",
            " ".join(filter(None, [simulate, point, _step(record)])),
        ),
        ("Move the parameters and see the injection change", advice.of_run("report", "--page")),
        ("Make this report again", advice.of_run("report")),
    ]
