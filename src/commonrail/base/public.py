"""Public names of the package and its namespaces: loaded from the modules named in the stub next to each."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

_NAME = re.compile(r"^from (\S+) import (\w+) as \w+$", re.M)
PACKAGE = "commonrail"

# Present names of moved functions and classes, by former name.
RENAMED = {
    "certify": "certainty",
    "judge_part": "parts.judge",
    "map": "maps.quantity_map",
    "Plan": "design.MeasurementPlan",
    "run_plan": "parts.plan",
    "Trim": "parts.SeriesTrim",
}


@cache
def read_stub(stub: Path) -> dict[str, str]:
    """Module of each public name in a stub; ``"."`` for a namespace."""
    return {name: home for home, name in _NAME.findall(stub.read_text(encoding="utf-8"))}


def attach(module: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """``__getattr__``, ``__dir__`` and ``__all__`` of a module whose names are in the stub next to its file (PEP 562).

    A name is imported when it is first used. Raises `AttributeError` for any other, which says where the name is if
    another namespace has it.
    """
    homes = read_stub(Path(file).with_suffix(".pyi"))
    names = sorted(homes)

    def load(name: str) -> Any:
        if name in homes:
            return (
                import_module(f"{PACKAGE}.{name}") if homes[name] == "." else getattr(import_module(homes[name]), name)
            )
        if name.startswith("_"):
            raise AttributeError(f"{module} has no {name}.")
        if place := find(name):
            raise AttributeError(f"{module} has no {name}; it is {place}.")
        from commonrail.base.errors import nearest  # importing the package loads no other module of it

        raise AttributeError(f"{module} has no {name}{nearest(name, names)}; dir({module}) lists what it has.")

    return load, lambda: names, names


def find_stub(space: str) -> Path:
    """Stub of a namespace; of the package itself for an empty name."""
    folder = Path(__file__).parents[1] / space
    return folder / "__init__.pyi" if folder.is_dir() else folder.with_suffix(".pyi")


def places() -> dict[str, str]:
    """Every public name with its module: `commonrail` or a namespace of it."""
    flat = read_stub(find_stub(""))
    modules = {name: PACKAGE for name, home in flat.items() if home != "."}
    for space in (name for name, home in flat.items() if home == "."):
        modules |= dict.fromkeys(read_stub(find_stub(space)), f"{PACKAGE}.{space}")
    return modules


def find(name: str) -> str:
    """Current place of a public name of any namespace, also by its former name; empty if unknown."""
    if name in RENAMED:
        return f"{PACKAGE}.{RENAMED[name]}"
    home = places().get(name)
    return f"{home}.{name}" if home else ""
