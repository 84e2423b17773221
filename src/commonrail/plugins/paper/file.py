"""Summary of a reproduction, from which its record and its report are made, and its folder."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.output import write_set, write_text
from commonrail.base.record import Key
from commonrail.data.records import make_record
from commonrail.plugins.paper import study
from commonrail.plugins.paper.claims import Claim, claims
from commonrail.plugins.paper.figures import PHASES, WINDOWS, Box, Figures, Spread, box, spread
from commonrail.plugins.paper.run import LABELS, METERED, Repetition, Reproduction
from commonrail.plugins.paper.study import Configuration
from commonrail.runs.folder import read_record, write_record
from commonrail.runs.traces import Curve, Trace, read_curves, write_traces

# The run folder of a reproduction: record, curves and truth.

Traces = dict[int, dict[str, Trace]]

RECORD, TRACES, TRUTH = "reproduce.json", "traces.csv", "truth.toml"
EXPERIMENT = "experiment"
BEFORE = ("seed",)


def write_reproduction(folder: Path, reproduction: Reproduction, record: Mapping[str, Any]) -> None:
    """Write reproduce.json, traces.csv and truth.toml."""
    notes = (
        f"SYNTHETIC: {reproduction.bench.truth.synthetic}",
        "a row is the mean rate of one sample, whose middle is the time",
    )
    with write_set(folder):
        write_record(folder / RECORD, record)
        write_text(folder / TRUTH, reproduction.bench.truth.text)
        write_traces(folder / TRACES, notes, (EXPERIMENT, *LABELS), _curves(reproduction.repetitions), BEFORE)


def _curves(repetitions: Iterable[Repetition]) -> Iterator[Curve]:
    for repetition in repetitions:
        for i, data in enumerate(repetition.data):
            rates = {label: repetition.rates[label][i] for label in LABELS}
            yield Curve(data.name, data.bounds, {EXPERIMENT: data.rate, **rates}, (str(repetition.seed),))


def read_reproduction(folder: Path) -> tuple[dict[str, Any], Traces]:
    """Read reproduce.json, and for each seed and data set "time_s" and rates [m³/s] by column; NaN for an empty cell.

    InputError if the folder was not left by ``commonrail lab reproduce``, or its files are broken.
    """
    try:
        record = read_record(folder / RECORD, "commonrail lab reproduce")
        columns = ("time_s", EXPERIMENT, *map(str, record["labels"]))
        traces: Traces = {}
        for (seed, data), trace in read_curves(folder / TRACES, EXPERIMENT, BEFORE).items():
            if set(trace) != set(columns):
                raise InputError(f"{TRACES} has other curves than {RECORD}")
            traces.setdefault(int(seed), {})[data] = {name: trace[name] for name in columns}
        return record, traces
    except (InputError, LookupError, TypeError, ValueError) as error:
        reason = str(error).removesuffix(".")
        raise InputError(
            f"{folder}: not a whole folder of commonrail lab reproduce ({reason}); reproduce again."
        ) from error


TITLE = "The study of Lino, Maione, Saponaro, Li (2016) on a virtual test bench"
MEAN = "mean"

ByModel = Mapping[str, Mapping[str, Floats]]  # by data set and label


class TruthFacts(NamedTuple):
    """Title of a truth, and its values as texts by name."""

    title: str
    facts: tuple[tuple[str, str], ...]


class CurveFacts(NamedTuple):
    """Curve of the bench: rail pressure [Pa] and energising time [s] asked for, and number of samples."""

    name: str
    role: str
    rail_pressure: float
    energising_time: float
    samples: int


class SeedValues(NamedTuple):
    """Values (seeds,), and their spread."""

    values: Floats
    spread: Annotated[Spread, Key("")]

    @classmethod
    def of(cls, values: Floats) -> SeedValues:
        """Values with their spread."""
        return cls(values, spread(values))


class SearchedValues(NamedTuple):
    """Bounds of a parameter and its values over the seeds [SI]."""

    lower: float
    upper: float
    best: Annotated[SeedValues, Key("")]


class Stiffness(NamedTuple):
    """Row of the paper's Table 1 [N/m]: theoretical, the paper's optimal, and ours over the seeds.

    `change` and `paper_change` are relative to theory; `standard_error` is a median. `covered` of the `intervals` hold
    the truth.
    """

    name: str
    symbol: str
    unit: str
    theoretical: float
    paper: float
    search: Annotated[SearchedValues, Key("")]
    paper_change: float
    change: Spread
    verdicts: Mapping[str, int]
    standard_error: float
    truth: float
    covered: int
    intervals: int


class RigidDimension(NamedTuple):
    """Dimension of the rigid body that is fitted [SI]."""

    name: str
    unit: str
    meaning: str
    drawing: float
    search: Annotated[SearchedValues, Key("")]


class ConfigurationResult(NamedTuple):
    """Column of the paper's Table 3: J (seeds,) by data set and on average, their spreads, and the paper's J."""

    generations: int
    members: int
    slots: int
    simulated: tuple[int, ...]
    j: Annotated[Mapping[str, Floats], Key("J")]
    mean: Floats
    median: Mapping[str, float]
    q1: Mapping[str, float]
    q3: Mapping[str, float]
    paper: Mapping[str, float]
    note: str


class TreatmentResult(NamedTuple):
    """Treatment of the constraints: slots, simulations (seeds,) and their share of the slots, and J (seeds,)."""

    name: str
    text: str
    slots: int
    simulated: tuple[int, ...]
    share: Spread
    j: Annotated[Floats, Key("J")]
    spread: Annotated[Spread, Key("")]


class Course(NamedTuple):
    """Median and quartiles over the seeds (generations,)."""

    median: Floats
    low: Floats
    high: Floats


class Convergence(NamedTuple):
    """J of the best member and on average over the generations, and the theoretical model's median J (`level`).

    `ninety` (seeds,): generations at which 90 % of the gain is reached.
    """

    generation: tuple[int, ...]
    best: Course
    mean: Course
    level: Annotated[float, Key("level.median")]
    ninety: Floats


class SearchBox(NamedTuple):
    """Members of the search over the theoretical stiffness: of the shown seed and of every seed, bounds, paper's."""

    symbol: str
    seed: Box
    every: Annotated[Box, Key("all")]
    lower: float
    upper: float
    paper: float


class PhaseParts(NamedTuple):
    """J by phase and by window (seeds, parts), and their medians (parts,)."""

    names: tuple[str, ...]
    j: Annotated[ByModel, Key("J")]
    median: ByModel


class EdgeErrors(NamedTuple):
    """Opening and closing of a model minus those of the experiment [s]."""

    opening: Spread
    closing: Spread


class Overfitting(NamedTuple):
    """J at an unseen pressure of a fit there, of the fit at 160 MPa and by theory, and the share of the gain kept."""

    fitted_there: Spread
    fitted_at_160: Spread
    theoretical: Spread
    gain_kept: Spread


class MeterResult(NamedTuple):
    """Fit through a meter: J by data set, stiffness [N/m] by symbol, and the delay [s] if it is fitted."""

    label: str
    text: str
    j: Annotated[Mapping[str, Spread], Key("J")]
    stiffness: Mapping[str, SeedValues]
    delay: Spread | None


@dataclass(frozen=True, kw_only=True)
class ReproductionSummary:
    """Content of the record and the report of a reproduction.

    SI units, J in mm³/ms summed over the samples; NaN for a missing number. Values by seed are in the order of `seeds`.
    """

    title: str
    synthetic: str
    status: str
    quick: bool
    seeds: tuple[int, ...]
    asked: int
    time_step: float
    truth: TruthFacts
    data: tuple[CurveFacts, ...]
    labels: Mapping[str, str]
    j: Annotated[ByModel, Key("J")]
    j_spread: Annotated[Mapping[str, Mapping[str, Spread]], Key("J_spread")]
    table1: tuple[Stiffness, ...]
    rigid_fit: tuple[RigidDimension, ...]
    table3: tuple[ConfigurationResult, ...]
    treatments: tuple[TreatmentResult, ...]
    convergence: Convergence
    search: tuple[SearchBox, ...]
    phases: PhaseParts
    edges: Mapping[str, Mapping[str, EdgeErrors]]
    overfitting: Mapping[str, Overfitting]
    meter: tuple[MeterResult, ...]
    claims: tuple[Claim, ...]
    shown_seed: int
    seconds: float
    simulations: int


def reproduction_record(reproduction: Reproduction, quick: bool = False) -> dict[str, Any]:
    """Record of a reproduction, JSON-able: its summary, with None for a missing number."""
    return make_record("reproduction", summarise(reproduction, quick))


def summarise(reproduction: Reproduction, quick: bool = False) -> ReproductionSummary:
    """Summary of a reproduction; `quick`: with few seeds."""
    f = Figures(reproduction.repetitions)
    bench = reproduction.bench
    return ReproductionSummary(
        title=TITLE,
        synthetic=bench.truth.synthetic,
        status=reproduction.status,
        quick=quick,
        seeds=tuple(f.seeds),
        asked=reproduction.asked,
        time_step=bench.time_step,
        truth=TruthFacts(bench.truth.title, tuple(bench.truth.facts())),
        data=tuple(
            CurveFacts(d.name, d.role.value, study.RAIL_PRESSURES[d.name], study.ENERGISING_TIME, len(d.rate))
            for d in f.repetitions[0].data
        ),
        labels=LABELS,
        j=f.j,
        j_spread={name: {label: spread(js) for label, js in models.items()} for name, models in f.j.items()},
        table1=tuple(_stiffnesses(f, bench)),
        rigid_fit=tuple(_rigid_dimensions(f)),
        table3=tuple(_configuration(f, c) for c in study.CONFIGURATIONS),
        treatments=tuple(_treatment(f, t) for t in study.TREATMENTS),
        convergence=Convergence(
            generation=tuple(range(study.BEST.generations + 1)),
            best=_course([[g.best for g in r.best.history] for r in f.repetitions]),
            mean=_course([[g.mean for g in r.best.history] for r in f.repetitions]),
            level=spread(f.j[study.FIT]["theoretical"]).median,
            ninety=f.ninety,
        ),
        search=tuple(_search_boxes(f)),
        phases=_phases(f),
        edges={
            name: {
                label: EdgeErrors(*(spread(f.edge_errors(name, label, edge)) for edge in EdgeErrors._fields))
                for label in LABELS
            }
            for name in study.RAIL_PRESSURES
        },
        overfitting={
            name: Overfitting(
                fitted_there=spread(f.own_j(name)),
                fitted_at_160=spread(f.j[name]["optimised"]),
                theoretical=spread(f.j[name]["theoretical"]),
                gain_kept=spread(f.gain_kept(name)),
            )
            for name in study.VALIDATION
        },
        meter=tuple(_meters(f)),
        claims=tuple(claims(f)),
        shown_seed=f.seeds[0],
        seconds=reproduction.seconds,
        simulations=sum(search.injections for r in f.repetitions for search in r.searches),
    )


def _symbol(parameter: cr.Parameter) -> str:
    return parameter.name.rpartition(".")[2]


def _stiffnesses(f: Figures, bench: cr.lab.Bench) -> Iterator[Stiffness]:
    values = np.array([r.best.x for r in f.repetitions])
    true = bench.truth.make_true_injector(bench.injector).values
    for i, p in enumerate(f.space.parameters):
        errors = [e.standard_error for e in f.certainty(i) if e.standard_error is not None]
        covered, intervals = f.covers(i, true[p.name])
        optimal = study.TABLE1_OPTIMAL[p.name]
        yield Stiffness(
            name=p.name,
            symbol=_symbol(p),
            unit=p.unit,
            theoretical=p.reference,
            paper=optimal,
            search=SearchedValues(p.lower, p.upper, SeedValues.of(values[:, i])),
            paper_change=optimal / p.reference - 1.0,
            change=spread(f.change[:, i]),
            verdicts=f.verdicts(i),
            standard_error=spread(errors).median,
            truth=true[p.name],
            covered=covered,
            intervals=intervals,
        )


def _rigid_dimensions(f: Figures) -> Iterator[RigidDimension]:
    """Stop and control volume of the rigid body fitted at 160 MPa."""
    values = np.array([r.rigid.x for r in f.repetitions])
    meanings = cr.models.parameter_quantities()
    for i, p in enumerate(f.rigid_space.parameters):
        search = SearchedValues(p.lower, p.upper, SeedValues.of(values[:, i]))
        yield RigidDimension(p.name, p.unit, meanings[p.name].meaning, p.reference, search)


def _configuration(f: Figures, c: Configuration) -> ConfigurationResult:
    js = {name: f.table3[c][:, i] for i, name in enumerate(study.RAIL_PRESSURES)}
    spreads = {name: spread(values) for name, values in (js | {MEAN: f.mean_j[c]}).items()}
    return ConfigurationResult(
        generations=c.generations,
        members=c.members,
        slots=c.settings.slots,
        simulated=tuple(r.table3[c][0].counts.simulated for r in f.repetitions),
        j=js,
        mean=f.mean_j[c],
        median={name: s.median for name, s in spreads.items()},
        q1={name: s.q1 for name, s in spreads.items()},
        q3={name: s.q3 for name, s in spreads.items()},
        paper=dict(zip(spreads, study.TABLE3[c], strict=True)),
        note=_READINGS.get(c, ""),
    )


_READINGS = {
    Configuration(70, 50): "the paper's choice in the order of its table: (Gmax, Npop)",
    Configuration(50, 70): "the paper's choice in the other order, as in its remark that Npop = 70",
}


def _treatment(f: Figures, t: study.TreatmentCase) -> TreatmentResult:
    results = [r.treatments[t.name] for r in f.repetitions]
    simulated, slots = [x.counts.simulated for x in results], t.settings.slots
    costs = np.array([x.cost for x in results])
    share = spread(np.array(simulated) / slots)
    return TreatmentResult(t.name, t.text, slots, tuple(simulated), share, costs, spread(costs))


def _course(table: list[list[float]]) -> Course:
    """Median and quartiles over the seeds (seeds, generations)."""
    spreads = np.array([spread(column) for column in np.array(table, float).T])
    median, low, high = spreads.T
    return Course(median, low, high)


def _search_boxes(f: Figures) -> Iterator[SearchBox]:
    shares = np.array([r.best.members for r in f.repetitions]) / f.space.reference
    for i, p in enumerate(f.space.parameters):
        yield SearchBox(
            symbol=_symbol(p),
            seed=box(shares[0, ..., i]),
            every=box(shares[..., i]),
            lower=p.lower / p.reference,
            upper=p.upper / p.reference,
            paper=study.TABLE1_OPTIMAL[p.name] / p.reference,
        )


def _phases(f: Figures) -> PhaseParts:
    parts = {
        name: {label: np.hstack((js, f.windows[name][label][..., 0])) for label, js in models.items()}
        for name, models in f.phases.items()
    }
    medians = {name: {label: np.median(js, axis=0) for label, js in models.items()} for name, models in parts.items()}
    return PhaseParts((*PHASES, *WINDOWS), parts, medians)


def _meters(f: Figures) -> Iterator[MeterResult]:
    """Search (70, 50) at 160 MPa without a meter and with each: stiffness, J at all pressures, delay."""
    searches = {"none": [(r.best, r.table3[study.BEST][1]) for r in f.repetitions]}
    searches |= {label: [r.metered[label] for r in f.repetitions] for label in METERED}
    texts = {"none": "none, as in the paper"} | METERED
    for label, metered in searches.items():
        x, js = np.array([search.x for search, _ in metered]), np.array([j for _, j in metered])
        yield MeterResult(
            label=label,
            text=texts[label],
            j={name: spread(js[:, i]) for i, name in enumerate(study.RAIL_PRESSURES)},
            stiffness={_symbol(p): SeedValues.of(x[:, i]) for i, p in enumerate(f.space.parameters)},
            delay=spread(x[:, len(study.NAMES)]) if x.shape[1] > len(study.NAMES) else None,
        )
