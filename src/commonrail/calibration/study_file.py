"""Studies from TOML: injector, measured data, free parameters, constraints and optimiser, ready to run."""

from __future__ import annotations

import itertools
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from commonrail.base import registry
from commonrail.base.arguments import file_path, not_whole
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.input import noting_files, read_plain
from commonrail.base.units import parse, to_text
from commonrail.calibration.constraints import parse_products
from commonrail.calibration.objective import Loss
from commonrail.calibration.parameter import Condition, Parameter, Prior, check_condition, percent_bounds
from commonrail.calibration.space import Space
from commonrail.calibration.study import Judgement, Method, Study, step_for_all
from commonrail.calibration.study_keys import (
    MOST_CONSTRAINTS,
    ConditionModel,
    ConstraintsModel,
    Optimisers,
    ParameterModel,
    StudyModel,
)
from commonrail.data.base import DataSet
from commonrail.data.quantities.reading import AFTER_ENERGISING
from commonrail.data.registry import get_kind
from commonrail.data.study_block import Context, DataModel
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.time_step import check_step
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, Source, parameter_quantities
from commonrail.physics.law import Domain, Q
from commonrail.physics.meters import QUANTITIES, Meter, parameter_name
from commonrail.readers.injector import load_injector, load_meters
from commonrail.readers.location import Place, Reach, locate_errors
from commonrail.readers.meters import Amount, MeterHead, meters_of_tables, read_installed_meters
from commonrail.readers.toml import UNSTATED, parse_toml, read_model, read_model_file, read_toml

MOST_SAMPLES = 3_000_000  # of curves and of their measured pressures or drives; 64 bytes each


def load_study(path: str | Path) -> Study:
    """Read a study with its injector and all its data.

    Parameters
    ----------
    path : str or Path
        TOML file; the paths in it are relative to its folder.

    Returns
    -------
    Study

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If `path` is no path, or values contradict one another: crossed bounds, constraints without room, a window
        outside the data.

    Notes
    -----
    Files that the study names lie in its folder or below, unless it says ``allow_outside = true``.
    """
    with noting_files() as files:
        file = file_path(path, "path of a study")
        study = _study(file, *read_model_file(StudyModel, file))
    return replace(study, files=files, as_read=study)


def edit_study(path: Path, edit: Callable[[Any], None]) -> Study:
    """Read a study whose text `edit`, a function of the TOML document, changes; the file stays as it is.

    The edited text may name files anywhere: a run folder has copies of them. Errors are those of `load_study`.
    """
    import tomlkit  # slow to import

    with noting_files() as files:
        document = tomlkit.parse(read_toml(path)[1])
        edit(document)
        text, at = tomlkit.dumps(document), Place(str(path))
        model = read_model(StudyModel, parse_toml(text, str(path)), at)
        study = _study(path, model, at, Reach(path, True, announced=True), text)
    return replace(study, files=files, as_read=study)


def _study(file: Path, model: StudyModel, at: Place, reach: Reach, text: str) -> Study:
    injector = named_injector(model.injector, file.parent, reach, at / "injector")
    if model.type is not None:
        model = registry.require("study_keys", "type").call(model, injector, reach, at)
    elif not model.parameter:
        raise (at / "parameter").error("this key is missing; add [[parameter]] tables, or name a type", code="missing")
    injector = _started(injector, model, at)
    tables = {**read_installed_meters((block.meter for block in model.data), model.meters), **model.meters}
    free = free_parameters(tables, at / "meters")
    space = _space(model.parameter, model.constraints, injector, at, free)
    with locate_errors(at / "time_step"):
        time_step = step_for_all(injector, space) if model.time_step is None else check_step(model.time_step)
    meters = meters_of_tables(tables, at / "meters")
    data = _data(model.data, Context(injector, time_step, reach, at, meters), at / "data")
    _refuse_unused(meters, data, at / "meters")
    if model.loss_scale is not None and model.loss is not Loss.SOFT_L1:
        raise (at / "loss_scale").error(
            f'it has no effect with the loss "{model.loss.value}"; take "soft_l1", or remove it', code="idle-key"
        )
    space = _with_products(space, model.constraints.products, injector, data, at / "constraints")
    method = method_of(model.optimiser, space, at / "optimiser")
    conditions = _conditions(model.condition, injector, at / "condition")
    logo = "" if model.logo is None else read_logo(reach.path(file.parent, model.logo, at / "logo"), at / "logo")
    with locate_errors(at):
        return Study(
            model.title,
            injector,
            data,
            space,
            method,
            model.seed,
            time_step,
            text,
            model.note,
            model.precision,
            model.loss,
            conditions,
            same_bits=model.same_bits,
            judgement=Judgement(model.judgement.seeds, tuple(model.judgement.leave_out)),
            loss_scale=1.0 if model.loss_scale is None else model.loss_scale,
            author=model.author,
            fixed=tuple(item.name for item in model.fixed),
            logo=logo,
        )


def named_injector(text: str, folder: Path, reach: Reach, at: Place) -> Injector:
    """Injector that a file in a folder names: one of the catalogue, or a TOML file."""
    if text.endswith(".toml"):
        return load_injector(reach.path(folder, text, at), reach)
    with locate_errors(at):
        return load_injector(text, reach)


def _started(injector: Injector, model: StudyModel, at: Place) -> Injector:
    """The injector with the values that the study fixes, and with start values of its own."""
    values, sources = {}, {}
    free = {parameter.name for parameter in model.parameter}
    for i, fixed in enumerate(model.fixed):
        place = (at / "fixed")[i]
        if fixed.name in free or fixed.name in values:
            raise (place / "name").error(f"{fixed.name} is given a second time; keep one of both", code="repeated")
        _check_own(fixed.name, injector, place)
        values[fixed.name], sources[fixed.name] = fixed.value, Source(fixed.mark, fixed.source)
        _check_domain(fixed.name, fixed.value, "value", place)
    for i, parameter in enumerate(model.parameter):
        place = (at / "parameter")[i]
        _check_own(parameter.name, injector, place)
        start = _start(parameter, place)
        if start is not None:
            _check_domain(parameter.name, start, "start value", place)
            values[parameter.name] = start
            sources[parameter.name] = _origin(parameter, injector.sources.get(parameter.name, UNSTATED))
    if not values:
        return injector
    return replace(injector.with_values(values), sources={**injector.sources, **sources})


def _check_own(name: str, injector: Injector, at: Place) -> None:
    """Refuse a parameter that this kind of injector does not have."""
    if name not in injector.values:
        raise (at / "name").error(
            f"{injector.name} is a {injector.variant.actuation.value} injector and has no {name}"
            f"{nearest(name, injector.values)}",
            code="unknown-name",
        )
    with locate_errors(at / "name"):
        injector.check_read([name])


def _start(model: ParameterModel, at: Place) -> float | None:
    """Start value that a study itself gives, by default its prior's; None for that of the injector."""
    prior = _prior(model, at)
    return prior.value if model.start is None and prior is not None else model.start


def _prior(model: ParameterModel, at: Place) -> Prior | None:
    """The prior that a study states, in SI."""
    if model.prior is None:
        return None
    unit = parameter_quantities()[model.name].unit
    with locate_errors(at / "prior" / "value"):
        value = parse(model.prior.value, unit)
    with locate_errors(at / "prior" / "sigma"):
        sigma = parse(model.prior.sigma, unit)
    with locate_errors(at / "prior"):
        return Prior(value, sigma, model.prior.source)


def _origin(model: ParameterModel, origin: Source) -> Source:
    """Mark and source of a start value; with a prior, the mark is F unless stated."""
    if model.prior is not None:
        origin = Source("F", model.prior.source)
    return Source(model.mark or origin.mark, model.source or origin.text)


def _data(models: Sequence[DataModel], context: Context, at: Place) -> tuple[DataSet, ...]:
    _refuse_twice([model.name for model in models], [at[i] / "name" for i in range(len(models))])
    data_sets: list[DataSet] = []
    samples = 0
    for i, model in enumerate(models):
        kind = get_kind(model.kind)
        noise = model.noise.read(kind.sigma_unit, at[i] / "noise")
        for read in kind.read_all(model, context._replace(at=at[i])):
            stated = noise.sigma is not None or bool(noise.shots)
            full_noise = replace(noise, **(read.noise.measured_scatter if stated else read.noise.measured))
            data_sets.append(read.changed(noise=full_noise))
            samples += read.samples
            if samples > MOST_SAMPLES:
                raise at[i].error(
                    f"the data have more than {MOST_SAMPLES} samples up to here; give windows or thin them out",
                    code="too-many",
                )
    _refuse_twice(
        [data.name for data in data_sets], [at] * len(data_sets)
    )  # parts that are held out have names of their own
    return tuple(data_sets)


def _refuse_twice(names: Sequence[str], at: Sequence[Place]) -> None:
    earlier: set[str] = set()
    for name, place in zip(names, at, strict=True):
        if name in earlier:
            raise place.error(f'there are two data sets "{name}"; rename one', code="repeated")
        earlier.add(name)


def _refuse_unused(meters: Mapping[str, Meter], data: Sequence[DataSet], at: Place) -> None:
    """Refuse a meter that no data set names: most likely a slip in one of the two names."""
    used = {d.meter.name for d in data if d.meter is not None}
    for name in meters:
        if name not in used:
            raise at.error(
                f'no data set has meter = "{name}"; add that key to a [[data]] block, or remove the meter',
                code="unused-meter",
            )


def method_of(stated: Optimisers, space: Space, at: Place) -> Method:
    """Method that a table of optimisers states.

    `space`: of the search; `at`: of the table. Raises `ConfigurationError` if settings contradict one another, or do
    not suit the space.
    """
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in stated.settings.items()}
    with locate_errors(at):
        settings = stated.optimiser.settings(**values)
    for key, check in stated.optimiser.checks.items():
        with locate_errors(at / key):
            check(settings, space)
    return Method(settings, stated.polish, stated.polish_iterations, stated.stop_when_converged)


def _space(
    models: list[ParameterModel], constraints: ConstraintsModel, injector: Injector, at: Place, free: list[Parameter]
) -> Space:
    """Space of the injector's free parameters and, after them, those of meters, `free`."""
    parameters = [_parameter(m, injector, (at / "parameter")[i]) for i, m in enumerate(models)] + free
    texts = [*constraints.order, *constraints.linear]
    rows = sum(sign in "<>" for text in texts for sign in text)
    if rows > MOST_CONSTRAINTS:
        raise (at / "constraints").error(
            f"there are {rows} relations, and at most {MOST_CONSTRAINTS} are read", code="too-many"
        )
    with locate_errors(at):
        return Space(parameters, texts)


def _conditions(models: list[ConditionModel], injector: Injector, at: Place) -> tuple[Condition, ...]:
    conditions = []
    for i, model in enumerate(models):
        with locate_errors(at[i]):
            for rail, time in itertools.product(model.rail_pressure, model.energising_time):
                horizon = time + AFTER_ENERGISING
                point = OperatingPoint(rail, time, model.cylinder_pressure, model.return_pressure, horizon=horizon)
                conditions.append(Condition(model.wanted, point))
                check_condition(injector, conditions[-1])
    return tuple(conditions)


def _with_products(space: Space, texts: list[str], injector: Injector, data: Sequence[DataSet], at: Place) -> Space:
    """Search space with the constraints on products, in which fixed parameters enter with their values."""
    if not texts:
        return space
    fixed_values = {name: value for name, value in injector.values.items() if name not in space.names}
    largest = max(point.initial_pressures()[0] for d in data for point in d.points)
    with locate_errors(at / "products"):
        return replace(
            space, products=parse_products(texts, space.names, {**fixed_values, "rail_pressure_max": largest})
        )


def _parameter(model: ParameterModel, injector: Injector, at: Place) -> Parameter:
    quantity = parameter_quantities()[model.name]
    prior = _prior(model, at)
    if model.reference is not None and (prior is not None or model.start is not None):
        raise (at / "reference").error(
            "reference and start (or prior) both say where the search starts; keep one", code="conflict"
        )
    reference = injector.values[model.name] if model.reference is None else model.reference
    lower, upper = _bounds(model, reference, at)
    source = _origin(model, injector.sources.get(model.name, UNSTATED))
    with locate_errors(at):
        parameter = Parameter(
            model.name,
            reference,
            lower,
            upper,
            quantity.unit,
            mark=source.mark,  # type: ignore[arg-type]  # a mark of the injector is one
            source=source.text,
            scale=model.scale,
            prior=prior,
        )
    _check_bounds(parameter, quantity, at)
    if model.name == FUEL_TEMPERATURE:
        _check_temperatures(parameter, injector, at)
    return parameter


def _bounds(model: ParameterModel, reference: float, at: Place) -> tuple[float, float]:
    """Lower and upper bound [SI] by one of the two ways to state them."""
    below, above, lower, upper = model.below, model.above, model.lower, model.upper
    if below is not None and above is not None and lower is upper is None:
        with locate_errors(at):
            return percent_bounds(reference, below, above, model.name)
    if lower is not None and upper is not None and below is above is None:
        return lower, upper
    raise at.error(
        f'{model.name} needs either below and above (percent of its value, such as "50 %") or lower and upper',
        code="conflict",
    )


def _check_bounds(p: Parameter, q: Q, at: Place) -> None:
    for key, value in (("lower", p.lower), ("upper", p.upper)):
        if not q.domain.admits(value):
            raise ConfigurationError(
                f"{at}: the {key} bound of {p.name} is {to_text(value, q.unit)}, and the {q.meaning} must "
                f"be {q.domain.value}; narrow the bounds.",
                code="bound-out-of-range",
                file=at.file,
                place=at.key,
            )
    if not p.lower <= p.reference <= p.upper:
        raise ConfigurationError(
            f"{at}: the start value of {p.name}, {to_text(p.reference, q.unit)}, lies outside its bounds "
            f"{to_text(p.lower, q.unit)} to {to_text(p.upper, q.unit)}; widen them or give a reference "
            "inside.",
            code="start-outside",
            file=at.file,
            place=at.key,
        )


def _check_domain(name: str, value: float, what: str, at: Place) -> None:
    if words := not_whole(name, value):
        raise at.error(words, code="not-whole")
    quantity = parameter_quantities()[name]
    if not quantity.domain.admits(value):
        raise at.error(
            f"the {what} of {name} is {to_text(value, quantity.unit)}, and the {quantity.meaning} must be "
            f"{quantity.domain.value}",
            code="out-of-range",
        )


def _check_temperatures(p: Parameter, injector: Injector, at: Place) -> None:
    low, high = injector.fuel.temperature_range
    if not low <= p.lower < p.upper <= high:
        raise ConfigurationError(
            f"{at}: the bounds of {p.name}, {p.lower:g} K to {p.upper:g} K, leave the range of "
            f"{injector.fuel.name}, {low:g} K to {high:g} K; narrow them.",
            code="out-of-range",
            file=at.file,
            place=at.key,
        )


# Logo of a report, kept as text within the result so that the page needs no other file.

LARGEST_LOGO = 200_000  # [bytes]
_KINDS = {b"\x89PNG\r\n\x1a\n": "image/png", b"\xff\xd8\xff": "image/jpeg", b"<svg": "image/svg+xml"}


def read_logo(path: Path, at: Place) -> str:
    """Picture as a data URI.

    The picture is a PNG, JPEG or SVG of at most `LARGEST_LOGO` bytes; `at`: its key in the study. Raises `InputError`
    if the file cannot be read, is too large or is not such a picture.
    """
    content = read_plain(path, LARGEST_LOGO)
    for opening, kind in _KINDS.items():
        if content.lstrip().startswith(opening):
            return f"data:{kind};base64,{b64encode(content).decode()}"
    raise at.error(f"{path}: this is no PNG, JPEG or SVG; save the logo as one of them", code="no-picture")


# One meter of a file that describes meters: a study, or the calibrated injector of a run.


def load_meter(path: str | Path, name: str) -> Meter:
    """Read one meter of a study, with its start values, or of ``calibrated.toml``, with its calibrated ones.

    Parameters
    ----------
    path : str or Path
        TOML file with a table ``[meters.NAME]``; the data of a study are not read.
    name : str

    Raises
    ------
    InputError
        If the file cannot be read, something in it is unknown or of the wrong kind, or there is no such meter.
    ConfigurationError
        If `path` is not a path, or the quantities do not form a meter.
    """
    file = file_path(path, "path of a file with meters")
    at = Place(str(file))
    document = read_toml(file)[0]
    if str(document.get("format", "")).startswith("commonrail-study/"):
        meters = meters_of_tables(read_model(StudyModel, document, at).meters, at / "meters")
    else:
        meters = {meter.name: meter for meter in load_meters(file)}
    if name not in meters:
        listing = f"it has {', '.join(meters)}" if meters else "it has none"
        raise (at / "meters").error(
            f'there is no meter "{name}"{nearest(name, meters)}; {listing}', code="unknown-name"
        )
    return meters[name]


def free_parameters(tables: Mapping[str, MeterHead], at: Place) -> list[Parameter]:
    """Parameters of a search for the quantities of meters that have bounds.

    `tables`, `at`: as for `meters_of_tables`. Raises `ConfigurationError` if bounds are crossed or do not hold the
    start value.
    """
    return [
        _of_meter(parameter_name(name, key), amount, QUANTITIES[key], table.origin(), at / name / key)
        for name, table in tables.items()
        for key, amount in table.amounts()
        if amount.free
    ]


def _of_meter(name: str, amount: Amount, q: Q, default: Source, at: Place) -> Parameter:
    source, start = amount.origin(default), amount.at_start(q)
    assert amount.lower is not None
    assert amount.upper is not None
    with locate_errors(at):
        parameter = Parameter(
            name,
            start,
            amount.lower,
            amount.upper,
            q.unit,
            mark=source.mark,  # type: ignore[arg-type]  # read as a mark
            source=source.text,
            scale=amount.scale,
            prior=_prior_of_meter(amount, start, at / "prior"),
            signed=q.domain is Domain.ANY,
        )
    if not amount.lower <= start <= amount.upper:
        raise at.error(f"the start value {start:g} must lie between lower and upper", code="start-outside")
    return parameter


def _prior_of_meter(amount: Amount, start: float, at: Place) -> Prior | None:
    """The prior that a quantity states, about its start value unless it gives another."""
    if amount.prior is None:
        return None
    value = start if amount.prior.value is None else amount.prior.value
    with locate_errors(at):
        return Prior(value, amount.prior.sigma, amount.prior.source)
