"""Candidates of an injector, simulated at the operating points of data sets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from commonrail.choices import Precision
from commonrail.engine.lanes import Misfit
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.plan import Prepared, prepare
from commonrail.engine.simulate import simulate_batch
from commonrail.engine.solution import Batch
from commonrail.engine.time_step import check_step
from commonrail.injector.definition import Injector

__all__ = ["Simulator"]

Floats = NDArray[np.float64]


class Simulator:
    """An injector, the parameters of it that vary, and how it is simulated.

    Parameters
    ----------
    injector : Injector
        Gives the values that do not vary.
    names : sequence of str
        Parameters that vary; none for the injector as it is.
    time_step : float
        [s].
    threads : int, optional
        All usable processors by default.
    precision : Precision
        Of batches that ask for none themselves.
    same_bits : bool
        Simulate to the same bits on every x86-64 processor with AVX2: see `simulate_batch`.
    """

    def __init__(
        self,
        injector: Injector,
        names: Sequence[str],
        time_step: float,
        threads: int | None = None,
        *,
        precision: Precision = Precision.F64,
        same_bits: bool = False,
    ) -> None:
        self.injector, self.names, self.time_step, self.threads = injector, tuple(names), time_step, threads
        self.precision, self.same_bits = precision, same_bits
        self._prepared: dict[int, Prepared] = {}  # by the identity of their points, which they hold

    def __getstate__(self) -> dict[str, Any]:
        """For workers, which prepare their simulations themselves."""
        return self.__dict__ | {"_prepared": {}}

    def batch(
        self,
        points: Sequence[OperatingPoint],
        values: Floats,
        precision: Precision | None = None,
        misfit: Misfit | None = None,
    ) -> Batch:
        """Figures of candidates at operating points.

        Parameters
        ----------
        points : sequence of OperatingPoint
            What they share with other candidates is prepared once for the same sequence.
        values : (candidates, names)
            [SI].
        precision : Precision, optional
        misfit : Misfit, optional
            Samples to compare with.
        """
        if id(points) not in self._prepared:
            check_step(self.time_step)
            self._prepared[id(points)] = prepare(self.injector, points, self.time_step)
        return simulate_batch(
            self.injector,
            points,
            self.names,
            values,
            time_step=self.time_step,
            threads=self.threads,
            misfit=misfit,
            precision=precision or self.precision,
            prepared=self._prepared[id(points)],
            same_bits=self.same_bits,
        )

    def once(self, points: Sequence[OperatingPoint]) -> Batch:
        """Figures of the injector as it is at points that are not asked for again, (1, points)."""
        return simulate_batch(
            self.injector, points, time_step=self.time_step, threads=self.threads, same_bits=self.same_bits
        )
