"""Measured data: their kinds, files and meters."""

from commonrail.calibration.study_file import load_meter as load_meter
from commonrail.data.base import Role as Role
from commonrail.data.quantities.baselines import Sister as Sister
from commonrail.data.quantities.returned import ReturnData as ReturnData
from commonrail.engine.solution import Metered as Metered
from commonrail.engine.solution import metered as metered
from commonrail.plugins.new.study import Started as Started
from commonrail.plugins.new.study import StatedByUser as StatedByUser
from commonrail.readers.columns import FileForm as FileForm
from commonrail.readers.overview import Survey as Survey
from commonrail.readers.overview import inspect as inspect
from commonrail.readers.quantity_matrix import GivenUnits as GivenUnits
