"""Maps and sweeps in one call."""

from __future__ import annotations

from typing import Any

import pytest

import commonrail as cr
from commonrail.plugins.maps import run
from commonrail.plugins.maps.sweep import Base, Variable


def test_axes_and_conditions_are_read_with_their_units(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(run, "injection_map", lambda *given: asked.append(given))
    injector = cr.load_injector("virtual-lino-2016")
    axes_given = {"pressures": ["80 MPa", 160e6], "times": ["300 us"], "quantities": ["1 mm3"]}
    cr.maps.quantity_map(
        injector, **axes_given, cylinder_pressure="50 bar", smooth="0.1 mm3", resolution=("0.4 us", None)
    )  # type: ignore[arg-type]
    ((model, axes, conditions, rules, progress, adjustment),) = asked
    assert adjustment == (pytest.approx(1e-10), False, pytest.approx(4e-7), None)
    assert model is injector
    assert axes.rail_pressure == pytest.approx([80e6, 160e6])
    assert axes.energising_time == pytest.approx([300e-6])
    assert axes.quantity == pytest.approx([1e-9])
    assert conditions.cylinder_pressure == pytest.approx(5e6)
    assert (rules.several, rules.beyond, progress) == (cr.maps.Several.NEIGHBOURS, cr.maps.Beyond.EXTRAPOLATE, None)


def test_a_rule_may_be_its_word(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(run, "injection_map", lambda *given: asked.append(given[3]))
    injector = cr.load_injector("virtual-lino-2016")
    cr.maps.quantity_map(injector, several="shortest", beyond="hold")  # type: ignore[arg-type]
    assert asked == [(cr.maps.Several.SHORTEST, cr.maps.Beyond.HOLD)]
    with pytest.raises(cr.errors.ConfigurationError):
        cr.maps.quantity_map(injector, several="small")  # type: ignore[arg-type]


def test_a_sweep_has_variables_and_a_base(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[cr.Injector, list[Variable], Base]] = []
    monkeypatch.setattr(run, "swept", lambda *given: asked.append(given))
    cr.maps.sweep(
        cr.load_injector("virtual-lino-2016"),
        {"dwell": ["300 us", "600 us"], "temperature": "40 degC"},
        first_energising_time="350 us",
        rail_pressure="120 MPa",
    )
    ((_, variables, base),) = asked
    assert [(v.name, v.unit) for v in variables] == [("dwell", "s"), ("fuel.temperature", "K")]
    assert variables[1].values == pytest.approx([313.15])
    assert (base.rail_pressure, base.first_energising_time) == pytest.approx((120e6, 350e-6))
    assert (base.energising_time, base.dwell) == pytest.approx((500e-6, 1e-3))  # where nothing is said


def test_what_cannot_be_used_is_refused() -> None:
    injector = cr.load_injector("virtual-lino-2016")
    with pytest.raises(cr.errors.ConfigurationError, match=r"\brail\b.* rail_pressure"):
        cr.maps.sweep(injector, {"dwell": ["1 ms"]}, rail="1 MPa")
    with pytest.raises(cr.errors.ConfigurationError, match=r"rail pressures .* 80 MPa"):
        cr.maps.quantity_map(injector, pressures=["160 MPa", "80 MPa"])
    for resolution in ("0.4 us", ("0.4 us",), ("0.4 mm3", None), (0.0, None)):
        with pytest.raises(cr.errors.ConfigurationError):
            cr.maps.quantity_map(injector, resolution=resolution)  # type: ignore[arg-type]
    with pytest.raises(cr.errors.ConfigurationError, match="model"):
        cr.maps.quantity_map("virtual-lino-2016")  # type: ignore[arg-type]
