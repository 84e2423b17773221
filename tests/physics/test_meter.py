"""Meters as a person describes them: units, names, what is refused, and what a fit has found."""

from __future__ import annotations

from typing import Any

import pytest

from commonrail.base.errors import ConfigurationError
from commonrail.physics.injector import Source
from commonrail.physics.meters import QUANTITIES, LowPass, Meter, known_quantity, parts_of


def test_quantities_are_read_with_their_units() -> None:
    meter = Meter("bench", {"delay": "5 us", "cutoff": "9 kHz", "offset": "0.2 mm3/ms"}, "zero-phase", 3)
    assert meter.values == pytest.approx({"delay": 5e-6, "cutoff": 9e3, "offset": 0.2e-6})
    assert (meter.law, meter.order) == (LowPass.ZERO_PHASE, 3)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("two words",), "letters, digits"),
        (("bench", {"delai": "5 us"}), "mean .delay"),
        (("bench", {"delay": "5 mm"}), "delay .*meter bench"),
        (("bench", {"gain": -1.0}), "gain.*than zero"),
        (("bench", {"cutoff": 0.0}), "cutoff.*than zero"),
        (("bench", {"density": 830.0, "temperature": 313.0}), "density.*temperature"),
        (("bench", {"echo_share": 0.7, "second_echo_share": 0.3}), "direct signal"),
        (("bench", {}, "bessel"), "law .*meter"),
        (("bench", {}, "cascade", 9), "order .*meter"),
        (("bench", {}, "cascade", 0), "order .*meter"),
    ],
)
def test_a_meter_that_makes_no_sense_is_refused_with_a_sentence(arguments: tuple[Any, ...], word: str) -> None:
    with pytest.raises(ConfigurationError, match=word):
        Meter(*arguments)


def test_only_neutral_values_are_neutral() -> None:
    assert Meter("bench").neutral
    assert Meter("bench", {key: q.default for key, q in QUANTITIES.items() if q.default in (0.0, 1.0)}).neutral
    for values in ({"delay": 1e-9}, {"gain": 1.01}, {"cutoff": 1e6}, {"density": 830.0}):
        assert not Meter("bench", values).neutral


def test_a_fit_s_values_replace_those_of_its_own_meter_alone() -> None:
    meter = Meter("bench", {"delay": 1e-6, "gain": 1.02}, sources={"gain": Source("M", "weighed")})
    best = {"meter.bench.delay": 5e-6, "meter.other.delay": 9e-6, "valve.mass": 1e-3}
    found = meter.with_best(best, Source("F", "calibrated"))
    assert found.values == {"delay": 5e-6, "gain": 1.02}
    assert found.sources == {"delay": Source("F", "calibrated"), "gain": Source("M", "weighed")}
    assert Meter("third").with_best(best) == Meter("third")


def test_names_lead_to_units() -> None:
    assert parts_of("meter.bench.echo_share") == ("bench", "echo_share")
    assert known_quantity("meter.bench.delay").unit == "s"
    assert known_quantity("valve.mass").unit == "kg"


def test_what_a_meter_sees_ahead_is_simulated_twice_over() -> None:
    assert Meter("bench", {"delay": "5 us", "cutoff": "9 kHz"}).ahead == 0.0
    assert Meter("bench", {"delay": "-5 us"}).ahead == pytest.approx(10e-6)
    assert Meter("bench", {"cutoff": "9 kHz"}, "zero-phase", 1).ahead > 7.0 / (2.0 * 3.1416 * 9e3)
