"""Text of a fuel file from fitted laws."""

from __future__ import annotations

import json as text_of

from commonrail.plugins.fuel.run import FittedFuel

_VAPOUR = """
[vapour_pressure] # not in the table; it must only be small compared with the return pressure
unit = "ln(Pa)"
mark = "E"
source = "taken from n-dodecane"
error = 1.0
ln_pressure = [6.598002, 2.179211, -0.3124296, 0.04114257, -0.005736842]
"""


def document(fit: FittedFuel, title: str, source: str) -> str:
    """Text of a fuel file; `source`: origin of the fitted data in words."""
    low, high = (value * 1e-6 for value in fit.pressure)
    lines = [
        "# Written by commonrail fuel. Polynomials ascend in (T - 353.15 K)/(40 K); pressures in MPa.",
        f"title = {text_of.dumps(title)}",
        f"source = {text_of.dumps(source)}",
        f"\n[range]\npressure_MPa = [{low!r}, {high!r}]\ntemperature_K = {list(fit.temperature)}",
    ]
    for law in fit.laws:
        lines.append(f"\n[{law.table}]")
        lines += ['kind = "integrated"'] if law.table == "density" else []
        lines += [f'unit = "{law.unit}"', 'mark = "F"', f"source = {text_of.dumps(source)}"]
        lines += [f"error = {law.error!r}", *(f"{name} = {values}" for name, values in law.polynomials.items())]
    vapour = "" if any(law.table == "vapour_pressure" for law in fit.laws) else _VAPOUR
    return "\n".join(lines) + "\n" + vapour
