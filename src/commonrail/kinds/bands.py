"""Bands of data sets in sentences."""

from __future__ import annotations

from commonrail.display.text import fixed
from commonrail.kinds.records import Record, origin_of

__all__ = ["band_name", "band_sentence", "shaded"]


def band_name(data: Record) -> str:
    """Name of the bands of a data set that has them, such as "90 % band"."""
    return f"{100.0 * data['band']['level']:.0f} % band"


def band_sentence(data: Record) -> str:
    """Sentence on how many measured values of a data set lie in their bands."""
    band = data["band"]
    course = "half_widths" not in band
    median, alone = fixed(band["median_half_width_percent"], 1), band["covered_by_parameters_alone"]
    return (
        f"{band['covered']} of {band['values']} measured {'samples' if course else 'quantities'} of {data['name']} "
        f"({data['role']}) lie in the {band_name(data)}, whose median half width is {median} %"
        f"{' of the largest value' if course else ''} ({alone} in that of the parameters alone)."
    )


def shaded(data: Record) -> str:
    """Sentence of a figure's caption, empty without bands."""
    return (
        f"Shaded: {band_name(data)} of the {origin_of(data)} value, by {data['band']['estimator']}."
        if "band" in data
        else ""
    )
