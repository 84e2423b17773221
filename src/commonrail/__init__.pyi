"""Names for an injector, its simulation and its calibration; the other public names are in the namespaces."""

from commonrail.base.errors import CommonrailError as CommonrailError
from commonrail.calibration.parameter import Parameter as Parameter
from commonrail.calibration.parameter import Prior as Prior
from commonrail.calibration.run import Calibration as Calibration
from commonrail.calibration.run import calibrate as calibrate
from commonrail.calibration.study import Study as Study
from commonrail.calibration.study import study as study
from commonrail.calibration.study_file import load_study as load_study
from commonrail.data.curves.data import RateData as RateData
from commonrail.data.noise import Noise as Noise
from commonrail.data.quantities.data import QuantityData as QuantityData
from commonrail.engine.operating_point import Energising as Energising
from commonrail.engine.operating_point import OperatingPoint as OperatingPoint
from commonrail.engine.operating_point import Trace as Trace
from commonrail.engine.simulate import simulate as simulate
from commonrail.engine.simulate import simulate_batch as simulate_batch
from commonrail.engine.solution import Batch as Batch
from commonrail.engine.solution import Solution as Solution
from commonrail.engine.status import Status as Status
from commonrail.physics.fuel import Fuel as Fuel
from commonrail.physics.injector import Injector as Injector
from commonrail.physics.meters import Meter as Meter
from commonrail.physics.variants import Variant as Variant
from commonrail.plugins.app.run import app as app
from commonrail.plugins.certainty.run import certainty as certainty
from commonrail.plugins.compare.run import compare as compare
from commonrail.plugins.export.run import export as export
from commonrail.plugins.new.study import new as new
from commonrail.plugins.page.page import page as page
from commonrail.plugins.prediction.run import predict as predict
from commonrail.plugins.stepper.run import Stepper as Stepper
from commonrail.plugins.update.run import update as update
from commonrail.readers.fuel import load_fuel as load_fuel
from commonrail.readers.injector import load_injector as load_injector
from commonrail.readers.injector_writer import dump_injector as dump_injector
from commonrail.report.page import write_report as write_report
from commonrail.runs.fit import resume as resume

from . import data as data
from . import design as design
from . import errors as errors
from . import features as features
from . import fit as fit
from . import fmu as fmu
from . import lab as lab
from . import maps as maps
from . import models as models
from . import observer as observer
from . import parts as parts
from . import runs as runs

__version__: str
