"""Simulated parts of a tolerance study: the injector with its dimensions as columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.analysis.tolerance.tolerances import Tolerances
from commonrail.arrays import Floats
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.status import OK


class Parts(NamedTuple):
    """Quantities (parts, points) [m³], NaN where a simulation failed, and codes: values of `Status`."""

    quantities: Floats
    codes: NDArray[np.int8]


class Simulated:
    """The study's injector with its dimensions as columns.

    Parameters
    ----------
    tolerances : Tolerances
    threads : int, optional
    """

    def __init__(self, tolerances: Tolerances, threads: int | None = None) -> None:
        self.tolerances, self.threads, self.injections = tolerances, threads, 0
        self.points = [p.point for p in tolerances.points]
        self._prepared = prepare(tolerances.injector, self.points, tolerances.time_step)

    def parts(self, values: Floats | None) -> Parts:
        """Quantities of parts (n, dimensions) [SI] at the study's points; of the part as drawn for None."""
        return self._run(self.points, values, self._prepared)

    def at(self, point: OperatingPoint, values: Floats | None) -> Parts:
        """Quantities of parts at another point, as those of `parts`."""
        return self._run([point], values, None)

    def _run(self, points: Sequence[OperatingPoint], values: Floats | None, prepared: Prepared | None) -> Parts:
        t = self.tolerances
        self.injections += (1 if values is None else len(values)) * len(points)
        batch = simulate_batch(
            t.injector,
            points,
            () if values is None else t.names,
            values,
            time_step=t.time_step,
            threads=self.threads,
            precision=t.precision,
            prepared=prepared,
        )
        good = batch.status == OK
        return Parts(np.where(good, batch.injected_volume, np.nan), batch.status.astype(np.int8))
