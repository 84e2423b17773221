"""Noise from repeated shots: differences between data sets of one operating point, which no model takes part in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from commonrail.analysis.certainty.block import Block, fit_noise
from commonrail.analysis.certainty.laws import sample_count
from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError
from commonrail.kinds import DataSet

__all__ = ["with_shots"]


def with_shots(blocks: Sequence[Block], data: Sequence[DataSet]) -> tuple[Block, ...]:
    """Blocks whose noise models name repeated shots, with the noise of these.

    Parameters
    ----------
    blocks : sequence of Block
    data : sequence of DataSet
        In the same order.

    Raises
    ------
    ConfigurationError
        If a group has a single data set, or its data sets differ in kind or number of values.
    """
    groups: dict[str, list[int]] = {}
    for i, block in enumerate(blocks):
        if block.noise.shots:
            groups.setdefault(block.noise.shots, []).append(i)
    found = list(blocks)
    for name, members in groups.items():
        kinds = {(data[i].kind, blocks[i].size) for i in members}
        if len(members) < 2 or len(kinds) > 1:
            raise ConfigurationError(
                f'The repeated shots "{name}" must be two data sets or more of one kind with equally many values; '
                f"{', '.join(blocks[i].name for i in members)} cannot be compared."
            )
        apart = _deviations([blocks[i].at_zero for i in members])
        mean = -np.mean([blocks[i].at_zero for i in members], axis=0)
        used = sample_count(apart)  # the mean shot
        noise = fit_noise(
            replace(blocks[members[0]], noise=replace(blocks[members[0]].noise, shots="")),
            apart.reshape(-1),
            used,
            rate=np.tile(mean, len(members)),
        )
        for i in members:
            found[i] = replace(blocks[i], shots=replace(noise, growth=noise.growth.at(mean)))
    return tuple(found)


def _deviations(shots: Sequence[Floats]) -> Floats:
    """Deviations (shots, n) from the mean shot."""
    values = np.array(shots)
    return np.asarray(values - values.mean(axis=0))
