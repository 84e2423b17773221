"""Rows of a large table by their texts, and how many there may be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["MOST_ROWS", "Groups", "Indices"]

Indices = NDArray[np.intp]
Groups = dict[tuple[str, ...], Indices]

MOST_ROWS = 10_000_000  # many injectors, each with a curve
