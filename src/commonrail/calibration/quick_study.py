"""Study in one call: an injector, measured data and the bounds of the free parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from commonrail.arguments import instance, instances, mapping, number
from commonrail.calibration.optimisers import EvolutionSettings
from commonrail.calibration.parameter import Mark, Parameter, percent_bounds
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.calibration.time_step import step_for_all
from commonrail.errors import ConfigurationError, nearest
from commonrail.injector.definition import Injector
from commonrail.kinds import ANY_KIND, DataSet
from commonrail.reading.fields import UNSTATED

__all__ = ["study"]

EXAMPLE = '{"valve.spring_preload": ("60 N", "95 N"), "nozzle.discharge_maximum": "10 %"}'
POLISH = 3  # refinements: as many as must agree before a search is called converged


def study(
    injector: Injector,
    data: DataSet | Sequence[DataSet],
    *,
    free: Mapping[str, Any],
    constraints: Sequence[str] = (),
    method: Method | None = None,
    seed: int = 1,
    title: str = "",
) -> Study:
    """Study of an injector and measured data, ready for `calibrate`.

    Parameters
    ----------
    injector : Injector
        Start values.
    data : DataSet or sequence of DataSet
        At least one with role fit.
    free : mapping of str to bounds
        By dotted name: lower and upper bound, SI or texts with units, or a share of the injector's value on either
        side, such as "10 %".
    constraints : sequence of str
        Such as "control_chamber.z_hole_diameter < control_chamber.a_hole_diameter".
    method : Method, optional
        By default differential evolution and three least-squares refinements, ended when it has converged.
    seed : int
    title : str
        By default the injector's name.

    Raises
    ------
    ConfigurationError
        If an argument is of another kind, a parameter is unknown, or bounds are crossed.
    """
    instance(injector, Injector, "injector")
    found = instances([data] if isinstance(data, ANY_KIND) else data, ANY_KIND, "data")
    space = Space([_free(injector, *item) for item in mapping(free, "free", EXAMPLE).items()], tuple(constraints))
    usual = Method(EvolutionSettings(), POLISH, stop_when_converged=True)
    return Study(
        title or injector.name,
        injector,
        found,
        space,
        usual if method is None else method,
        seed,
        step_for_all(injector, space),
    )


def _free(injector: Injector, name: str, bounds: Any) -> Parameter:
    if name not in injector.values:
        raise ConfigurationError(
            f"{injector.name} has no parameter {name}{nearest(name, injector.values)}; free is, for example, {EXAMPLE}."
        )
    unit, reference = injector.quantities[name].unit, injector.values[name]
    origin = injector.sources.get(name, UNSTATED)
    if isinstance(bounds, str) and bounds.strip().endswith("%"):
        share = number(bounds.strip().removesuffix("%"), "1", f"bounds of {name}")
        lower, upper = percent_bounds(reference, share, share, name)
    elif isinstance(bounds, Sequence) and not isinstance(bounds, str) and len(bounds) == 2:
        lower, upper = (number(value, unit, f"bound of {name}") for value in bounds)
    else:
        wanted = f'(lower, upper) or a share such as "10 %", not {bounds!r}'
        raise ConfigurationError(f"The bounds of {name} must be {wanted}.")
    return Parameter(name, reference, lower, upper, unit, mark=cast(Mark, origin.mark), source=origin.text)
