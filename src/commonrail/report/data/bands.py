"""Bands of data sets in sentences."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from commonrail.base.chart import Band, Points
from commonrail.base.text import MISSING, number, to_fixed
from commonrail.data.records import JUDGED, MEASURED, MICROSECOND, MM3, Record, origin_word
from commonrail.report.data.view import scale_values

INDEPENDENT = (
    10  # samples of a course that count as independent [E]: opening, rise, plateau, fall and closing, and noise
)
UNLIKELY = 0.05  # probability below which a band is said to hold too few values
IN_SAMPLE = "; the fit has seen them, so that this says nothing of others"


def band_name(data: Record) -> str:
    """Name of the bands of a data set that has them, such as "90 % band"."""
    return f"{100.0 * data['band']['level']:.0f} % band"


def band_sentence(data: Record) -> str:
    """Sentence on how many values of a data set, measured or synthetic, lie in their bands."""
    band = data["band"]
    course = "half_widths" not in band
    median, alone = to_fixed(band["median_half_width_percent"], 1), band["covered_by_parameters_alone"]
    return (
        f"{band['covered']} of {band['values']} {origin_word(data)} {'samples' if course else 'quantities'} of "
        f"{data['name']} ({data['role']}) lie in the {band_name(data)}, whose median half width is {median} %"
        f"{' of the largest value' if course else ''} ({alone} in that of the parameters alone)"
        f"{IN_SAMPLE if data['role'] == 'fit' else ''}."
    )


def too_few_inside(data: Record) -> bool:
    """True if a band of its level holds as few of the measured values as these with a probability below 5 %.

    Samples of a course follow each other: they count as at most `INDEPENDENT` independent ones.
    """
    band = data["band"]
    values, inside = int(band["values"]), int(band["covered"])
    if "half_widths" not in band and values > INDEPENDENT:
        values, inside = INDEPENDENT, math.ceil(INDEPENDENT * inside / values)
    chances = [math.comb(values, k) * band["level"] ** k * (1.0 - band["level"]) ** (values - k) for k in range(values)]
    return sum(chances[: inside + 1]) < UNLIKELY and inside < values


def band_caption(data: Record) -> str:
    """Sentence of a figure's caption, empty without bands."""
    return (
        f"Shaded: {band_name(data)} of the {origin_word(data)} value, by {data['band']['estimator']}."
        if "band" in data
        else ""
    )


# Bands of a quantity map in tables and figures.

INSIDE, OUTSIDE = "✓", "✗"

Measure = Callable[[float, float], float]  # of a value and the measured quantity [m³]


def band_note(data: Record) -> str:
    """Sentence that explains the bands."""
    return f"{band_name(data)} by {data['band']['estimator']}; {INSIDE} measured value inside, {OUTSIDE} outside."


def band_cells(row: Record) -> tuple[str]:
    """Half width of a row's band [mm³], and on which side of its edge the measured quantity lies."""
    half, best = number(row["band"]), number(row.get(JUDGED))
    if half is None or best is None:
        return (MISSING,)
    return (f"{to_fixed(half, 2, MM3)} {INSIDE if abs(best - row[MEASURED]) <= half else OUTSIDE}",)


def error_band(rows: Sequence[Record], family: int, measure: Measure, about: str = "", ordered: int = 0) -> Band:
    """Area within the half widths, about zero or about a label's values.

    The rows are of one rail pressure, in the order of energising time. The middle is the values of the label
    `about`, or zero; `ordered` is the number of rail pressures, where their colours are to be in order.
    """
    low, high = (_edge(rows, sign, measure, about) for sign in (-1.0, 1.0))
    return Band(JUDGED, scale_values(rows, "energising_time", MICROSECOND), low, high, family, ordered)


def _edge(rows: Sequence[Record], sign: float, measure: Measure, about: str) -> Points:
    edge = []
    for row in rows:
        half, middle = number(row["band"]), number(row.get(about)) if about else 0.0
        value = None if half is None or middle is None else measure(middle + sign * half, float(row[MEASURED]))
        edge.append(value)
    return tuple(edge)
