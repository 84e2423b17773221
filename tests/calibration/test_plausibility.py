"""Plausibility of data, settings and fits: each check at its limit, on curves and maps made here."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.calibration.parameter import Parameter
from commonrail.calibration.plausibility import (
    LARGE_MISFIT,
    Finding,
    Fit,
    after_fit,
    best_gain,
    best_shift,
    common_delays,
    of_model,
    of_settings,
    of_values,
    onset,
)
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.data.base import Role
from commonrail.data.curves.data import RateData, RateScore
from commonrail.data.quantities.data import QuantityData, QuantityScore
from commonrail.engine.operating_point import OperatingPoint, Trace
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector, parameter_quantities
from commonrail.physics.law import Domain, Q
from commonrail.physics.meters import Meter
from commonrail.runs.fingerprint import TARGET

BOUNDS = 3e-6 * np.arange(521)
RNG = np.random.default_rng(5)
NOISE = 0.3e-6 * RNG.standard_normal(520)  # [m³/s]
POINT = OperatingPoint(160e6, 700e-6, horizon=1.56e-3)
QUANTITY = np.array([2.0, 12.0, 30.0, 60.0]) * 1e-9


def pulse(start: float = 350e-6, length: float = 1e-3, height: float = 50e-6) -> np.ndarray:
    """Samples of a trapezoid [m³/s] with flanks of 150 us."""
    time = 0.5 * (BOUNDS[1:] + BOUNDS[:-1]) - start
    return height * np.clip(np.minimum(time, length - time) / 150e-6, 0.0, 1.0)


def curve(rate: np.ndarray, point: OperatingPoint = POINT, **changes: Any) -> RateData:
    """An injection curve to fit."""
    return replace(RateData("EVI", Role.FIT, point, BOUNDS, rate, 1.0, "bench", ""), **changes)


def map_(quantity: np.ndarray = QUANTITY, **changes: Any) -> QuantityData:
    """A map of four points to fit."""
    points = tuple(OperatingPoint(80e6, t) for t in (300e-6, 500e-6, 700e-6, 1000e-6))
    dead = np.zeros(4, bool)
    return replace(QuantityData("map", Role.FIT, points, quantity, 2e-10, 0.05, dead, 1.0, "bench", ""), **changes)


def scored(data: RateData | QuantityData, simulated: np.ndarray) -> RateScore | QuantityScore:
    """Score of a simulation that gave these values."""
    if isinstance(data, RateData):
        return RateScore(data, simulated)
    return QuantityScore(data, simulated, np.empty(0))


def parameter(name: str = "valve.spring_preload", lower: float = 60.0, upper: float = 90.0) -> Parameter:
    unit = parameter_quantities()[name].unit
    return Parameter(name, 0.5 * (lower + upper), lower, upper, unit, mark="E", source="here")


def study(injector: Injector, *data: RateData | QuantityData, free: tuple[Parameter, ...] = (parameter(),)) -> Study:
    return Study("Title", injector, data, Space(list(free)), Method(), 1, 1e-6)


def codes(findings: tuple[Finding, ...]) -> list[str]:
    return [finding.code for finding in findings]


def of_data(injector: Injector, data: RateData | QuantityData) -> list[str]:
    return codes(of_settings(study(injector, data)))


def at_start(injector: Injector, data: RateData | QuantityData, simulated: np.ndarray) -> tuple[Finding, ...]:
    return of_values(study(injector, data), [scored(data, simulated)])


def fitted(
    injector: Injector, data: RateData | QuantityData, simulated: np.ndarray, start: float = 1e6, best: float = 75.0
) -> tuple[Finding, ...]:
    """Findings after a fit whose J fell from `start` to that of the simulation."""
    score = scored(data, simulated)
    cost = score.j if isinstance(score, RateScore) else 1.0
    fit = Fit(study(injector, data), {"valve.spring_preload": best}, start, cost, [score])
    return after_fit(fit, injector)


def test_sound_data_and_a_sound_fit_give_no_warning(pwm: Injector) -> None:
    data = [curve(pulse() + NOISE, weight=0.01), map_()]
    whole = study(pwm, *data)
    # a start 20 % and 60 us off, a fit 2 % and 5 us off
    start = [scored(data[0], pulse(410e-6, height=40e-6)), scored(data[1], 1.3 * QUANTITY)]
    best = [scored(data[0], pulse(355e-6, height=49e-6)), scored(data[1], 1.02 * QUANTITY)]
    assert of_settings(whole) == ()
    assert of_values(study(pwm, data[0]), start[:1]) == of_values(study(pwm, data[1]), start[1:]) == ()
    assert after_fit(Fit(whole, {"valve.spring_preload": 75.0}, 1e4, 5.0, best), pwm) == ()
    assert of_model(whole, pwm, best, fitted=True) == ()


@pytest.mark.parametrize(
    ("rate", "code"),
    [
        (-(pulse() + NOISE), "sign"),
        (pulse(height=20e-6) - 30e-6, "sign"),  # an offset
        (np.zeros(520), "constant"),
        (np.full(520, 7e-6), "constant"),
    ],
)
def test_a_curve_without_a_signal_or_upside_down(pwm: Injector, rate: np.ndarray, code: str) -> None:
    assert of_data(pwm, curve(rate)) == [code]
    assert at_start(pwm, curve(rate), pulse()) == ()  # all else would follow from that


@pytest.mark.parametrize(("quantity", "code"), [(-QUANTITY, "sign"), (0.0 * QUANTITY, "constant")])
def test_a_map_without_a_signal_or_upside_down(pwm: Injector, quantity: np.ndarray, code: str) -> None:
    assert of_data(pwm, map_(quantity)) == [code]


def test_a_small_pilot_in_much_noise_has_a_sign(pwm: Injector) -> None:
    assert of_data(pwm, curve(pulse(length=301e-6, height=3e-6) + NOISE)) == []


@pytest.mark.parametrize(
    ("duration", "odd"), [(0.7e-6, 1), (49e-6, 1), (50e-6, 0), (10e-3, 0), (10.1e-3, 1), (0.07, 1)]
)
def test_energising_time(pwm: Injector, duration: float, odd: int) -> None:
    data = curve(pulse(), OperatingPoint(160e6, duration, horizon=1.56e-3))
    assert of_data(pwm, data) == ["energising"] * odd


@pytest.mark.parametrize(("scale", "odd"), [(1e-3, 1), (0.02, 0), (300.0, 0), (1e3, 1)])
def test_times_between_samples(pwm: Injector, scale: float, odd: int) -> None:
    assert of_data(pwm, curve(pulse(), bounds=scale * BOUNDS)) == ["sampling"] * odd


@pytest.mark.parametrize(("peak", "odd"), [(20.0, 0), (20e3, 1), (0.02, 1)])
def test_a_measured_drive(by_current: Injector, by_voltage: Injector, pwm: Injector, peak: float, odd: int) -> None:
    trace = Trace((0.0, 100e-6, 700e-6), (0.0, peak, 0.5 * peak))
    data = curve(pulse(), replace(POINT, drive=trace))
    assert of_data(by_current, data) == of_data(by_voltage, data) == ["drive"] * odd
    assert of_data(pwm, data) == []


@pytest.mark.parametrize(
    ("point", "words"),
    [
        (OperatingPoint(1.6e6, 700e-6, 1e6), "pressure is 1.6 MPa"),
        (OperatingPoint(450e6, 700e-6), "rail pressure is 450 MPa"),
        (OperatingPoint(Trace((0.0, 1e-3), (1.5e6, 1.7e6)), 700e-6, 1e6), "pressure is 1.6 MPa"),
        (OperatingPoint(160e6, 700e-6, 50e6), "cylinder pressure is 50 MPa, and 50 kPa to 30 MPa"),
        (OperatingPoint(160e6, 700e-6, 20e3), "cylinder pressure is 20 kPa"),
        (OperatingPoint(160e6, 700e-6, 5e6, 10e6), "return pressure is 10 MPa"),
    ],
)
def test_pressures(pwm: Injector, point: OperatingPoint, words: str) -> None:
    (finding,) = of_settings(study(pwm, curve(pulse(), point)))
    assert finding.code == "pressure"
    assert words in finding.sentence


def test_the_points_of_a_map_make_one_finding(pwm: Injector) -> None:
    points = tuple(OperatingPoint(80e6, t) for t in (300e-9, 500e-9, 700e-9, 1000e-6))
    (finding,) = of_settings(study(pwm, map_(points=points)))
    assert finding.code == "energising"
    assert "300 ns (and 2" in finding.sentence


def test_a_closed_injector_among_the_points_is_not_odd(pwm: Injector) -> None:
    points = tuple(OperatingPoint(80e6, t) for t in (0.0, 500e-6, 700e-6, 1000e-6))
    assert of_settings(study(pwm, map_(points=points))) == ()


def test_a_parameter_outside_what_its_part_calls_usual(pwm: Injector) -> None:
    (finding,) = of_settings(study(pwm.with_values({"valve.lift": 55e-3}), curve(pulse())))
    assert (finding.code, finding.subject) == ("parameter", "valve.lift")
    assert re.search(r"\b55 mm, .*5 µm to 1 mm", finding.sentence)


@pytest.mark.parametrize(("upper", "odd"), [(9e-3, 0), (11e-3, 1)])
def test_bounds_may_lie_ten_times_outside(pwm: Injector, upper: float, odd: int) -> None:
    free = (parameter("valve.lift", 40e-6, upper),)
    assert codes(of_settings(study(pwm, curve(pulse()), free=free))) == ["parameter_bound"] * odd


def test_a_spring_that_hardly_holds_the_valve_is_named_of_fixed_and_of_calibrated_values(pwm: Injector) -> None:
    free, seat = (parameter("valve.lift", 40e-6, 60e-6),), pwm.values["valve.seat_diameter"]
    for holds, warns in ((1.05 * 160e6, ["valve"]), (1.15 * 160e6, [])):  # to both sides of a reserve of a tenth
        injector = pwm.with_values({"valve.spring_preload": holds * 0.25 * np.pi * seat**2})
        assert codes(of_settings(study(injector, curve(pulse()), free=free))) == warns
        assert of_settings(study(injector, curve(pulse()))) == ()  # a free spring is the fit's to find
        assert codes(fitted(injector, curve(pulse()), pulse())) == warns


def test_the_pressure_that_a_valve_holds_is_that_of_the_simulation(pwm: Injector) -> None:
    holds = pwm.values["valve.spring_preload"] / (0.25 * np.pi * pwm.values["valve.seat_diameter"] ** 2)
    low = pwm.values["valve.spring_preload"] * 150e6 / holds
    injector = pwm.with_values({"valve.spring_preload": low})
    lifts = [
        simulate(injector, OperatingPoint(rail, 0.0, horizon=0.5e-3)).channels["valve_lift"].max()
        for rail in (147e6, 156e6)
    ]
    assert lifts[0] < 1e-6 < lifts[1]  # the pressure of the return line and the seat's elasticity are 1 % each


def test_zero_switches_an_effect_off_and_is_usual() -> None:
    assert Q("m", "gap", Domain.NON_NEGATIVE, usual=(1e-6, 1e-5)).is_usual(0.0)
    assert not Q("m", "gap", usual=(1e-6, 1e-5)).is_usual(0.0)
    offset = Q("m", "offset", Domain.ANY, usual=(-1e-3, 1e-3))
    assert [offset.is_usual(x, 10.0) for x in (-9e-3, 9e-3, -11e-3, 11e-3)] == [True, True, False, False]


@pytest.mark.parametrize("name", ["pwm", "cri2-16", "direct-acting-kr"])
def test_a_unit_mistaken_by_a_thousand_leaves_the_usual_range(name: str, pwm: Injector) -> None:
    """Of every length, volume, force, stiffness, pressure, voltage and current of the catalogue."""
    from commonrail.readers.injector import load_injector

    injector = pwm if name == "pwm" else load_injector(name)
    judged = 0
    for path, q in injector.quantities.items():
        value = injector.values[path]
        if q.usual is None:
            assert q.unit in ("1", "K", "T", "s/m", "N s/m", "V/A"), path
            continue
        assert q.is_usual(value), path
        if value != 0.0 and q.domain not in (Domain.ANY, Domain.CHANGE) and q.unit != "rad":
            assert not q.is_usual(1e3 * value), path
            assert not q.is_usual(1e-3 * value), path
            judged += 1
    assert judged > (20 if name == "direct-acting-kr" else 50)


@pytest.mark.parametrize(("factor", "odd"), [(2.9, 0), (3.1, 1), (1 / 2.9, 0), (1 / 3.1, 1)])
def test_quantity_within_a_factor_of_three(pwm: Injector, factor: float, odd: int) -> None:
    assert codes(at_start(pwm, curve(factor * pulse()), pulse())) == ["quantity"] * odd
    assert codes(at_start(pwm, map_(factor * QUANTITY), QUANTITY)) == ["quantity"] * odd


def test_a_slip_of_units_is_named(pwm: Injector) -> None:
    (finding,) = at_start(pwm, curve(pulse() / 0.06), pulse())
    assert re.search(r"16\.7 times; mm3/ms .*L/min", finding.sentence)
    (finding,) = at_start(pwm, curve(1e-3 * pulse()), 1.2 * pulse())
    assert re.search(r"factor .*1000 .*units", finding.sentence)


def test_a_pilot_less_than_a_cubic_millimetre_apart_is_no_matter(pwm: Injector) -> None:
    small = 1e-9 * QUANTITY / QUANTITY.max()
    assert at_start(pwm, map_(small), 0.1 * small) == ()


def test_a_row_mistyped_is_told_with_its_number(pwm: Injector) -> None:
    typed = QUANTITY * [1.0, 10.0, 1.0, 1.0]
    (finding,) = at_start(pwm, map_(typed), QUANTITY)
    assert re.search("measured .* 120 mm³, .*simulated .* 12 mm³ at 1 of 4 .* 2: ", finding.sentence)


def test_a_point_that_reads_zero_is_told(pwm: Injector) -> None:
    (finding,) = at_start(pwm, map_(QUANTITY * [1.0, 0.0, 1.0, 1.0]), QUANTITY)
    assert re.search(r"measured .* 0 mm³, .*simulated .* 12 mm³ at 1 of 4", finding.sentence)


def test_start_values_that_inject_nothing_or_fail(pwm: Injector) -> None:
    (finding,) = at_start(pwm, curve(pulse()), 0.0 * pulse())
    assert finding.code == "quantity"
    assert re.search(r"simulated .* 0 mm³", finding.sentence)
    assert codes(at_start(pwm, curve(pulse()), np.nan * pulse())) == ["start"]
    assert codes(at_start(pwm, map_(), np.nan * QUANTITY)) == ["start"]
    assert at_start(pwm, map_(), np.where(QUANTITY > 5e-8, np.nan, QUANTITY)) == ()


@pytest.mark.parametrize(("begin", "odd"), [(-100e-6, 1), (150e-6, 0), (380e-6, 0), (640e-6, 0), (700e-6, 1)])
def test_onset_against_energising_and_against_the_simulation(pwm: Injector, begin: float, odd: int) -> None:
    """The simulated injection begins at 350 us, energising at 0."""
    found = at_start(pwm, curve(pulse(begin, 600e-6) + NOISE), pulse(length=600e-6))
    assert codes(found) == ["onset"] * odd


def test_a_drift_of_the_meter_is_no_onset() -> None:
    """0.4 mm³/ms over the 350 us before the injection: 0.1 mm³, 0.3 % of it."""
    drift = np.where(BOUNDS[1:] < 350e-6, 0.4e-6, 0.0)
    assert onset(pulse() + NOISE + drift, BOUNDS) == pytest.approx(onset(pulse(), BOUNDS), abs=20e-6)


def test_an_onset_before_energising_says_so(pwm: Injector) -> None:
    late = OperatingPoint(160e6, [(600e-6, 700e-6)], horizon=1.56e-3)
    (finding,) = at_start(pwm, curve(pulse(), late), pulse())
    assert re.search(r"600 µs: .*\bsoon", finding.sentence)


def test_an_onset_long_after_energising_says_so(pwm: Injector) -> None:
    early = OperatingPoint(160e6, [(-3e-3, 700e-6)], start=-3e-3, horizon=4.56e-3)
    (finding,) = at_start(pwm, curve(pulse(), early), pulse())
    assert "too late" in finding.sentence


def at_pressures(injector: Injector, late: tuple[float, ...], meter: Meter | None = None) -> tuple[Finding, ...]:
    """Findings about curves at 50, 100 … MPa that begin later than the simulated ones."""
    data = [
        curve(pulse(350e-6 + shift, 600e-6), replace(POINT, rail_pressure=50e6 * k), name=f"curve {k}", meter=meter)
        for k, shift in enumerate(late, 1)
    ]
    return of_values(study(injector, *data), [scored(one, pulse(length=600e-6)) for one in data])


@pytest.mark.parametrize(
    ("late", "subjects"),
    [
        ((200e-6, 170e-6, 230e-6), ["Title"]),
        ((-200e-6, -180e-6), ["Title"]),
        ((340e-6, 330e-6), ["Title"]),  # in place of two onsets
        ((200e-6,), []),  # of one pressure
        ((140e-6, 130e-6), []),  # as drawings miss it
        ((320e-6, 20e-6), ["curve 1"]),
    ],
)
def test_one_delay_is_said_of_curves_that_share_it(pwm: Injector, late: tuple[float, ...], subjects: list[str]) -> None:
    findings = at_pressures(pwm, late)
    assert [finding.subject for finding in findings] == subjects
    assert codes(findings) == ["onset"] * len(subjects)


def test_a_delay_starts_from_what_its_meter_has() -> None:
    meter = Meter("evi", {"delay": "50 us"})
    data = [curve(pulse(550e-6), replace(POINT, rail_pressure=p), meter=meter) for p in (50e6, 100e6)]
    (delay,) = common_delays([(one, scored(one, pulse())) for one in data])
    read = tomllib.loads(f"delay = {delay.text()}")["delay"]
    assert read == {"lower": "50 us", "upper": "450 us", "start": "250 us"}


def test_one_set_that_makes_all_of_j_is_told(pwm: Injector) -> None:
    first, second = curve(pulse()), map_()
    scores = [scored(first, 1.2 * pulse()), scored(second, 1.2 * QUANTITY)]
    (finding,) = of_values(study(pwm, first, second), scores)
    assert (finding.code, finding.subject) == ("share", "EVI")
    weighted = replace(first, weight=0.01)
    assert of_values(study(pwm, weighted, second), scores) == ()
    twins = [replace(first, rate=f * pulse()) for f in (1.0, 1.1)]  # of one name, as a study made in Python may have
    assert codes(of_values(study(pwm, *twins), [scored(d, 1.1 * pulse()) for d in twins])) == ["share"]
    check = replace(second, role=Role.VALIDATION)
    assert of_values(study(pwm, first, check), scores) == ()
    met = [scores[0], scored(second, 1.02 * QUANTITY)]  # within its tolerance of 5 %: nothing is neglected
    assert of_values(study(pwm, first, second), met) == ()


def test_a_set_that_makes_nothing_of_j_is_told_if_no_other_makes_all(pwm: Injector) -> None:
    data = [curve(pulse(), name=name) for name in "abc"]
    scores = [scored(d, f * pulse()) for d, f in zip(data, (1.2, 1.2, 1.001), strict=True)]
    (finding,) = of_values(study(pwm, *data), scores)
    assert (finding.code, finding.subject) == ("share", "c")
    scores[2] = scored(data[2], 1.01 * pulse())  # 2.4 % of J
    assert of_values(study(pwm, *data), scores) == ()
    many = [curve(pulse(), name=str(i)) for i in range(120)]
    assert of_values(study(pwm, *many), [scored(d, 1.2 * pulse()) for d in many]) == ()


@pytest.mark.parametrize(("fall", "odd"), [(1.0, 1), (1.009, 1), (1.02, 0)])
def test_a_fit_that_barely_moved(pwm: Injector, fall: float, odd: int) -> None:
    data, simulated = curve(pulse() + NOISE), pulse(length=1.1e-3)  # 9 % off, which neither shift nor gain mends
    j = float(data.misfit(simulated))
    assert codes(fitted(pwm, data, simulated, start=fall * j)) == ["moved"] * odd


def test_a_fall_that_rounds_to_nothing_is_not_called_one(pwm: Injector) -> None:
    data, simulated = curve(pulse() + NOISE), pulse(length=1.1e-3)
    j = float(data.misfit(simulated))
    sentences = [fitted(pwm, data, simulated, start=fall * j)[0].sentence for fall in (1.0 + 1e-9, 1.009)]
    assert f"J is {j:.4g} at the start and at the end: the free parameters" in sentences[0]
    assert "only from" in sentences[1]


def test_good_start_values_need_not_move(pwm: Injector) -> None:
    data, simulated = curve(pulse() + NOISE), pulse(length=1.02e-3)
    assert fitted(pwm, data, simulated, start=float(data.misfit(simulated))) == ()


@pytest.mark.parametrize(("length", "odd"), [(750e-6, 0), (650e-6, 1)])
def test_a_large_error_is_told(pwm: Injector, length: float, odd: int) -> None:
    assert codes(fitted(pwm, curve(pulse()), pulse(length=length))).count("misfit") == odd


def test_noise_is_no_error(pwm: Injector) -> None:
    """A pilot of 0.5 mm³ in noise whose absolute values sum up to twice that."""
    pilot = pulse(length=310e-6, height=3e-6)
    data = curve(pilot + 3.0 * NOISE)
    assert data.misfit(pilot) > 2.0 * np.sum(pilot) * 1e6
    assert RateScore(data, pilot).relative_error() < LARGE_MISFIT
    assert fitted(pwm, data, pilot) == ()


@pytest.mark.parametrize("shift", [-35e-6, 35e-6, 300e-6, -300e-6])
def test_a_shift_that_halves_j_is_told_with_its_size(pwm: Injector, shift: float) -> None:
    data = curve(pulse(350e-6 + shift, 700e-6) + NOISE)
    simulated = pulse(length=700e-6)
    found = best_shift(data, RateScore(data, simulated))
    assert found.amount == pytest.approx(shift, abs=1e-6)  # the step of the search
    assert found.after == pytest.approx(float(data.misfit(pulse(350e-6 + shift, 700e-6))), rel=0.05)
    (finding,) = (f for f in fitted(pwm, data, simulated) if f.code == "shift")
    assert f"come {abs(shift) * 1e6:.0f} µs {'later' if shift > 0.0 else 'earlier'}" in finding.sentence


def test_a_shift_within_what_triggers_know_is_not_told(pwm: Injector) -> None:
    assert fitted(pwm, curve(pulse(365e-6)), pulse()) == ()
    assert codes(fitted(pwm, curve(pulse(375e-6)), pulse())) == ["shift"]


@pytest.mark.parametrize(("gain", "odd"), [(1.04, 0), (1.10, 1), (0.9, 1), (4.0, 1)])
def test_a_gain_that_halves_j_is_told(pwm: Injector, gain: float, odd: int) -> None:
    for data, simulated in ((curve(gain * pulse() + NOISE), pulse()), (map_(gain * QUANTITY), QUANTITY)):
        # half of the step of the map's search
        assert best_gain(data, scored(data, simulated)).amount == pytest.approx(gain, rel=0.006)
        assert codes(fitted(pwm, data, simulated)).count("gain") == odd


def test_a_gain_that_explains_only_a_part_is_not_told(pwm: Injector) -> None:
    data, simulated = curve(1.1 * pulse(length=1.1e-3)), pulse()
    found = best_gain(data, scored(data, simulated))
    assert 0.5 * found.before < found.after < 0.8 * found.before
    assert "gain" not in codes(fitted(pwm, data, simulated))


def test_a_gain_as_large_as_the_density_is_named(pwm: Injector) -> None:
    density = 0.787  # of the fuel at 5 MPa and 80 °C [mg/mm³]
    (finding,) = fitted(pwm, curve(pulse() / density), pulse())
    assert re.search(r"\(mm3\) .*\(mg\) .*0\.787 mg/mm³", finding.sentence)
    (finding,) = fitted(pwm, curve(pulse() * density), pulse())
    assert re.search(r"\(mg\) as mm3", finding.sentence)
    (finding,) = fitted(pwm, curve(pulse() * 1.1), pulse())
    assert "would do" not in finding.sentence


def test_dead_times_and_failed_points_take_no_part_in_a_gain(pwm: Injector) -> None:
    dead = np.array([True, False, False, False])
    data = map_(1.2 * QUANTITY, dead_time=dead)
    simulated = np.array([9e-9, 12e-9, 30e-9, np.nan])
    assert best_gain(data, scored(data, simulated)).amount == pytest.approx(1.2, rel=0.006)


def test_parameters_at_their_bounds(pwm: Injector) -> None:
    free = (parameter(), parameter("plunger_needle.spring_preload", 20.0, 40.0))
    data = curve(pulse())
    own = study(pwm, data, free=free)

    def found(first: float, second: float) -> list[str]:
        best = {free[0].name: first, free[1].name: second}
        return codes(after_fit(Fit(own, best, 1e6, 0.0, [scored(data, pulse())]), pwm))

    assert found(60.1, 39.9) == ["bounds"]
    assert found(60.1, 30.0) == []


def test_findings_about_the_start_are_those_of_the_calibrated_values_after_the_fit(pwm: Injector) -> None:
    """A quantity ten times too small at the start says nothing of a fit that meets it; one that does not is told."""
    data, start = curve(10.0 * pulse()), pulse()
    own = study(pwm, data)
    assert codes(of_values(own, [scored(data, start)])) == ["quantity"]
    for fitted, told in ((10.0 * pulse(), []), (start, ["quantity"])):  # an error by a factor is no other finding
        fit = Fit(own, {"valve.spring_preload": 75.0}, 1e9, 1.0, [scored(data, fitted)])
        assert codes(after_fit(fit, pwm)) == told


def test_an_uncalibrated_model_is_not_judged_as_a_fit(pwm: Injector) -> None:
    data = curve(1.5 * pulse())
    scores = [scored(data, pulse())]
    assert codes(of_model(study(pwm, data), pwm, scores, fitted=True)) == ["misfit", "gain"]
    assert of_model(study(pwm, data), pwm, scores, fitted=False) == ()


def test_a_sentence_is_one_line_whatever_a_data_set_is_called(pwm: Injector) -> None:
    (finding,) = of_settings(study(pwm, curve(0.0 * pulse(), name="a\n\x1b[31mb")))
    assert finding.sentence.startswith("a [31mb: all 520 values")


def test_the_page_tells_every_code() -> None:
    root = Path(__file__).resolve().parents[2]
    sources = [root / "src/commonrail/calibration/plausibility.py"]
    codes = {
        code
        for path in sources
        for code in re.findall(r'(?:make_finding|_unusual)\(\s*"(\w+)"', path.read_text(encoding="utf-8"))
    }
    told = set(re.findall(r"(?m)^\| `(\w+)` \| ", (root / "docs/howto/plausibility.md").read_text(encoding="utf-8")))
    assert codes
    assert codes | {TARGET} == told - {"compare", "fleet"}


def test_a_film_without_a_disc_is_told_of_where_it_is_fixed_or_free(pwm: Injector) -> None:
    film, disc = parameter("valve.stop_film", 2e-6, 20e-6), parameter("valve.stop_disc", 1e-3, 4e-3)
    both = study(pwm, curve(pulse()), free=(film, disc))
    assert of_settings(both) == ()
    (finding,) = of_settings(study(pwm, curve(pulse()), free=(film,)))
    assert finding.subject == "valve.stop_film"
    (finding,) = of_settings(replace(study(pwm, curve(pulse())), fixed=("valve.seat_film",)))
    assert finding.subject == "valve.seat_film"
