"""commonrail type: type file from calibrated parts, from a fleet, or from a joint fit, which can be resumed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.errors import InputError, SimulationError
from commonrail.base.input import read_plain
from commonrail.base.text import quantity
from commonrail.base.units import parse
from commonrail.cli.console import print_json, print_rows, print_synthetic, print_table, print_text, say
from commonrail.cli.fit import Outcome, end_if_stopped, run_and_report
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    ClusterAddress,
    Json,
    Threads,
    WorkerCount,
    check_file,
    free_run_folder,
    open_workers,
    stem_of,
)
from commonrail.cli.study_kind import RunOptions, StudyKind

if TYPE_CHECKING:
    from commonrail.plugins.family.injector_type import InjectorType
    from commonrail.workers.workers import Workers

CORNERS = ((40e6, 160e6), (300e-6, 1000e-6))  # points at which a type's spreads are shown as quantities [Pa, s]


@table_verb
def type_(
    sources: Annotated[
        tuple[Path, ...],
        Argument(
            metavar="SOURCE",
            help="Family file, whose parts are fitted together; run folders of `calibrate`, one for each part; or the "
            "folder of a fleet.",
        ),
    ],
    *,
    out: Annotated[Path, Option(metavar="TYPE.toml", help="Type file to be written.")],
    name: Annotated[str | None, Option(help="Name of the type. [default: as in the file, or its name]")] = None,
    part_spread: Annotated[
        str | None,
        Option(
            help="Assumed standard deviation between parts, e.g. 3%, for a type of one part. [default: from the "
            "priors of its study]"
        ),
    ] = None,
    run: Annotated[
        Path | None,
        Option(metavar="RUN", help="New run folder of a family file. [default: runs/<family>-<n>]"),
    ] = None,
    models: Annotated[
        Path | None,
        Option(metavar="FOLDER", help="New folder for the injector of each part of a family file."),
    ] = None,
    seed: Annotated[
        int | None,
        Option(min=0, help="Seed of the random numbers of a family file. [default: as in the file]"),
    ] = None,
    threads: Threads = None,
    workers: WorkerCount = None,
    cluster: ClusterAddress = None,
    json: Json = False,
) -> None:
    """Write a type file from parts of one type.

    The key `type` of a study uses it for starts and priors; `commonrail adapt` makes a part's model from it.
    The joint fit of a family file has a run folder: Ctrl-C stops it with the best values so far and exit
    status 130, and `commonrail resume RUN` resumes it.

    \b
    Examples:
      commonrail type cases/family/family.toml --out cri2.toml --models parts
      commonrail type runs/part-1 runs/part-2 runs/part-3 --out cri2.toml
      commonrail type fleets/line-4 --out cri2.toml
      commonrail type runs/part-1 --part-spread 3% --out cri2.toml
    """
    from commonrail.base.output import write_text
    from commonrail.plugins.family.from_results import FLEET
    from commonrail.plugins.family.injector_type import dump_type
    from commonrail.plugins.family.run import TYPE

    check_file(out, "--out")
    share = None if part_spread is None else parse(part_spread, "1", "--part-spread")
    joint = [source for source in sources if source.suffix == ".toml"]
    if joint and len(sources) > 1:
        raise InputError(f"{joint[0]}: a family file must be the only source; give it alone, or run folders only.")
    if not joint and any(option is not None for option in (run, models, seed, workers, cluster)):
        raise InputError("--run, --models, --seed, --workers and --cluster: only for a family file; omit them.")
    if share is not None and (joint or any((source / FLEET).is_file() for source in sources)):
        raise InputError("--part-spread: only for run folders; omit it for a family file or a fleet.")
    if joint:
        stated = {key: value for key, value in (("name", name), ("seed", seed)) if value is not None}
        with open_workers(workers, cluster) as crew:
            outcome = _fit(joint[0], run or free_run_folder(stem_of(joint[0])), stated, models, threads, crew)
        write_text(out, read_plain(outcome.folder / TYPE).decode())
        _print_family(outcome, json, out)
        return
    injector_type = _from_results(sources, name or out.stem, share)
    dump_type(injector_type, out)
    if json:
        print_json(_type_record(injector_type, out))
    else:
        print_synthetic(injector_type.synthetic)
        _print_type(injector_type)
    _say_written(injector_type, out)


def _from_results(sources: Sequence[Path], name: str, share: float | None) -> InjectorType:
    from commonrail.plugins.family.from_results import FLEET, type_from_fleet, type_from_runs

    fleets = [source for source in sources if (source / FLEET).is_file()]
    if fleets and len(sources) > 1:
        raise InputError(f"{fleets[0]}: a fleet must be the only source; give it alone, or run folders only.")
    if fleets:
        return type_from_fleet(fleets[0], name)
    _refuse_twice(sources)
    return type_from_runs(sources, name, part_spread=share)


def _refuse_twice(sources: Sequence[Path]) -> None:
    """Refuse a run given twice, or together with its copy: equal parts have no spread."""
    from commonrail.base.input import fingerprint
    from commonrail.runs.folder import RESULT

    seen: dict[str, Path] = {}
    for source in sources:
        if (source / RESULT).is_file():
            first = seen.setdefault(fingerprint(source / RESULT), source)
            if first is not source:
                raise InputError(f"{source}: this is the same run as {first}; give each part once.")


def _fit(
    source: Path,
    folder: Path,
    changes: Mapping[str, Any],
    models: Path | None,
    threads: int | None,
    workers: Workers | None,
) -> Outcome:
    """Fit the parts of a family file together in a new run folder, with progress on stderr.

    `changes`: name of the type and seed that replace the file's; `models`: new folder for the injectors of the parts.
    Without `workers` this process simulates.
    """
    from commonrail.base.output import write_text
    from commonrail.plugins.family.run import MODELS, fit_type
    from commonrail.plugins.family.study import load_family
    from commonrail.runs.folder import new_folder, refuse_used

    if models is not None:
        refuse_used(models)
    family = replace(load_family(source), **changes)
    fit = partial(fit_type, folder, family, threads=threads, workers=workers)
    outcome = run_and_report(family.title, folder, lambda listener: fit(listener=listener))
    if models is not None:
        with new_folder(models) as place:
            for part_record in outcome.record["parts"]:
                file = f"{part_record['name']}.toml"
                write_text(place / file, read_plain(folder / MODELS / file).decode())
    return outcome


def _resume(folder: Path, options: RunOptions) -> None:
    from commonrail.plugins.family.run import TYPE, resume_family

    settings: dict[str, Any] = {
        "generations": options.generations,
        "as_begun": options.as_begun,
        "threads": options.threads,
    }
    with open_workers(options.workers, options.cluster) as workers:
        fit = partial(resume_family, folder, workers=workers, **settings)
        outcome = run_and_report(f"resuming {folder}", folder, lambda listener: fit(listener=listener))
    _print_family(outcome, options.json, folder / TYPE)


STUDY = StudyKind(_resume)


def _print_family(outcome: Outcome, json: bool, out: Path) -> None:
    """Print the result of a joint fit, or its record; exit status 130 if it was stopped. `out`: type file."""
    from commonrail.plugins.family.file import TEXTS
    from commonrail.plugins.family.injector_type import load_type
    from commonrail.plugins.family.page import family_lines
    from commonrail.report.fit.tables import tables_of

    record, injector_type = outcome.record, load_type(out)
    if json:
        figures = {
            "run": str(outcome.folder),
            "report": str(outcome.report),
            "status": record["status"],
            "cost": record["objective"]["best"],
            "injections": record["evaluations"]["injections"],
            "joint": record["joint"],
            "fits": {
                part_record["name"]: {"best": part_record["best"], "data": part_record["data"]}
                for part_record in record["parts"]
            },
        }
        print_json(_type_record(injector_type, out) | figures)
    else:
        print_synthetic(injector_type.synthetic)
        verdict, *notes = family_lines(record)
        print_text([verdict], notes=notes)
        _print_type(injector_type)
        for part_record in record["parts"]:
            for table in tables_of(part_record["data"], TEXTS):
                print_table(replace(table, title=f"{part_record['name']}: {table.title}"))
        click.echo(f"report: {outcome.report}")
    _say_written(injector_type, out)
    end_if_stopped(outcome)


def _say_written(injector_type: InjectorType, out: Path) -> None:
    from commonrail.plugins.family.injector_type import names_injector

    if not names_injector(injector_type):
        say(f"{out} does not name an injector; give `commonrail adapt` the part's injector.")
    say(f"wrote {out}")


def _type_record(injector_type: InjectorType, out: Path) -> dict[str, Any]:
    """Record of a type for ``--json``; `out`: its file."""
    parts = [{"name": p.name, "source": p.source, "injectors": p.injectors} for p in injector_type.parts]
    values = [
        {"name": p.name, "value": p.value, "spread": p.spread, "lower": p.lower, "upper": p.upper, "source": p.source}
        for p in injector_type.parameters
    ]
    head = {
        "schema": 1,
        "kind": "type",
        "type": str(out),
        "name": injector_type.name,
        "synthetic": injector_type.synthetic,
    }
    fixed = [{"name": v.name, "value": v.value, "mark": v.mark, "source": v.source} for v in injector_type.fixed]
    return {**head, "parts": parts, "parameters": values, "fixed": fixed}


def _print_type(injector_type: InjectorType) -> None:
    """Print the parameters of a type with their spreads."""
    from commonrail.physics.injector import parameter_quantities

    units = {name: q.unit for name, q in parameter_quantities().items()}
    rows = [
        [p.name, quantity(p.value, units[p.name]), quantity(p.spread, units[p.name])] for p in injector_type.parameters
    ]
    rows += [[v.name, quantity(v.value, units[v.name]), "fixed"] for v in injector_type.fixed]
    print_rows(["parameter", "value", "spread"], rows, injector_type.title, texts=1)
    _print_quantities(injector_type)


def _print_quantities(injector_type: InjectorType) -> None:
    """Print the spreads of a type as quantities, if its injector is known."""
    import numpy as np

    from commonrail.plugins.family.adapt import grid
    from commonrail.plugins.family.drawn import BAND, draw_quantities

    if injector_type.injector is None:
        return
    points = [point for point in grid() if point.pulses[0].duration in CORNERS[1]]
    points = [point for point in points if point.initial_pressures()[0] in CORNERS[0]]
    part_injector = injector_type.apply_to(injector_type.injector)
    try:
        drawn = draw_quantities(injector_type, part_injector, points)
    except SimulationError as error:
        say(str(error))
        return
    low, middle, high = (1e9 * np.quantile(drawn, share, axis=0) for share in (BAND[0], 0.5, BAND[1]))
    rows = [
        [
            quantity(point.initial_pressures()[0], "Pa"),
            quantity(point.pulses[0].duration, "s"),
            f"{middle[i]:.2f} mm³",
            f"{low[i]:.2f} to {high[i]:.2f} mm³",
        ]
        for i, point in enumerate(points)
    ]
    title = f"quantities of {len(drawn)} parts drawn with these spreads, 3 % for the flow; cylinder pressure 5 MPa"
    print_rows(["rail pressure", "energising time", "median", "90 % of parts"], rows, title, texts=0)
