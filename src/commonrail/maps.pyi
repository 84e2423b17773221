"""Quantity maps with their inverse, and sweeps."""

from commonrail.plugins.maps.axes import MapAxes as MapAxes
from commonrail.plugins.maps.choices import Beyond as Beyond
from commonrail.plugins.maps.choices import CellState as CellState
from commonrail.plugins.maps.choices import Several as Several
from commonrail.plugins.maps.compensation import Compensation as Compensation
from commonrail.plugins.maps.compensation import hold as hold
from commonrail.plugins.maps.run import InjectionMap as InjectionMap
from commonrail.plugins.maps.run import quantity_map as quantity_map
from commonrail.plugins.maps.run import sweep as sweep
from commonrail.plugins.maps.sweep import Sweep as Sweep
