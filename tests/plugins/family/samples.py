"""A type that the tests share, and quantities that a known part injects."""

from __future__ import annotations

import numpy as np

import commonrail as cr

INJECTOR = cr.load_injector("virtual-lino-2016")
PRELOAD, MASS = "valve.spring_preload", "valve.mass"


def small_type(spread: float = 0.05) -> cr.parts.InjectorType:
    """Type of two parameters with the injector's own values, spread relative to them."""
    parameters = []
    for name in (PRELOAD, MASS):
        value = INJECTOR.values[name]
        parameters.append(cr.parts.TypeParameter(name, value, spread * value, 0.5 * value, 1.5 * value, "F", "made up"))
    return cr.parts.InjectorType(
        "lino", "made up", tuple(parameters), (cr.parts.TypePart("a part", "made up", {"data.csv": "0a"}),), INJECTOR
    )


def injected(injector: cr.Injector, *points: tuple[float, float]) -> cr.QuantityData:
    """Quantities that an injector injects at rail pressures [MPa] and energising times [us], as reference."""
    at = tuple(cr.OperatingPoint(rail * 1e6, time * 1e-6, horizon=time * 1e-6 + 3e-3) for rail, time in points)
    quantity = cr.simulate_batch(injector, at, time_step=1e-6).injected_volume[0]
    shut = np.zeros(len(at), bool)
    return cr.QuantityData(
        "reference", cr.data.Role.FIT, at, quantity, 0.05e-9, 0.015, shut, 1.0, "simulated", "simulated"
    )


def study_of(truth: cr.Injector, points: tuple[tuple[float, float], ...], *names: str) -> cr.Study:
    """Study of a part: `names` free within 30 % of the injector's own values, fitted to what the truth injects."""
    units = cr.models.parameter_quantities()
    free = [
        cr.Parameter(name, v, 0.7 * v, 1.3 * v, units[name].unit, mark="E", source="made up")
        for name, v in ((name, INJECTOR.values[name]) for name in names)
    ]
    return cr.Study(
        "part",
        INJECTOR,
        (injected(truth, *points),),
        cr.fit.Space(free),
        cr.fit.Method(),
        1,
        1e-6,
        loss=cr.fit.Loss.SQUARES,
    )
