"""Uncertain quantities of the bench as parameters with priors, stated or usual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import ConfigurationError
from commonrail.data.noise import Noise
from commonrail.plugins.certainty.uncertain import ASSUMED, STATED, with_uncertain_free


@pytest.fixture(scope="module")
def study() -> cr.Study:
    """A curve at one operating point; its values play no part."""
    injector = cr.load_injector("virtual-lino-2016")
    bounds = np.arange(0.0, 1.5e-3, 3e-6)
    point = cr.OperatingPoint(160e6, 700e-6, horizon=1.56e-3)
    curve = cr.RateData("curve", cr.data.Role.FIT, point, bounds, np.zeros(len(bounds) - 1), 1.0, "", "made up")
    space = cr.fit.Space([cr.Parameter("nozzle.discharge_maximum", 0.8, 0.6, 1.0, "1", mark="E", source="test")])
    return cr.Study("bench", injector, (curve,), space, cr.fit.Method(), 1, 1e-6)


def stated(study: cr.Study, noise: Noise) -> cr.Study:
    return replace(study, data=tuple(one.changed(noise=noise) for one in study.data))


def test_a_bench_that_states_nothing_leaves_delay_and_gain_open(study: cr.Study) -> None:
    free = with_uncertain_free(study)
    more = free.space.parameters[1:]
    assert [p.name for p in more] == ["meter.unnamed.delay", "meter.unnamed.gain"]
    assert {p.source for p in more} == {ASSUMED}
    assert [p.prior and p.prior.sigma for p in more] == [1e-6, 0.01]


def test_a_statement_takes_the_place_of_what_is_usual(study: cr.Study) -> None:
    friction = {"delay": 3e-6, "plunger_needle.friction": 5.0}
    free = with_uncertain_free(stated(study, Noise(uncertain=friction)))
    by = {p.name: p for p in free.space.parameters[1:]}
    delay, drag = by["meter.unnamed.delay"], by["plunger_needle.friction"]
    assert (delay.source, delay.prior and delay.prior.sigma) == (STATED, 3e-6)
    assert drag.lower == pytest.approx(0.0, abs=1e-9)  # no negative friction
    assert drag.upper == pytest.approx(30.0)
    assert by["meter.unnamed.gain"].source == ASSUMED


@pytest.mark.parametrize(
    ("noise", "words"),
    [
        (Noise(uncertain={"cutoff": 1e3}), "cutoff"),
        (Noise(uncertain={"nozzle.discharge_maximum": 0.01}), "the fit"),
        (Noise(uncertain={"quantity_offset": 1e-10}), "no effect"),
        (Noise(uncertain={"nozzle.holes": 1.0}), "counts pieces"),
    ],
)
def test_a_statement_that_does_not_fit_the_study_is_refused(study: cr.Study, noise: Noise, words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        with_uncertain_free(stated(study, noise))


def test_two_statements_about_one_meter_are_refused(study: cr.Study) -> None:
    meter = cr.Meter("bench", {})
    data = tuple(
        study.data[0].changed(name=name, meter=meter, noise=Noise(uncertain={"delay": size}))
        for name, size in (("a", 1e-6), ("b", 2e-6))
    )
    with pytest.raises(ConfigurationError, match=r"meter\.bench\.delay .*1 µs .*2 µs"):
        with_uncertain_free(replace(study, data=data))
