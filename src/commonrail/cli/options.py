"""Options of the verbs, and the reading of values with units from them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.cli.grammar import Argument, Option
from commonrail.errors import InputError, nearest
from commonrail.units import parse

if TYPE_CHECKING:
    from commonrail.engine.operating_point import Energising
    from commonrail.injector.definition import Injector
    from commonrail.workers.workers import Workers

__all__ = [
    "ClusterAddress",
    "Json",
    "OutFile",
    "PlotFile",
    "StudyFile",
    "Threads",
    "WorkerCount",
    "check_workers",
    "open_workers",
    "read_energisings",
    "with_overrides",
]


Json = Annotated[bool, Option("--json", help="Print the result as one JSON object in SI units on stdout.")]
StudyFile = Annotated[Path, Argument(metavar="STUDY.toml", help="Study file.")]
OutFile = Annotated[
    Path | None,
    Option("--out", help="CSV file to be written with rate, lifts, pressures and current against time."),
]
PlotFile = Annotated[Path | None, Option("--plot", help="HTML file to be written with the same as plots.")]
Threads = Annotated[
    int | None,
    Option(min=1, help="Number of threads; does not change the result. [default: all processors]"),
]
WorkerCount = Annotated[
    int | None,
    Option("--workers", min=1, help="Number of worker processes, for large populations. [default: none]"),
]
ClusterAddress = Annotated[
    str | None,
    Option("--cluster", metavar="ADDRESS", help='Address of a Dask scheduler, e.g. tls://host:8786, or "local".'),
]


def check_workers(count: int | None, address: str | None) -> None:
    """Refuse a number of workers for a cluster that is there already.

    Raises
    ------
    InputError
        If both are given.
    """
    if count is not None and address not in (None, "local"):
        raise InputError("--workers: a cluster has its own number of workers; omit --workers or --cluster.")


def open_workers(count: int | None, address: str | None) -> AbstractContextManager[Workers | None]:
    """Workers as asked for; none by default."""
    from commonrail.workers.workers import Workers

    check_workers(count, address)
    if address is not None:
        return Workers.cluster(address, count)
    return nullcontext() if count is None else Workers.processes(count)


def read_energisings(duration: str | None, pulses: Sequence[str]) -> tuple[Energising, ...] | float:
    """Energisings from ``--energising-time`` or from repeated ``--energising START:DURATION``.

    Raises
    ------
    InputError
        If both or neither are given, or one cannot be read.
    """
    if (duration is None) == (not pulses):
        raise InputError(
            "Give --energising-time for one injection, or --energising START:DURATION once for each of several."
        )
    if duration is not None:
        return parse(duration, "s", "--energising-time")
    return tuple(_energising(text) for text in pulses)


def with_overrides(injector: Injector, settings: Sequence[str]) -> Injector:
    """The injector with values from ``--set path=value``; a value has its unit or is a plain SI number.

    Raises
    ------
    InputError
        If a setting cannot be read.
    ConfigurationError
        If a value lies outside its domain.
    """
    from commonrail.injector.reads import reader_of, unread_parameters

    if not settings:
        return injector
    found = list(map(_setting, settings))
    values = dict(found)
    if len(values) < len(found):
        twice = next(path for i, (path, _) in enumerate(found) if path in dict(found[:i]))
        raise InputError(f"--set {twice}: it is set twice; keep one.")
    for name in unread_parameters(injector.variant).intersection(values):
        raise InputError(
            f"--set {name}: {injector.name} with {injector.variant.label} does not read it; take a model with "
            f"{reader_of(name)}, or omit it."
        )
    return injector.with_values(values)


def _setting(text: str) -> tuple[str, float]:
    from commonrail.arguments import not_whole
    from commonrail.injector.definition import parameter_quantities

    path, equals, value = (part.strip() for part in text.partition("="))
    known = parameter_quantities()
    if not (path and equals and value):
        raise InputError(f'--set {text}: expected PATH=VALUE, such as "nozzle.holes=7".')
    if path not in known:
        raise InputError(
            f"--set {path}: there is no such parameter{nearest(path, known)}; "
            "`commonrail catalogue parameters` lists them."
        )
    try:
        found = float(value)
    except ValueError:
        found = parse(value, known[path].unit, f"--set {path}")
    if words := not_whole(path, found):
        raise InputError(f"--set {words}.")
    return path, found


def _energising(text: str) -> Energising:
    from commonrail.engine.operating_point import Energising

    where = f"--energising {text}"
    start, colon, duration = text.partition(":")
    if not colon:
        raise InputError(f"{where}: expected START:DURATION, such as 900us:700us.")
    return Energising(parse(start, "s", where), parse(duration, "s", where))
