"""A reproduction as one JSON-able record: everything that the report says comes from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.output import write_set, write_text
from commonrail.base.text import number, numbers
from commonrail.data.records import record_head
from commonrail.plugins.paper import study
from commonrail.plugins.paper.claims import claims
from commonrail.plugins.paper.figures import PHASES, WINDOWS, Figures, box, spread
from commonrail.plugins.paper.run import LABELS, METERED, Found, Repetition, Reproduction
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
    """reproduce.json, and by seed and data set the arrays "time_s" and rates [m³/s] by column; NaN for an empty cell.

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


def reproduction_record(reproduction: Reproduction, quick: bool = False) -> dict[str, Any]:
    """Record of a reproduction.

    SI units, J in mm³/ms summed over the samples; null for a missing number. Arrays "per seed" are in the order
    of "seeds".
    """
    f = Figures(reproduction.repetitions)
    bench = reproduction.bench
    return {
        **record_head("reproduction", TITLE, bench.truth.synthetic),
        "status": reproduction.status,
        "quick": quick,
        "seeds": f.seeds,
        "asked": reproduction.asked,
        "time_step": bench.time_step,
        "truth": {"title": bench.truth.title, "facts": [list(fact) for fact in bench.truth.facts()]},
        "data": [
            {
                "name": d.name,
                "role": d.role.value,
                "rail_pressure": study.RAIL_PRESSURES[d.name],
                "energising_time": study.ENERGISING_TIME,
                "samples": len(d.rate),
            }
            for d in f.repetitions[0].data
        ],
        "labels": LABELS,
        "J": _each(f.j, numbers),
        "J_spread": _each(f.j, _spread),
        "table1": _table1(f, bench),
        "rigid_fit": _rigid_fit(f),
        "table3": [_configuration(f, c) for c in study.CONFIGURATIONS],
        "treatments": [_treatment(f, t) for t in study.TREATMENTS],
        "convergence": {
            "generation": list(range(study.BEST.generations + 1)),
            "best": _band([r.best for r in f.repetitions], "best"),
            "mean": _band([r.best for r in f.repetitions], "mean"),
            "level": {"median": number(spread(f.j[study.FIT]["theoretical"]).median)},
            "ninety": numbers(f.ninety),
        },
        "search": _search(f),
        "phases": _phases(f),
        "edges": {
            name: {
                label: {which: _spread(f.edge_errors(name, label, which)) for which in ("opening", "closing")}
                for label in LABELS
            }
            for name in study.RAIL_PRESSURES
        },
        "overfitting": {
            name: {
                "fitted_there": _spread(f.own_j(name)),
                "fitted_at_160": _spread(f.j[name]["optimised"]),
                "theoretical": _spread(f.j[name]["theoretical"]),
                "gain_kept": _spread(f.gain_kept(name)),
            }
            for name in study.VALIDATION
        },
        "meter": _meter(f),
        "claims": [c._asdict() | {"interval": list(c.interval)} for c in claims(f)],
        "shown_seed": f.seeds[0],
        "seconds": reproduction.seconds,
        "simulations": sum(search.injections for r in f.repetitions for search in r.searches),
    }


def _table1(f: Figures, bench: cr.lab.Bench) -> list[dict[str, Any]]:
    values = np.array([r.best.x for r in f.repetitions])
    true = bench.truth.make_true_injector(bench.injector).values
    rows = []
    for i, p in enumerate(f.space.parameters):
        errors = [e["standard_error"] for e in f.certainty(i) if e["standard_error"] is not None]
        covered, intervals = f.covers(i, true[p.name])
        optimal = study.TABLE1_OPTIMAL[p.name]
        rows.append(
            {
                "name": p.name,
                "symbol": p.name.rpartition(".")[2],
                "unit": p.unit,
                "theoretical": p.reference,
                "paper": optimal,
                **_summarise_search(p, values[:, i]),
                "paper_change": optimal / p.reference - 1.0,
                "change": _spread(f.change[:, i]),
                "verdicts": f.verdicts(i),
                "standard_error": number(spread(errors).median),
                "truth": true[p.name],
                "covered": covered,
                "intervals": intervals,
            }
        )
    return rows


def _rigid_fit(f: Figures) -> list[dict[str, Any]]:
    """Stop and control volume of the rigid body fitted at 160 MPa."""
    values = np.array([r.rigid.x for r in f.repetitions])
    meanings = cr.models.parameter_quantities()
    return [
        {
            "name": p.name,
            "unit": p.unit,
            "meaning": meanings[p.name].meaning,
            "drawing": p.reference,
            **_summarise_search(p, values[:, i]),
        }
        for i, p in enumerate(f.rigid_space.parameters)
    ]


def _summarise_search(p: cr.Parameter, values: Floats) -> dict[str, Any]:
    """Bounds of a parameter and its values over the seeds."""
    return {"lower": p.lower, "upper": p.upper, "values": numbers(values), **_spread(values)}


def _configuration(f: Figures, c: Configuration) -> dict[str, Any]:
    js = {name: f.table3[c][:, i] for i, name in enumerate(study.RAIL_PRESSURES)} | {MEAN: f.mean_j[c]}
    spreads = {name: _spread(values) for name, values in js.items()}
    return {
        "generations": c.generations,
        "members": c.members,
        "slots": c.settings.slots,
        "simulated": [r.table3[c][0].counts.simulated for r in f.repetitions],
        "J": {name: numbers(js[name]) for name in study.RAIL_PRESSURES},
        "mean": numbers(js[MEAN]),
        **{key: {name: s[key] for name, s in spreads.items()} for key in ("median", "q1", "q3")},
        "paper": dict(zip(js, study.TABLE3[c], strict=True)),
        "note": _READINGS.get(c, ""),
    }


_READINGS = {
    Configuration(70, 50): "the paper's choice, read as its table is: (Gmax, Npop)",
    Configuration(50, 70): "the paper's choice read the other way, as its remark that Npop = 70 would have it",
}


def _treatment(f: Figures, t: study.TreatmentCase) -> dict[str, Any]:
    results = [r.treatments[t.name] for r in f.repetitions]
    simulated = np.array([x.counts.simulated for x in results])
    costs = [x.cost for x in results]
    return {
        "name": t.name,
        "text": t.text,
        "slots": t.settings.slots,
        "simulated": simulated.tolist(),
        "share": _spread(simulated / t.settings.slots),
        "J": numbers(costs),
        **_spread(costs),
    }


def _band(searches: list[Found], which: str) -> dict[str, list[float | None]]:
    """Median and quartiles over the seeds in each generation."""
    table = np.array([[float(getattr(g, which)) for g in s.history] for s in searches])
    spreads = [_spread(column) for column in table.T]
    return {key: [s[of] for s in spreads] for key, of in (("median", "median"), ("low", "q1"), ("high", "q3"))}


def _search(f: Figures) -> list[dict[str, Any]]:
    shares = np.array([r.best.members for r in f.repetitions]) / f.space.reference
    return [
        {
            "symbol": p.name.rpartition(".")[2],
            "seed": box(shares[0, ..., i])._asdict(),
            "all": box(shares[..., i])._asdict(),
            "lower": p.lower / p.reference,
            "upper": p.upper / p.reference,
            "paper": study.TABLE1_OPTIMAL[p.name] / p.reference,
        }
        for i, p in enumerate(f.space.parameters)
    ]


def _phases(f: Figures) -> dict[str, Any]:
    parts = {
        name: {label: np.hstack((js, f.windows[name][label][..., 0])) for label, js in models.items()}
        for name, models in f.phases.items()
    }
    return {
        "names": [*PHASES, *WINDOWS],
        "J": _each(parts, numbers),
        "median": _each(parts, lambda js: numbers(np.median(js, axis=0))),
    }


def _meter(f: Figures) -> list[dict[str, Any]]:
    """Search (70, 50) at 160 MPa without a meter and with each: stiffness, J at all pressures, delay."""
    searches = {"none": [(r.best, r.table3[study.BEST][1]) for r in f.repetitions]}
    searches |= {label: [r.metered[label] for r in f.repetitions] for label in METERED}
    texts = {"none": "none, as in the paper"} | METERED
    rows, symbols = [], [p.name.rpartition(".")[2] for p in f.space.parameters]
    for label, metered in searches.items():
        x, js = np.array([search.x for search, _ in metered]), np.array([j for _, j in metered])
        stiffness = {k: {"values": numbers(x[:, i]), **_spread(x[:, i])} for i, k in enumerate(symbols)}
        rows.append(
            {
                "label": label,
                "text": texts[label],
                "J": {name: _spread(js[:, i]) for i, name in enumerate(study.RAIL_PRESSURES)},
                "stiffness": stiffness,
                "delay": _spread(x[:, len(study.NAMES)]) if x.shape[1] > len(study.NAMES) else None,
            }
        )
    return rows


def _each(values_by_name: dict[str, dict[str, Floats]], make: Callable[[Floats], Any]) -> dict[str, dict[str, Any]]:
    """Results of a function of the arrays of each data set and label."""
    return {name: {label: make(values) for label, values in models.items()} for name, models in values_by_name.items()}


def _spread(values: ArrayLike) -> Mapping[str, float | None]:
    return {key: number(value) for key, value in spread(values)._asdict().items()}
