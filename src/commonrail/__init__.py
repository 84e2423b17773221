"""commonrail: simulate and calibrate common-rail electro-injectors.

The public names are loaded when they are first used: importing the package compiles and reads
nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from commonrail.analysis.truth import Truth
    from commonrail.calibration.comparison import Comparison, compare
    from commonrail.calibration.plausibility.finding import Finding
    from commonrail.calibration.run import Calibration, Progress, calibrate, check_study, validate
    from commonrail.calibration.study import Study
    from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
    from commonrail.engine.simulate import simulate, simulate_batch
    from commonrail.engine.solution import Batch, Solution
    from commonrail.engine.status import Status
    from commonrail.errors import (
        CommonrailError,
        ConfigurationError,
        InputError,
        OutputError,
        SimulationError,
        StudyError,
    )
    from commonrail.files.fuel_file import load_fuel
    from commonrail.files.injector_file import dump_injector, injector_catalogue, load_injector
    from commonrail.files.run_folder import create_run_folder, read_run, write_run
    from commonrail.files.study_file import load_study
    from commonrail.files.truth_file import load_truth
    from commonrail.fuel.fuel import Fuel
    from commonrail.injector.definition import Injector, parameter_quantities
    from commonrail.injector.variants import Variant
    from commonrail.kinds import QuantityData, RateData
    from commonrail.report.build import write_report
    from commonrail.report.simulation import simulation_figure
    from commonrail.reproduction.repetition import Bench
    from commonrail.reproduction.run import Reproduction, reproduce
    from commonrail.store.listing import list_runs
    from commonrail.store.run import calibrate_into, resume

    __version__: str

# Module that holds each public name; the imports above say the same to a type checker.
_HOMES = {
    "analysis.truth": ("Truth",),
    "calibration.comparison": ("Comparison", "compare"),
    "calibration.plausibility.finding": ("Finding",),
    "calibration.run": ("Calibration", "Progress", "calibrate", "check_study", "validate"),
    "calibration.study": ("Study",),
    "engine.operating_point": ("Energising", "OperatingPoint", "Trace"),
    "engine.simulate": ("simulate", "simulate_batch"),
    "engine.solution": ("Batch", "Solution"),
    "engine.status": ("Status",),
    "errors": (
        "CommonrailError",
        "ConfigurationError",
        "InputError",
        "OutputError",
        "SimulationError",
        "StudyError",
    ),
    "files.fuel_file": ("load_fuel",),
    "files.injector_file": ("dump_injector", "injector_catalogue", "load_injector"),
    "files.run_folder": ("create_run_folder", "read_run", "write_run"),
    "files.study_file": ("load_study",),
    "files.truth_file": ("load_truth",),
    "fuel.fuel": ("Fuel",),
    "injector.definition": ("Injector", "parameter_quantities"),
    "injector.variants": ("Variant",),
    "kinds": ("QuantityData", "RateData"),
    "report.build": ("write_report",),
    "report.simulation": ("simulation_figure",),
    "reproduction.repetition": ("Bench",),
    "reproduction.run": ("Reproduction", "reproduce"),
    "store.listing": ("list_runs",),
    "store.run": ("calibrate_into", "resume"),
}
_MODULES = {name: f"commonrail.{home}" for home, names in _HOMES.items() for name in names}

__all__ = [
    "Batch",
    "Bench",
    "Calibration",
    "CommonrailError",
    "Comparison",
    "ConfigurationError",
    "Energising",
    "Finding",
    "Fuel",
    "Injector",
    "InputError",
    "OperatingPoint",
    "OutputError",
    "Progress",
    "QuantityData",
    "RateData",
    "Reproduction",
    "SimulationError",
    "Solution",
    "Status",
    "Study",
    "StudyError",
    "Trace",
    "Truth",
    "Variant",
    "__version__",
    "calibrate",
    "calibrate_into",
    "check_study",
    "compare",
    "create_run_folder",
    "dump_injector",
    "injector_catalogue",
    "load_fuel",
    "load_injector",
    "load_study",
    "list_runs",
    "load_truth",
    "parameter_quantities",
    "read_run",
    "reproduce",
    "resume",
    "simulate",
    "simulate_batch",
    "simulation_figure",
    "validate",
    "write_report",
    "write_run",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("commonrail")
    elif name in _MODULES:
        value = getattr(import_module(_MODULES[name]), name)
    else:
        raise AttributeError(f"module 'commonrail' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Public names, loaded or not."""
    return sorted({*globals(), *__all__})
