"""Page of the catalogue's injectors: curves, figures, and the mark and source of every value."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from commonrail.base.chart import Figure, Panel
from commonrail.base.choices import Actuation, Drive
from commonrail.base.table import Table, table_from_columns
from commonrail.base.text import quantity, to_fixed
from commonrail.data.records import MICROSECOND, MM3
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.engine.solution import Solution
from commonrail.physics.injector import Injector
from commonrail.plugins.features.anatomy import end_of_motion
from commonrail.report.figure import figure_html
from commonrail.report.fit.tables import MARKS
from commonrail.report.html import render
from commonrail.report.simulation import course_figure

# Operating points of the figures: a main injection at the usual pressures of each kind of injector. The direct-acting
# injector is shown at the rail and cylinder pressures of the traces to which it was fitted.
SERVO = tuple(OperatingPoint(p, 700e-6, 5e6) for p in (40e6, 80e6, 120e6, 160e6))
DIRECT = tuple(OperatingPoint(p, 1e-3, 0.1e6, 0.1e6) for p in (10e6, 20e6, 30e6))


OVERVIEW = ("holes", "diameter, mm", "quantity, mm³", "values measured")  # heads of the overview


@dataclass(frozen=True)
class Exhibit:
    """One injector of the gallery.

    `name`: in the catalogue; `solutions`: by rail pressure, as in the legend; `notes`: on synthetic or assumed inputs.
    """

    name: str
    injector: Injector
    points: tuple[OperatingPoint, ...]
    solutions: dict[str, Solution]
    notes: tuple[str, ...]


def exhibit(name: str, injector: Injector) -> Exhibit:
    """Simulate an injector of the catalogue for the gallery.

    An injector that follows a measured voltage or current is driven by the peak and hold currents of its file instead.
    """
    notes = [injector.synthetic] if injector.synthetic else []
    shown, drive = injector, injector.variant.drive
    if drive.is_trace:
        shown = replace(injector, variant=injector.variant._replace(drive=Drive.REGULATED))
        notes.append(
            f"The injector follows a measured {drive.value}, which is not in the catalogue; the curves are for "
            f"an assumed current: {quantity(injector.values['drive.peak_current'], 'A', 3)} for "
            f"{quantity(injector.values['drive.peak_duration'], 's', 3)}, then "
            f"{quantity(injector.values['drive.hold_current'], 'A', 3)}."
        )
    points = DIRECT if injector.variant.actuation is Actuation.DIRECT else SERVO
    solutions = {quantity(p.initial_pressures()[0], "Pa", 3): simulate(shown, p) for p in points}
    return Exhibit(name, injector, points, solutions, tuple(notes))


def gallery_html(exhibits: Sequence[Exhibit], version: str) -> str:
    """Return the page of several injectors; `version`: of commonrail."""
    return render(
        "gallery.html",
        package=__package__,
        exhibits=[
            {
                "name": e.name,
                "title": e.injector.title,
                "wiring": e.injector.variant.label,
                "notes": e.notes,
                "heading": "Synthetic, not measured" if e.injector.synthetic else "Assumed, not measured",
                "commands": _commands(e),
                "origin": _origin(e.injector),
                "overview": _overview(e),
                "figure": figure,
                "drawing": figure_html(figure, f"curves-{e.name}"),
                "figures": _figures(e),
                "values": _values(e.injector),
            }
            for e in exhibits
            for figure in [_curves(e)]
        ],
        overview=OVERVIEW,
        version=version,
    )


def _commands(e: Exhibit) -> list[str]:
    """Command lines with the injector; none if it follows a trace, which needs data."""
    if e.injector.variant.drive.is_trace:
        return []
    rail, time = quantity(e.points[-1].initial_pressures()[0], "Pa"), quantity(e.points[-1].pulses[0][1], "s")
    point = f"--rail-pressure {rail} --energising-time {time}".replace(" MPa", "MPa").replace(" us", "us")
    return [f"commonrail simulate {e.name} {point}", f"commonrail page {e.name} --out {e.name}.html"]


def _curves(e: Exhibit) -> Figure:
    """Rates and lifts at all points."""
    figure = course_figure(e.solutions)
    end = max(end_of_motion(s, p.pulses) for s, p in zip(e.solutions.values(), e.points, strict=True))
    rate, lifts = (_crop_panel(panel, len(e.points), end * MICROSECOND) for panel in figure.panels[:2])
    lasting, back = quantity(e.points[0].pulses[0][1], "s", 3), quantity(e.points[0].initial_pressures()[1], "Pa", 3)
    return replace(
        figure,
        title=f"Rate and lifts, energised for {lasting}",
        caption=f"Simulated, not measured; time step 1 µs, cylinder pressure {back}. "
        "Lifts: needle solid, valve dashed.",
        panels=(rate, replace(lifts, has_legend=False)),
    )


def _crop_panel(panel: Panel, count: int, end: float) -> Panel:
    """Label the series of a panel by rail pressure, and crop them at a time [µs]."""
    series = []
    for s in panel.series:
        n = sum(x is not None and x <= end for x in s.x)
        series.append(replace(s, label=s.label.split(", ")[-1], ordered=count, x=s.x[:n], y=s.y[:n]))
    return replace(panel, series=tuple(series))


def _figures(e: Exhibit) -> Table:
    """Quantities, delays and peaks by rail pressure."""
    end = sum(e.points[0].pulses[0])
    return table_from_columns(
        "Simulated figures",
        e.solutions.items(),
        (
            ("rail pressure", lambda row: row[0]),
            ("quantity, mm³", lambda row: to_fixed(row[1].injected_volume, 2, MM3)),
            ("opening delay, µs", lambda row: to_fixed(row[1].opening, 0, MICROSECOND)),
            ("closing delay, µs", lambda row: to_fixed(row[1].closing - end, 0, MICROSECOND)),
            ("peak rate, mm³/ms", lambda row: to_fixed(max(row[1].rate_mm3_per_ms), 2)),
            ("largest lift, µm", lambda row: to_fixed(max(row[1].channels["needle_lift"]) * 1e6, 0)),
            ("outcome", lambda row: row[1].sentence),
        ),
        note="Quantities by volume at the density at cylinder pressure.",
    )


def _overview(e: Exhibit) -> tuple[str, ...]:
    """Cells of the injector's row in the overview."""
    values, counts = e.injector.values, Counter(source.mark for source in e.injector.sources.values())
    last, solution = e.points[-1], list(e.solutions.values())[-1]
    place = f"{quantity(last.initial_pressures()[0], 'Pa', 3)}, {quantity(last.pulses[0].duration, 's', 3)}"
    return (
        to_fixed(values["nozzle.holes"], 0),
        to_fixed(values["nozzle.hole_diameter"], 3, 1e3),
        f"{to_fixed(solution.injected_volume, 1, MM3)} at {place}",
        f"{counts['M']} of {sum(counts.values())}",
    )


def _origin(injector: Injector) -> str:
    """Say how many values are measured, fitted or estimated."""
    counts = Counter(source.mark for source in injector.sources.values())
    origins = [f"{words}: {counts[mark]}" for mark, words in MARKS.items() if counts[mark]]
    return f"Origin of its {sum(counts.values())} values: {', '.join(origins)}."


def _values(injector: Injector) -> Table:
    """Every value of the file with its mark and source."""
    rows = [(name, q, injector.sources[name]) for name, q in injector.quantities.items() if name in injector.sources]
    return table_from_columns(
        "Values",
        rows,
        (
            ("parameter", lambda row: row[0]),
            ("meaning", lambda row: row[1].meaning),
            ("mark", lambda row: MARKS.get(row[2].mark, row[2].mark)),
            ("source", lambda row: row[2].text),
            ("value", lambda row: quantity(injector.values[row[0]], row[1].unit)),
        ),
        texts=4,
    )
