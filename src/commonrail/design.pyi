"""Measurements to make next, and effect of parameters."""

from commonrail.plugins.next.run import MeasurementPlan as MeasurementPlan
from commonrail.plugins.next.run import next_measurements as next_measurements
from commonrail.plugins.next.settings import Criterion as Criterion
from commonrail.plugins.next.settings import DesignSettings as DesignSettings
from commonrail.plugins.next.study import Candidate as Candidate
from commonrail.plugins.sensitivity.file import Sensitivity as Sensitivity
from commonrail.plugins.sensitivity.run import sensitivity as sensitivity
from commonrail.plugins.sensitivity.settings import SensitivitySettings as SensitivitySettings
from commonrail.plugins.sensitivity.study import parameters_within as parameters_within
