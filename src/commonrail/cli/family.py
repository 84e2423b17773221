"""commonrail family: type file of parts of one type, which were calibrated or are fitted together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import ClusterAddress, Json, Threads, WorkerCount, open_workers
from commonrail.cli.output import check_file, free_run_folder, stem_of
from commonrail.errors import InputError
from commonrail.units import parse

if TYPE_CHECKING:
    from commonrail.calibration.injector_type import InjectorType

__all__ = ["family"]


@verb
def family(
    sources: Annotated[
        tuple[Path, ...],
        Argument(
            metavar="SOURCE",
            help="Family file whose parts are fitted together; or run folders of `calibrate`, one for each part; or "
            "the folder of a fleet.",
        ),
    ],
    *,
    out: Annotated[Path, Option(metavar="TYPE.toml", help="Type file to be written.")],
    name: Annotated[str | None, Option(help="Name of the type. [default: that of the file]")] = None,
    part_spread: Annotated[
        str | None,
        Option(
            help="Assumed standard deviation between parts, e.g. 3%, for a type of one part. [default: the priors' of "
            "its study]"
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

    A study takes it as start and prior with the key `type`; `commonrail adapt` makes a part's model of it.
    The joint fit of a family file has a run folder: Ctrl-C stops it with the best values so far and exit
    status 130, and `commonrail resume RUN` resumes it.

    \b
    Examples:
      commonrail family cases/family/family.toml --out cri2.toml --models parts
      commonrail family runs/part-1 runs/part-2 runs/part-3 --out cri2.toml
      commonrail family fleets/line-4 --out cri2.toml
      commonrail family runs/part-1 --part-spread 3% --out cri2.toml
    """
    from commonrail.cli.family_run import print_family, print_type, run_family, type_record
    from commonrail.family.from_results import FLEET
    from commonrail.files.type_file import dump_type, names_injector

    check_file(out, "--out")
    share = None if part_spread is None else parse(part_spread, "1", "--part-spread")
    joint = [source for source in sources if source.suffix == ".toml"]
    if joint and len(sources) > 1:
        raise InputError(f"{joint[0]}: a family file is a source by itself; name it alone, or run folders only.")
    if not joint and any(one is not None for one in (run, models, seed, workers, cluster)):
        raise InputError("--run, --models, --seed, --workers and --cluster: only for a family file; omit them.")
    if share is not None and (joint or any((source / FLEET).is_file() for source in sources)):
        raise InputError("--part-spread: only for run folders; omit it for a family file or a fleet.")
    if joint:
        with open_workers(workers, cluster) as crew:
            stated = {key: value for key, value in (("name", name), ("seed", seed)) if value is not None}
            outcome = run_family(joint[0], run or free_run_folder(stem_of(joint[0])), stated, models, threads, crew)
        dump_type(outcome.fit.injector_type, out)
        print_family(outcome, json, out)
        return
    found = _from_results(sources, name or out.stem, share)
    dump_type(found, out)
    if json:
        print_json(type_record(found, out))
    else:
        print_type(found)
    if not names_injector(found):
        say(f"{out} names no injector of the catalogue; `commonrail adapt` needs one for it.")
    say(f"wrote {out}")


def _from_results(sources: Sequence[Path], name: str, share: float | None) -> InjectorType:
    from commonrail.family.from_results import FLEET, type_from_fleet, type_from_runs

    fleets = [source for source in sources if (source / FLEET).is_file()]
    if fleets and len(sources) > 1:
        raise InputError(f"{fleets[0]}: a fleet is a source by itself; name it alone, or run folders only.")
    if fleets:
        return type_from_fleet(fleets[0], name)
    _refuse_twice(sources)
    return type_from_runs(sources, name, part_spread=share)


def _refuse_twice(sources: Sequence[Path]) -> None:
    """Refuse a run that is named twice, or beside its copy: a part that equals another has no spread.

    Raises
    ------
    InputError
        If there is one.
    """
    from commonrail.files.run_folder import RESULT
    from commonrail.reading.guarded_file import fingerprint

    seen: dict[str, Path] = {}
    for source in sources:
        if (source / RESULT).is_file():
            first = seen.setdefault(fingerprint(source / RESULT), source)
            if first is not source:
                raise InputError(f"{source}: this is the same run as {first}; name each part once.")
