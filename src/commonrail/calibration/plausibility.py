"""Plausibility: what about a study, its data and its result is too odd to be believed without a look.

Two moments: before the fit, of settings and of the start values, and after it. The limits stand first, and the usual
range of a parameter at the parameter; docs/howto/plausibility.md tells what each finding means.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Bools, Floats
from commonrail.base.choices import Drive
from commonrail.base.errors import one_line
from commonrail.base.text import quantity
from commonrail.calibration.space import Space
from commonrail.calibration.study import Study, longest_for_all
from commonrail.data.base import DataSet, Role, Score, ToleratedData, value_widths
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.baselines import SCALES, interpolate, point_places
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.operating_point import Trace
from commonrail.engine.plan import reference_density
from commonrail.engine.time_step import step_advice
from commonrail.physics.elementary import exp, log
from commonrail.physics.flow import pipe_area
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.physics.meters import known_quantity
from commonrail.readers.injector import idle_words


class Finding(NamedTuple):
    """A warning: the calibration runs, and its result should not be believed before this is looked at.

    Attributes
    ----------
    code : str
        Kind of the finding, an anchor of docs/howto/plausibility.md.
    subject : str
        Data set or parameter, or the study's title.
    sentence : str
        Where, what was found, what is expected and the cure; one line.
    """

    code: str
    subject: str
    sentence: str


def make_finding(code: str, subject: str, text: str) -> Finding:
    """Finding whose sentence begins with its subject.

    `code`, `subject`: as in `Finding`; `text`: the sentence without its subject.
    """
    return Finding(code, subject, one_line(f"{subject}: {text}"))


# Every limit of the plausibility pass, with its reason; a usual range of a parameter stands at the parameter itself.
#
# All are set so that a sound study of a servo-hydraulic injector stays well inside: a warning must mean something.

# Before the fit: settings.
ENERGISING = (50e-6, 10e-3)  # [s] a coil needs some 100 us to open a valve; 10 ms are over 60° of crank at 1000 1/min
SAMPLING = (50e-9, 1e-3)  # [s] between samples of a curve, from 20 MHz down to one in 1 ms, which shows no flank
RAIL = (5e6, 400e6)  # [Pa] below, no servo valve opens a needle; no series injector is built for more than 300 MPa
CYLINDER = (0.05e6, 30e6)  # [Pa] from a bench at ambient pressure to peak combustion pressure
RETURN = (0.05e6, 5e6)  # [Pa] from ambient to the back pressure of piezo injectors with a hydraulic coupler, 1 MPa
VALVE_RESERVE = 1.1  # of the rail pressure that a valve's spring holds; those of the catalogue hold 1.2 times and more
BOUND_SLACK = 10.0  # a bound may lie outside the usual range of its parameter by this factor: a box may be generous

# Before the fit: data against the injector with its start values.
QUANTITY_TIMES = 3.0  # a drawing's injector is within a factor of 2 of its bench; units slip by 16.7, 60, 1000
QUANTITY_APART = 1e-9  # [m³] a smaller difference is a matter of the opening delay, whatever its factor
ONSET_SHARE = 0.05  # of the injected quantity marks the onset: an integral, so that noise does not trigger it
EARLIEST = 50e-6  # [s] onset after energising begins: coil, valve and control chamber take 150 us or more
LATEST = 3e-3  # [s] onset after the last energising begins: ten times the opening delay of a slow injector
ONSET_APART = 300e-6  # [s] onset, measured against simulated: twice what drawings miss
ONSET_MISSED = 150e-6  # [s] by which drawings miss the opening delay; more than that is not the injector's
LEAST_ONSET = 0.01  # of the greater quantity: the smaller one may be hardly more than noise
COMMON = 0.5  # of the median shift: scatter of onsets up to which it is one; an injector's depends on the pressure
DELAY_REACH = 200e-6  # [s] to both sides of a delay from onsets: what drawings miss, and the scatter of the onsets
HEAVY, LIGHT = 0.95, 0.01  # shares of J; of many sets, light is below a tenth of an equal share

# After the fit.
BARELY = 0.01  # fall of J, as a share of J of the start values: less than that, nothing was found
GOOD_FIT = 0.05  # relative error of every fitted set below which start values are good, and need not improve
LARGE_MISFIT = 0.30  # relative error beyond noise; start values taken from a drawing are as good as that
HALF = 0.5  # a shift or gain must bring J below this share
LONGEST_SHIFT, SHIFT_STEP = 0.5e-3, 5e-6  # [s] search for a shift; triggers and meter delays slip by less than 0.5 ms
LEAST_SHIFT = 20e-6  # [s] triggers and the delays of meters are known to some us; shots scatter as much
GAINS, GAIN_STEP = (0.2, 5.0), 0.01  # search for a gain; beyond, the quantity has told before the fit
LEAST_GAIN = 0.05  # distance of the gain from 1: rate meters are calibrated to 1 to 3 %
DENSITY_MATCH = 0.03  # between the gain and the density in g/cm³ or its inverse: the latter are 20 % from 1
UNIT_MATCH = 0.08  # the same for curves and a map: interpolation adds up to 6 %, and density is 20 % from 1
AT_BOUNDS = 0.5  # share of the free parameters; single ones are told with the parameters in the report


# Checks of what a study says: data, energising, pressures, parameters. Nothing is simulated.

_PRESSURES = (
    ("rail_pressure", "rail pressure", RAIL),
    ("cylinder_pressure", "cylinder pressure", CYLINDER),
    ("return_pressure", "return pressure", RETURN),
)


_DRIVES = {Drive.CURRENT: "drive.peak_current", Drive.VOLTAGE: "drive.boost_voltage"}  # whose ranges a trace keeps


def data_findings(data: DataSet, injector: Injector) -> Iterator[Finding]:
    """Findings about one data set by itself: values, times, pressures, measured drive."""
    yield from signal_findings(data)
    if data.bounds is not None:
        interval = float(np.median(np.diff(data.bounds)))
        yield from _unusual("sampling", data.name, "interval of its samples", [interval], SAMPLING, "s")
    yield from _drive(data, injector)
    times = [pulse.duration for point in data.points for pulse in point.pulses]
    if data.bounds is None:  # a map of the return of a closed injector has zeros
        times = [time for time in times if time != 0.0]
    yield from _unusual("energising", data.name, "energising time", times, ENERGISING, "s")
    for key, words, usual in _PRESSURES:
        courses = [getattr(point, key) for point in data.points]
        levels = [float(np.mean(course.value)) if isinstance(course, Trace) else float(course) for course in courses]
        yield from _unusual("pressure", data.name, words, levels, usual, "Pa")


def injector_findings(injector: Injector) -> Iterator[Finding]:
    """Parameters outside the range that their part declares as usual."""
    for name, q in injector.quantities.items():
        value = injector.values[name]
        if q.usual is not None and not q.is_usual(value):
            yield make_finding(
                "parameter",
                name,
                f"the {q.meaning} is {quantity(value, q.unit, 4)}, and {_range(q.usual, q.unit)} is usual; check its "
                f"unit in the file of {injector.name}.",
            )


def valve_findings(injector: Injector, data: Iterable[DataSet]) -> Iterator[Finding]:
    """A control valve whose spring hardly holds the greatest rail pressure: beyond it opens without a current."""
    values = injector.values
    if "valve.spring_preload" not in values:  # a direct-acting needle
        return
    preload, seat = values["valve.spring_preload"], values["valve.seat_diameter"]
    holds = preload / pipe_area(seat)
    rail = max(float(point.initial_pressures()[0]) for data_set in data for point in data_set.points)
    if holds < VALVE_RESERVE * rail:
        yield make_finding(
            "valve",
            "valve.spring_preload",
            f"{quantity(preload, 'N', 3)} hold the valve's seat of {quantity(seat, 'm', 3)} closed up to "
            f"{quantity(holds, 'Pa', 3)}, and the rail pressure reaches {quantity(rail, 'Pa', 3)}: above the former "
            "the valve opens by itself; check valve.spring_preload and valve.seat_diameter, or narrow their bounds.",
        )


def bounds_findings(space: Space) -> Iterator[Finding]:
    """Bounds far outside the usual range of their parameter."""
    for p in space.parameters:
        q = known_quantity(p.name)
        odd = [value for value in (p.lower, p.upper) if not q.is_usual(value, BOUND_SLACK)]
        if q.usual is not None and odd:
            yield make_finding(
                "parameter_bound",
                p.name,
                f"a bound is {quantity(odd[0], q.unit, 4)}, more than {BOUND_SLACK:g} times outside the usual "
                f"{_range(q.usual, q.unit)}; check its unit in the study.",
            )


def idle_findings(study: Study) -> Iterator[Finding]:
    """Stated or free parameters that have no effect beside the values of others."""
    free = study.space.names
    for name in (*study.fixed, *free):
        if words := idle_words(name, lambda p: 1.0 if p in free else study.injector.values[p]):
            yield make_finding("parameter", name, f"{words}; state that, or omit this one.")


def step_findings(study: Study) -> Iterator[Finding]:
    """A time step that part of the candidates does not bear."""
    limit = longest_for_all(study.injector, study.space)
    if study.time_step > limit:
        yield make_finding(
            "time_step",
            "time_step",
            f"the step of {quantity(study.time_step, 's')} is too long for the stiffest parameters within the bounds, "
            f'which bear {quantity(limit, "s", 3)}: such candidates fail. {step_advice(limit)} The time step "auto" '
            "chooses it.",
        )


def signal_findings(data: DataSet) -> Iterator[Finding]:
    """No signal at all, or a signal upside down: nothing that is compared with such data says anything."""
    values, what, unit = data.measured, data.what, data.unit
    first = quantity(float(values[0]), unit, 4)
    if not np.any(values):
        yield make_finding("constant", data.name, f"all {len(values)} values of the {what} are zero; check the column.")
    elif len(values) > 1 and np.ptp(values) == 0.0:
        yield make_finding(
            "constant", data.name, f"all {len(values)} values of the {what} are {first}; check the column."
        )
    elif np.sum(values * value_widths(data)) < 0.0 or -values.min() > values.max():
        yield make_finding(
            "sign",
            data.name,
            f"the {what} is mostly negative: from {quantity(float(values.min()), unit, 4)} to "
            f"{quantity(float(values.max()), unit, 4)}; fuel that is injected counts positive, so reverse the sign or "
            "remove the offset.",
        )


def _unusual(
    code: str, name: str, words: str, values: Sequence[float], usual: tuple[float, float], unit: str
) -> Iterator[Finding]:
    """Values outside a usual range, as one finding; `words`: name of the quantity."""
    odd = [value for value in values if not usual[0] <= value <= usual[1]]
    if odd:
        others = f" (and {len(odd) - 1} more such values)" if len(odd) > 1 else ""
        yield make_finding(
            code,
            name,
            f"the {words} is {quantity(odd[0], unit, 4)}{others}, and {_range(usual, unit)} is usual; check its unit.",
        )


def _drive(data: DataSet, injector: Injector) -> Iterator[Finding]:
    name = _DRIVES.get(injector.variant.drive)
    drives = [point.drive.value for point in data.points if point.drive is not None]
    if name is None or not drives:
        return
    q = parameter_quantities()[name]
    peak = float(np.max(np.abs(np.concatenate(drives))))
    if q.usual is not None:
        yield from _unusual("drive", data.name, "peak of the measured drive", [peak], q.usual, q.unit)


def _range(limits_: tuple[float, float], unit: str) -> str:
    return f"{quantity(limits_[0], unit, 4)} to {quantity(limits_[1], unit, 4)}"


# Check of the curves of a study against its maps: nothing is simulated.


def unit_findings(data: Sequence[DataSet], injector: Injector) -> Iterator[Finding]:
    """Curves and maps, one of which mistakes mass for volume: their quantities differ by the fuel's density."""
    sets = [data_set for data_set in data if all(len(point.pulses) == 1 for point in data_set.points)]
    curves = [data_set for data_set in sets if isinstance(data_set, RateData)]
    integrals = np.array([np.sum(data_set.measured * value_widths(data_set)) for data_set in curves])
    for data_set in (data_set for data_set in sets if isinstance(data_set, QuantityData) and curves):
        map_points, at = (
            np.column_stack([point_places(data_set), data_set.measured]),
            np.concatenate([*map(point_places, curves)]),
        )
        mapped, is_extrapolated = interpolate(map_points, at, SCALES["√p"])
        inside = ~is_extrapolated & (mapped > QUANTITY_APART)
        ratios = integrals[inside] / mapped[inside]
        ratio = float(np.median(ratios)) if len(ratios) else 1.0
        slip = _density_slip(ratio, 1e-3 * reference_density(injector, curves[0].point), UNIT_MATCH)
        if slip and np.ptp(ratios) <= UNIT_MATCH * ratio:
            yield make_finding(
                "unit",
                curves[0].name,
                f"the integrals of {len(ratios)} curves are {ratio:.3g} times the quantities of {data_set.name} at the "
                f"same operating points: {slip}check the units of both.",
            )


# Checks of the data against a simulation, as a rule of the start values: quantity, onset, shares of J.

MM3 = 1e9  # of 1 m³

_SLIPS = (  # factor between the number and what it should be, by the units that are mistaken
    (1e-3 / 60.0 / 1e-6, "mm3/ms read as L/min"),
    (1e-6 / (1e-3 / 60.0), "L/min read as mm3/ms"),
    (1e3, "a factor of 1000 between units"),
    (1e-3, "a factor of 1000 between units"),
)
_SLIP_MATCH = 1.5  # start values know the quantity no better


def start_findings(data: DataSet, score: Score) -> Iterator[Finding]:
    """Findings about one data set beside its simulation."""
    if not np.any(np.isfinite(score.values)):
        yield make_finding(
            "start",
            data.name,
            "the simulation fails, so that quantity and onset cannot be compared; check the injector with "
            "`commonrail simulate`.",
        )
        return
    yield from _quantities(data.name, *score.quantities())
    if data.bounds is not None:
        yield from _onset(data, onset(data.measured, data.bounds), onset_shift(data, score))


def share_findings(data: Sequence[DataSet], scores: Sequence[Score], of: str) -> Iterator[Finding]:
    """Fitted sets that make nearly all of J, or nearly nothing of it, while the others, or they, miss their tolerances.

    `scores`: one for each data set; `of`: what the scored model is called.
    """
    fitted = [(d, s) for d, s in zip(data, scores, strict=True) if d.role is Role.FIT]
    costs = np.array([set_cost(d, s) for d, s in fitted])
    total = float(np.sum(costs))
    if len(fitted) < 2 or not np.isfinite(total) or total <= 0.0:
        return
    shares = costs / total
    light = min(LIGHT, 0.1 / len(fitted))
    alone = bool(shares.max() > HEAVY)
    missed = [not _is_met(d, cost) for (d, _), cost in zip(fitted, costs, strict=True)]
    for (d, _), share, misses in zip(fitted, shares, missed, strict=True):
        if (share > HEAVY and sum(missed) > misses) or (share < light and misses and not alone):
            yield make_finding(
                "share",
                d.name,
                f"it makes {100.0 * share:.3g} % of J with the {of}: the fit will follow "
                f"{'it alone' if alone else 'the other sets'}; set the weights of the data so that each counts.",
            )


def _is_met(data: DataSet, cost: float) -> bool:
    """True for a set whose values lie within its stated tolerances: it counts, however small its share of J."""
    return isinstance(data, ToleratedData) and cost <= data.weight * len(data.measured)


def set_cost(data: DataSet, score: Score) -> float:
    """Weight · J of one data set; NaN for a failed simulation."""
    return data.weight * float(data.misfit(score.values))


def onset(rate: Floats, bounds: Floats, volume: float | None = None) -> float | None:
    """Time after which all but a small volume is injected [s]; None if no more than that is injected.

    `volume` [m³]: by default a small share of the quantity.
    """
    cumulated = np.cumsum(rate * np.diff(bounds))
    level = ONSET_SHARE * cumulated[-1] if volume is None else volume
    if not 0.0 < level < cumulated[-1]:
        return None
    before = np.flatnonzero(cumulated < level)
    return float(bounds[before[-1] + 1]) if len(before) else float(bounds[0])


def onset_shift(data: DataSet, score: Score) -> float | None:
    """Time by which the measured injection begins later than the simulated one [s]; None if one injects nothing.

    Both begin when the same volume is injected: a share of each quantity would count an injection that ends too soon as
    one that begins too soon.
    """
    assert data.bounds is not None
    totals = [float(np.sum(rate * np.diff(data.bounds))) for rate in (data.measured, score.values)]
    volume = max(ONSET_SHARE * min(totals), LEAST_ONSET * max(totals))
    measured, simulated = (onset(rate, data.bounds, volume) for rate in (data.measured, score.values))
    return None if measured is None or simulated is None else measured - simulated


class Delay(NamedTuple):
    """Shift of the onset [s] that curves of one meter share, positive if the measured ones are later."""

    shift: float
    curves: tuple[DataSet, ...]

    def sentence(self) -> str:
        """Statement about the curves, without a full stop."""
        late = f"{quantity(abs(self.shift), 's', 2)} {'later' if self.shift > 0.0 else 'earlier'}"
        return f"{len(self.curves)} curves begin {late} than the simulated ones, whatever the pressure"

    def text(self) -> str:
        """Value of the key `delay` of a meter, as TOML: free, with this delay as its start."""
        meter = self.curves[0].meter
        start = round(1e6 * (self.shift + (0.0 if meter is None else meter.values.get("delay", 0.0))), -1)
        ends = {"lower": start - 1e6 * DELAY_REACH, "upper": start + 1e6 * DELAY_REACH, "start": start}
        texts = [f'{key} = "{value:.0f} us"' for key, value in ends.items()]
        return f"{{ {', '.join(texts)} }}"


def common_delays(scored: Iterable[tuple[DataSet, Score]]) -> list[Delay]:
    """Delays of meters by the onsets of their curves: one for each meter whose curves agree at several pressures.

    `scored`: data sets with their scores; maps have no onset.
    """
    shifts: dict[str, list[tuple[DataSet, float]]] = {}
    for data, score in scored:
        shift = None if data.bounds is None else onset_shift(data, score)
        if shift is not None:
            shifts.setdefault("" if data.meter is None else data.meter.name, []).append((data, shift))
    delays = []
    for pairs in shifts.values():
        curves, values = zip(*pairs, strict=True)
        middle = float(np.median(values))
        pressures = {float(curve.points[0].initial_pressures()[0]) for curve in curves}
        if len(pressures) > 1 and abs(middle) > ONSET_MISSED and np.ptp(values) <= COMMON * abs(middle):
            delays.append(Delay(middle, curves))
    return delays


def _delay(delay: Delay, subject: str) -> Finding:
    meter = delay.curves[0].meter
    name = "bench" if meter is None else meter.name
    blocks = "" if meter else f' and meter = "{name}" in their blocks'
    return make_finding(
        "onset",
        subject,
        f"{delay.sentence()}; correct their time_zero, or write delay = {delay.text()} in [meters.{name}]{blocks}.",
    )


def _quantities(name: str, measured: Floats, simulated: Floats) -> Iterator[Finding]:
    """Quantities beyond a factor of the simulated ones [m³]; nothing is said if they are negative in sum."""
    total, expected = float(np.sum(measured)), float(np.sum(simulated))
    differs = np.abs(measured - simulated) > QUANTITY_APART
    odd = differs & ~_is_near(measured, simulated)
    if not odd.any() or total <= 0.0:
        return
    all_of_it = not _is_near(np.array(total), np.array(expected))
    first = int(np.argmax(odd))
    m, s = (total, expected) if all_of_it else (float(measured[first]), float(simulated[first]))
    where = "" if all_of_it else f" at {np.count_nonzero(odd)} of {len(measured)} points, first at number {first + 1}"
    yield make_finding(
        "quantity",
        name,
        f"the measured quantity is {m * MM3:.4g} mm³, and the simulated one {s * MM3:.4g} mm³{where}: "
        f"more than a factor of {QUANTITY_TIMES:g} apart{_slip(m, s)}; check the unit of the data, the "
        "pressures and the holes of the nozzle.",
    )


def _is_near(measured: Floats, simulated: Floats) -> Bools:
    times = QUANTITY_TIMES
    return np.asarray((measured <= times * simulated) & (simulated <= times * measured))


def _slip(measured: float, simulated: float) -> str:
    if simulated <= 0.0:
        return ""
    times = measured / simulated
    likely = [words for factor, words in _SLIPS if 1.0 / _SLIP_MATCH < times / factor < _SLIP_MATCH]
    return f" ({times:.3g} times; {likely[0]} would do that)" if likely else f" ({times:.3g} times)"


def _onset(data: DataSet, measured: float | None, shift: float | None) -> Iterator[Finding]:
    pulses = data.points[0].pulses
    if measured is None or not pulses:
        return
    first, last = pulses[0].start, pulses[-1].start
    if measured < first + EARLIEST:
        odd = f"and energising begins at {quantity(first, 's', 4)}: no injector opens that soon"
    elif measured > last + LATEST:
        odd = f"{quantity(measured - last, 's', 4)} after the last energising begins: that is too late"
    elif shift is not None and abs(shift) > ONSET_APART:
        odd = f"{quantity(abs(shift), 's', 3)} {'later' if shift > 0.0 else 'earlier'} than the simulated one"
    else:
        return
    at = f"the measured injection begins at {quantity(measured, 's', 4)}"
    yield make_finding("onset", data.name, f"{at}, {odd}; check the energising time and the trigger's zero.")


# Checks of a fitted model: fall of J, values at bounds, size of the error, and shifts or gains that explain it.


class Fit(NamedTuple):
    """Result of a search: best values [SI], objective of start and best, scores of the best on every data set."""

    study: Study
    best: Mapping[str, float]
    start_cost: float
    cost: float
    scores: Sequence[Score]


class Change(NamedTuple):
    """A shift [s] or gain of the simulation, J as it is and J with the change."""

    amount: float
    before: float
    after: float

    @property
    def halves(self) -> bool:
        """True if it brings J below half."""
        return self.after < HALF * self.before


def fit_findings(fit: Fit) -> Iterator[Finding]:
    """Findings about the search as a whole."""
    yield from _moved(fit)
    yield from _at_bounds(fit)


def model_findings(data: DataSet, score: Score, injector: Injector) -> Iterator[Finding]:
    """Findings about one model on one data set: a large error, and a shift or a gain that would explain it.

    `score`: of the model on these data; `injector`: the model.
    """
    error = score.relative_error()
    if error > LARGE_MISFIT:
        yield make_finding(
            "misfit",
            data.name,
            f"the error of the model is {100.0 * error:.0f} % of the data beyond their noise, and less than "
            f"{100.0 * LARGE_MISFIT:.0f} % is expected of a fit; check operating point and units, then which "
            "parameters are free.",
        )
    shift, gain = best_shift(data, score), best_gain(data, score)
    if shift is not None and shift.halves and not (gain.halves and gain.after < shift.after):
        yield from _shift(data.name, shift)
    elif gain.halves:
        yield from _gain(data, gain, injector)


def best_shift(data: DataSet, score: Score) -> Change | None:
    """Shift of a simulated course in time that makes J least; positive: the data come later. None of other data."""
    if data.bounds is None:
        return None
    time = 0.5 * (data.bounds[1:] + data.bounds[:-1])

    def j(shift: float) -> float:
        return float(data.misfit(np.interp(time - shift, time, score.values)))

    steps = round(LONGEST_SHIFT / SHIFT_STEP)
    coarse = SHIFT_STEP * np.arange(-steps, steps + 1)
    near = min(coarse, key=j)
    best = min(near + SHIFT_STEP * np.linspace(-1.0, 1.0, 11), key=j)
    before = float(data.misfit(score.values))
    return Change(float(best), before, j(best) if abs(best) >= LEAST_SHIFT else before)


def best_gain(data: DataSet, score: Score) -> Change:
    """Factor on the simulated values that makes J least; above 1: the data lie higher."""
    low, high = log(GAINS)
    gains = exp(np.linspace(low, high, round((high - low) / GAIN_STEP) + 1))
    gain = score.best_gain(gains)
    before, after = map(float, data.misfit(score.scaled(np.array([1.0, gain]))))
    return Change(gain, before, after if abs(gain - 1.0) >= LEAST_GAIN else before)


def _moved(fit: Fit) -> Iterator[Finding]:
    pairs = zip(fit.study.data, fit.scores, strict=True)
    good = all(s.relative_error() <= GOOD_FIT for d, s in pairs if d.role is Role.FIT)
    if good or not fit.cost >= (1.0 - BARELY) * fit.start_cost:
        return
    yield make_finding(
        "moved",
        fit.study.title,
        f"{_fall(fit)}: the free parameters cannot explain the data; check the data's units and operating point, and "
        "free parameters that they depend on.",
    )


def _fall(fit: Fit) -> str:
    start, end = f"{fit.start_cost:.4g}", f"{fit.cost:.4g}"
    if start == end:
        return f"J is {start} at the start and at the end"
    return f"J fell only from {start} to {end}, by less than {100.0 * BARELY:g} %"


def _at_bounds(fit: Fit) -> Iterator[Finding]:
    parameters = fit.study.space.parameters
    names = [p.name for p in parameters if p.is_at_bound(fit.best[p.name])]
    if len(names) > AT_BOUNDS * len(parameters):
        yield make_finding(
            "bounds",
            fit.study.title,
            f"{len(names)} of {len(parameters)} free parameters end at a bound ({', '.join(names)}): the data pull "
            "beyond what the bounds admit; check the data's units and operating point, then widen the bounds.",
        )


def _shift(name: str, shift: Change) -> Iterator[Finding]:
    late = "later" if shift.amount > 0.0 else "earlier"
    yield make_finding(
        "shift",
        name,
        f"the data come {abs(shift.amount) * 1e6:.0f} µs {late} than the simulation: without that shift J would be "
        f"{shift.after:.4g} instead of {shift.before:.4g}; check the trigger's zero and the delay of the meter.",
    )


def _gain(data: DataSet, gain: Change, injector: Injector) -> Iterator[Finding]:
    density = 1e-3 * reference_density(injector, data.points[0])
    yield make_finding(
        "gain",
        data.name,
        f"the data lie {gain.amount:.3g} times as high as the simulation: without that gain J would be "
        f"{gain.after:.4g} instead of {gain.before:.4g}; "
        f"{_density_slip(gain.amount, density)}check unit and gain of the meter.",
    )


def _density_slip(gain: float, density: float, match: float = DENSITY_MATCH) -> str:
    """The mistake between mass and volume that makes such a gain; `density` in g/cm³, which is mg/mm³."""
    for factor, words in ((1.0 / density, "volumes (mm3) labelled as masses (mg)"), (density, "masses (mg) as mm3")):
        if abs(gain / factor - 1.0) <= match:
            return f"{words} would do that, at the fuel's {density:.3g} mg/mm³; "
    return ""


# Plausibility: what about a study, its data and its result is too odd to be believed without a look.


def of_settings(study: Study) -> tuple[Finding, ...]:
    """Findings about what a study says: no simulation is needed."""
    findings = [f for data in study.data for f in data_findings(data, study.injector)]
    findings += [*injector_findings(study.injector), *bounds_findings(study.space), *idle_findings(study)]
    if not {"valve.spring_preload", "valve.seat_diameter"} & set(study.space.names):  # else the fit changes it
        findings += valve_findings(study.injector, study.data)
    findings += [*step_findings(study), *unit_findings(study.data, study.injector)]
    return tuple(findings)


def of_values(study: Study, scores: Sequence[Score], of: str = "start values") -> tuple[Finding, ...]:
    """Findings about the data beside their simulation with values `of` the parameters, one score for each data set."""
    # the most likely values follow the noise of each set; only those of an evolution follow its weight
    shares = share_findings(study.data, scores, of) if study.method.is_evolution else ()
    return (*_start_findings(study, scores), *shares)


def _start_findings(study: Study, scores: Sequence[Score]) -> Iterator[Finding]:
    """Findings about each data set beside its simulation, and a delay in place of the onsets that it explains."""
    scored = list(_judged(study, scores))
    delays = common_delays(scored)
    delayed = {data.name for delay in delays for data in delay.curves}
    for data, score in scored:
        yield from (f for f in start_findings(data, score) if f.code != "onset" or data.name not in delayed)
    yield from (_delay(delay, study.title) for delay in delays)


def after_fit(fit: Fit, injector: Injector, before: Iterable[Finding] = ()) -> tuple[Finding, ...]:
    """Findings about a finished search and its calibrated injector, those about start values again with its values.

    `injector`: the calibrated one; `before`: what the settings tell already.
    """
    now = of_values(fit.study, fit.scores, "calibrated values")
    findings = [*fit_findings(fit), *valve_findings(injector, fit.study.data)]
    findings += _of_scores(fit.study, injector, fit.scores)
    return (*now, *_unknown(findings, (*before, *now)))


def of_model(study: Study, injector: Injector, scores: Sequence[Score], fitted: bool) -> tuple[Finding, ...]:
    """Findings about any injector on the data of a study.

    `scores`: of the injector, one for each data set; `fitted`: judge errors, shifts and gains too.
    """
    findings = [f for data in study.data for f in data_findings(data, injector)]
    findings += [*injector_findings(injector), *valve_findings(injector, study.data), *_start_findings(study, scores)]
    return tuple(findings) + (_unknown(_of_scores(study, injector, scores), findings) if fitted else ())


def _unknown(findings: Iterable[Finding], before: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings that those before do not tell already."""
    reported = {(f.code, f.subject) for f in before}
    # A quantity that is wrong by a factor makes a large error in any case.
    reported |= {("misfit", subject) for code, subject in reported if code == "quantity"}
    return tuple(f for f in findings if (f.code, f.subject) not in reported)


def _of_scores(study: Study, injector: Injector, scores: Sequence[Score]) -> list[Finding]:
    return [f for data, score in _judged(study, scores) for f in model_findings(data, score, injector)]


def _judged(study: Study, scores: Sequence[Score]) -> Iterable[tuple[DataSet, Score]]:
    """Data sets with their scores, without those that lack a signal or are upside down: all else follows from that."""
    for data, score in zip(study.data, scores, strict=True):
        if not any(signal_findings(data)):
            yield data, score
