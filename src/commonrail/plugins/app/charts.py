"""Charts of the pages: options of ECharts, which NiceGUI ships, from the answers of the preview."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

# Colours that differ in lightness too, on white and on black; the same as in reports.
MEASURED, START, BEST = "#8a94a0", "#0072b2", "#d55e00"
SCALE = ("#56b4e9", "#0072b2", "#009e73", "#e69f00", "#d55e00", "#cc79a7", "#8c6bb1", "#7f7f7f", "#b8860b", "#20808d")


def _axis(name: str, **more: Any) -> dict[str, Any]:
    return {
        "type": "value",
        "name": name,
        "nameLocation": "middle",
        "nameGap": 26,
        "splitLine": {"show": False},
        **more,
    }


def _frame(words: str, x: str, y: str, series: list[dict[str, Any]], **more: Any) -> dict[str, Any]:
    left = _axis(y, nameGap=38)
    left["splitLine"] = {"lineStyle": {"opacity": 0.25}}
    return {
        "animation": False,
        "aria": {"enabled": True, "label": {"description": words}},
        "textStyle": {"fontFamily": "system-ui, Liberation Sans, Arial, sans-serif"},
        "grid": {"left": 52, "right": 14, "top": 26, "bottom": 42},
        "tooltip": {"trigger": "axis", "confine": True},
        "xAxis": _axis(x),
        "yAxis": left,
        "series": series,
        **more,
    }


def curve(data: Mapping[str, Any], colour: str = START) -> dict[str, Any]:
    """Measured and simulated injection curve."""
    pairs = {key: list(map(list, zip(data["time"], data[key], strict=True))) for key in ("measured", "simulated")}
    top = max((abs(x) for x in data["measured"] if x is not None), default=1.0)
    seen = [t for t, x in zip(data["time"], data["measured"], strict=True) if x is not None and abs(x) > 0.08 * top]
    low, high = (min(seen) - 250.0, max(seen) + 350.0) if seen else (None, None)
    line = {"type": "line", "showSymbol": False}
    series = [
        {**line, "name": "measured", "data": pairs["measured"], "color": MEASURED, "lineStyle": {"width": 3}},
        {**line, "name": "simulated", "data": pairs["simulated"], "color": colour, "lineStyle": {"width": 1.8}},
    ]
    options = _frame(summary(data), "time, µs", "rate, mm³/ms", series, legend={"top": 0, "right": 8, "itemHeight": 8})
    options["xAxis"] |= {"min": low and round(low, -2), "max": high and round(high, -2)}
    return options


def errors(data: Mapping[str, Any]) -> dict[str, Any]:
    """Simulated minus measured quantity of a map over the energising time, a line for each rail pressure."""
    return _lines(data, lambda row: None if row[3] is None else row[3] - row[2], "error, mm³")


def quantities(data: Mapping[str, Any]) -> dict[str, Any]:
    """Quantity of a map over the energising time: measured points, simulated lines."""
    options = _lines(data, lambda row: row[3], "quantity, mm³")
    for i, rows in enumerate(_by_pressure(data).values()):
        points = {"type": "scatter", "data": [[r[1], r[2]] for r in rows], "symbolSize": 5, "color": SCALE[i % 10]}
        options["series"].append({**points, "name": options["series"][i]["name"], "tooltip": {"show": False}})
    return options


def _by_pressure(data: Mapping[str, Any]) -> dict[float, list[Any]]:
    groups: dict[float, list[Any]] = {}
    for row in sorted(data["rows"], key=lambda r: (r[0], r[1])):
        groups.setdefault(round(row[0], 1), []).append(row)
    return groups


def _lines(data: Mapping[str, Any], value: Any, words: str) -> dict[str, Any]:
    series = [
        {
            "type": "line",
            "name": f"{pressure:g} MPa",
            "color": SCALE[i % 10],
            "showSymbol": False,
            "lineStyle": {"width": 1.8, "type": ("solid", "dashed", "dotted")[i // 10 % 3]},
            "data": [[row[1], value(row)] for row in rows],
        }
        for i, (pressure, rows) in enumerate(_by_pressure(data).items())
    ]
    legend = {"type": "scroll", "top": 0, "itemHeight": 8, "itemWidth": 16, "itemGap": 6, "textStyle": {"fontSize": 11}}
    return _frame(summary(data), "energising time, µs", words, series, legend=legend)


def course(values: Sequence[float]) -> dict[str, Any]:
    """Objective over the steps of a search."""
    words = f"Objective J over {len(values)} steps" + (f", now {values[-1]:.4g}" if values else "")
    line = {"type": "line", "step": "end", "showSymbol": False, "color": BEST, "data": list(enumerate(values, start=1))}
    options = _frame(words, "step", "J", [line])
    options["yAxis"] |= {"scale": True, "nameGap": 46}
    options["grid"] |= {"left": 62}
    return options


def summary(data: Mapping[str, Any]) -> str:
    """Error of a data set in words, also for who cannot see its chart."""
    words = f"mean error {100.0 * data['error']:.1f} %"
    if "rms" in data:
        words += f", {data['rms']:.2f} mm³ rms"
    if data["failed"]:
        words += f", {data['failed']} points without a simulation"
    return words + ("" if data["role"] == "fit" else "; held out")
