"""An injector checks its values and hands them to the physics in order."""

from __future__ import annotations

from dataclasses import replace

import pytest

from commonrail.base.choices import Actuation, Boundary
from commonrail.base.errors import ConfigurationError
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths, parameter_quantities


def test_parameters_carry_the_values_by_name(regulated: Injector) -> None:
    injector = regulated.with_values({"plunger_needle.k3": 9e7, "nozzle.holes": 8.0})
    assert injector.parameters.plunger_needle.k3 == 9e7
    assert injector.parameters.nozzle.holes == 8.0
    assert injector.parameters.valve == regulated.parameters.valve


def test_every_parameter_has_unit_and_meaning() -> None:
    quantities = parameter_quantities()
    assert all(q.unit and q.meaning for q in quantities.values())
    assert set(parameter_paths()) < set(quantities)
    for actuation in Actuation:
        own = parameter_quantities(actuation)
        assert set(parameter_paths(actuation)) | {FUEL_TEMPERATURE} == set(own)
        assert {name: quantities[name] for name in own} == own


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("plunger_needle.k8", 1e8, r"no parameter plunger_needle\.k8.*k[1-7]"),
        ("valve.mass", 0.0, r"valve\.mass.*than zero"),
        ("valve.mass", float("nan"), r"valve\.mass.*than zero"),
        ("valve.damping", -1.0, r"valve\.damping.*zero or"),
        ("control_chamber.z_hole_from_inlet", 1.5, "between 0 and 1"),
        ("nozzle.lift_maximum_slope", float("inf"), "finite"),
    ],
)
def test_a_value_that_makes_no_sense_is_refused(regulated: Injector, name: str, value: float, says: str) -> None:
    with pytest.raises(ConfigurationError, match=says):
        regulated.with_values({name: value})


def test_a_missing_value_is_named(regulated: Injector) -> None:
    values = {k: v for k, v in regulated.values.items() if k != "sac.volume"}
    with pytest.raises(ConfigurationError, match=r"sac\.volume"):
        replace(regulated, values=values)


def test_a_value_that_the_variant_does_not_read_is_refused(regulated: Injector) -> None:
    """It would change nothing, of an ideal rail its volume and of a regulated drive the voltage of the PWM."""
    assert regulated.variant.boundary is Boundary.IDEAL
    for name, reader in (("rail.volume", "@volume"), ("drive.supply_voltage", "@pwm")):
        with pytest.raises(ConfigurationError, match=rf"{name}; .*{reader}"):
            regulated.with_values({name: regulated.values[name]})
    behind = replace(regulated, variant=regulated.variant._replace(boundary=Boundary.VOLUME))
    assert behind.with_values({"rail.volume": "20 cm3"}).values["rail.volume"] == pytest.approx(20e-6)
