"""Parameters in words: their meaning in place of their dotted name."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from commonrail.physics.injector import parameter_quantities

FORMULA_SIGNS = ("Eq.", "=")  # a meaning that cites a formula says less than the name


def describe_parameters(names: Iterable[str]) -> dict[str, str]:
    """Texts of parameters by their names: the meaning, or the name if the meaning is unknown, shared or a formula."""
    quantities = parameter_quantities()
    meanings = {name: quantities[name].meaning if name in quantities else name for name in names}
    count = Counter(meanings.values())
    return {
        name: name if count[meaning] > 1 or any(sign in meaning for sign in FORMULA_SIGNS) else meaning
        for name, meaning in meanings.items()
    }
