"""Settings of short judgements; where this folder is on PYTHONPATH, Python imports this file and they apply."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

# Simulated positions for each coefficient, rounds, draws, draws that weights must be worth, steps of walkers, checks.
FEW = {"EACH": 5, "ROUNDS": 2, "DRAWS": 1000, "LEAST_SIZE": 50.0, "STEPS": 200, "THINNED": 5, "CHECKS": 48}
MODULE = "commonrail.plugins.certainty.draws"


class Finder:
    """Finds the module of the draws, and changes its settings once it is loaded."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        spec = PathFinder.find_spec(name, path, target) if name == MODULE else None
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def load_and_change(module: ModuleType) -> None:
                load(module)
                vars(module).update(FEW)

            spec.loader.exec_module = load_and_change  # type: ignore[method-assign]
        return spec


if __name__ == "sitecustomize":
    sys.meta_path.insert(0, Finder)
