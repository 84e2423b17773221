"""The declared truth: what it alters, and that it tells every number."""

from __future__ import annotations

import re

import pytest

from commonrail.base.choices import Boundary
from commonrail.base.errors import ConfigurationError
from commonrail.physics.injector import Injector
from commonrail.plugins.paper.bench import Friction, Truth


def test_the_hidden_injector_is_the_fitted_one_altered(truth: Truth, pwm: Injector) -> None:
    hidden = truth.make_true_injector(pwm)
    changed = {name for name, value in hidden.values.items() if value != pwm.values[name]}
    assert changed == {*(f"plunger_needle.k{i}" for i in range(1, 8)), "rail.volume"}
    assert hidden.variant == pwm.variant._replace(boundary=Boundary.VOLUME)
    assert hidden.values["plunger_needle.k1"] == 3.03e8


def test_a_value_that_no_injector_has_is_refused(pwm: Injector) -> None:
    with pytest.raises(ConfigurationError, match=r"parameter plunger_needle\.k8"):
        Truth("t", "t", "virtual-lino-2016", {"plunger_needle.k8": 1.0}).make_true_injector(pwm)


def test_the_facts_are_every_number_of_the_file(truth: Truth) -> None:
    """Digits of the file's values, read from its text, stand in the facts."""
    facts = truth.facts()
    text = " ".join(f"{name} {what}" for name, what in facts)
    expected = {
        "plunger_needle.k1": "303 N/µm [F] Lino et al. 2016, Table 1, optimal",
        "plunger_needle.k7": "64.4 N/µm [F]",
        "rail.volume": "40 cm³ [E]",
        "rail.throttle_diameter": "850 µm [E]",
        "Coulomb friction": "1.5, 0.5, 0.3, 1, 1, 0.3, 1.5, 1, 0 N [E]",
        "viscous friction": "1, 0.3, 0.2, 0.6, 0.6, 0.2, 1, 0.6, 0 N s/m [E]",
        "rate meter, bandwidth": "60 kHz [E]",
        "rate meter, noise": "0.3 mm³/ms [E]",
        "rail sensor, bandwidth": "100 kHz [E]",
        "rail sensor, noise": "100 kPa [E]",
        "scatter, rail pressure": "300 kPa [E]",
        "scatter, energising time": "500 ns [E]",
        "scatter, boost voltage": "300 mV [E]",
        "finite volumes": "480 in the feed pipe, 120 in the return line",
        "time step": "50 ns",
    }
    for name, what in expected.items():
        (found,) = [told for known, told in facts if known.startswith(name)]
        assert found.startswith(what), name
    # nine forces of two kinds count as two
    assert len(facts) == 1 + 7 + 3 + 2 + 6 + 3 + 2
    assert len(re.findall(r"\[[MCFE]\]", text)) == 7 + 3 + 2 + 6 + 3


def test_an_ideal_truth_says_that_there_is_nothing(ideal: Truth) -> None:
    told = dict(ideal.facts())
    assert told["Coulomb friction on masses 1 to 9"] == "none"
    assert [what for name, what in told.items() if "bandwidth" in name] == ["unlimited"] * 2
    assert [what for name, what in told.items() if "standard deviation" in name] == ["none"] * 5
    assert ideal.friction == Friction()


def test_it_is_said_to_be_synthetic(truth: Truth) -> None:
    assert "truth virtual-lino-2016" in truth.synthetic
