"""Injector models: catalogue, parts, parameters, and export to files, pages and linear models."""

from commonrail.base.choices import Body as Body
from commonrail.physics.injector import Source as Source
from commonrail.physics.injector import parameter_quantities as parameter_quantities
from commonrail.physics.meters import LowPass as LowPass
from commonrail.plugins.catalogue.run import Section as Section
from commonrail.plugins.catalogue.run import catalogue as catalogue
from commonrail.plugins.fuel.write import WrittenFuel as WrittenFuel
from commonrail.plugins.fuel.write import fuel as fuel
from commonrail.plugins.heating import Heating as Heating
from commonrail.plugins.heating import heating as heating
from commonrail.plugins.stepper.linear import LinearModel as LinearModel
from commonrail.readers.injector import injector_catalogue as injector_catalogue
from commonrail.readers.injector import load_meters as load_meters
from commonrail.readers.part_number import PartMatch as PartMatch
from commonrail.readers.part_number import find_part as find_part
from commonrail.report.simulation import simulation_figure as simulation_figure
