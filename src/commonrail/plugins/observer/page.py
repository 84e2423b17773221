"""Report of an observer: quantities shot by shot, a map of the drift, and the assumptions."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.chart import BOTH, MARKERS, Band, Chart, Figure, HeatMap, Panel, Series, points
from commonrail.base.record import from_record
from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, percent, quantity, significant, to_fixed, to_signed
from commonrail.data.records import MICROSECOND, MM3, MPA, Record
from commonrail.engine.operating_point import RAIL_PRESSURES
from commonrail.plugins.observer.file import (
    InjectionFigures,
    ObservationSummary,
    ShotFigures,
    TrainTimes,
)
from commonrail.plugins.observer.kalman import TRUSTED
from commonrail.report.analysis import SHOWN, analysis_html
from commonrail.report.figure import figure_html
from commonrail.report.fit.rules import BAD, CARE, GOOD, Tile
from commonrail.report.presenter import Array, Arrays, Presenter, in_common_unit
from commonrail.report.result_kind import ResultKind

MOST_COLUMNS = 16  # of the drift map, wide enough for "−10.3"; some shots are omitted
MOVED, OFTEN = 0.3, 0.1  # a warning needs this relative change of the quantity in this share of injections; chosen
FAR = 4.0  # standard deviations before the first shot beyond which a state is doubted; chosen
LEARNT = 0.8  # share of its first standard deviation below which a state counts as estimated from the pressure; chosen
CONSISTENT = (0.5, 2.0)  # medians of the consistency for which the stated deviations can be trusted; chosen
# Coverage of the stated deviations on simulated injectors: studies/observer_trial.py.
HELD = (
    "In a trial with a rail sensor on simulated injectors, whose parameters scatter by the initial deviations of the "
    "states, 95 % intervals contained 97 % of the quantities."
)
FURTHER_WORDS = {"current": ("the coil's current", "--current"), "return": ("the return flow", "--return-flow")}
SHOWN_UNITS = {"1": (100.0, "%"), "Pa": (MPA, "MPa"), "s": (MICROSECOND, "µs")}  # of states in figures
TWO = 1.96  # standard deviations of a 95 % interval


def observer_html(record: Record, folder: Path = Path("DIR")) -> str:
    """Report of an observer; `folder` is its name in the command lines shown."""
    summary = from_record(ObservationSummary, record)
    charts = observer_figures(summary)
    heights = [420, 380, 160 * len(_learnt(summary))] if len(charts) > 2 else []
    if summary.compensation:
        heights.append(380)
    drawn = [(c, figure_html(c, f"figure-{i}", h)) for i, (c, h) in enumerate(zip(charts, heights, strict=True))]
    if summary.compensation:  # the requested result comes first
        drawn = [drawn[-1], *drawn[:-1]]
    return analysis_html(
        "observer.html",
        __package__,
        record,
        folder,
        _facts(summary),
        kind="Observer",
        lines=observer_lines(summary),
        notes=observer_notes(summary),
        warnings=warning_lines(summary),
        alarms=alarm_lines(summary),
        tiles=_tiles(summary),
        first=drawn[0] if drawn else None,
        figures=drawn[1:],
        tables=observer_tables(summary),
    )


RESULT = ResultKind("observer.json", "observer", "observe", observer_html)


def observer_lines(summary: ObservationSummary) -> list[str]:
    """Sentences: accuracy and change of the quantities, and shots and injections that are exceptions."""
    injections, observed = summary.every_injection, summary.observed
    if observed and not any(injection.quantity_open_loop > 0.0 for injection in observed):
        return [
            f"The model does not inject at the {count_noun(len(injections), 'energising')} of the log, so the pressure "
            "cannot correct a quantity; check energising times, command and pressure."
        ]
    lines = [f"{count_noun(len(summary.shots), 'shot')} with {count_noun(len(injections), 'injection')}"]
    if observed:
        shift = 100.0 * np.nanmedian(_shift_by_pressure(observed))
        lines[0] += (
            f"; median standard deviation of a quantity {_deviation(observed)}; the pressure moved the model's "
            f"quantities by {to_fixed(shift, 1)} % (median)"
        )
    lines[0] += "."
    if strange := _count_strange(summary):
        lines.append(
            f"{count_noun(strange, 'shot')} changed no state, since the pressure{_further_sensor_words(summary)} "
            "contradicts model and disturbance (consistency above 3)."
        )
    if closed := _count_closed(summary):
        lines.append(
            f"{count_noun(closed, 'injection')} did not open in the model with its states and has no standard "
            "deviation."
        )
    return lines


def observer_notes(summary: ObservationSummary) -> list[str]:
    """Sentences on the method and its assumptions."""
    lines = [
        f"Quantity, opening and closing follow from the pressure at the {_place(summary)}"
        f"{_further_sensor_words(summary)} and the command, by the model of {summary.injector.title}.",
        f"Rail volume {_volume(summary)}.",
    ]
    if summary.horizon > 1 and len(summary.shots) > 1:
        lines.append(
            f"Estimates use a sliding window of {summary.horizon} shots, in which later shots correct earlier ones. "
            "The last shot and the alarms come from the filter."
        )
    if _count_strange(summary):
        lines.append(
            "A shot contradicts the model for example if another injector injects at once; its figures follow from "
            "the states."
        )
    if _count_closed(summary):
        lines.append("The slopes of the model do not show where a closed injector begins to open.")
    return [*lines, HELD]


def _count_closed(summary: ObservationSummary) -> int:
    """Number of injections with a quantity and without its standard deviation."""
    return sum(bool(np.isnan(injection.quantity_deviation)) for injection in summary.observed)


def _count_strange(summary: ObservationSummary) -> int:
    return sum((shot.consistency or 0.0) > TRUSTED for shot in summary.shots)


def _shift_by_pressure(injections: list[InjectionFigures]) -> Floats:
    """Relative change (injections,) of each quantity by the pressure, against the model alone."""
    before = np.array([injection.quantity_open_loop for injection in injections], float)
    after = np.array([injection.quantity for injection in injections], float)
    return np.asarray(np.abs(after / np.where(before > 0.0, before, np.nan) - 1.0))


def _volume(summary: ObservationSummary) -> str:
    source = summary.log.volume_source
    return f"{significant(summary.rail_volume * 1e6, 4)} cm³" + (f" ({source})" if source else "")


def warning_lines(summary: ObservationSummary) -> list[str]:
    """Reasons for doubting the figures."""
    shots, strange = summary.shots, _count_strange(summary)
    rest, (low, high) = float(np.median([shot.rail_pressure for shot in shots])), RAIL_PRESSURES.likely
    moved = _shift_by_pressure(summary.observed)
    conditions = {
        f"{quantity(low, 'Pa', 3)} to {quantity(high, 'Pa', 3)} is usual before a shot.": not low <= rest <= high,
        f"{strange} of {len(shots)} shots contradict the model: do not use the quantities.": 2 * strange > len(shots),
        f"More than 10 % of the quantities differ from the model by over {100.0 * MOVED:g} %.": bool(
            np.sum(moved > MOVED) > OFTEN * len(moved)
        ),
    }
    lines = [line for line, holds in conditions.items() if holds]
    last = summary.last_shot
    for value, state in zip([] if last is None else _drift_of(last).tolist(), summary.states, strict=False):
        if (far := abs(value) / state.deviation) > FAR:
            label = f"{state.name} {_with_unit(value, state.unit, True)}"
            lines.append(
                f"{label[0].upper()}{label[1:]} is {significant(far, 2)} standard deviations from its start value."
            )
    if lines:
        more = "".join(
            f"column and unit of {words} ({option}), " for words, option in _find_used_sensors(summary).values()
        )
        lines.append(
            f"Check rail.volume ({_volume(summary).partition(' (')[0]}), the pressure's unit (--pressure-unit; "
            f"{quantity(rest, 'Pa', 3)} before the shots, median), {more}and whether the command is this injector's."
        )
    for name, (words, option) in FURTHER_WORDS.items():
        counts = [shot.further[name] for shot in shots if name in shot.further]
        if out := counts.count(False):
            lines.append(
                f"{words[0].upper()}{words[1:]} was left out of {out} of {count_noun(len(counts), 'shot')}, since it "
                f"contradicts the pressure and the model; check its column, unit and zero ({option})."
            )
    return lines


def _drift_of(shot: ShotFigures) -> Floats:
    """States after a shot that has an estimate."""
    assert shot.drift is not None
    return shot.drift


def _place(summary: ObservationSummary) -> str:
    return "rail" if summary.sensor == "rail" else "injector's end of the line"


def _further_sensor_words(summary: ObservationSummary) -> str:
    return "".join(f", {words}" for words, _ in _find_used_sensors(summary).values())


def _find_used_sensors(summary: ObservationSummary) -> dict[str, tuple[str, str]]:
    """Words and option of each further sensor that counts in a shot."""
    used = {name for shot in summary.shots for name, counts in shot.further.items() if counts}
    return {name: words for name, words in FURTHER_WORDS.items() if name in used}


def _deviation(injections: list[InjectionFigures]) -> str:
    """Median standard deviation of the quantities that have one, with its share."""
    pairs = np.array([(injection.quantity_deviation, injection.quantity) for injection in injections])
    deviations, quantities = pairs[np.isfinite(pairs[:, 0])].T
    if not len(deviations):
        return MISSING
    shares = deviations / np.maximum(quantities, 1e-12)
    return f"{significant(np.median(deviations), 2, MM3)} mm³ ({percent(np.median(shares))} %)"


def alarm_lines(summary: ObservationSummary) -> list[str]:
    """Sentence on each alarm."""
    units = {state.name: state.unit for state in summary.states}
    return [
        f"{alarm.state}: {_with_unit(alarm.size, units[alarm.state], True)} ± "
        f"{_with_unit(alarm.deviation, units[alarm.state])} from shot {k - alarm.ago} on, seen at shot {k}."
        for k, alarm in summary.alarms
    ]


def _with_unit(value: float | None, unit: str, with_sign: bool = False) -> str:
    """Value of a state with its unit; a relative one in percent."""
    if value is None:
        return MISSING
    if unit == "1":
        return f"{to_signed(100.0 * value, 1) if with_sign else significant(100.0 * value, 2)} %"
    text = quantity(value, unit, 2)
    return f"+{text}" if with_sign and value > 0.0 else text


def _tiles(summary: ObservationSummary) -> list[Tile]:
    observed = summary.observed
    names = list(dict.fromkeys(alarm.state for _, alarm in summary.alarms))
    tested = len(summary.shots) > summary.learning
    words = ", ".join(names) or ("no state has changed" if tested else "too few shots for a test")
    tiles = [Tile("Drift", count_noun(len(names), "alarm"), words, BAD if names else GOOD if tested else "")]
    if warnings := warning_lines(summary):
        tiles[0] = tiles[0]._replace(level=BAD if names else "")
        tiles.insert(0, Tile("Check", "warning", f"{warnings[0].partition('. ')[0]}", CARE))
    if not observed:
        return tiles
    same = "median standard deviation"
    tiles.append(Tile("Quantity", _deviation(observed).partition(" (")[0], same))
    for title, pairs in {
        "Opening": [(injection.opening, injection.opening_deviation) for injection in observed],
        "Closing": [(injection.closing, injection.closing_deviation) for injection in observed],
    }.items():
        deviations = [deviation for time, deviation in pairs if np.isfinite(time)]
        if deviations:
            tiles.append(Tile(title, f"{to_fixed(np.median(deviations), 1, MICROSECOND)} µs", same))
    middle = float(np.median([shot.consistency for shot in summary.shots if shot.consistency is not None]))
    level = "" if warnings else GOOD if CONSISTENT[0] < middle < CONSISTENT[1] else CARE
    words = "squared innovation over its expectation; 1 if model and noise are as assumed"
    return [*tiles, Tile("Consistency", significant(middle, 2), words, level)]


def observer_figures(summary: ObservationSummary) -> list[Chart]:
    """Quantities, map of the drift, and the states estimated from the pressure."""
    charts: list[Chart] = [_compensation(summary.compensation)] if summary.compensation else []
    if summary.last_shot is None:
        return charts
    return [_quantities(summary), _drift_map(summary), _drift(summary), *charts]


def _compensation(trains: tuple[TrainTimes, ...]) -> Figure:
    """Change of each quantity with the dwell, without and with compensation."""
    rails = list(dict.fromkeys(train.rail_pressure for train in trains))
    panels = []
    for i in range(len(trains[0].targets)):
        lines = []
        for k, rail in enumerate(rails):
            rows = [train for train in trains if train.rail_pressure == rail]
            x = points(1e3 * (train.dwells or (0.0,))[0] for train in rows)
            for words, look, quantities in (
                ("without", "dash", [train.plain_quantities[i] for train in rows]),
                ("with", "solid", [train.quantities[i] for train in rows]),
            ):
                y = points(100.0 * (q / train.targets[i] - 1.0) for q, train in zip(quantities, rows, strict=True))
                lines.append(Series(f"{to_fixed(rail, 0, MPA)} MPa, {words}", look, x, y, BOTH, k))
        panels.append(Panel(f"injection {i + 1}, % off", tuple(lines), zero_line=True, has_legend=i == 0))
    caption = (
        "Deviation from the target quantities, simulated with the estimated states: energising times of single "
        "injections without the states, and compensated energising times."
    )
    return Figure("Compensation", caption, "dwell, ms", tuple(panels))


def _compensation_table(trains: tuple[TrainTimes, ...]) -> Table:
    def volumes(values: Iterable[float]) -> str:
        return ", ".join(to_fixed(value, 2, MM3) for value in values)

    def times(values: Iterable[float]) -> str:
        return ", ".join(to_fixed(value, 1, MICROSECOND) for value in values)

    columns: list[Column] = [
        ("p, MPa", lambda train: to_fixed(train.rail_pressure, 1, MPA)),
        ("dwell, ms", lambda train: to_fixed((train.dwells or (None,))[0], 2, 1e3)),
        ("wanted, mm³", lambda train: volumes(train.targets)),
        ("ET, µs", lambda train: times(train.energising_times)),
        ("without, µs", lambda train: times(train.plain_times)),
        ("without, mm³", lambda train: volumes(train.plain_quantities)),
        ("met", lambda train: "yes" if train.met else f"no: {volumes(train.quantities)} mm³"),
    ]
    note = "Energising times by the states after the last shot; without: times of single injections without the states."
    return table_from_columns("Compensated energising times", trains, columns, note, inputs=("wanted, mm³",))


def _quantities(summary: ObservationSummary) -> Figure:
    """Quantities by shot, and their deviation from the model without the pressure."""
    number = max(len(shot.injections) for shot in summary.shots)
    upper, lower = [], []
    for j in range(number):
        rows = [(k, shot.injections[j]) for k, shot in enumerate(summary.shots, 1) if j < len(shot.injections)]
        x = points(k for k, _ in rows)
        table = [(row.quantity, row.quantity_deviation, row.quantity_open_loop) for _, row in rows]
        quantities, deviation, model = np.array(table, float).T * MM3
        name = "" if number == 1 else f", injection {j + 1}"
        upper.append(Series(f"observer{name}", "best", x, points(quantities), MARKERS, j))
        with np.errstate(invalid="ignore", divide="ignore"):
            share, spread = 100.0 * (quantities / model - 1.0), 100.0 * TWO * deviation / model
        edges = points(share - spread), points(share + spread)
        lower.append(Series("", "best", x, points(share), MARKERS, j, 0, *edges))
    panels = (
        Panel("quantity, mm³", tuple(upper)),
        Panel("to model alone, %", tuple(lower), zero_line=True),
    )
    return Figure(
        "Quantity shot by shot",
        "Below, deviation from the model without the pressure, with 95 % by the stated deviation.",
        "shot",
        panels,
    )


def _drift_map(summary: ObservationSummary) -> HeatMap:
    columns = [(k, shot.drift) for k, shot in enumerate(summary.shots, 1) if shot.drift is not None]
    columns = columns[:: max(-(-len(columns) // MOST_COLUMNS), 1)]  # even steps
    states = summary.states
    drift = np.array([drift for _, drift in columns]) / [state.deviation for state in states]
    rows = drift.T.tolist()
    return HeatMap(
        "Map of the drift",
        "Estimate of each state after a shot, in units of its standard deviation before the first.",
        "shot",
        "",
        tuple(str(k) for k, _ in columns),
        tuple(state.name for state in states),
        tuple(map(points, rows)),
        tuple(tuple(to_fixed(round(value, 1) + 0.0, 1) for value in row) for row in rows),
        "st. dev.",
        diverging=True,
    )


def _drift(summary: ObservationSummary) -> Figure:
    """Courses of the estimated states, with bands."""
    shots = [(k, shot) for k, shot in enumerate(summary.shots, 1) if shot.drift is not None]
    x = points(k for k, _ in shots)
    drift = np.array([shot.drift for _, shot in shots])
    deviations = np.array([shot.drift_deviations for _, shot in shots])
    panels = []
    for i in _learnt(summary):
        state = summary.states[i]
        scale, unit = SHOWN_UNITS.get(state.unit, (1.0, state.unit))
        mean, spread = drift[:, i] * scale, deviations[:, i] * scale
        panels.append(
            Panel(
                f"{state.name}, {unit}",
                (Series("", "best", x, points(mean)),),
                zero_line=True,
                bands=(Band("best", x, points(mean - TWO * spread), points(mean + TWO * spread)),),
                has_legend=False,
            )
        )
    caption = "States that the pressure determines best; bands: 95 % of the stated uncertainty."
    return Figure("Drift", caption, "shot", tuple(panels))


def _learnt(summary: ObservationSummary, most: int = 4) -> list[int]:
    """Indices of the states whose deviation has shrunk most."""
    last = summary.last_shot
    assert last is not None
    shares: Floats = np.asarray(last.drift_deviations) / [state.deviation for state in summary.states]
    order = np.argsort(shares, kind="stable").tolist()
    return [i for i in order if shares[i] < LEARNT][:most] or order[:1]


def observer_tables(summary: ObservationSummary) -> list[Table]:
    """States after the last shot, and the first injections."""
    more = [_compensation_table(summary.compensation)] if summary.compensation else []
    return [*more, _state_table(summary), _shot_table(summary)]


def _state_table(summary: ObservationSummary) -> Table:
    last = summary.last_shot
    lacking = [None] * len(summary.states)
    values = lacking if last is None or last.drift is None else last.drift.tolist()
    deviations = lacking if last is None or last.drift_deviations is None else last.drift_deviations.tolist()
    columns: list[Column] = [
        ("state", lambda row: row[0].name),
        ("estimate", lambda row: _with_unit(row[1], row[0].unit, True)),
        ("st. dev.", lambda row: _with_unit(row[2], row[0].unit)),
        ("st. dev. before", lambda row: _with_unit(row[0].deviation, row[0].unit)),
        ("limit of a step", lambda row: _with_unit(row[0].limit or None, row[0].unit)),
    ]
    note = (
        f"An alarm needs a step beyond the limit and beyond {summary.significance:g} standard deviations. "
        "The pressure does not determine states whose standard deviation has not shrunk."
    )
    rows = zip(summary.states, values, deviations, strict=True)
    return table_from_columns("States after the last shot", rows, columns, note)


def _shot_table(summary: ObservationSummary) -> Table:
    rows = [
        (k, i, shot, injection)
        for k, shot in enumerate(summary.shots, 1)
        for i, injection in enumerate(shot.injections, 1)
    ]

    def both(value: float, deviation: float, scale: float, decimals: int) -> str:
        if np.isnan(value):
            return MISSING
        if np.isnan(deviation):
            return f"{to_fixed(abs(value), decimals, scale)} ± {MISSING} (does not open)"
        return f"{to_fixed(value, decimals, scale)} ± {to_fixed(deviation, decimals, scale)}"

    columns: list[Column] = [
        ("shot", lambda row: f"{row[0]}" if len(row[2].injections) == 1 else f"{row[0]}, injection {row[1]}"),
        ("p, MPa", lambda row: to_fixed(row[2].rail_pressure, 1, MPA)),
        ("ET, µs", lambda row: to_fixed(row[3].energising_time, 0, MICROSECOND)),
        ("quantity, mm³", lambda row: both(row[3].quantity, row[3].quantity_deviation, MM3, 2)),
        ("model alone, mm³", lambda row: to_fixed(row[3].quantity_open_loop, 2, MM3)),
        ("opening, µs", lambda row: both(row[3].opening, row[3].opening_deviation, MICROSECOND, 1)),
        ("closing, µs", lambda row: both(row[3].closing, row[3].closing_deviation, MICROSECOND, 1)),
    ]
    more = f" The first {SHOWN} of {len(rows)} injections; all are in observer.csv." if len(rows) > SHOWN else ""
    note = f"± one standard deviation; times from the start of the shot.{more}"
    return table_from_columns("Injections", rows[:SHOWN], columns, note, inputs=("p, MPa", "ET, µs"))


def _facts(summary: ObservationSummary) -> list[tuple[str, str]]:
    disturbance = summary.disturbance
    origin = {"Command": summary.log.command, "Log": summary.log.log}
    facts = [
        ("Injector", summary.injector.title),
        ("Variant", summary.injector.variant),
        *((name, text) for name, text in origin.items() if text is not None),
        ("Rail volume", _volume(summary)),
        ("Cylinder and return pressure", " and ".join(quantity(p, "Pa", 3) for p in summary.pressures)),
        ("Sensor", _place(summary)),
        (
            "Disturbance",
            f"noise of an averaged sample {quantity(disturbance.noise, 'Pa', 2)}; rate of change by pump and others "
            f"{significant(disturbance.rate * 1e-9, 2)} MPa/ms over {quantity(disturbance.memory, 's', 2)}; waves "
            f"{quantity(disturbance.wave, 'Pa', 2)} at {significant(disturbance.frequency * 1e-3, 2)} kHz",
        ),
        ("Discrepancy", f"{percent(summary.discrepancy)} % of the drop of the pressure"),
    ]
    for name, (noise, discrepancy) in summary.further.items():
        sensor, words = {
            "current": ("Current", f"noise of a sample {quantity(noise, 'A', 2)}"),
            "return": ("Return flow", f"standard deviation of a shot's {percent(noise)} %"),
        }[name]
        facts.append((sensor, f"{words}; discrepancy {percent(discrepancy)} %"))
    return facts


def _lines(summary: ObservationSummary) -> list[str]:
    return [
        summary.title,
        *observer_lines(summary),
        *observer_notes(summary),
        *warning_lines(summary),
        *alarm_lines(summary),
    ]


def _arrays(summary: ObservationSummary) -> Arrays:
    """Figures by shot and injection; NaN for an injection that a shot does not have."""
    axes, shots = ("shot", "injection"), summary.shots
    shape = len(shots), max(len(shot.injections) for shot in shots)
    tables = {name: np.full(shape, np.nan) for name in InjectionFigures._fields}
    for k, shot in enumerate(shots):
        for i, injection in enumerate(shot.injections):
            for table, value in zip(tables.values(), injection, strict=True):
                table[k, i] = value
    values = {
        name: in_common_unit(axes, table, "m3" if name.startswith("quantity") else "s")
        for name, table in tables.items()
    }
    values["rail_pressure"] = in_common_unit(axes[:1], [shot.rail_pressure for shot in shots], "Pa")
    numbers = {axis: Array((axis,), np.arange(1, size + 1)) for axis, size in zip(axes, shape, strict=True)}
    return Arrays(numbers, values, summary.title)


OBSERVATION = Presenter(
    lambda observation: _lines(observation.summary),
    lambda observation: observer_tables(observation.summary),
    lambda observation: observer_figures(observation.summary),
    lambda observation: _arrays(observation.summary),
)
