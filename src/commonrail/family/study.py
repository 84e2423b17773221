"""Families from TOML: the studies of several parts, and what their parameters share."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PlainValidator

from commonrail.arguments import file_path
from commonrail.calibration.injector_type import InjectorType
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.prior import Prior
from commonrail.calibration.products import Products
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method, Study
from commonrail.errors import nearest
from commonrail.family.adapt import FLOW
from commonrail.family.sharing import Share, Shared, Sharing, joint_space
from commonrail.files.study_file import load_study, method_of
from commonrail.files.study_models import Optimisers, read_optimisers
from commonrail.files.type_file import load_type
from commonrail.kinds import Role, of_role
from commonrail.kinds.reading import Name
from commonrail.observation.quantities import known_quantity
from commonrail.reading.fields import FileModel, Text, Unit
from commonrail.reading.guarded_file import noting_files
from commonrail.reading.model_file import read_model_file
from commonrail.reading.place import Place, located
from commonrail.reading.reach import Reach
from commonrail.units import parse

__all__ = ["Family", "load_family"]

MOST_PARTS = 100
MOST_AROUND = 1000
FARTHEST = 4.0  # standard deviations that a flow factor may lie from 1


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
        Of the joint parameters.
    sharing : Sharing
        Map from joint points to the parts'.
    shared : mapping of str to Shared
        Relation of each parameter that is not common.
    method : Method
    seed : int
    files : mapping of Path to str
        SHA-256 of each file that the family was read from, its own first; empty if it was made in Python.
    text : str
        The family file as given.
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

    @property
    def same_bits(self) -> bool:
        """Return whether the result of all parts is the same, bit for bit, on every x86-64 processor."""
        return all(study.same_bits for study in self.parts.values())

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the studies, empty if there are none."""
        return " ".join(dict.fromkeys(study.synthetic for study in self.parts.values() if study.synthetic))


def load_family(path: str | Path) -> Family:
    """Read a family with the studies of its parts.

    Parameters
    ----------
    path : str or Path
        TOML file; the paths in it are relative to its folder.

    Raises
    ------
    InputError
        If a file cannot be read, or something in it is unknown, missing or of the wrong kind.
    ConfigurationError
        If values contradict one another.
    """
    file = file_path(path, "path of a family")
    with noting_files() as own:
        model, at, reach, text = read_model_file(_FamilyModel, file)
    with noting_files() as of_type:
        known = None if model.type is None else load_type(reach.path(file.parent, model.type, at / "type"), reach)
    studies = {name: _known(study, known) for name, study in _studies(model, reach, file.parent, at).items()}
    flow = () if model.flow is None else (FLOW,)  # whose prior has the spread `flow`
    spreads = _spreads(model.prior, _known_names(studies), at / "prior", flow)
    studies = {name: _with_spreads(study, spreads) for name, study in studies.items()}
    shared = _shared(model, studies, at)
    with located(at):
        space, sharing = joint_space({name: study.space for name, study in studies.items()}, shared)
    method = method_of(model.optimiser, space, at / "optimiser")
    files = own | of_type
    for study in studies.values():
        files |= study.files
    return Family(model.name, model.title, studies, space, sharing, shared, method, model.seed, files, text)


def _studies(model: _FamilyModel, reach: Reach, folder: Path, at: Place) -> dict[str, Study]:
    found: dict[str, Study] = {}
    for i, part in enumerate(model.part):
        place = (at / "part")[i]
        if part.name in found:
            raise (place / "name").error(f'there are two parts "{part.name}"; rename one')
        if Path(part.name).name != part.name or "\\" in part.name:
            raise (place / "name").error(f'"{part.name}" is no name of a file, and the part\'s model is written to one')
        study = load_study(reach.path(folder, part.study, place / "study"))
        if not of_role(study.data, Role.FIT):
            raise (place / "study").error("no data set of this study has role fit")
        if model.flow is not None and not 0.0 < model.flow < 1.0 / FARTHEST:
            raise (at / "flow").error(
                f'{model.flow:g} is no spread of the hole area; give a share below {100 / FARTHEST:g} %, such as "2 %"'
            )
        found[part.name] = _with_flow(study, model.flow)
    return found


def _known(study: Study, known: InjectorType | None) -> Study:
    """The study with values, spreads and fixed values of a type: starts and priors in place of its own."""
    if known is None:
        return study
    free = [
        replace(p, reference=min(max(of.value, p.lower), p.upper), prior=_within(of.prior, p), source=of.source)
        if (of := known.by_name.get(p.name))
        else p
        for p in study.space.parameters
    ]
    fixed = known.fixed_for(study.injector, {*study.fixed, *study.space.names})
    values = {p.name: p.reference for p in free if p.name in known.by_name} | {v.name: v.value for v in fixed}
    sources = {**study.injector.sources} | {v.name: v.of_type(known.name) for v in fixed}
    return replace(
        study,
        injector=replace(study.injector.with_values(values), sources=sources),
        space=Space(free, study.space.constraints, study.space.products),
        fixed=(*study.fixed, *(v.name for v in fixed)),
    )


def _with_spreads(study: Study, spreads: Mapping[str, float]) -> Study:
    """The study with other spreads of its priors, about its start where there was no prior."""
    free = [
        replace(p, prior=replace(p.prior or Prior(p.reference, 1.0, p.source), sigma=spreads[p.name]))
        if p.name in spreads
        else p
        for p in study.space.parameters
    ]
    return replace(study, space=Space(free, study.space.constraints, study.space.products))


def _within(prior: Prior, p: Parameter) -> Prior:
    """The prior with its value within the bounds."""
    return replace(prior, value=min(max(prior.value, p.lower), p.upper))


def _with_flow(study: Study, spread: float | None) -> Study:
    """The study with an effective hole diameter about that of its own drawing, by a spread of the hole area."""
    if spread is None or FLOW in study.space.names:
        return study
    own = study.injector.values[FLOW]
    sigma = 0.5 * spread * own  # the area is the square of the diameter
    source = "hole diameter of the part's drawing; the spread is that of the family's flow"
    low, high = own - FARTHEST * sigma, own + FARTHEST * sigma
    prior = Prior(own, sigma, source)
    flow = Parameter(FLOW, own, low, high, "m", mark="E", source=source, prior=prior)
    old = study.space
    products = Products([c._replace(exponents=np.append(c.exponents, 0.0)) for c in old.products.constraints])
    return replace(study, space=Space((*old.parameters, flow), old.constraints, products))


def _known_names(studies: Mapping[str, Study]) -> dict[str, None]:
    """Free parameters of any part."""
    return dict.fromkeys(name for study in studies.values() for name in study.space.names)


def _shared(model: _FamilyModel, studies: Mapping[str, Study], at: Place) -> dict[str, Shared]:
    known = _known_names(studies)
    found: dict[str, Shared] = {} if model.flow is None else {FLOW: Shared(Share.PER_PART)}
    for i, pattern in enumerate(model.per_part):
        for name in _matching(pattern, known, (at / "per_part")[i]):
            found[name] = Shared(Share.PER_PART)
    around = _spreads(model.around, known, at / "around", found)
    return found | {name: Shared(Share.AROUND, spread) for name, spread in around.items()}


def _spreads(
    items: Sequence[_SpreadModel], known: Mapping[str, None], at: Place, taken: Container[str] = ()
) -> dict[str, float]:
    """Spread [SI] of each parameter that is named.

    Parameters
    ----------
    items : sequence of _SpreadModel
    known : mapping
        Free parameters by name.
    at : Place
        Of the items.
    taken : container of str
        Parameters whose relation is given elsewhere.
    """
    found: dict[str, float] = {}
    for i, item in enumerate(items):
        for name in _matching(item.name, known, at[i] / "name"):
            if name in found or name in taken:
                raise (at[i] / "name").error(f"{name} is given a second time; keep one of both")
            with located(at[i] / "spread"):
                found[name] = parse(item.spread, known_quantity(name).unit)
            if not found[name] > 0.0:
                raise (at[i] / "spread").error("the spread must be greater than zero; to omit it, remove this entry")
    return found


def _matching(pattern: str, known: Mapping[str, None], at: Place) -> list[str]:
    """Free parameters that a name, or a pattern with a star, names."""
    names = [name for name in known if fnmatchcase(name, pattern)]
    if not names:
        raise at.error(f'no part has the free parameter "{pattern}"{nearest(pattern, known)}')
    return names
