"""A type of injector turned into the model of one part by a few reference quantities that were measured on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from commonrail.arguments import file_path, instance, thread_count
from commonrail.arrays import Floats
from commonrail.calibration.goal import Loss
from commonrail.calibration.injector_type import InjectorType
from commonrail.calibration.optimisers import StagedSettings
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.run import Calibration, Progress, calibrate
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.calibration.time_step import step_for_all
from commonrail.errors import InputError
from commonrail.family.fixed import OF_PART
from commonrail.files.injector_file import load_injector
from commonrail.files.type_file import load_type
from commonrail.injector.definition import Injector, Source, parameter_quantities
from commonrail.kinds import QuantityData
from commonrail.kinds.maps.reading import QuantitiesModel
from commonrail.kinds.reading import Context
from commonrail.notice import note
from commonrail.reading.place import Place
from commonrail.reading.reach import Reach
from commonrail.units import parse, to_text

__all__ = ["FACTORS", "FEWEST_FOR_PRIORS", "FLOW", "Adapted", "adapt", "held_parameters", "part_of", "read_points"]

FLOW = "nozzle.hole_diameter"  # its square is the area: the flow factor scales c_d A at every lift and pressure
FAR, ANYWAY = 0.5, 1e-9  # share of a reference quantity, and volume [m³], by which an adapted model may miss it
FACTORS = (0.6, 1.6)  # flow factors that are searched
FEWEST_FOR_PRIORS = 4  # reference quantities from which the type's parameters move too, held by their spreads
MEMBERS, MOVES = 64, 24  # candidates that are screened, and iterations after it


@dataclass(frozen=True)
class Adapted:
    """Model of one part.

    Attributes
    ----------
    injector : Injector
        The model; its changed values are marked F and name the type and the data.
    flow_factor : float
        Area of the nozzle's holes times discharge coefficient, relative to the drawing and the type [1].
    before, after : (points,)
        Quantities of the type's injector and of the adapted one at the reference points [m³].
    points : QuantityData
        Reference quantities.
    calibration : Calibration
        The fit that found it.
    """

    injector: Injector
    flow_factor: float
    before: Floats
    after: Floats
    points: QuantityData
    calibration: Calibration


def adapt(
    injector_type: InjectorType | str | Path,
    points: QuantityData | str | Path,
    *,
    injector: Injector | str | Path | None = None,
    cylinder_pressure: float | str = "5 MPa",
    return_pressure: float | str = "0.5 MPa",
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Adapted:
    """Fit the model of a type to reference quantities of one part.

    Up to three quantities determine one number, the flow factor: effective area of the nozzle's holes relative to the
    drawing. It has no prior, so one quantity is met exactly. From four quantities on the parameters of the type are
    fitted too, each with its value and spread as prior.

    Parameters
    ----------
    injector_type : InjectorType or path
        The type, or its file.
    points : QuantityData or path
        Reference quantities, or a CSV file with columns rail_pressure, energising_time and quantity.
    injector : Injector, name or path, optional
        The part: nozzle, line and all that was measured on it (mark M) are its own, the rest is the type's. By default
        the type's injector.
    cylinder_pressure, return_pressure : float or str
        [Pa] of the points of a file.
    threads : int, optional
        All usable processors by default; the result does not depend on it.
    progress : function of Progress, optional

    Returns
    -------
    Adapted

    Raises
    ------
    InputError
        If a file cannot be read, there is no injector, the flow factor would lie outside 0.6 to 1.6, or a reference
        quantity is missed by more than half of it and 1 mm³.
    ConfigurationError
        If an argument is of another kind.
    SimulationError
        If no candidate could be simulated.
    """
    known = injector_type if isinstance(injector_type, InjectorType) else load_type(injector_type)
    part = part_of(known, injector)
    if not isinstance(points, QuantityData):
        points = read_points(points, part, cylinder_pressure, return_pressure)
    study = _study(known, part, instance(points, QuantityData, "points"))
    found = calibrate(study, threads=thread_count(threads), progress=progress)
    factor = (found.best[FLOW] / part.values[FLOW]) ** 2
    low, high = FACTORS
    if study.space.parameters[0].is_at_bound(found.best[FLOW]):
        raise InputError(
            f"{points.name}: the reference quantities would need a flow factor at the end of {low:g} to {high:g}; "
            "check nozzle, units and pressures."
        )
    _check_met(points, np.asarray(found.scores["best"][0].values))
    start, best = (np.asarray(found.scores[label][0].values) for label in ("start", "best"))
    return Adapted(_named(known, study, found, factor), factor, start, best, points, found)


def _check_met(points: QuantityData, best: Floats) -> None:
    """Refuse reference quantities that the adapted model does not come near: no flow factor can repair that."""
    for point, wanted, given in zip(points.points, points.quantity, best, strict=True):
        if not abs(given - wanted) <= max(FAR * wanted, ANYWAY):
            duration = sum(pulse.duration for pulse in point.pulses)
            at = f"{1e-6 * point.initial_pressures()[0]:.4g} MPa and {1e6 * duration:.4g} us"
            raise InputError(
                f"{points.name}: {wanted * 1e9:.3g} mm3 are measured at {at}, and the adapted type injects "
                f"{given * 1e9:.3f} mm3; check units and pressures, or take a point with a larger energising time."
            )


def read_points(
    path: str | Path, injector: Injector, cylinder_pressure: float | str, return_pressure: float | str
) -> QuantityData:
    """Read reference quantities from a CSV file with columns rail_pressure, energising_time and quantity.

    Parameters
    ----------
    path : str or Path
    injector : Injector
        Gives the fuel, for quantities by mass.
    cylinder_pressure, return_pressure : float or str
        [Pa], or texts with their units.

    Raises
    ------
    InputError
        If the file cannot be read, or something in it is missing or of the wrong kind.
    """
    file = file_path(path, "path of the reference quantities")
    pressures = {"cylinder_pressure": cylinder_pressure, "return_pressure": return_pressure}
    stated = {key: f"{value!r} Pa" if isinstance(value, float) else value for key, value in pressures.items()}
    for key, value in stated.items():
        parse(value, "Pa", key)
    model = QuantitiesModel.model_validate(
        {"kind": "quantities", "name": file.name, "role": "fit", "file": str(file.absolute()), **stated}
        | {"absolute": "0.05 mm3", "relative": 0.015, "source": f"reference quantities of {file.name}"}
    )
    return QuantityData.read(model, Context(injector, 1e-6, Reach(file, True), Place(str(file))))


def part_of(known: InjectorType, injector: Injector | str | Path | None) -> Injector:
    """The part's injector before it is fitted: its own measured values and nozzle, the type's other values.

    Raises
    ------
    InputError
        If a file cannot be read, or there is no injector.
    """
    if injector is None:
        if known.injector is None:
            raise InputError(f"The type {known.name} names no injector; give the part's own.")
        return known.applied(known.injector)
    own = injector if isinstance(injector, Injector) else load_injector(injector)
    part = known.applied(own, keep=OF_PART)
    for value in known.fixed:
        if value.name not in OF_PART and part.values[value.name] != value.value:
            unit = parameter_quantities()[value.name].unit
            note(
                f"{value.name} stays {to_text(part.values[value.name], unit)}, as measured on {own.name}; the type was "
                f"learnt with {to_text(value.value, unit)}."
            )
    return part


def _study(known: InjectorType, part: Injector, points: QuantityData) -> Study:
    """Study that fits the flow factor, and from four points on the type's parameters with their spreads."""
    own = part.values[FLOW]
    low, high = (own * factor**0.5 for factor in FACTORS)
    origin = "drawing times the root of the flow factor"
    free = [Parameter(FLOW, own, low, high, "m", mark="F", source=origin)]
    if np.count_nonzero(points.judged) >= FEWEST_FOR_PRIORS:
        free += held_parameters(known, part)
    space = Space(free)
    settings = StagedSettings(members=MEMBERS, generations=MOVES, starts=1, stage_iterations=8)
    return Study(
        f"{known.name} adapted to {points.name}",
        part,
        (points,),
        space,
        Method(settings),
        1,
        step_for_all(part, space),
        loss=Loss.SQUARES,
    )


def held_parameters(known: InjectorType, part: Injector) -> list[Parameter]:
    """Parameters of the type with their priors, without those that were measured on the part."""
    measured = {p.name for p in known.parameters} - {p.name for p in known.given_to(part)}
    units = parameter_quantities()
    return [
        Parameter(
            p.name,
            p.value,
            p.lower,
            p.upper,
            units[p.name].unit,
            mark=p.mark,
            source=p.source,
            prior=p.prior,
        )
        for p in known.parameters
        if p.name != FLOW and p.name not in measured
    ]


def _named(known: InjectorType, study: Study, found: Calibration, factor: float) -> Injector:
    """The adapted injector with name and sources."""
    points = study.data[0]
    text = f'type "{known.name}", fitted to {points.name}'
    drawn = study.injector.values[FLOW]
    notes = {name: Source("F", text) for name in study.space.names}
    notes[FLOW] = Source("F", f"effective: {drawn!r} m times the root of the flow factor {factor:.5g}; {text}")
    return replace(found.injector, name=f"{study.injector.name}-adapted", sources={**found.injector.sources, **notes})
