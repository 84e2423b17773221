"""Map of a sister part: the trivial model that knows another part of the type and the ratio of catalogue flows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from commonrail.arguments import Limits, amount, array, plain_text, settle
from commonrail.arrays import Floats
from commonrail.errors import ConfigurationError
from commonrail.kinds.reading import Context
from commonrail.parts.furniture import Domain
from commonrail.reading.fields import Unit
from commonrail.reading.file_form import FormModel
from commonrail.reading.tables import Column

__all__ = ["Sister", "SisterModel", "read_sister"]


class SisterModel(FormModel):
    """A file with the columns rail_pressure, energising_time and quantity of a sister part."""

    file: str
    flow_ratio: Annotated[float, Unit("1")] = 1.0
    source: str = "no source stated"


@dataclass(frozen=True)
class Sister:
    """Measured map of another part of the type.

    Parameters
    ----------
    places : (m, 3)
        Rail pressure [Pa], energising time [s] and quantity [m³].
    flow_ratio : float
        Catalogue flow of the part that is fitted over that of the sister part.
    source : str
        Source of both.

    Raises
    ------
    ConfigurationError
        If the array has another shape or no row, or the ratio is not greater than zero.
    """

    places: Floats
    flow_ratio: float = 1.0
    source: str = "no source stated"

    def __post_init__(self) -> None:
        plain_text(self.source, "source of the sister part")
        places = array(self.places, "1", "places of the sister part", 2)
        if places.shape[1] != 3 or not len(places):
            raise ConfigurationError("The places of a sister part need rows of rail pressure, time and quantity.")
        ratio = amount(self.flow_ratio, "1", "flow_ratio of the sister part", Limits(1e-3, 1e3))
        settle(self, places=places, flow_ratio=ratio)


def read_sister(model: SisterModel, context: Context) -> Sister:
    """Read the map of a sister part.

    Parameters
    ----------
    model : SisterModel
    context : Context
        `at` is the place of the data set that names it.

    Raises
    ------
    InputError
        If the file cannot be read.
    ConfigurationError
        If the ratio of the flows is not greater than zero.
    """
    units = {"rail_pressure": "Pa", "energising_time": "s", "quantity": "m3"}
    wanted = [Column(name, unit, None, domain=Domain.NON_NEGATIVE) for name, unit in units.items()]
    at = context.at / "sister"
    table = context.columns(model.file, at, wanted, 1, model.form)
    if not model.flow_ratio > 0.0:
        raise (at / "flow_ratio").error("the ratio of the flows must be greater than zero")
    return Sister(np.column_stack([table.columns[name] for name in units]), model.flow_ratio, model.source)
