"""Draws of a posterior by matplotlib: each pair of parameters, or each parameter over the number of the draw."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot

from commonrail.base.errors import ConfigurationError
from commonrail.plugins.certainty.file import Certainty
from commonrail.report.figure import FAMILIES, LOOKS

BINS = 40
KINDS = ("corner", "trace")


def draw_posterior(certainty: Certainty, ax: Any, kind: str) -> Any:
    """Draw a corner plot into axes (d, d), or the traces of d parameters into axes (d,); new ones by default."""
    if kind not in KINDS:
        raise ConfigurationError(f"The kind of a posterior plot must be one of {', '.join(KINDS)}, not {kind!r}.")
    d, points, corner = certainty.d, certainty.points, kind == "corner"
    columns, size = d if corner else 1, 1.9 * max(d, 2)
    if ax is None:
        _, ax = pyplot.subplots(
            d, columns, squeeze=False, sharex="col", layout="constrained", figsize=(size if corner else 7.0, size)
        )
    axes = np.asarray(ax, dtype=object)
    if axes.size != d * columns:
        raise ConfigurationError(f"A {kind} plot of {d} parameters needs {d * columns} axes, not {axes.size}.")
    axes = axes.reshape(d, columns)
    units = certainty.estimate.likelihood.units
    labels = [f"{name} [{unit}]" for name, unit in zip(certainty.names, units, strict=False)]
    for i, value in enumerate(certainty.point):
        if corner:  # histogram of parameter i, and its draws over the draws of each previous parameter
            axes[i, i].hist(points[:, i], BINS, color=FAMILIES[0], alpha=0.5)
            axes[i, i].axvline(value, color=LOOKS["best"][0], linewidth=1.0)
            axes[i, i].set_yticks([])
            for j in range(i):
                axes[i, j].plot(points[:, j], points[:, i], ".", markersize=1.0, color=FAMILIES[0], alpha=0.3)
            for unused in axes[i, i + 1 :]:
                unused.set_axis_off()
        else:
            axes[i, 0].plot(points[:, i], linewidth=0.5, color=FAMILIES[0])
            axes[i, 0].axhline(value, color=LOOKS["best"][0], linewidth=1.0)
        if i > 0 or not corner:
            axes[i, 0].set_ylabel(labels[i])
    for j in range(columns):
        axes[-1, j].set_xlabel(labels[j] if corner else "draw")
    return axes if corner else axes[:, 0]
