"""Page of a tolerance study: capability, histograms, shares of the variance, trim, dimensions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from commonrail.base.chart import Figure, Panel, Series
from commonrail.base.record import from_record
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, percent, quantity, significant, to_fixed
from commonrail.data.records import MICROSECOND, MM3, Record
from commonrail.plugins.tolerance.file import DimensionShare, DistributionFacts, PointResult, ToleranceResult
from commonrail.plugins.tolerance.statistics import Spread
from commonrail.plugins.tolerance.study import Sampling
from commonrail.plugins.tolerance.trim import Trimmed
from commonrail.report.analysis import MARKS, SHOWN, analysis_html, bar_height, interval_bars
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.parameter_names import describe_parameters
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind

CAPABLE, FITS = 1.33, 1.0  # Cpk asked for in series production: four and three standard deviations to the limit
ENDS = ("0.00135", "0.99865")  # shares of the parts that enclose 99.73 %
SMALL = 1e-3  # shares of parts below this are printed in parts per million


def tolerance_html(record: Record, folder: Path = Path("DIR")) -> str:
    """Page of a tolerance study; `folder` is the name of its folder in the command lines."""
    result, sections = from_record(ToleranceResult, record), []
    for k, point in enumerate(result.points):
        figures = [(f, figure_html(f, f"figure-{k}-{i}", height)) for i, (f, height) in enumerate(_figures(point))]
        lines = [f"{number:,} parts failed: {text}" for text, number in point.spread.reasons.items()]
        sections.append((point.name, lines, figures, _share_table(point)))
    first = sections[0][2].pop(0) if sections and sections[0][2] else None
    return analysis_html(
        "tolerance.html",
        __package__,
        record,
        folder,
        _facts(result),
        kind="Tolerance",
        lines=[*tolerance_lines(result), *tolerance_notes(result)],
        tiles=[_tile(point) for point in result.points],
        first=first and (replace(first[0], title=f"{first[0].title}: {result.points[0].name}"), first[1]),
        capability=_capability_table(result),
        sections=sections,
        trim=result.trim and _trim_table(result.trim),
        trim_lines=_trim_lines(result.trim) if result.trim else [],
        dimensions=_dimension_table(result),
    )


RESULT = ResultKind("tolerance.json", "tolerance", "tolerance", tolerance_html)


def tolerance_lines(result: ToleranceResult) -> list[str]:
    """Sentences: worst capability, dimensions with the largest shares, failed simulations."""
    worst = min(result.points, key=lambda p: (p.spread.cpk is None, p.spread.cpk or -(p.spread.deviation or 0.0)))
    text = f"{result.parts:,} parts: standard deviation {_volume(worst.spread.deviation, 3)} mm³ at {worst.name}"
    if worst.spread.cpk is not None:
        text += f", Cpk {to_fixed(worst.spread.cpk, 2)}, {_out(worst.spread)} out of limits"
    lines = [f"{text}{', the worst point' if len(result.points) > 1 else ''}."]
    leading = [(point, point.dimensions[0]) for point in result.points]
    texts = describe_parameters(d.name for d in result.dimensions)
    shares = [f"{p.name}, {texts[d.name]} {percent(d.share.value, 0)} %" for p, d in leading if d.share is not None]
    if shares:
        lines.append(f"Largest shares of the variance: {'; '.join(shares)}.")
    failed = sum(point.spread.failed for point in result.points)
    if failed:
        lines.append(f"{failed:,} simulations failed; such parts count as out of limits.")
    return lines


def tolerance_notes(result: ToleranceResult) -> list[str]:
    """Sentences on the study, and on the gain of a halved spread."""
    lines = [
        f"{result.injector.title}: {len(result.dimensions)} dimensions scatter within their "
        f"tolerances, {len(result.points)} operating points, {result.injections:,} simulations."
    ]
    texts = describe_parameters(d.name for d in result.dimensions)
    for point in result.points:
        best = point.dimensions[0]
        if best.share is not None:
            lines.append(
                f"{point.name}: standard deviation {quantity(point.spread.deviation, 'm3', 3)}; with half of the "
                f"spread of {texts[best.name]} {quantity(best.if_halved, 'm3', 3)}."
            )
    return lines


def _tile(point: PointResult) -> Tile:
    """Capability at an operating point, or the scatter if limits are absent."""
    spread, cpk = point.spread, point.spread.cpk
    scatter = f"standard deviation {_volume(spread.deviation, 3)} mm³"
    if cpk is None:
        return Tile(point.name, f"{_volume(spread.deviation, 3)} mm³", "standard deviation; limits are not stated")
    level = GOOD if cpk >= CAPABLE else CARE if cpk >= FITS else BAD
    return Tile(point.name, f"Cpk {to_fixed(cpk, 2)}", f"{_out(spread)} out of limits; {scatter}", level)


def tolerance_tables(result: ToleranceResult) -> list[Table]:
    """Tables of the terminal: capability, shares of each point, trim."""
    tables = [_capability_table(result), *map(_share_table, result.points)]
    return [*tables, _trim_table(result.trim)] if result.trim else tables


def tolerance_figures(result: ToleranceResult) -> list[Figure]:
    """Figures of all operating points, named by them."""
    return [
        replace(figure, title=f"{figure.title}: {point.name}")
        for point in result.points
        for figure, _ in _figures(point)
    ]


def _out(spread: Spread) -> str:
    if spread.lower is None and spread.upper is None:
        return MISSING
    if spread.out.value < SMALL:
        value, low, high = (significant(1e6 * share, 3) for share in spread.out)
        return f"{value} ppm ({low} to {high})"
    value, low, high = (percent(share, 2) for share in spread.out)
    return f"{value} % ({low} to {high})"


def _volume(value: float | None, digits: int = 4) -> str:
    return significant(value, digits, MM3)


def _capability_table(result: ToleranceResult) -> Table:
    columns: list[Column] = [
        ("operating point", lambda p: p.name),
        ("as drawn, mm³", lambda p: _volume(p.nominal)),
        ("mean, mm³", lambda p: _volume(p.spread.mean)),
        ("st. dev., mm³", lambda p: _volume(p.spread.deviation, 3)),
        ("99.73 % of the parts, mm³", lambda p: " to ".join(_volume(p.spread.quantiles[end]) for end in ENDS)),
        ("limits, mm³", lambda p: f"{_volume(p.spread.lower)} to {_volume(p.spread.upper)}"),
        ("out of limits", lambda p: _out(p.spread)),
        ("failed", lambda p: f"{p.spread.failed:,}"),
        ("Cp", lambda p: to_fixed(p.spread.cp, 2)),
        ("Cpk", lambda p: to_fixed(p.spread.cpk, 2)),
    ]
    sure = percent(result.confidence, 0)
    note = (
        f"Out of limits: counted, failed parts included, with a {sure} % interval (Clopper and Pearson). Cp and Cpk "
        "use the standard deviation and presume a normal distribution."
    )
    return table_from_columns("Capability", result.points, columns, note, inputs=("as drawn, mm³", "limits, mm³"))


def _share_table(point: PointResult) -> Table:
    columns: list[Column] = [
        ("dimension", lambda d: d.name),
        ("share of the variance, %", _share),
        ("from 2.5 % to 97.5 % of the parts, mm³", lambda d: significant(d.swing, 3, MM3)),
        ("st. dev. with half the spread, mm³", lambda d: _volume(d.if_halved, 3)),
    ]
    rest = "" if point.rest is None else f"Rest: {percent(max(point.rest, 0.0))} % from interactions and steps. "
    more = len(point.dimensions) - SHOWN
    note = f"{rest}{f'{more} more are in tolerance.csv.' if more > 0 else ''}".strip()
    return table_from_columns(f"Tolerances to tighten: {point.name}", point.dimensions[:SHOWN], columns, note)


def _share(row: DimensionShare) -> str:
    if row.share is None:
        return MISSING
    value, low, high = map(percent, row.share)
    return f"{value} ({low} to {high})".replace("-", "−")


def _figures(point: PointResult) -> list[tuple[Figure, int]]:
    figures = [(_histogram(point), 260)]
    rows = [row for row in point.dimensions if row.share is not None][:SHOWN]
    if rows:
        bars = (interval_bars("", "start", [row.share for row in rows], 100.0),)
        panel = Panel("", (), bars=bars, rows=tuple(row.name for row in rows))
        figure = Figure(
            "Share of the variance", "Covariance of each dimension's term in a cubic fit.", "share, %", (panel,)
        )
        figures.append((figure, bar_height(len(rows)) - 30))
    return figures


def _histogram(point: PointResult) -> Figure:
    """Histogram as a stepped line, with the limits."""
    spread = point.spread
    shares = [100.0 * count / spread.parts for count in spread.histogram.counts]
    x = tuple(MM3 * edge for edge in spread.histogram.edges for _ in (0, 1))
    y = (0.0, *(share for share in shares for _ in (0, 1)), 0.0)
    series = [Series("parts", "solid", x, y, family=0)]
    top = max(shares)
    for name, at in (("lower", spread.lower), ("upper", spread.upper), ("drawn", point.nominal)):
        if at is not None:
            look = "level" if name == "drawn" else "best"
            label = "as drawn" if name == "drawn" else "limits" if name == "lower" or spread.lower is None else ""
            series.append(Series(label, look, (MM3 * at,) * 2, (0.0, top)))
    ends = [v for s in series for v in s.x if v is not None]
    aside = 0.03 * (max(ends) - min(ends))  # so that no limit lies on the frame
    series.append(Series("", "level", (min(ends) - aside, max(ends) + aside), (None, None)))
    return Figure(
        "Quantity of the parts", "", "injected quantity, mm³", (Panel("share of the parts, %", tuple(series)),)
    )


def _trim_table(trim: Trimmed) -> Table:
    columns: list[Column] = [
        ("operating point", lambda p: p.name),
        ("st. dev. before, mm³", lambda p: _volume(p.before.deviation, 3)),
        ("after, mm³", lambda p: _volume(p.after.deviation, 3)),
        ("after, % of before", lambda p: to_fixed(100.0 * p.after.deviation / p.before.deviation, 0)),
        ("out of limits before", lambda p: _out(p.before)),
        ("out of limits after", lambda p: _out(p.after)),
        ("st. dev. of the correction, µs", lambda p: to_fixed(p.correction.deviation, 1, MICROSECOND)),
    ]
    return table_from_columns("Trim", trim.points, columns, "Standard deviations over the parts.")


def _trim_lines(trim: Trimmed) -> list[str]:
    test = " and ".join(trim.test_points)
    law = "the same at all points" if len(trim.test_points) == 1 else "linear in the energising time"
    scatter = quantity(trim.scatter, "m3", 3)
    lines = [
        f"{trim.parts:,} parts were measured at {test} with a scatter of {scatter}. Energising times were corrected "
        f"by the nominal slope, {law}, in steps of {quantity(trim.resolution, 's', 3)}. Each part was simulated again."
    ]
    if trim.unmeasured:
        lines.append(f"{trim.unmeasured:,} parts could not be measured and are omitted.")
    limited = sum(point.limited for point in trim.points)
    return [*lines, *([f"{limited:,} corrections were limited to half of the energising time."] if limited else [])]


def _dimension_table(result: ToleranceResult) -> Table:
    columns: list[Column] = [
        ("dimension", lambda d: d.name),
        ("as drawn", lambda d: quantity(d.drawn, d.unit)),
        ("distribution", lambda d: _distribution(d.distribution, d.unit)),
        ("mark", lambda d: d.mark),
        ("source", lambda d: d.source),
    ]
    pairs = [f"{c.first} and {c.second}: {c.value:g}" for c in result.correlations]
    note = f"Correlations of the normal scores: {'; '.join(pairs)}. " if pairs else "All dimensions are independent. "
    return table_from_columns("Dimensions", result.dimensions, columns, note + MARKS)


def _distribution(law: DistributionFacts, unit: str) -> str:
    between = f"{quantity(law.lower, unit, 5)} to {quantity(law.upper, unit, 5)}"
    if law.kind == "normal":
        cut = "" if law.lower is None and law.upper is None else f", cut: {between}"
        return f"normal, {quantity(law.mean, unit, 5)}, standard deviation {quantity(law.sigma, unit, 3)}{cut}"
    return f"{law.kind}, {between}"


_SAMPLING = {
    Sampling.QUASI_RANDOM: "quasi-random (scrambled Sobol' sequence)",
    Sampling.RANDOM: "independent random numbers",
}


def _facts(result: ToleranceResult) -> list[tuple[str, str]]:
    return [
        ("Injector", f"{result.injector.name} ({result.injector.variant})"),
        ("Parts", f"{result.parts:,}, {_SAMPLING[result.sampling]}"),
        ("Seed", str(result.seed)),
        ("Time step", f"{significant(result.time_step, 4, MICROSECOND)} µs, {result.precision.value}"),
    ]


TOLERANCE = Presenter(
    lambda t: [t.title, *tolerance_lines(t), *tolerance_notes(t)], tolerance_tables, tolerance_figures
)
