"""Kind of data: fuel that the injector takes per stroke, injected and returned, as a meter in the supply counts it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from commonrail.base.arrays import Floats
from commonrail.data.quantities.reading import MapModel
from commonrail.data.quantities.returned import ReturnData, ReturnsModel
from commonrail.data.simulator import Candidates
from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.solution import Batch
from commonrail.report.data.quantities import MapView


class SupplyModel(ReturnsModel):
    """Keys of its block in a study."""

    quantity_column: ClassVar[str] = "supply_quantity"

    kind: Literal["supply quantities"]  # type: ignore[assignment]  # of this kind


@dataclass(frozen=True)
class SupplyData(ReturnData):
    """Quantities at several operating points; volumes are those at the pressure of the return line."""

    kind: ClassVar[str] = "supply quantities"
    what: ClassVar[str] = "supply quantity"
    model: ClassVar[type[MapModel]] = SupplyModel

    def masses(self, batch: Batch, candidates: Candidates, points: Sequence[OperatingPoint]) -> Floats:
        """Mass per stroke, (candidates, points) [kg]."""
        return batch.injected_mass + super().masses(batch, candidates, points)


VIEW = MapView("supply ", "Supply quantity")
