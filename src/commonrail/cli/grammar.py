"""Grammar of the command: its verbs, each imported when it is called, and their options from annotated signatures.

A verb is a click command that is registered in the group "verbs" of `commonrail.base.registry`. The verbs of this
package are functions under the decorator `verb`. Installed packages may use the decorator or click directly.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from dataclasses import is_dataclass
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

import click

from commonrail.base.arguments import LARGEST_WHOLE
from commonrail.base.declare import read_declarations
from commonrail.base.errors import PluginError, nearest
from commonrail.base.hooks import catch_stops, check_unheld_stop
from commonrail.base.registry import entries, find, words_on_shipped
from commonrail.base.units import parse
from commonrail.cli.console import SHORT, ShortForm, print_lines, say, short_form
from commonrail.cli.grid import LINES
from commonrail.cli.guard import check_paths, end_on_errors


class Option:
    """Declaration of an option in the annotation of a parameter: ``Annotated[type, Option(...)]``.

    Parameters
    ----------
    *names : str
        Names on the command line, if they differ from the parameter's name.
    **settings
        ``help``, ``metavar``, ``min`` and ``max``, ``unit``, the SI unit of a number that is given as text with its
        unit, or what else `click.Option` takes.
    """

    def __init__(self, *names: str, **settings: Any) -> None:
        self.names, self.settings = names, settings


class Argument(Option):
    """Declaration of a positional argument, with the parameters of `Option`."""


class _Argument(click.Argument):
    """Positional argument with a help text, which click supports from 8.5 on."""

    def __init__(self, *args: Any, text: str, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.text = text

    def make_metavar(self, *context: Any) -> str:  # without a context below click 8.2
        """Name in the usage."""
        name = self.human_readable_name if self.required else f"[{self.human_readable_name}]"
        return name if self.nargs == 1 else f"{name}..."


class _FiniteRange(click.FloatRange):
    """Range of numbers; click takes nan for a number within any limits."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Read a finite number within the limits."""
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Verb(click.Command):
    """Command of a function."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the positional arguments before the options."""
        arguments = [(param.make_metavar(ctx), param.text) for param in self.params if isinstance(param, _Argument)]
        if arguments:
            with formatter.section("Arguments"):
                formatter.write_dl(arguments)
        super().format_options(ctx, formatter)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the command line; refuse a repeated single-valued option, of which click would take the last value.

        An option with several values is refused if two values are equal.
        """
        seen: set[str | None] = set()
        values, _, order = self.make_parser(ctx).parse_args(list(args))
        for param in order:
            if param.multiple and len(set(values[param.name])) < len(values[param.name]):
                ctx.fail(f"Option '{param.opts[-1]}' is given twice with the same value; name each once.")
            if isinstance(param, click.Option) and not (param.multiple or param.is_flag):
                if param.name in seen:
                    ctx.fail(f"Option '{param.opts[-1]}' is given twice, and one value is expected.")
                seen.add(param.name)
        return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the function, and report what its short tables omit."""
        check_paths(ctx.params)
        try:
            return super().invoke(ctx)
        finally:
            if (short := short_form()) and (hint := short.hint()):
                print_lines([hint])


def verb(function: Callable[..., None]) -> Verb:
    """Make a command of a function, whose docstring is the help.

    Each of its parameters is annotated with ``Annotated[type, Option(...)]`` or ``Annotated[type, Argument(...)]``. The
    type is str, int, float, bool (a flag), Path or an enumeration of texts; a ``tuple[type, ...]`` may be repeated, and
    ``type | None`` is None if the option is absent. A dataclass of such fields is a group that several verbs share. In
    a dataclass declared with `commonrail.base.declare.settings`, each setting becomes an option.
    """
    params: list[click.Parameter] = []
    groups: dict[str, tuple[Callable[..., Any], list[str]]] = {}
    for each in inspect.signature(function, eval_str=True).parameters.values():
        fields = [each]
        if is_dataclass(group := each.annotation) and isinstance(group, type):
            fields = _fields(group)
            groups[each.name] = group, [field.name for field in fields]
        params += map(_parameter, fields)

    def call(**values: Any) -> None:
        group_values = {name: kind(**{key: values.pop(key) for key in keys}) for name, (kind, keys) in groups.items()}
        function(**group_values, **values)

    name = function.__name__.rstrip("_").replace("_", "-")
    return Verb(name, callback=call if groups else function, params=params, help=inspect.getdoc(function))


def _fields(group: type) -> list[inspect.Parameter]:
    """Fields of a group as parameters; a declared setting provides its type, help and default."""
    declared, fields = read_declarations(group), []
    for field in inspect.signature(group, eval_str=True).parameters.values():
        if (setting := declared.get(field.name)) is None:
            fields.append(field)
        elif setting.option:
            kind, options = setting.kind, dict[str, Any](help=setting.meaning)
            if setting.read is not None:
                kind = str  # read by the group
            elif setting.type is float:
                options["unit"] = setting.unit
                field = field.replace(
                    default=field.empty if setting.default_text == "required" else setting.default_text or None
                )
            elif setting.type is int:
                low, high = setting.whole_limits
                options |= {"min": low} if high == LARGEST_WHOLE else {"min": low, "max": high}
            fields.append(field.replace(annotation=Annotated[kind, Option(**options)]))
    return fields


def _parameter(parameter: inspect.Parameter) -> click.Parameter:
    """Option or argument of click for a parameter of a function."""
    kind, declared = get_args(parameter.annotation)
    kind = get_args(kind)[0] if isinstance(kind, UnionType) else kind
    several = get_origin(kind) is tuple
    kind = get_args(kind)[0] if several else kind
    settings: dict[str, Any] = {"required": parameter.default is parameter.empty, **declared.settings}
    limits = {name: settings.pop(name) for name in ("min", "max") if name in settings}
    if unit := settings.pop("unit", ""):
        settings["type"] = str
        settings["callback"] = lambda ctx, param, value: None if value is None else parse(value, unit, param.opts[-1])
    elif limits:
        settings["type"] = (click.IntRange if kind is int else _FiniteRange)(**limits)
    elif kind is Path:
        settings["type"] = click.Path(path_type=Path)
    elif issubclass(kind, Enum):  # click from 8.2 takes enumerations, but by the names of their members
        settings["type"] = click.Choice([member.value for member in kind])
        settings["callback"] = lambda ctx, param, value: None if value is None else kind(value)
    elif kind is bool:
        settings["is_flag"] = True
    else:
        settings["type"] = kind
    if not (settings["required"] or several):
        settings["default"] = getattr(parameter.default, "value", parameter.default)
    if isinstance(declared, Argument):
        return _Argument([parameter.name], nargs=-1 if several else 1, text=settings.pop("help"), **settings)
    names = declared.names or ("--" + parameter.name.replace("_", "-"),)
    return click.Option([parameter.name, *names], multiple=several, show_default=parameter.default != "", **settings)


def table_verb(function: Callable[..., None]) -> Verb:
    """Make a command of a function that prints tables: a short form of them, and all with --full."""
    command = verb(function)
    names = [param.name for param in command.params]
    place = names.index("json") if "json" in names else len(names)
    command.params.insert(
        place, click.Option(["--full"], is_flag=True, expose_value=False, callback=_choose_form, help=FULL)
    )
    return command


FULL = f"Print all rows, columns and tables, in place of {LINES} lines."


def _choose_form(ctx: click.Context, _: click.Parameter, full: bool) -> None:
    ctx.meta[SHORT] = None if full else ShortForm()


class Verbs(click.Group):
    """Group of the registered verbs whose names begin with `prefix`, such as "lab "."""

    def __init__(self, *args: Any, prefix: str = "", **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.prefix = prefix

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the verbs, shipped verbs first; a verb that cannot be loaded is reported on stderr."""
        names = []
        for name in self._names():
            try:
                self.get_command(ctx, name)
            except PluginError as error:
                say(f"commonrail: {error}")
            else:
                names.append(name)
        return names

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a verb; None if no verb has the name.

        Raises `PluginError` if the verb of an installed package cannot be loaded, or is not a click command.
        """
        entry = find("verbs", self.prefix + cmd_name)
        if entry is None:
            return None
        return entry.load_as(click.Command, "a command of click")

    def _names(self) -> list[str]:
        names = [name.removeprefix(self.prefix) for name in entries("verbs") if name.startswith(self.prefix)]
        return [name for name in names if " " not in name]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Import the called verb; from then on Ctrl-C requests a stop, see `catch_stops`."""
        if find("verbs", self.prefix + args[0]) is None:
            names = self._names() if self.prefix else [*entries("verbs")]
            ctx.fail(f"No such command '{args[0]}'{nearest(args[0], names)}.")
        resolved = super().resolve_command(ctx, args)
        ctx.with_resource(catch_stops())
        return resolved

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the verbs under headings; verbs without a heading, such as from installed packages, come last."""
        headings = words_on_shipped("HEADINGS")
        names = self.list_commands(ctx)
        placed = {name for verbs in headings.values() for name in verbs}
        for heading, verbs in (*headings.items(), ("Other", [name for name in names if name not in placed])):
            commands = [(name, self.get_command(ctx, name)) for name in verbs if name in names]
            width = formatter.width - 6 - max((len(name) for name in names), default=0)
            rows = [(name, command.get_short_help_str(width)) for name, command in commands if command is not None]
            if rows:
                with formatter.section(heading if self.prefix == "" else "Commands"):
                    formatter.write_dl(rows)

    def make_context(self, *args: Any, **settings: Any) -> click.Context:
        """Read the options of the command itself; a mistake in them becomes a sentence."""
        with end_on_errors():
            return super().make_context(*args, **settings)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the verb; an exception ends as a sentence, and a requested stop as a failure."""
        with end_on_errors():
            result = super().invoke(ctx)
            check_unheld_stop()
            return result


# The help is plain: it reads the same in a terminal, a log and a page of documentation.
@click.command(
    "commonrail", cls=Verbs, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(package_name="commonrail", message="%(prog)s %(version)s", help="Print the version.")
@click.option("--traceback", is_flag=True, help="Show the traceback of an error.")
def cli(traceback: bool) -> None:
    """Simulate a common-rail electro-injector and calibrate it to measured injection curves.

    \b
    Start here:
      commonrail new my-injector
      commonrail calibrate my-injector/study.toml
      commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us
    """


lab = Verbs(
    "lab",
    prefix="lab ",
    help="""Check the program, and repeat the study of a paper.

    \b
    Examples:
      commonrail lab verify --quick
      commonrail lab reproduce --quick
    """,
)
