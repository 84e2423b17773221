"""Calibration of foreign FMUs."""

from commonrail.plugins.foreign_fmu.data import FmuData as FmuData
from commonrail.plugins.foreign_fmu.data import FmuInputs as FmuInputs
from commonrail.plugins.foreign_fmu.data import fmu_curve as fmu_curve
from commonrail.plugins.foreign_fmu.data import fmu_rows as fmu_rows
from commonrail.plugins.foreign_fmu.fit import FmuFit as FmuFit
from commonrail.plugins.foreign_fmu.fit import calibrate_fmu as calibrate_fmu
from commonrail.plugins.foreign_fmu.fmu import FmuStatus as FmuStatus
from commonrail.plugins.foreign_fmu.run import calibrate_fmu_into as calibrate_fmu_into
from commonrail.plugins.foreign_fmu.run import resume_fmu as resume_fmu
from commonrail.plugins.foreign_fmu.study import FmuStudy as FmuStudy
from commonrail.plugins.foreign_fmu.study import fmu_study as fmu_study
from commonrail.plugins.foreign_fmu.study import load_fmu_study as load_fmu_study
