"""State of a stepper that its caller keeps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError
from commonrail.stepper.course import Held

__all__ = ["Kept", "refuse_damaged"]


class Kept(NamedTuple):
    """State of a `Stepper` at one instant: steps taken, memory of the loop, inputs that are held."""

    steps: int
    memory: Floats
    held: Held


def refuse_damaged(kept: Kept) -> None:
    """Refuse a state that no `save` returns: one with other kinds of content, or with numbers that are not finite."""
    memory = np.asarray(kept.memory)
    sound = memory.dtype == np.float64 and isinstance(kept.held, Held) and isinstance(kept.steps, int)
    if not (sound and kept.steps >= 0 and np.isfinite(memory).all()):
        raise ConfigurationError(
            "The state is damaged: it holds numbers that are not finite, or other content than a state of save; "
            "restore one that save returned, unchanged."
        )
