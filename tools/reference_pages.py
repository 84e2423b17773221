"""Pages of the reference that are generated from the code, by the same declarations as the program.

Commands are those of the verbs, keys of files those of their models, parameters those of the components, Python the
public names. `tools/site_pages.py` hands them to the site.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import re
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, get_args

import click
from pydantic import BaseModel

from commonrail.base.public import find_stub, read_stub

# Symbols of the paper (Lino, Maione, Saponaro, Li 2016) and its equations, by path.
SYMBOLS = {
    "feed_pipe.length": "L (6)",
    "feed_pipe.diameter": "D (6)",
    "feed_pipe.friction_factor": "f (6)",
    "control_chamber.volume": "V (3)",
    "control_chamber.z_hole_diameter": "A_0 (4)",
    "control_chamber.z_hole_discharge": "c_d (4)",
    "control_chamber.a_hole_diameter": "A_0 (4)",
    "control_chamber.a_hole_discharge": "c_d (4)",
    "valve.lift": "part of l_a (11)",
    "valve.seat_discharge": "c_d (4)",
    "solenoid.turns": "N (11)",
    "solenoid.resistance": "R (11)",
    "solenoid.pole_area": "A_g (11)",
    "solenoid.residual_gap": "part of l_a (11)",
    "solenoid.air_gaps": "1 in (11), 2 in (12)",
    "solenoid.iron_length": "l_s (11)",
    "solenoid.permeability": "part of f(φ/A_g) (11)",
    "solenoid.knee_flux_density": "part of f(φ/A_g) (11)",
    "accumulation.volume": "V (3)",
    **{f"plunger_needle.k{i}": f"k{i} (8), (10)" for i in range(1, 8)},
    **{f"plunger_needle.m{i}": "M (8)" for i in range(1, 8)},
    "plunger_needle.joint_stiffness": "k (10)",
    "plunger_needle.damping_ratio": "ξ (below 8)",
    "plunger_needle.plunger_diameter": "d (5)",
    "plunger_needle.guide_diameter": "d (5)",
    "plunger_needle.plunger_gap": "g (5)",
    "plunger_needle.plunger_guide_length": "l (5)",
    "plunger_needle.needle_gap": "g (5)",
    "plunger_needle.needle_guide_length": "l (5)",
    "needle_seat.discharge": "c_d (4)",
    "sac.volume": "V (3)",
    "nozzle.holes": "N (4)",
    "nozzle.hole_diameter": "A_0 (4)",
    "nozzle.discharge_transition": "c_d(z0) (9)",
    "nozzle.discharge_maximum": "c_d(zM) (9)",
    "nozzle.lift_maximum_slope": "K1 (9)",
    "nozzle.lift_maximum_offset": "K2 (9)",
    "nozzle.lift_transition_slope": "K3 (9)",
    "nozzle.lift_transition_offset": "K4 (9)",
    "fuel.temperature": "T (2)",
}

# Files that users write: title, module and model of the whole file or of a block.
MODELS = {
    "Study": [
        ("calibration.study_keys", "StudyModel"),
        ("calibration.study_keys", "ParameterModel"),
        ("calibration.study_keys", "FixedModel"),
        ("calibration.study_keys", "ConstraintsModel"),
        ("calibration.study_keys", "ConditionModel"),
        ("calibration.study_keys", "JudgementModel"),
        ("data.curves.samples", "RateModel"),
        ("data.curves.samples", "ShotsModel"),
        ("data.quantities.reading", "QuantitiesModel"),
        ("data.quantities.returned", "ReturnsModel"),
        ("plugins.plans.data", "PlanModel"),
        ("plugins.features.targets_file", "FeaturesModel"),
        ("plugins.features.targets_file", "TargetModel"),
        ("data.noise", "NoiseModel"),
    ],
    "Injector": [("readers.injector", "_Head")],
    "Fuel": [("readers.fuel", "FuelModel")],
    "Type": [
        ("plugins.family.injector_type", "_TypeModel"),
        ("plugins.family.injector_type", "_PartModel"),
        ("plugins.family.injector_type", "_ParameterModel"),
    ],
    "Family": [("plugins.family.study", "_FamilyModel"), ("plugins.family.study", "_SpreadModel")],
    "Fleet": [("plugins.fleet.study", "_FleetModel")],
    "Tolerances": [("plugins.tolerance.file", "_ToleranceModel"), ("plugins.tolerance.file", "_PointModel")],
    "Truth of the virtual bench": [("plugins.paper.bench_file", "_Head"), ("plugins.paper.bench_file", "_Numerics")],
    "Study of an FMU": [
        ("plugins.foreign_fmu.study", "_StudyModel"),
        ("plugins.foreign_fmu.study", "_DataModel"),
        ("plugins.foreign_fmu.study", "_ParameterModel"),
    ],
}


def cell(text: Any) -> str:
    """Text of a cell of a Markdown table."""
    return re.sub(r"\s+", " ", str(text)).replace("|", "\\|").replace("<", "&lt;").strip()


def table(head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines) + "\n"


# --- Commands -------------------------------------------------------------------------------------------------------


def _option(parameter: click.Parameter) -> tuple[str, str, str]:
    metavar = parameter.metavar or ("" if getattr(parameter, "is_flag", False) else parameter.type.name.upper())
    if isinstance(parameter.type, click.Choice):
        metavar = "|".join(map(str, parameter.type.choices))
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    if isinstance(parameter, click.Argument):
        names = f"`{parameter.metavar or parameter.human_readable_name.upper()}`"
    elif metavar:
        names += f" {metavar}"
    default = parameter.default
    plain = isinstance(default, str | int | float | Path) and not isinstance(default, bool)
    shown = "required" if parameter.required else str(default) if plain else ""
    return names, getattr(parameter, "help", None) or "", shown


def commands() -> str:
    """Every verb with its help, its example and its options."""
    from commonrail.cli.grammar import cli

    context = click.Context(cli, info_name="commonrail")
    parts = ["# Commands\n\nGenerated from their declarations. [Rules](command-line.md) that hold for all.\n"]
    for group, prefix in [(cli, "")]:
        parts += _verbs(group, context, prefix)
    return "\n".join(parts)


def _verbs(group: Any, context: click.Context, prefix: str) -> list[str]:
    parts = []
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        text, _, examples = inspect.cleandoc(command.help or "").replace("\b", "").partition("Examples:")
        if not examples:
            text, _, examples = text.partition("Example:")
        parts.append(f"## {prefix}{name}\n\n{text.strip()}\n")
        if isinstance(command, click.Group):
            parts += _verbs(command, click.Context(command, info_name=name, parent=context), f"{prefix}{name} ")
            continue
        if examples:
            lines = [
                line.strip() if line.lstrip().startswith("commonrail") else f"    {line.strip()}"
                for line in examples.strip().splitlines()
            ]
            parts.append("```text\n" + "\n".join(lines) + "\n```\n")
        rows = [_option(p) for p in command.params if not getattr(p, "hidden", False)]
        parts.append(table(("option", "meaning", "default"), rows))
    return parts


# --- Parameters -----------------------------------------------------------------------------------------------------


def parameters() -> str:
    """Every parameter of an injector with symbol, unit, meaning, domain, default and usual range."""
    import commonrail as cr

    parts = [
        "# Parameters\n\nGenerated from the declarations of the components: names as in files, studies and `--set`, "
        "SI units. Symbols and equations are the paper's. A default is an engineering "
        "estimate [E] unless the injector's file gives another value.\n"
    ]
    groups: dict[str, list[tuple[Any, ...]]] = defaultdict(list)
    for path, q in cr.models.parameter_quantities().items():
        component, _, key = path.partition(".")
        default = "must be given" if q.default is None else f"{q.default:g}"
        usual = "" if not q.usual else f"{q.usual[0]:g} to {q.usual[1]:g}"
        groups[component].append((f"`{key}`", SYMBOLS.get(path, ""), q.unit, q.meaning, q.domain.value, default, usual))
    head = ("key", "symbol", "unit", "meaning", "domain", "default", "usual")
    for component, rows in groups.items():
        parts.append(f"## {component}\n\n{table(head, rows)}")
    return "\n".join(parts)


# --- Keys of files --------------------------------------------------------------------------------------------------


def _type(annotation: Any) -> str:
    """Type of a key as words: unit of a quantity, values of a choice."""
    text = re.sub(r"\b(?:[a-z_]\w*\.)+", "", str(annotation)).replace("NoneType", "None")
    unit = re.search(r"Unit\(unit='([^']+)'", text)
    members = (
        [m.value for m in annotation] if inspect.isclass(annotation) and hasattr(annotation, "__members__") else []
    )
    if members:
        return " or ".join(f'"{m}"' for m in members)
    if unit:
        return f"quantity [{unit[1]}]"
    literal = [a for a in get_args(annotation) if isinstance(a, str)]
    if literal:
        return " or ".join(f'"{a}"' for a in literal)
    if inspect.isclass(annotation):
        simple = {"str": "text", "float": "number", "int": "whole number", "bool": "true or false"}
        return simple.get(annotation.__name__, "table")
    names = re.findall(r"\b(?:str|float|int|bool|list|dict|tuple|\w+Model)\b", text)
    words = {
        "str": "text",
        "float": "number",
        "int": "whole number",
        "bool": "true or false",
        "tuple": "list",
        "dict": "table",
    }
    return (
        " or ".join(dict.fromkeys(words.get(n, "table" if n.endswith("Model") else n) for n in names)) or "see the page"
    )


def _keys(model: type[BaseModel]) -> str:
    rows = []
    for name, field in model.model_fields.items():
        unit = next((f"quantity [{m.unit}]" for m in field.metadata if hasattr(m, "unit")), "")
        default = None if field.is_required() or field.default_factory else field.default
        plain = "" if default in (None, [], {}, "") else str(getattr(default, "value", default))
        shown = "required" if field.is_required() else plain
        rows.append(
            (
                f"`{field.alias or name}`",
                unit or _type(field.annotation),
                shown if len(shown) < 60 else "",
                field.description or "",
            )
        )
    return table(("key", "type", "default", ""), rows)


def files() -> str:
    """Keys of every file, from the models that check them."""
    parts = [
        "# Keys of every file\n\nGenerated from the models that check the files. A quantity is text with a unit of the "
        "same kind. The how-to pages say what keys mean.\n"
    ]
    for title, models in MODELS.items():
        parts.append(f"## {title}\n")
        for module, name in models:
            model = getattr(importlib.import_module(f"commonrail.{module}"), name)
            said = inspect.cleandoc(model.__doc__ or "").partition("\n\n")[0]
            parts.append(f"**{name.strip('_').removesuffix('Model')}**: {said}\n\n{_keys(model)}")
    return "\n".join(parts)


# --- Terms of the reports ---------------------------------------------------------------------------------------------


def terms() -> str:
    """Terms of the reports, each with the page that says more."""
    from commonrail.report.html import glossary

    rows = [(f"**{term.name}**", term.meaning.replace("|", "\\|"), f"[more](../{term.page})") for term in glossary()]
    return "# Terms of the reports\n\n" + table(("term", "meaning", ""), rows)


# --- Python ---------------------------------------------------------------------------------------------------------


def python(space: str = "") -> str:
    """Public names of a namespace, by default those of the package itself, with their docstrings."""
    module = importlib.import_module(f"commonrail.{space}".rstrip("."))
    names = [name for name in module.__all__ if name not in NAMESPACES]
    parts = [f"# commonrail{space and f'.{space}'}\n\n{inspect.getdoc(module)}\n"]
    if not space:
        parts.append(
            "Arguments and units: [Call it from Python](../howto/python.md). Names without a page may change.\n"
        )
        rows = [
            (f"[`{name}`](python-{name}.md)", inspect.getdoc(importlib.import_module(f"commonrail.{name}")))
            for name in NAMESPACES
        ]
        parts.append(table(("namespace", "content"), rows))
    homes = read_stub(find_stub(space))
    for name in sorted(names, key=str.lower):
        parts.append(f"::: {homes[name]}.{name}\n    options:\n      heading: {name}\n      toc_label: {name}\n")
        parts += _settings(getattr(module, name))
    return "\n".join(parts)


def _settings(kind: Any) -> list[str]:
    """Table of the declared settings of a class; empty if it is another object."""
    from commonrail.base.declare import read_declarations

    if not (inspect.isclass(kind) and dataclasses.is_dataclass(kind)) or not (declared := read_declarations(kind)):
        return []
    rows = [
        (f"`{name}`", declaration.accepted, declaration.default_text, declaration.meaning)
        for name, declaration in declared.items()
    ]
    return [table(("setting", "value", "default", "meaning"), rows)]


NAMESPACES = tuple(name for name, home in read_stub(find_stub("")).items() if home == ".")
GENERATED: dict[str, Callable[[], str]] = {
    "commands": commands,
    "parameters": parameters,
    "files": files,
    "terms": terms,
    "python": python,
    **{f"python-{space}": partial(python, space) for space in NAMESPACES},
}
