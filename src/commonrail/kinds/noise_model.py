"""Shape of the table ``noise`` of a data set in a study file."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from commonrail.kinds.noise import Correlation, Law, Noise
from commonrail.reading.fields import FileModel, Unit
from commonrail.reading.place import Place, located
from commonrail.units import parse

__all__ = ["NoiseModel"]

MOST_UNCERTAIN = 20


class NoiseModel(FileModel):
    """Noise of a data set; what is left out is estimated from the residuals, or zero."""

    law: Law = Field(default=Law.AUTO, strict=False)
    correlation: Correlation = Field(default=Correlation.AUTO, strict=False)
    sigma: str | float | int | None = None
    freedom: float = math.inf
    shots: str = ""
    discrepancy: str | float | int = 0.0
    length: Annotated[float, Unit("s")] = 0.0
    pressure_length: Annotated[float, Unit("Pa")] = math.inf
    uncertain: dict[str, str | float | int] = Field(default={}, max_length=MOST_UNCERTAIN)

    def read(self, unit: str, at: Place) -> Noise:
        """Noise with its numbers in SI units.

        Parameters
        ----------
        unit : str
            SI unit of a standard deviation of the kind's noise.
        at : Place
            Of the table.

        Raises
        ------
        InputError, ConfigurationError
            If a number has another unit or makes no sense; the message names the key.
        """
        sigma, relative = (None, 0.0) if self.sigma is None else _deviation(self.sigma, unit, at / "sigma")
        discrepancy = _read(self.discrepancy, unit, at / "discrepancy") if self.discrepancy else 0.0
        with located(at):
            return Noise(
                self.law,
                self.correlation,
                sigma,
                self.shots,
                discrepancy,
                self.length,
                self.pressure_length,
                self.uncertain,
                self.freedom,
                relative,
            )


def _deviation(item: str | float | int, unit: str, at: Place) -> tuple[float, float]:
    """Standard deviation at a rate of zero and the share of the rate that is added, as in "0.02 mm3/ms + 1 %"."""
    first, plus, second = item.rpartition(" + ") if isinstance(item, str) else (item, "", "")
    if not plus:
        return _read(item, unit, at), 0.0
    if unit == "1":
        raise at.error(
            f'"{item}" has two parts, and a sigma here is a multiple of the tolerance; state one number, and the part '
            'that grows with the value as the key "relative" of the data set'
        )
    if "%" not in second:
        raise at.error(f'the second part of "{item}" must be percent of the rate, as in "0.02 mm3/ms + 1 %"')
    return _read(first, unit, at), _read(second, "1", at)


def _read(item: str | float | int, unit: str, at: Place) -> float:
    with located(at):
        return parse(item, unit)
