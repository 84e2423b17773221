"""Energising times of trains: quantities by a simulation of their own, in a closed loop, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.engine.operating_point import Energising, OperatingPoint
from commonrail.engine.simulate import simulate
from commonrail.physics.injector import Injector
from commonrail.plugins.observer.compensation import LONGEST, compensate
from commonrail.plugins.observer.file import Compensated, Memory, Observation, ObservedShot
from commonrail.plugins.observer.kalman import Belief, StepTest
from commonrail.plugins.observer.response import find_cuts, find_figures
from commonrail.plugins.observer.run import observe
from commonrail.plugins.observer.study import InjectionTrain, ObserverSettings
from commonrail.plugins.observer.verb import _Wanted
from tests.cli.conftest import Command, check_made_again

RATE, CYCLE = 50e3, 15e-3
RAIL = 140e6
PILOT, MAIN = 4e-9, 12e-9
DWELLS = (0.25e-3, 0.4e-3, 1e-3)
TRAINS = [InjectionTrain(RAIL, (PILOT, MAIN), (dwell,)) for dwell in DWELLS]


def shot(injector: Injector, pulses: tuple[Energising, ...]) -> tuple[Floats, Floats, Floats]:
    """Times [s], rail pressure [Pa] and quantities (injections,) [m³] of a train, at half the observer's step."""
    point = OperatingPoint(RAIL, pulses, horizon=pulses[-1].start + pulses[-1].duration + 2.2e-3)
    found = simulate(injector, point, time_step=0.5e-6)
    figures = find_figures(found.time, found.injected, find_cuts(found.time, found.injected, pulses))
    return found.time, found.channels["rail_pressure"], figures[0] / found.reference_density


def log_of(
    injector: Injector, trains: list[Compensated], seed: int
) -> tuple[Floats, Floats, list[tuple[float, float]]]:
    """Log of trains, with 0.05 MPa of noise."""
    time = np.asarray(np.arange(round((len(trains) * CYCLE + 4e-3) * RATE)) / RATE, float)
    pressure, pulses = np.full_like(time, RAIL), []
    for k, train in enumerate(trains):
        start = 4e-3 + k * CYCLE
        clock, course, _ = shot(injector, train.energisings)
        own = (time >= start - 7e-3) if k else time >= 0.0
        pressure[own] = np.interp(time[own] - start, clock, course)
        pulses += [(start + a, b) for a, b in train.energisings]
    return time, pressure + 0.05e6 * np.random.default_rng(seed).standard_normal(len(time)), pulses


@pytest.fixture(scope="module")
def part(rigid_volume: Injector) -> Injector:
    """A part with 6 % more nozzle flow and a weaker valve spring, whose main injection follows pilots otherwise."""
    values = rigid_volume.values
    hole, spring = "nozzle.hole_diameter", "valve.spring_preload"
    return rigid_volume.with_values({hole: values[hole] * 1.06**0.5, spring: values[spring] * 0.97})


@pytest.fixture(scope="module")
def mapped(rigid_volume: Injector) -> list[Compensated]:
    """Trains by the model without an observer: a map over the dwell."""
    return compensate(rigid_volume, TRAINS, threads=1)


@pytest.fixture(scope="module")
def observed(rigid_volume: Injector, part: Injector, mapped: list[Compensated]) -> Observation:
    """Observation of the part with the times of the map, each train twice."""
    return observe(rigid_volume, *log_of(part, 2 * mapped, 1), threads=1)


def test_trains_deliver_their_quantities_whatever_the_dwell(rigid_volume: Injector, mapped: list[Compensated]) -> None:
    """Against `simulate`: pilot alone, and pilot and main together; without compensation the dwell moves the main."""
    for train in mapped:
        assert train.met
        first, second = train.energisings
        assert second.start - first.duration == pytest.approx(train.train.dwells[0])
        both = simulate(rigid_volume, OperatingPoint(RAIL, train.energisings))
        pilot = simulate(rigid_volume, OperatingPoint(RAIL, first.duration))
        # quantities are met to 0.1 % each; the horizon of 2 ms leaves a little
        assert both.injected_volume == pytest.approx(PILOT + MAIN, rel=2e-3)
        assert pilot.injected_volume == pytest.approx(PILOT, rel=2e-3)
        alone = simulate(rigid_volume, OperatingPoint(RAIL, float(train.plain_times[1])))
        assert alone.injected_volume == pytest.approx(MAIN, rel=2e-3)
    plain = np.array([train.plain_quantities for train in mapped])
    assert np.ptp(plain[:, 1]) > 0.05 * MAIN


def test_observed_states_bring_the_part_nearer_than_the_map(
    part: Injector, mapped: list[Compensated], observed: Observation
) -> None:
    """Main quantities of the part: mean and spread over the dwell, with times of the map and of the observation."""
    closed = compensate(observed, TRAINS, threads=1)
    off, now = (np.array([shot(part, one.energisings)[2] for one in each]) - [PILOT, MAIN] for each in (mapped, closed))
    assert np.ptp(off[:, 1]) > 0.05 * MAIN
    assert np.ptp(now[:, 1]) < 0.5 * np.ptp(off[:, 1])
    assert np.all(np.abs(now).max(axis=0) < 0.5 * np.abs(off).max(axis=0))


def test_times_go_half_of_the_way_from_the_present_ones(observed: Observation, mapped: list[Compensated]) -> None:
    whole, half = compensate(observed, TRAINS, threads=1), compensate(observed, TRAINS, last=mapped, threads=1)
    for one, two, present in zip(whole, half, mapped, strict=True):
        assert one.energising_times[1] != pytest.approx(present.energising_times[1], rel=1e-3)
        between = 0.5 * (one.energising_times + present.energising_times)
        assert two.energising_times == pytest.approx(between, rel=1e-9)
        assert abs(two.quantities[1] - MAIN) > 1e-3 * MAIN  # those of the times that are given
    with pytest.raises(ConfigurationError, match="`last`"):
        compensate(observed, TRAINS, last=mapped[:2])


def test_the_sensor_shows_the_rail_pressure_that_is_wanted(rigid_volume: Injector, observed: Observation) -> None:
    """With a sensor known to show 5 MPa more the times are those of a rail 5 MPa lower."""
    names = [state.name for state in observed.settings.states]
    mean = np.where([name == "sensor offset" for name in names], 5e6, 0.0)
    shifted = replace(observed, memory=observed.memory._replace(belief=observed.memory.belief._replace(mean=mean)))
    (found,) = compensate(shifted, [TRAINS[0]], threads=1)
    (lower,) = compensate(rigid_volume, [replace(TRAINS[0], rail_pressure=RAIL - 5e6)], threads=1)
    assert found.energising_times == pytest.approx(lower.energising_times, abs=0.3e-6)  # of 0.1 % of a quantity


def test_an_observation_goes_on_with_the_next_log(
    rigid_volume: Injector, part: Injector, mapped: list[Compensated], observed: Observation
) -> None:
    """Two halves of a log, one after the other, give what the whole gives to a filter."""
    states = observed.settings.states
    first = Belief.before(states)
    fresh = Memory(first, StepTest(states, 20, 4.0), 0, first)
    time, pressure, pulses = log_of(part, 2 * mapped, 1)
    half = 4e-3 + 3 * CYCLE - 6e-3  # between the shots
    before = replace(observed, memory=fresh, settings=replace(observed.settings, horizon=1))
    at_once, found = observe(rigid_volume, time, pressure, pulses, previous=before), list[ObservedShot]()
    for own, count in ((time < half, slice(0, 6)), (time >= half, slice(6, 12))):
        before = observe(rigid_volume, time[own], pressure[own], pulses[count], previous=before, threads=1)
        found += before.shots
    assert before.memory.shots == 6
    for one, whole in zip(found, at_once.shots, strict=True):
        assert one.figures is not None
        assert one.figures == pytest.approx(whole.figures, rel=1e-9)
    with pytest.raises(ConfigurationError, match="no settings"):
        observe(rigid_volume, time, pressure, pulses, ObserverSettings(), previous=before)


def test_what_cannot_be_delivered_is_marked(rigid_volume: Injector) -> None:
    wanted = [InjectionTrain(RAIL, (PILOT, 0.9e-6), ("0.7 ms",)), TRAINS[1]]
    with pytest.warns(RuntimeWarning, match=r"^1 of 2 trains"):
        found = compensate(rigid_volume, wanted, threads=1)
    assert [one.met for one in found] == [False, True]
    assert found[0].quantities[0] == pytest.approx(PILOT, rel=2e-3)
    # more than any time delivers: the longest that was tried, from which `last` does not go back
    assert found[0].energising_times[1] > 0.9 * LONGEST
    with pytest.warns(RuntimeWarning, match=r"^1 of 2 trains"):
        again = compensate(rigid_volume, wanted, last=found, threads=1)
    assert again[0].energising_times == pytest.approx(found[0].energising_times, rel=1e-3)


def test_wrong_trains_are_refused_in_a_sentence(rigid_volume: Injector, observed: Observation) -> None:
    with pytest.raises(ConfigurationError, match=r"\b2 quantities .*\b0 dwells"):
        InjectionTrain(RAIL, (PILOT, MAIN))
    with pytest.raises(ConfigurationError, match="mm3"):
        InjectionTrain(RAIL, (20.0,))
    with pytest.raises(ConfigurationError, match="trains"):
        compensate(rigid_volume, [TRAINS[0], InjectionTrain(RAIL, (MAIN,))])
    with pytest.raises(ConfigurationError, match="trains"):
        compensate(rigid_volume, [])
    with pytest.raises(ConfigurationError, match="`settings`"):
        compensate(observed, TRAINS, ObserverSettings())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"train": replace(TRAINS[0], rail_pressure=60e6)}, "within 5 %"),
        ({"train": replace(TRAINS[0], dwells=(0.5e-3,))}, "dwells"),
        ({"train": None}, "InjectionTrain"),
        ({"energising_times": None}, "of last"),
        ({"energising_times": np.array([1e-4, np.nan])}, "finite"),
        ({"energising_times": np.array([1e-4, -1e-4])}, "between 0 s and"),
        ({"energising_times": np.array([1e-4])}, "`last`"),
    ],
)
def test_a_last_compensation_of_other_trains_is_refused(
    rigid_volume: Injector, mapped: list[Compensated], change: dict[str, Any], words: str
) -> None:
    with pytest.raises(ConfigurationError, match=words):
        compensate(rigid_volume, TRAINS, last=[mapped[0]._replace(**change), *mapped[1:]], threads=1)
    near = [mapped[0]._replace(train=replace(TRAINS[0], rail_pressure=1.04 * RAIL))]
    assert compensate(rigid_volume, TRAINS[:1], last=near, threads=1)[0].met


@pytest.mark.parametrize(
    ("quantities", "dwells"), [("12 mm3", ()), (12e-9, ()), (None, ()), (("4 mm3", "12 mm3"), "1 ms")]
)
def test_a_train_that_is_no_list_says_how_to_write_one(quantities: Any, dwells: Any) -> None:
    with pytest.raises(ConfigurationError, match="list"):
        InjectionTrain(RAIL, quantities, dwells)


def test_masses_are_volumes_at_the_learnt_temperature(observed: Observation) -> None:
    """By 30 K more of the fuel the volume grows as its density in the cylinder falls."""
    with pytest.raises(InputError, match="5e\\+09 mg"):
        _Wanted.parse("5e9mg", None, None)
    wanted = _Wanted.parse("4,12 mg", "0.4ms", None)
    names = [state.name for state in observed.settings.states]
    mean = np.where([name == "fuel temperature" for name in names], 30.0, 0.0)
    warmer = replace(observed, memory=observed.memory._replace(belief=observed.memory.belief._replace(mean=mean)))
    (train,) = wanted.add_compensation(warmer, 1).compensation
    injector = observed.injector
    density = injector.fuel.density(observed.settings.cylinder_pressure, injector.values["fuel.temperature"] + 30.0)
    assert train.train.quantities == pytest.approx(np.array([4e-6, 12e-6]) / density)


def test_the_verb_gives_times_over_the_dwell(
    command: Command, tmp_path: Path, part: Injector, mapped: list[Compensated]
) -> None:
    time, pressure, pulses = log_of(part, mapped, 1)
    log, times, folder = tmp_path / "log.csv", tmp_path / "pulses.csv", tmp_path / "out"
    np.savetxt(log, np.column_stack([time, pressure]), "%.9g", ",", header="time [s],pressure [Pa]", comments="")
    np.savetxt(times, np.array(pulses), "%.9g", ",", header="start [s],duration [s]", comments="")
    options = ("--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa", "--energisings", times)
    line = ("observe", log, "--model", "virtual-lino-2016@rigid,volume,regulated", *options)
    done = command(*line, "--wanted", "4,12mm3", "--dwells", "0.4:1.2:0.4ms", "--out", folder)
    assert done.status == 0, done.err
    assert "Compensated energising" in done.out
    assert "Compensation" in (folder / "report.html").read_text(encoding="utf-8")
    check_made_again(command, folder)
    late = command(*line, "--wanted", "4mm3", "--rail-pressures", "300MPa", "--out", tmp_path / "late")
    assert late.status == 2
    assert "300 MPa" in late.err
    assert (tmp_path / "late" / "observer.csv").exists()  # the shots are not lost by what the fuel does not allow
    for wrong, words in (
        (("--wanted", "4,12m3", "--dwells", "1ms"), "mm3"),
        (("--wanted", "4,30mm3"), "add --dwells"),
        (("--wanted", "30mm3", "--dwells", "1ms"), "omit --dwells"),
        (("--dwells", "1ms"), "--wanted"),
        (("--wanted", "30MPa"), "--wanted"),
    ):
        refused = command(*line, *wrong)
        assert refused.status == 2
        assert words in refused.err
