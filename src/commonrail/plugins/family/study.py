"""Families from TOML: studies of several parts, and the relations between their parameters."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from pydantic import Field, PlainValidator

from commonrail.base.arguments import file_path, settle
from commonrail.base.arrays import Floats, IndexArray
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.input import noting_files
from commonrail.base.units import parse
from commonrail.calibration.constraints import Products
from commonrail.calibration.objective import Goal, Loss, Objective, Scores
from commonrail.calibration.parameter import Parameter, Prior, Priors
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study, goal_of, objective_of
from commonrail.calibration.study_file import load_study, method_of
from commonrail.calibration.study_keys import Optimisers, read_optimisers
from commonrail.data.base import Role
from commonrail.data.registry import of_role
from commonrail.data.study_block import Name
from commonrail.physics.meters import known_quantity
from commonrail.plugins.family.drawn import FLOW
from commonrail.plugins.family.injector_type import InjectorType, load_type
from commonrail.readers.location import Place, Reach, locate_errors
from commonrail.readers.toml import FileModel, Text, Unit, read_model_file

# Relations of parameters between the parts of a joint fit: common, per part, or around a mean.

OF = " of part "  # in the name of a part's parameter
WIDEST = 4.0  # largest distance of a part from the common value in standard deviations


class Share(StrEnum):
    """Relation of a parameter between the parts of a family."""

    COMMON = "common"
    """One value for all parts."""

    PER_PART = "per part"
    """An independent value for each part."""

    AROUND = "around"
    """A value for each part, normally distributed about a common value."""


class Shared(NamedTuple):
    """Relation of a parameter; `spread`: standard deviation between parts, SI, for `AROUND`."""

    share: Share = Share.COMMON
    spread: float = 0.0


@dataclass(frozen=True, eq=False)
class Sharing:
    """Map from points of the joint space (D,) to points of the parts' spaces.

    The point of a part is its matrix (d, D) times the joint point, clipped to its bounds: lower (d,) and upper (d,)
    [SI].
    """

    names: tuple[str, ...]
    matrices: tuple[Floats, ...]
    bounds: tuple[tuple[Floats, Floats], ...]

    def of_part(self, index: int, x: Floats) -> Floats:
        """Return points (…, d) of a part from joint points (…, D), SI."""
        low, high = self.bounds[index]
        return np.clip(x @ self.matrices[index].T, low, high)


class _PartsConstraints(Products):
    """Constraints of all parts, at joint points."""

    def __init__(self, spaces: Sequence[Space], sharing: Sharing) -> None:
        super().__init__()
        self._spaces, self._sharing = tuple(spaces), sharing

    def __len__(self) -> int:
        return sum(len(space.rows) + len(space.products) for space in self._spaces)

    @property
    def labels(self) -> tuple[str, ...]:
        """Texts of the constraints as in the studies."""
        return tuple(dict.fromkeys(label for space in self._spaces for label in space.labels))

    def shortfall(self, x: Floats) -> Floats:
        """Shortfall (…, m) of the constraints of each part."""
        parts = enumerate(self._spaces)
        return np.concatenate([space.shortfall(self._sharing.of_part(k, x)) for k, space in parts], axis=-1)


def joint_space(parts: Mapping[str, Space], shared: Mapping[str, Shared]) -> tuple[Space, Sharing]:
    """Return the space of the joint parameters, and the map from it to the parts.

    `shared`: relation of each parameter, common by default. A common parameter has bounds, start and prior of the first
    part with it; a parameter per part keeps its study's. An `AROUND` parameter has a common value, and for each part
    the distance from it in standard deviations with a standard normal prior. Raises `ConfigurationError` if a name in
    `shared` is not a free parameter of any part.
    """
    free_names = dict.fromkeys(name for space in parts.values() for name in space.names)
    for name in shared:
        if name not in free_names:
            raise ConfigurationError(f"No part has the free parameter {name}{nearest(name, free_names)}.")
    joint_parameters: dict[str, Parameter] = {}
    entries: list[list[tuple[int, str, float]]] = []
    for part_name, space in parts.items():
        part_entries: list[tuple[int, str, float]] = []
        for row, parameter in enumerate(space.parameters):
            share, spread = shared.get(parameter.name, Shared(Share.COMMON))
            if share is not Share.PER_PART:
                first = joint_parameters.setdefault(parameter.name, parameter)
                if max(first.lower, parameter.lower) > min(first.upper, parameter.upper):
                    raise ConfigurationError(
                        f"The bounds of {parameter.name} in part {part_name} do not overlap with an earlier part's; "
                        "widen them, or list the parameter in per_part."
                    )
                part_entries.append((row, parameter.name, 1.0))
            if share is not Share.COMMON:
                single = _part_parameter(parameter, part_name, share)
                joint_parameters[single.name] = single
                part_entries.append((row, single.name, spread if share is Share.AROUND else 1.0))
        entries.append(part_entries)
    names = tuple(joint_parameters)
    matrices = [
        _matrix(part_entries, space.dimension, names)
        for part_entries, space in zip(entries, parts.values(), strict=True)
    ]
    bounds = tuple((space.lower, space.upper) for space in parts.values())
    sharing = Sharing(names, tuple(matrices), bounds)
    spaces = tuple(parts.values())
    return Space(tuple(joint_parameters.values()), (), _PartsConstraints(spaces, sharing)), sharing


def _matrix(entries: Sequence[tuple[int, str, float]], rows: int, names: Sequence[str]) -> Floats:
    matrix = np.zeros((rows, len(names)))
    for row, name, factor in entries:
        matrix[row, names.index(name)] = factor
    return matrix


def _part_parameter(parameter: Parameter, part_name: str, share: Share) -> Parameter:
    """Return a part's parameter: its value, or its distance from the common value in standard deviations."""
    name = f"{parameter.name}{OF}{part_name}"
    if share is Share.PER_PART:
        return replace(parameter, name=name, signed=True)
    source = f"normally distributed about the common value of {parameter.name}"
    normal = Prior(0.0, 1.0, source)
    return Parameter(name, 0.0, -WIDEST, WIDEST, "1", mark="E", source=source, prior=normal, signed=True)


# Objective of a joint fit.


class FamilyObjective(Objective):
    """Sum of the parts' objectives, and the squared residuals of the priors of the joint parameters.

    Each part simulates its candidates in batches. Joint candidates that differ only in parameters of other parts are
    simulated once. `space`: of the joint parameters.
    """

    def __init__(self, studies: Sequence[Study], sharing: Sharing, space: Space, threads: int | None = None) -> None:
        self.sharing, self.names = sharing, sharing.names
        # without priors: the joint priors count once
        self.parts = [objective_of(study, threads, goal_of(study)._replace(priors=Priors())) for study in studies]
        conditions = tuple(condition for study in studies for condition in study.conditions)
        self.goal = Goal(studies[0].loss, Priors.of(space.parameters), conditions, scale=studies[0].loss_scale)
        self.data = tuple(data for objective in self.parts for data in objective.data)
        self.simulator = self.parts[0].simulator

    def use_threads(self, threads: int | None) -> None:
        """Set the number of threads; all usable processors if None."""
        for objective in self.parts:
            objective.use_threads(threads)

    def costs(self, values: Floats) -> Scores:
        """Objective of joint candidates (n, names), SI; every joint candidate counts as simulated."""
        total, statuses = self.goal.priors.costs(values), np.zeros(len(values), np.int8)
        for objective, (part_values, which) in zip(self.parts, self._distinct_candidates(values), strict=True):
            scores = objective.costs(part_values)
            total = total + scores.costs[which]
            statuses = np.where(statuses == 0, scores.statuses[which], statuses).astype(np.int8)
        return Scores(total, statuses, len(values) * self.injections)

    def residuals(self, values: Floats) -> Floats:
        """Residuals (n, m): of all parts, then of the priors."""
        return self._joint_residuals(values, [objective.residuals for objective in self.parts])

    def screened(self, values: Floats) -> Floats:
        """Residuals as `residuals` returns them, in f32 and at the time step of the screening."""
        return self._joint_residuals(values, [objective.screened for objective in self.parts])

    def linearised(self, values: Floats) -> Floats:
        """Residuals for derivatives at the first candidate, see `Objective.linearised`."""
        if self.goal.loss is not Loss.SOFT_L1:
            return self.residuals(values)
        part_residuals = [
            objective.linearised(self.sharing.of_part(k, values)) for k, objective in enumerate(self.parts)
        ]
        return np.concatenate([*part_residuals, self.goal.priors.residuals(values)], axis=1)

    def _joint_residuals(self, values: Floats, of_parts: Sequence[Callable[[Floats], Floats]]) -> Floats:
        part_residuals = [
            of(part_values)[which]
            for of, (part_values, which) in zip(of_parts, self._distinct_candidates(values), strict=True)
        ]
        return np.concatenate([*part_residuals, self.goal.priors.residuals(values)], axis=1)

    def _distinct_candidates(self, values: Floats) -> list[tuple[Floats, IndexArray]]:
        """For each part its distinct candidates, and the index of the candidate for each joint candidate."""
        candidates = []
        for k in range(len(self.parts)):
            part_values, which = np.unique(self.sharing.of_part(k, values), axis=0, return_inverse=True)
            candidates.append((part_values, which.reshape(-1)))
        return candidates


MOST_PARTS = 100
MOST_AROUND = 1000
FARTHEST = 4.0  # largest distance of a flow factor from 1 in standard deviations


class _PartModel(FileModel):
    name: Name
    study: Text


class _SpreadModel(FileModel):
    name: Text
    spread: str | float


class _FamilyModel(FileModel):
    """The whole file."""

    format: Literal["commonrail-family/1"]
    name: Name
    title: Text
    allow_outside: bool = False
    seed: int = Field(default=1, ge=0)
    type: Text | None = None
    part: list[_PartModel] = Field(min_length=2, max_length=MOST_PARTS)
    per_part: list[str] = Field(default=[], max_length=MOST_AROUND)
    around: list[_SpreadModel] = Field(default=[], max_length=MOST_AROUND)
    prior: list[_SpreadModel] = Field(default=[], max_length=MOST_AROUND)
    flow: Annotated[float, Unit("1")] | None = None
    optimiser: Annotated[Optimisers, PlainValidator(read_optimisers)] = Field(
        default_factory=lambda: read_optimisers({"method": "staged least squares"})
    )


@dataclass(frozen=True)
class Family:
    """Several parts of one type, to be fitted together.

    Attributes
    ----------
    name, title : str
    parts : mapping of str to Study
        Study of each part by its name.
    space : Space
        Space of the joint parameters.
    sharing : Sharing
        Map from the joint space to the parts.
    shared : mapping of str to Shared
        Relation of each parameter that is not common.
    method : Method
    seed : int
    files : mapping of Path to str
        SHA-256 of each file read, the family file first; empty if the family was made in Python.
    text : str
        Text of the family file.
    as_read : Family or None
        The family as its files state it.
    """

    name: str
    title: str
    parts: Mapping[str, Study]
    space: Space
    sharing: Sharing
    shared: Mapping[str, Shared]
    method: Method
    seed: int
    files: Mapping[Path, str] = field(default_factory=dict)
    text: str = ""
    as_read: Family | None = None

    def __post_init__(self) -> None:
        settle(self, parts=self.parts, shared=self.shared, files=self.files)

    @property
    def same_bits(self) -> bool:
        """True if the result of all parts is the same, bit for bit, on every x86-64 processor."""
        return all(study.same_bits for study in self.parts.values())

    @property
    def synthetic(self) -> str:
        """Notes on synthetic data in the studies; empty without any."""
        return " ".join(dict.fromkeys(study.synthetic for study in self.parts.values() if study.synthetic))


def load_family(path: str | Path) -> Family:
    """Read a family with the studies of its parts from a TOML file; paths in it are relative to its folder.

    Raises `InputError` if a file cannot be read, or a key is unknown, missing or of the wrong type, and
    `ConfigurationError` if values contradict each other.
    """
    file = file_path(path, "path of a family")
    with noting_files() as family_files:
        model, at, reach, text = read_model_file(_FamilyModel, file)
    with noting_files() as of_type:
        injector_type = (
            None if model.type is None else load_type(reach.path(file.parent, model.type, at / "type"), reach)
        )
    studies = {
        name: _apply_type(study, injector_type) for name, study in _load_studies(model, reach, file.parent, at).items()
    }
    flow = () if model.flow is None else (FLOW,)  # its prior has the spread `flow`
    spreads = _read_spreads(model.prior, _free_names(studies), at / "prior", flow)
    studies = {name: _with_spreads(study, spreads) for name, study in studies.items()}
    shared = _read_relations(model, studies, at)
    with locate_errors(at):
        space, sharing = joint_space({name: study.space for name, study in studies.items()}, shared)
    method = method_of(model.optimiser, space, at / "optimiser")
    files = family_files | of_type
    for study in studies.values():
        files |= study.files
    family = Family(
        name=model.name,
        title=model.title,
        parts=studies,
        space=space,
        sharing=sharing,
        shared=shared,
        method=method,
        seed=model.seed,
        files=files,
        text=text,
    )
    return replace(family, as_read=family)


def _load_studies(model: _FamilyModel, reach: Reach, folder: Path, at: Place) -> dict[str, Study]:
    studies: dict[str, Study] = {}
    for i, part_model in enumerate(model.part):
        place = (at / "part")[i]
        if part_model.name in studies:
            raise (place / "name").error(f'there are two parts "{part_model.name}"; rename one')
        if Path(part_model.name).name != part_model.name or "\\" in part_model.name:
            raise (place / "name").error(
                f'"{part_model.name}" cannot be a file name, which the model of the part needs; rename the part'
            )
        study = load_study(reach.path(folder, part_model.study, place / "study"))
        if not of_role(study.data, Role.FIT):
            raise (place / "study").error("no data set of this study has role fit")
        if model.flow is not None and not 0.0 < model.flow < 1.0 / FARTHEST:
            raise (at / "flow").error(
                f'{model.flow:g} is not a spread of the hole area; give a share below {100 / FARTHEST:g} %, as "2 %"'
            )
        studies[part_model.name] = _with_flow(study, model.flow)
    return studies


def _apply_type(study: Study, injector_type: InjectorType | None) -> Study:
    """Return the study with starts, priors and fixed values of a type."""
    if injector_type is None:
        return study
    free = [
        replace(
            p,
            reference=min(max(of.value, p.lower), p.upper),
            prior=replace(of.prior, value=min(max(of.prior.value, p.lower), p.upper)),
            source=of.source,
        )
        if (of := injector_type.by_name.get(p.name))
        else p
        for p in study.space.parameters
    ]
    fixed = injector_type.fixed_values_for(study.injector, {*study.fixed, *study.space.names})
    values = {p.name: p.reference for p in free if p.name in injector_type.by_name} | {v.name: v.value for v in fixed}
    sources = {**study.injector.sources} | {v.name: v.source_on_part(injector_type.name) for v in fixed}
    return replace(
        study,
        injector=replace(study.injector.with_values(values), sources=sources),
        space=Space(free, study.space.constraints, study.space.products),
        fixed=(*study.fixed, *(v.name for v in fixed)),
    )


def _with_spreads(study: Study, spreads: Mapping[str, float]) -> Study:
    """Return the study with other spreads of its priors; a new prior is about the start."""
    free = [
        replace(p, prior=replace(p.prior or Prior(p.reference, 1.0, p.source), sigma=spreads[p.name]))
        if p.name in spreads
        else p
        for p in study.space.parameters
    ]
    return replace(study, space=Space(free, study.space.constraints, study.space.products))


def _with_flow(study: Study, spread: float | None) -> Study:
    """Return the study with a free effective hole diameter about its drawing; `spread`: relative, of the hole area."""
    if spread is None or FLOW in study.space.names:
        return study
    drawing_diameter = study.injector.values[FLOW]
    sigma = 0.5 * spread * drawing_diameter  # the area is the square of the diameter
    source = "hole diameter of the part's drawing; spread by the key flow of the family"
    low, high = drawing_diameter - FARTHEST * sigma, drawing_diameter + FARTHEST * sigma
    prior = Prior(drawing_diameter, sigma, source)
    flow = Parameter(FLOW, drawing_diameter, low, high, "m", mark="E", source=source, prior=prior)
    old = study.space
    products = Products([c._replace(exponents=np.append(c.exponents, 0.0)) for c in old.products.constraints])
    return replace(study, space=Space((*old.parameters, flow), old.constraints, products))


def _free_names(studies: Mapping[str, Study]) -> dict[str, None]:
    """Names of the free parameters of all parts."""
    return dict.fromkeys(name for study in studies.values() for name in study.space.names)


def _read_relations(model: _FamilyModel, studies: Mapping[str, Study], at: Place) -> dict[str, Shared]:
    free_names = _free_names(studies)
    relations: dict[str, Shared] = {} if model.flow is None else {FLOW: Shared(Share.PER_PART)}
    for i, pattern in enumerate(model.per_part):
        for name in _match_names(pattern, free_names, (at / "per_part")[i]):
            relations[name] = Shared(Share.PER_PART)
    around = _read_spreads(model.around, free_names, at / "around", relations)
    return relations | {name: Shared(Share.AROUND, spread) for name, spread in around.items()}


def _read_spreads(
    items: Sequence[_SpreadModel], free_names: Mapping[str, None], at: Place, taken: Container[str] = ()
) -> dict[str, float]:
    """Read the spread [SI] of each free parameter in a list of the file.

    Names in `taken`, whose relation is given elsewhere, are refused.
    """
    spreads: dict[str, float] = {}
    for i, item in enumerate(items):
        for name in _match_names(item.name, free_names, at[i] / "name"):
            if name in spreads or name in taken:
                raise (at[i] / "name").error(f"{name} is given a second time; keep one of both")
            with locate_errors(at[i] / "spread"):
                spreads[name] = parse(item.spread, known_quantity(name).unit)
            if not spreads[name] > 0.0:
                raise (at[i] / "spread").error("the spread must be greater than zero; to omit it, remove this entry")
    return spreads


def _match_names(pattern: str, free_names: Mapping[str, None], at: Place) -> list[str]:
    """Return the free parameters that match a name, or a pattern with a star."""
    names = [name for name in free_names if fnmatchcase(name, pattern)]
    if not names:
        raise at.error(f'no part has the free parameter "{pattern}"{nearest(pattern, free_names)}')
    return names
