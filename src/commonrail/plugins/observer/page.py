"""Report of an observer: quantities shot by shot, a map of the drift, and the assumptions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import BOTH, MARKERS, Band, Chart, Figure, HeatMap, Panel, Series, points
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, percent, quantity, significant, to_fixed, to_signed
from commonrail.data.records import MICROSECOND, MM3, MPA, Record
from commonrail.engine.operating_point import RAIL_PRESSURES
from commonrail.plugins.observer.kalman import TRUSTED
from commonrail.report.analysis import SHOWN, analysis_html
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.presenter import Presenter
from commonrail.report.result_kind import ResultKind

KEYS = ("title", "states", "shots", "disturbance", "sensor", "injections", "clock", "log", "rail_volume")
MOST_COLUMNS = 16  # of the map of drift, wide enough for "−10.3"; some shots are left out
MOVED, OFTEN = 0.3, 0.1  # a warning needs this change of the quantity by the pressure, in this share; chosen
FAR = 4.0  # standard deviations before the first shot beyond which a state is doubted; chosen
LEARNT = 0.8  # share of its first standard deviation below which a state counts as estimated from the pressure; chosen
CONSISTENT = (0.5, 2.0)  # medians of the consistency for which the stated deviations can be trusted; chosen
# Coverage of the stated deviations on simulated injectors: studies/observer_trial.py.
HELD = (
    "In a trial with a rail sensor on simulated injectors, whose parameters scatter as the first deviations of the "
    "states, 95 % intervals held 97 % of the quantities."
)
FURTHER_WORDS = {"current": ("the coil's current", "--current"), "return": ("the return flow", "--return-flow")}
SHOWN_UNITS = {"1": (100.0, "%"), "Pa": (MPA, "MPa"), "s": (MICROSECOND, "µs")}  # of states in figures
TWO = 1.96  # standard deviations of a 95 % interval


def observer_html(record: Record, folder: Path = Path("DIR")) -> str:
    """Report of an observer; `folder` is its name in the command lines shown."""
    charts = observer_figures(record)
    heights = [420, 380, 160 * len(_learnt(record))] if len(charts) > 2 else []
    if _trains(record):
        heights.append(380)
    drawn = [(c, figure_html(c, f"figure-{i}", h)) for i, (c, h) in enumerate(zip(charts, heights, strict=True))]
    if _trains(record):  # the requested result comes first
        drawn = [drawn[-1], *drawn[:-1]]
    return analysis_html(
        "observer.html",
        __package__,
        record,
        folder,
        _facts(record),
        kind="Observer",
        lines=[*observer_lines(record), *observer_notes(record)],
        warnings=warning_lines(record),
        alarms=alarm_lines(record),
        tiles=_tiles(record),
        first=drawn[0] if drawn else None,
        figures=drawn[1:],
        tables=observer_tables(record),
    )


RESULT = ResultKind("observer.json", "observer", "observe", observer_html, KEYS)


def observer_lines(record: Record) -> list[str]:
    """Sentences: accuracy and change of the quantities, and shots and injections that are exceptions."""
    rows, further = _injections(record), _further_sensor_words(record)
    observed = [row for row in rows if row["quantity"] is not None]
    if observed and not any((row["quantity_open_loop"] or 0.0) > 0.0 for row in observed):
        return [
            f"By the model alone the {count_noun(len(rows), 'energising')} of the log do not inject, and "
            "the pressure moves no quantity; check energising times, command and pressure."
        ]
    lines = [f"{count_noun(len(record['shots']), 'shot')} with {count_noun(len(rows), 'injection')}"]
    if observed:
        shift = 100.0 * np.nanmedian(_shift_by_pressure(observed))
        lines[0] += (
            f"; median standard deviation of a quantity {_deviation(observed)}; the pressure moved the model's "
            f"quantities by {to_fixed(shift, 1)} % (median)"
        )
    lines[0] += "."
    if strange := _strange(record):
        lines.append(
            f"{count_noun(strange, 'shot')} changed no state, since the pressure{further} contradicts model and "
            "disturbance (consistency above 3)."
        )
    if closed := sum(row["quantity_deviation"] is None for row in observed):
        lines.append(
            f"{count_noun(closed, 'injection')} did not open in the model with its states and has no standard "
            "deviation."
        )
    return lines


def observer_notes(record: Record) -> list[str]:
    """Sentences on the method and its assumptions."""
    lines = [
        f"Quantity, opening and closing follow from the pressure at the {_place(record)}"
        f"{_further_sensor_words(record)} and the command, by the model of {record['injector']['title']}.",
        f"Rail volume {_volume(record)}.",
    ]
    if record.get("horizon", 1) > 1 and len(record["shots"]) > 1:
        lines.append(
            f"Estimates use a sliding window of {record['horizon']} shots, in which later shots correct earlier ones. "
            "The last shot and the alarms come from the filter."
        )
    if _strange(record):
        lines.append(
            "A shot contradicts the model for example if another injector injects at once; its figures follow from "
            "the states."
        )
    if any(row["quantity"] is not None and row["quantity_deviation"] is None for row in _injections(record)):
        lines.append("The slopes of the model do not show where a closed injector begins to open.")
    return [*lines, HELD]


def _strange(record: Record) -> int:
    return sum((shot["consistency"] or 0.0) > TRUSTED for shot in record["shots"])


def _shift_by_pressure(rows: list[Record]) -> Floats:
    """Relative change (injections,) of each quantity by the pressure, against the model alone."""
    before, after = (np.array([row[key] for row in rows], float) for key in ("quantity_open_loop", "quantity"))
    return np.asarray(np.abs(after / np.where(before > 0.0, before, np.nan) - 1.0))


def _volume(record: Record) -> str:
    source = record["log"].get("volume_source", "")
    return f"{significant(record['rail_volume'] * 1e6, 4)} cm³" + (f" ({source})" if source else "")


def warning_lines(record: Record) -> list[str]:
    """Reasons for doubting the figures."""
    shots, strange = record["shots"], _strange(record)
    rest, (low, high) = float(np.median([shot["rail_pressure"] for shot in shots])), RAIL_PRESSURES.likely
    moved = _shift_by_pressure([row for row in _injections(record) if row["quantity"] is not None])
    conditions = {
        f"{quantity(low, 'Pa', 3)} to {quantity(high, 'Pa', 3)} is usual before a shot.": not low <= rest <= high,
        f"{strange} of {len(shots)} shots contradict the model: use no quantity.": 2 * strange > len(shots),
        f"More than 10 % of the quantities differ from the model by over {100.0 * MOVED:g} %.": bool(
            np.sum(moved > MOVED) > OFTEN * len(moved)
        ),
    }
    lines = [line for line, holds in conditions.items() if holds]
    last = next((shot["drift"] for shot in reversed(shots) if shot["drift"] is not None), ())
    for value, state in zip(last, record["states"], strict=False):
        if (far := abs(value) / state["deviation"]) > FAR:
            label = f"{state['name']} {_with_unit(value, state['unit'], True)}"
            lines.append(
                f"{label[0].upper()}{label[1:]} is {significant(far, 2)} standard deviations from its start value."
            )
    if lines:
        more = "".join(
            f"column and unit of {words} ({option}), " for words, option in _find_used_sensors(record).values()
        )
        lines.append(
            f"Check rail.volume ({_volume(record).partition(' (')[0]}), the pressure's unit (--pressure-unit; "
            f"{quantity(rest, 'Pa', 3)} before the shots, median), {more}and whether the command is this injector's."
        )
    for name, (words, option) in FURTHER_WORDS.items():
        counts = [shot["further"][name] for shot in record["shots"] if name in shot.get("further", ())]
        if out := counts.count(False):
            lines.append(
                f"{words[0].upper()}{words[1:]} was left out of {out} of {count_noun(len(counts), 'shot')}, since it "
                f"contradicts the pressure and the model; check its column, unit and zero ({option})."
            )
    return lines


def _place(record: Record) -> str:
    return "rail" if record["sensor"] == "rail" else "injector's end of the line"


def _further_sensor_words(record: Record) -> str:
    return "".join(f", {words}" for words, _ in _find_used_sensors(record).values())


def _find_used_sensors(record: Record) -> dict[str, tuple[str, str]]:
    """Words and option of each further sensor that counts in a shot."""
    used = {name for shot in record["shots"] for name, counts in shot.get("further", {}).items() if counts}
    return {name: words for name, words in FURTHER_WORDS.items() if name in used}


def _deviation(rows: list[Record]) -> str:
    pairs = [(row["quantity_deviation"], row["quantity"]) for row in rows if row["quantity_deviation"] is not None]
    if not pairs:
        return MISSING
    deviations, quantities = np.array(pairs).T
    shares = deviations / np.maximum(quantities, 1e-12)
    return f"{significant(np.median(deviations), 2, MM3)} mm³ ({percent(np.median(shares))} %)"


def _alarms(record: Record) -> list[tuple[int, Record]]:
    """All alarms with the numbers of their shots."""
    return [(k, shot["alarm"]) for k, shot in enumerate(record["shots"], 1) if shot["alarm"]]


def alarm_lines(record: Record) -> list[str]:
    """Sentence on each alarm."""
    units = {state["name"]: state["unit"] for state in record["states"]}
    return [
        f"{alarm['state']}: {_with_unit(alarm['size'], units[alarm['state']], True)} ± "
        f"{_with_unit(alarm['deviation'], units[alarm['state']])} from shot {k - alarm['ago']} on, seen at shot {k}."
        for k, alarm in _alarms(record)
    ]


def _with_unit(value: float | None, unit: str, with_sign: bool = False) -> str:
    """Value of a state with its unit; a relative one in percent."""
    if value is None:
        return MISSING
    if unit == "1":
        return f"{to_signed(100.0 * value, 1) if with_sign else significant(100.0 * value, 2)} %"
    text = quantity(value, unit, 2)
    return f"+{text}" if with_sign and value > 0.0 else text


def _tiles(record: Record) -> list[Tile]:
    rows = [row for row in _injections(record) if row["quantity"] is not None]
    names = list(dict.fromkeys(alarm["state"] for _, alarm in _alarms(record)))
    tested = len(record["shots"]) > record["learning"]
    words = ", ".join(names) or ("no state has changed" if tested else "too few shots for a test")
    tiles = [Tile("Drift", count_noun(len(names), "alarm"), words, BAD if names else GOOD if tested else "")]
    if warnings := warning_lines(record):
        tiles[0] = tiles[0]._replace(level=BAD if names else "")
        tiles.insert(0, Tile("Check", "warning", f"{warnings[0].partition('. ')[0]}", CARE))
    if not rows:
        return tiles
    tiles.append(Tile("Quantity", _deviation(rows).partition(" (")[0], "median standard deviation"))
    same = tiles[-1].words
    for key in ("opening", "closing"):
        deviations = [row[f"{key}_deviation"] for row in rows if row[key] is not None]
        if deviations:
            tiles.append(Tile(key.title(), f"{to_fixed(np.median(deviations), 1, MICROSECOND)} µs", same))
    middle = float(np.median([s["consistency"] for s in record["shots"] if s["consistency"] is not None]))
    level = "" if warnings else GOOD if CONSISTENT[0] < middle < CONSISTENT[1] else CARE
    words = "squared innovation over its expectation; 1 if model and noise are as assumed"
    return [*tiles, Tile("Consistency", significant(middle, 2), words, level)]


def _injections(record: Record) -> list[Record]:
    return [injection for shot in record["shots"] for injection in shot["injections"]]


def observer_figures(record: Record) -> list[Chart]:
    """Quantities, map of the drift, and the states estimated from the pressure."""
    charts: list[Chart] = [_compensation(record)] if _trains(record) else []
    if all(shot["drift"] is None for shot in record["shots"]):
        return charts
    return [_quantities(record), _drift_map(record), _drift(record), *charts]


def _trains(record: Record) -> list[Record]:
    return list(record.get("compensation", ()))


def _compensation(record: Record) -> Figure:
    """Change of each quantity with the dwell, without and with compensation."""
    trains = _trains(record)
    rails = list(dict.fromkeys(train["rail_pressure"] for train in trains))
    panels = []
    for i in range(len(trains[0]["wanted"])):
        lines = []
        for k, rail in enumerate(rails):
            rows = [train for train in trains if train["rail_pressure"] == rail]
            x = points(1e3 * (train["dwells"] or [0.0])[0] for train in rows)
            for key, words, look in (("plain_quantities", "without", "dash"), ("quantities", "with", "solid")):
                shares = [train[key][i] and 100.0 * (train[key][i] / train["wanted"][i] - 1.0) for train in rows]
                lines.append(Series(f"{to_fixed(rail, 0, MPA)} MPa, {words}", look, x, tuple(shares), BOTH, k))
        panels.append(Panel(f"injection {i + 1}, % off", tuple(lines), zero_line=True, has_legend=i == 0))
    caption = (
        "Deviation from the target quantities by the model with its states: with the energising times of single "
        "injections by the model without them, and with compensated ones."
    )
    return Figure("Compensation", caption, "dwell, ms", tuple(panels))


def _compensation_table(record: Record) -> Table:
    def each(key: str, scale: float, decimals: int) -> Any:
        return lambda row: ", ".join(to_fixed(value, decimals, scale) for value in row[key])

    columns: list[Column] = [
        ("p, MPa", lambda row: to_fixed(row["rail_pressure"], 1, MPA)),
        ("dwell, ms", lambda row: to_fixed((row["dwells"] or [None])[0], 2, 1e3)),
        ("wanted, mm³", each("wanted", MM3, 2)),
        ("ET, µs", each("energising_times", MICROSECOND, 1)),
        ("without, µs", each("plain_times", MICROSECOND, 1)),
        ("without, mm³", each("plain_quantities", MM3, 2)),
        ("met", lambda row: "yes" if row["met"] else f"no: {each('quantities', MM3, 2)(row)} mm³"),
    ]
    note = "Energising times by the states after the last shot; without: times of single injections by the model alone."
    return table_from_columns("Compensated energising times", _trains(record), columns, note, inputs=("wanted, mm³",))


def _quantities(record: Record) -> Figure:
    """Quantities by shot, and their deviation from the model without the pressure."""
    number = max(len(shot["injections"]) for shot in record["shots"])
    upper, lower = [], []
    bands = []
    for j in range(number):
        rows = [(k, s["injections"][j]) for k, s in enumerate(record["shots"], 1) if j < len(s["injections"])]
        x = points(k for k, _ in rows)
        quantities, deviation, model = (
            np.array([row[f"quantity{key}"] for _, row in rows], float) * MM3
            for key in ("", "_deviation", "_open_loop")
        )
        name = "" if number == 1 else f", injection {j + 1}"
        upper.append(Series(f"observer{name}", "best", x, points(quantities), MARKERS, j))
        with np.errstate(invalid="ignore", divide="ignore"):
            share, spread = 100.0 * (quantities / model - 1.0), 100.0 * TWO * deviation / model
        lower.append(Series("", "best", x, points(share), MARKERS, j))
        bands.append(Band("best", x, points(share - spread), points(share + spread), j))
    panels = (
        Panel("quantity, mm³", tuple(upper)),
        Panel("to model alone, %", tuple(lower), zero_line=True, bands=tuple(bands)),
    )
    return Figure(
        "Quantity shot by shot",
        "Bands: 95 % from the stated deviation; below, deviation from the model without the pressure.",
        "shot",
        panels,
    )


def _drift_map(record: Record) -> HeatMap:
    columns = [k for k, shot in enumerate(record["shots"]) if shot["drift"] is not None]
    columns = columns[:: max(-(-len(columns) // MOST_COLUMNS), 1)]  # even steps
    states = record["states"]
    drift = np.array([record["shots"][k]["drift"] for k in columns]) / [state["deviation"] for state in states]
    rows = drift.T.tolist()
    return HeatMap(
        "Map of the drift",
        "Estimate of each state after a shot, in units of its standard deviation before the first.",
        "shot",
        "",
        tuple(str(k + 1) for k in columns),
        tuple(state["name"] for state in states),
        tuple(map(points, rows)),
        tuple(tuple(to_fixed(round(value, 1) + 0.0, 1) for value in row) for row in rows),
        "st. dev.",
        diverging=True,
    )


def _drift(record: Record) -> Figure:
    """Courses of the estimated states, with bands."""
    shots = [(k, shot) for k, shot in enumerate(record["shots"], 1) if shot["drift"] is not None]
    x = points(k for k, _ in shots)
    panels = []
    for i in _learnt(record):
        state = record["states"][i]
        scale, unit = SHOWN_UNITS.get(state["unit"], (1.0, state["unit"]))
        mean, spread = (np.array([s[key][i] for _, s in shots]) * scale for key in ("drift", "drift_deviations"))
        panels.append(
            Panel(
                f"{state['name']}, {unit}",
                (Series("", "best", x, points(mean)),),
                zero_line=True,
                bands=(Band("best", x, points(mean - TWO * spread), points(mean + TWO * spread)),),
                has_legend=False,
            )
        )
    caption = "States that the pressure determines best; bands: 95 % of the stated uncertainty."
    return Figure("Drift", caption, "shot", tuple(panels))


def _learnt(record: Record, most: int = 4) -> list[int]:
    """Indices of the states whose deviation has shrunk most."""
    last = next(shot for shot in reversed(record["shots"]) if shot["drift"] is not None)
    shares: Floats = np.array(last["drift_deviations"]) / [state["deviation"] for state in record["states"]]
    order = np.argsort(shares, kind="stable").tolist()
    return [i for i in order if shares[i] < LEARNT][:most] or order[:1]


def observer_tables(record: Record) -> list[Table]:
    """States after the last shot, and the first injections."""
    more = [_compensation_table(record)] if _trains(record) else []
    return [*more, _state_table(record), _shot_table(record)]


def _state_table(record: Record) -> Table:
    last = next((shot for shot in reversed(record["shots"]) if shot["drift"] is not None), None)

    def value(key: str, with_sign: bool = False) -> Any:
        def text(row: tuple[int, Record]) -> str:
            return _with_unit(None if last is None else last[key][row[0]], row[1]["unit"], with_sign)

        return text

    columns: list[Column] = [
        ("state", lambda row: row[1]["name"]),
        ("estimate", value("drift", True)),
        ("st. dev.", value("drift_deviations")),
        ("st. dev. before", lambda row: _with_unit(row[1]["deviation"], row[1]["unit"])),
        ("limit of a step", lambda row: _with_unit(row[1]["limit"] or None, row[1]["unit"])),
    ]
    note = (
        f"An alarm needs a step beyond the limit and beyond {record['significance']:g} standard deviations. "
        "The pressure does not determine states whose standard deviation has not shrunk."
    )
    return table_from_columns("States after the last shot", list(enumerate(record["states"])), columns, note)


def _shot_table(record: Record) -> Table:
    rows = [
        (k, i, shot, row) for k, shot in enumerate(record["shots"], 1) for i, row in enumerate(shot["injections"], 1)
    ]

    def both(key: str, scale: float, decimals: int) -> Any:
        def text(item: tuple[int, int, Record, Record]) -> str:
            row = item[3]
            if row[key] is None:
                return MISSING
            if row[f"{key}_deviation"] is None:
                return f"{to_fixed(abs(row[key]), decimals, scale)} ± {MISSING} (does not open)"
            return f"{to_fixed(row[key], decimals, scale)} ± {to_fixed(row[f'{key}_deviation'], decimals, scale)}"

        return text

    columns: list[Column] = [
        ("shot", lambda item: f"{item[0]}" if len(item[2]["injections"]) == 1 else f"{item[0]}, injection {item[1]}"),
        ("p, MPa", lambda item: to_fixed(item[2]["rail_pressure"], 1, MPA)),
        ("ET, µs", lambda item: to_fixed(item[3]["energising_time"], 0, MICROSECOND)),
        ("quantity, mm³", both("quantity", MM3, 2)),
        ("model alone, mm³", lambda item: to_fixed(item[3]["quantity_open_loop"], 2, MM3)),
        ("opening, µs", both("opening", MICROSECOND, 1)),
        ("closing, µs", both("closing", MICROSECOND, 1)),
    ]
    more = f" The first {SHOWN} of {len(rows)} injections; all are in observer.csv." if len(rows) > SHOWN else ""
    note = f"± one standard deviation; times from the start of the shot.{more}"
    return table_from_columns("Injections", rows[:SHOWN], columns, note, inputs=("p, MPa", "ET, µs"))


def _facts(record: Record) -> list[tuple[str, str]]:
    d = record["disturbance"]
    facts = [
        ("Injector", record["injector"]["title"]),
        ("Variant", record["injector"]["variant"]),
        *((name, record["log"][name.lower()]) for name in ("Command", "Log") if record["log"]),
        ("Rail volume", _volume(record)),
        ("Cylinder and return pressure", " and ".join(quantity(p, "Pa", 3) for p in record["pressures"])),
        ("Sensor", _place(record)),
        (
            "Disturbance",
            f"noise of an averaged sample {quantity(d['noise'], 'Pa', 2)}; rate of change by pump and others "
            f"{significant(d['rate'] * 1e-9, 2)} MPa/ms over {quantity(d['memory'], 's', 2)}; waves "
            f"{quantity(d['wave'], 'Pa', 2)} at {significant(d['frequency'] * 1e-3, 2)} kHz",
        ),
        ("Discrepancy", f"{percent(record['discrepancy'])} % of the drop of the pressure"),
    ]
    for name, (noise, lacks) in record.get("further", {}).items():
        what, words = {
            "current": ("Current", f"noise of a sample {quantity(noise, 'A', 2)}"),
            "return": ("Return flow", f"standard deviation of a shot's {percent(noise)} %"),
        }[name]
        facts.append((what, f"{words}; discrepancy {percent(lacks)} %"))
    return facts


OBSERVATION = Presenter.of_record(
    lambda record: [
        record["title"],
        *observer_lines(record),
        *observer_notes(record),
        *warning_lines(record),
        *alarm_lines(record),
    ],
    observer_tables,
    observer_figures,
)
