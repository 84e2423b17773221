"""Live chart of a calibration's report: it is simulated again when the reader drags a parameter's value."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import ALL_ENTRIES, lasting
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.data.records import JUDGED, Record
from commonrail.data.simulator import Simulator
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE
from commonrail.plugins.page.module import wasm_module
from commonrail.plugins.page.page import FIRST_POINT, bench_numbers, curve_numbers, embed_json, map_numbers, pack
from commonrail.plugins.page.subject import Subject, limits_of, read_subject, stable_sliders, variant_of
from commonrail.report.data.quantities import USUAL_LIMIT
from commonrail.report.figure import LOOKS, colour_of
from commonrail.report.fit.record import by_kind
from commonrail.report.html import render

LARGEST = 200_000  # characters of the encoded data; J of further data is not shown


@lasting(ALL_ENTRIES)
def live_chart(record: Record, folder: Path) -> Markup:
    """Scripts and numbers at the end of a report's page; empty if its main chart cannot simulate.

    The chart needs the compiler of the module, injection curves or maps of the injected quantity, and an injector that
    pages support.
    """
    main = next((d for _, records in by_kind(record["data"]) for d in records), None)
    if main is None:
        return Markup()
    try:
        subject = read_subject(str(folder), with_fan=False)
        if main["name"] not in {d.name for d in (*subject.data, *subject.maps)}:
            return Markup()
        module = wasm_module(variant_of(subject))
        numbers = _numbers(subject, main)
    except (ConfigurationError, InputError):
        return Markup()
    wasm = base64.b64encode(module).decode()
    return Markup(render("live.html", package=__package__, model=embed_json(numbers), wasm=wasm))


def _numbers(subject: Subject, main: Record) -> dict[str, Any]:
    """Mapping that the script reads."""
    injector = subject.injector
    simulator, nodes = Simulator(injector, (), subject.time_step), [injector.values[FUEL_TEMPERATURE]]
    sliders, _ = stable_sliders(subject, limits_of(subject, FIRST_POINT)["rail"][1])
    sets: list[RateData | QuantityData] = [*subject.data, *subject.maps]
    sets.sort(key=lambda d: d.name != main["name"])
    numbers: dict[str, list[dict[str, Any]]] = {"data": [], "maps": []}
    size = 0
    for d in sets:
        kind, set_numbers = (
            ("data", curve_numbers(d, simulator, nodes))
            if isinstance(d, RateData)
            else ("maps", map_numbers(d, simulator, nodes))
        )
        size += len(str(set_numbers))
        if d is sets[0] or size < LARGEST:
            numbers[kind].append(set_numbers)
    return {
        **bench_numbers(subject, sliders, subject.points[0]),
        "temperature": {"coefficients": [pack(fuel_coefficients(injector.fuel, nodes[0]))]},
        "present": {s.name: injector.values[s.name] for s in sliders},
        "bounds": {} if subject.space is None else {p.name: [p.lower, p.upper] for p in subject.space.parameters},
        **numbers,
        "main": main["name"],
        "limit": main["figures"].get(JUDGED, {}).get("limit_quantity", USUAL_LIMIT) if "figures" in main else 0.0,
        "colours": _colours(main),
        "moved": dict(zip(("colour", "width"), LOOKS["moved"][:2], strict=True)),
    }


def _colours(main: Record) -> Sequence[str]:
    """Colours of the rail pressures of a map, lowest first; empty for a curve."""
    count = len({row["rail_pressure"] for row in main.get("rows", ()) if not row.get("dead_time")})
    return [colour_of(JUDGED, i, count) for i in range(count)]
