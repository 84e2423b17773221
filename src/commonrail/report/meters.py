"""Meters in reports: a sentence on each, from the record of a result."""

from __future__ import annotations

from commonrail.display.text import listed
from commonrail.kinds.records import Record
from commonrail.units import to_text

__all__ = ["meter_lines"]

_MARKS = {"F": "fitted", "M": "measured", "C": "from the ECU", "E": "estimate"}


def meter_lines(record: Record) -> list[str]:
    """One sentence for each meter through which the simulated curves and quantities are seen; often none."""
    lines = []
    for meter in record.get("meters", []):
        parts = [_quantity(quantity) for quantity in meter["quantities"]]
        if any(quantity["name"].endswith("cutoff") for quantity in meter["quantities"]):
            parts.append(f"low-pass {meter['law']} of order {meter['order']}")
        sets = [d["name"] for d in record["data"] if d.get("meter") == meter["name"]]
        of = f" ({listed(sets)})" if sets else ""
        lines.append(
            f"Simulated values are shown as the meter “{meter['name']}”{of} sees them: {listed(parts) or 'unchanged'}."
        )
    return lines


def _quantity(quantity: Record) -> str:
    value = to_text(quantity["value"], quantity["unit"], 4)
    return f"{quantity['name'].replace('_', ' ')} {value} [{_MARKS.get(quantity['mark'], quantity['mark'])}]"
