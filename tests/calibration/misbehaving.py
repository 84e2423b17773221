"""An objective that misbehaves in a worker, on demand: what workers meet in a night, without waiting for it."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from commonrail.base.errors import ConfigurationError
from commonrail.calibration.objective import Objective, Scores


class Misbehaving(Objective):
    """The objective of another one, but for a candidate `marked` that does `what` to its worker, `times` times.

    `folder` counts them: workers share no memory.
    """

    def __init__(self, objective: Objective, marked: float, what: str, times: int, folder: Path) -> None:
        vars(self).update(vars(objective))
        self.marked, self.what, self.times, self.folder = marked, what, times, folder
        self.home = os.getpid()

    def costs(self, values: NDArray[np.float64]) -> Scores:
        """As of an objective."""
        if os.getpid() != self.home and self.marked in values[:, 0] and self._once_more():
            self._misbehave()
        return super().costs(values)

    def _once_more(self) -> bool:
        so_far = len(list(self.folder.iterdir()))
        (self.folder / str(so_far)).touch()
        return so_far < self.times

    def _misbehave(self) -> None:
        if self.what == "die":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.what == "hang":
            os.kill(os.getpid(), signal.SIGSTOP)
        if self.what == "fail":
            raise MemoryError("no room for 8 GiB")
        raise ConfigurationError("This cannot be simulated.")
