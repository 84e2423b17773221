"""Parts of a tolerance study: values of their dimensions, drawn one after the other."""

from __future__ import annotations

import numpy as np

from commonrail.analysis.tolerance.tolerances import Sampling, Tolerances
from commonrail.arrays import Floats

__all__ = ["Draws"]


EDGE = 1e-12  # distance of a share from 0 and 1, where a normal distribution has no value


class Draws:
    """Parts in order; the same study gives the same parts, however many are drawn at a time.

    Parameters
    ----------
    tolerances : Tolerances
    """

    def __init__(self, tolerances: Tolerances) -> None:
        from scipy.stats import qmc  # slow to import

        rng = np.random.default_rng(tolerances.seed)
        self._dimensions, self._factor = tolerances.dimensions, tolerances.factor()
        d = len(self._dimensions)
        even = tolerances.sampling is Sampling.QUASI_RANDOM
        self._sequence = qmc.Sobol(d, rng=rng) if even else None
        self._rng = rng

    def take(self, count: int) -> Floats:
        """The next parts (count, dimensions) [SI]; a power of two each time keeps the sequence even."""
        shares = self._rng.random((count, len(self._dimensions))) if self._sequence is None else self._even(count)
        shares = np.clip(shares, EDGE, 1.0 - EDGE)
        if self._factor is not None:
            from scipy.special import ndtr, ndtri  # slow to import

            shares = np.clip(ndtr(ndtri(shares) @ self._factor.T), EDGE, 1.0 - EDGE)
        columns = [dimension.distribution.at(shares[:, j]) for j, dimension in enumerate(self._dimensions)]
        return np.stack(columns, axis=1)

    def _even(self, count: int) -> Floats:
        assert self._sequence is not None
        whole = 1 << (count - 1).bit_length()  # SciPy warns of numbers that are no powers of two
        if self._sequence.num_generated or whole == count:
            return np.asarray(self._sequence.random(count))
        return np.asarray(self._sequence.random(whole)[:count])
