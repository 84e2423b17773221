"""Options of the verbs, and the reading of values with units from them."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.errors import CommonrailError, InputError, nearest
from commonrail.base.units import parse, parse_difference, to_text
from commonrail.cli.grammar import Argument, Option

if TYPE_CHECKING:
    from commonrail.base.arrays import Floats
    from commonrail.calibration.study import Study
    from commonrail.cli.model_name import NamedModel
    from commonrail.engine.operating_point import Energising
    from commonrail.physics.injector import Injector
    from commonrail.readers.columns import FileForm
    from commonrail.workers.workers import Workers


# Places to write to: refused before the work rather than after it.


def check_file(path: Path | None, option: str) -> None:
    """Refuse a file that could not be written later.

    Raises `InputError` if it is a folder, its folder is missing, or it is a file that a run has written or copied.
    Raises `OutputError` if it is a symbolic link or a device, or its folder is not writable.
    """
    if path is None:
        return
    if path.is_dir():
        raise InputError(f"{option}: {path} is a folder; name a file in it.")
    if not path.parent.is_dir():
        raise InputError(f"{option}: there is no folder {path.parent}; make it or name another.")
    from commonrail.base.output import check_target, writing

    check_target(path)
    if path.exists():
        from commonrail.runs.copies import refuse_file_of_run  # slow to import

        refuse_file_of_run(path, option)
    with writing(path, option):
        if path.exists():
            path.open("ab").close()
        tempfile.TemporaryFile(dir=path.parent).close()


def check_report(path: Path | None) -> None:
    """Refuse a report that could not be written later, or whose name does not end in .html."""
    check_file(path, "--report")
    if path is not None and path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--report: {path}: a report is an HTML page; name it {path.with_suffix('.html')}.")


def check_distinct(*paths: Path | None) -> None:
    """Refuse outputs of one command that would take each other's place.

    Raises `InputError` if two are one file.
    """
    seen: dict[Path, Path] = {}
    for path in paths:
        if path is None:
            continue
        place = path.absolute().parent.resolve() / path.name
        if place in seen:
            raise InputError(f"{path}: two outputs of one command are to be written there; name a file for each.")
        seen[place] = path


def check_folder(path: Path) -> None:
    """Refuse a folder that could not be made or written to later, without making it.

    Raises `InputError` if it is a file. Raises `OutputError` if the nearest folder above it is not writable.
    """
    above = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not above.is_dir():
        raise InputError(f"{path}: {above} is a file; name a folder.")
    from commonrail.base.output import writing

    with writing(path):
        tempfile.TemporaryFile(dir=above).close()


def free_run_folder(stem: str, under: Path = Path("runs")) -> Path:
    """First folder ``runs/<stem>-<n>`` that does not exist yet."""
    number = 1
    while (folder := under / f"{stem}-{number}").exists():
        number += 1
    return folder


def stem_of(source: Path) -> str:
    """Name for runs of a file: its stem, or its folder's name if the stem is study or family."""
    return source.absolute().parent.name if source.stem in ("study", "family") else source.stem


def is_given(name: str) -> bool:
    """Return whether an option of the verb that runs stands on the command line, by its parameter's name."""
    import click
    from click.core import ParameterSource

    context = click.get_current_context(silent=True)
    return context is not None and context.get_parameter_source(name) is not ParameterSource.DEFAULT


NO_RESULT = ("json", "full", "threads")  # options that change no result


def command_again(*without: str, **values: str) -> str:
    """Present command line, `without` some options and `NO_RESULT`, and with replaced values."""
    import shlex

    import click

    context = click.get_current_context()
    words = ["commonrail", str(context.info_name)]
    for param in context.command.params:
        name = str(param.name)
        if name in (*without, *NO_RESULT):
            continue
        value = values.get(name, context.params[name] if is_given(name) else ())
        for each in value if isinstance(value, tuple) else (value,):
            option = [] if isinstance(param, click.Argument) else [param.opts[0]]
            words += option if each is True else [*option, str(each)]
    return shlex.join(words)


def refuse_unused(needed: Mapping[str, tuple[bool, str]]) -> None:
    """Refuse options that would do nothing.

    `needed`: by the parameter's name, whether its prerequisite is present, and the prerequisite, such as "--out FILE".
    Raises `InputError` for the first option without effect.
    """
    for name, (useful, what) in needed.items():
        if not useful and is_given(name):
            raise InputError(f"--{name.replace('_', '-')}: without {what} it does nothing; add that, or omit it.")


# Axes on the command line: lists and ranges of values with their unit.

MOST_VALUES = 200
NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.A)


def read_axis(text: str, unit: str, option: str, *, increasing: bool = False) -> Floats:
    """Values (n,) of an axis in `unit`.

    `text`: ``"20,40,80MPa"``, ``"20MPa, 400bar"`` or a range ``"20:180:10MPa"`` of first value, last value and step. A
    unit at the end holds for the values before it that have none. `unit`: SI unit of the result. `increasing`: refuse
    values that do not increase strictly. Raises `InputError` if a value cannot be read, there are none or too many, or
    they have to increase and do not.
    """
    if ":" in text:
        return _range(text, unit, option)
    texts = _with_units(text.split(","), option)
    import numpy as np  # imported late: help does not need it

    values = np.array([parse(value_text, unit, option) for value_text in texts])
    if len(values) > MOST_VALUES:
        raise InputError(f"{option}: there are {len(values)} values, and at most {MOST_VALUES} are taken.")
    falls = np.flatnonzero(np.diff(values) <= 0.0).tolist() if increasing else []
    if falls:
        before, after = texts[falls[0] : falls[0] + 2]
        raise InputError(
            f"{option}: the values must increase strictly, but {after} follows {before}; sort them and remove repeated "
            "ones."
        )
    return values


def _range(text: str, unit: str, option: str) -> Floats:
    parts = text.split(":")
    if len(parts) != 3:
        raise InputError(f'{option} "{text}": a range is FIRST:LAST:STEP, such as 20:180:10MPa.')
    texts = _with_units(parts, option)
    first, last = (parse(limit_text, unit, option) for limit_text in texts[:2])
    step = parse_difference(texts[2], unit, option)  # of a temperature: 20 degC between two values, not 293 K
    if not (step > 0.0 and last >= first):
        raise InputError(
            f'{option} "{text}": the step of a range must be greater than zero, the last value not smaller.'
        )
    import numpy as np

    count = int(np.floor((last - first) / step * (1.0 + 1e-9) + 1e-9)) + 1
    if count > MOST_VALUES:
        raise InputError(f'{option} "{text}": the range has {count} values, and at most {MOST_VALUES} are taken.')
    return np.array([float(f"{first + step * i:.12g}") for i in range(count)])


def _with_units(parts: list[str], option: str) -> list[str]:
    """Texts with a unit each; a text without a unit takes the unit of the next text that has one."""
    completed: list[str] = []
    unit = ""
    for text in reversed(parts):
        match = NUMBER.fullmatch(text)
        if match is None:
            raise InputError(
                f'{option}: "{text.strip()}" is not a number with a unit; write a list such as 20,40,80MPa.'
            )
        if re.match(r"-\s*\d", match[2]):
            raise InputError(f'{option}: "{text.strip()}" is no number with a unit; write a range as 20:180:10MPa.')
        unit = match[2] or unit
        completed.append(f"{match[1]} {unit}")
    return completed[::-1]


Json = Annotated[bool, Option("--json", help="Print the result as one JSON object in SI units on stdout.")]
SheetName = Annotated[str | None, Option(help="Sheet of a workbook. [default: the first with cells]")]
Encoding = Annotated[str | None, Option(help="Encoding of a text that is no UTF-8, e.g. cp1252 or utf-16.")]
DecimalSign = Annotated[str | None, Option(help='Decimal sign of a text that does not tell it, "." or ",".')]
NoLive = Annotated[bool, Option("--no-live", help="Write the report without the chart that simulates in the browser.")]
StudyFile = Annotated[Path, Argument(metavar="STUDY.toml", help="Study file.")]
CylinderPressure = Annotated[
    str | None,
    Option(help="Cylinder pressure, e.g. 5MPa. [default: that of the first data of a run or study, else 5MPa]"),
]
ReturnPressure = Annotated[
    str | None,
    Option(
        help="Pressure at the end of the return line. [default: that of the first data of a run or study, else 0.5MPa]"
    ),
]
Settings = Annotated[
    tuple[str, ...],
    Option("--set", metavar="PATH=VALUE", help="Value of a parameter, with its unit or in SI units; repeatable."),
]
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


def read_form(encoding: str | None, decimal: str | None, sheet: str | None, files: Iterable[Path] = ()) -> FileForm:
    """Form of data files as options state it.

    `InputError` if the encoding or the decimal sign is unknown, or an option applies to none of the `files`.
    """
    from commonrail.readers.columns import FileForm, check_encoding
    from commonrail.readers.tables import idle_key

    form, files = FileForm(encoding or "", decimal or "", sheet or ""), list(files)
    if files and (idle := idle_key(form, files)):
        raise InputError(f"--{idle[0]} {getattr(form, idle[0])}: {idle[1]}.")
    if decimal not in (None, ".", ","):
        raise InputError(f'--decimal {decimal}: the decimal sign of a text is "." or ",".')
    return form._replace(encoding=check_encoding(encoding, "--encoding") if encoding else "")


def check_workers(count: int | None, address: str | None) -> None:
    """Refuse a number of workers for a cluster that is there already.

    Raises `InputError` if both are given.
    """
    if count is not None and address not in (None, "local"):
        raise InputError("--workers: a cluster has its own number of workers; omit --workers or --cluster.")


def open_workers(count: int | None, address: str | None) -> AbstractContextManager[Workers | None]:
    """Workers as asked for; none by default."""
    check_workers(count, address)
    if count is None and address is None:
        return nullcontext()
    if is_given("threads"):
        raise InputError("--threads: each worker computes on one thread; omit --threads, --workers or --cluster.")
    from commonrail.workers.workers import Workers

    return Workers.processes(count) if address is None else Workers.cluster(address, count)


def read_energisings(duration: str | None, pulses: Sequence[str]) -> tuple[Energising, ...] | float:
    """Energisings from ``--energising-time`` or from repeated ``--energising START:DURATION``.

    Raises `InputError` if both or neither are given, or one cannot be read.
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

    Warns on stderr of values that no built injector has, or that have no effect. Raises `InputError` if a setting
    cannot be read. Raises `ConfigurationError` if a value lies outside its domain.
    """
    from commonrail.cli.console import say
    from commonrail.readers.injector import idle_words

    if not settings:
        return injector
    overrides = [_setting(injector, text) for text in settings]
    values = dict(overrides)
    if len(values) < len(overrides):
        twice = next(path for i, (path, _) in enumerate(overrides) if path in dict(overrides[:i]))
        raise InputError(f"--set {twice}: it is set twice; keep one.")
    changed = injector.with_values(values)
    for name, value in values.items():
        if words := idle_words(name, changed.values.__getitem__):
            say(f"warning: --set {name}: {words}.")
        q = changed.quantities[name]
        if q.usual is not None and not q.is_usual(value):
            low, high = (to_text(limit, q.unit, 4) for limit in q.usual)
            say(
                f"warning: --set {name}: the {q.meaning} is {to_text(value, q.unit, 4)}, and {low} to {high} is usual; "
                "check its unit."
            )
    return changed


def read_models(texts: Sequence[str], settings: Sequence[str]) -> list[NamedModel]:
    """Models of a command line, all with the values of ``--set``; a changed model no longer counts as a run."""
    from commonrail.cli.model_name import read_model_names

    models = read_model_names(texts)
    if not settings:
        return models
    return [model._replace(injector=with_overrides(model.injector, settings), run=None) for model in models]


USUAL_PRESSURES = (5e6, 0.5e6)  # in the cylinder and at the end of the return line [Pa]; chosen


def read_pressures(
    cylinder: str | None,
    back: str | None,
    source: Path | Study | None = None,
    usual: tuple[float, float] = USUAL_PRESSURES,
) -> tuple[float, float]:
    """Cylinder pressure and pressure at the end of the return line [Pa].

    A pressure that is not stated comes from the first data of a run folder or study, else from `usual`; stderr reports
    it.
    """
    from commonrail.base.text import quantity
    from commonrail.cli.console import say

    texts = {"cylinder": cylinder, "return": back}
    stated = [None if text is None else parse(text, "Pa", f"--{name}-pressure") for name, text in texts.items()]
    if None not in stated:
        return stated[0], stated[1]  # type: ignore[return-value]
    defaults, origin = _data_pressures(source, usual)
    lacking = [
        f"{name} pressure {quantity(value, 'Pa')}"
        for name, stated_value, value in zip(texts, stated, defaults, strict=True)
        if stated_value is None
    ]
    say(f"{' and '.join(lacking)}: {origin}")
    pressures = [
        value if stated_value is None else stated_value for stated_value, value in zip(stated, defaults, strict=True)
    ]
    return pressures[0], pressures[1]


def _data_pressures(source: Path | Study | None, usual: tuple[float, float]) -> tuple[tuple[float, float], str]:
    """Pressures of the first data of a run folder or study, or the usual ones, and words on their origin."""
    if source is None:
        return usual, "the usual values"
    study, origin = source, "those of the study's first data"
    if isinstance(source, Path):
        from commonrail.runs.folder import read_fit

        try:
            study, origin = read_fit(source)[0], f"those of the first data of {source}"
        except CommonrailError:  # of a study made in Python
            return usual, f"the usual values, since {source} keeps no data"
    _, cylinder, back = study.data[0].points[0].initial_pressures()  # type: ignore[union-attr]
    return (cylinder, back), origin


def refuse_return_pressure(injector: Injector) -> None:
    """Refuse (`InputError`) the option --return-pressure for an injector without a return."""
    from commonrail.physics.variants import RETURN, reader_of, unread_inputs

    if RETURN in unread_inputs(injector.variant) and is_given(RETURN):
        raise InputError(
            f"--return-pressure: {injector.name} has no return and does not read it; take a model with "
            f"{reader_of(RETURN)}, or omit it."
        )


def _setting(injector: Injector, text: str) -> tuple[str, float]:
    from commonrail.base.arguments import not_whole

    path, equals, value = (piece.strip() for piece in text.partition("="))
    quantities = injector.quantities
    if not (path and equals and value):
        raise InputError(f'--set {text}: expected PATH=VALUE, such as "nozzle.holes=7".')
    if path not in quantities:
        raise InputError(
            f"--set {path}: {injector.name} has no such parameter{nearest(path, quantities)}; "
            "`commonrail catalogue parameters` lists those of all injectors."
        )
    try:
        number = float(value)
    except ValueError:
        number = parse(value, quantities[path].unit, f"--set {path}")
    if words := not_whole(path, number):
        raise InputError(f"--set {words}.")
    return path, number


def _energising(text: str) -> Energising:
    from commonrail.engine.operating_point import Energising

    return Energising(*read_pair(text, "s", f"--energising {text}", "START:DURATION, such as 900us:700us"))


def read_pair(text: str, unit: str, option: str, form: str) -> tuple[float, float]:
    """Two values in `unit` with a colon between them; InputError with the form that they should have."""
    first, colon, second = text.partition(":")
    if not colon:
        raise InputError(f"{option}: expected {form}.")
    return parse(first, unit, option), parse(second, unit, option)
