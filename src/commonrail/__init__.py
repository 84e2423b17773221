"""commonrail: simulate and calibrate common-rail electro-injectors.

The public names are loaded when they are first used: importing the package compiles and reads
nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from commonrail.analysis.certainty.certify import Certainty, certify
    from commonrail.analysis.certainty.likelihood import Likelihood
    from commonrail.analysis.design.candidates import Candidate
    from commonrail.analysis.design.criteria import Criterion
    from commonrail.analysis.design.next import DesignSettings, Plan, next_measurements
    from commonrail.analysis.identifiability import identify, identify_at
    from commonrail.analysis.posterior.sample import Posterior, sample_posterior
    from commonrail.analysis.prediction.predict import Prediction, predict
    from commonrail.analysis.seeds import SeedProgress, for_seeds
    from commonrail.analysis.sensitivity.result import Sensitivity
    from commonrail.analysis.sensitivity.run import sensitivity
    from commonrail.analysis.sensitivity.settings import SensitivitySettings, parameters_within
    from commonrail.analysis.tolerance.distributions import Normal, Triangular, Uniform
    from commonrail.analysis.tolerance.result import ToleranceResult
    from commonrail.analysis.tolerance.run import tolerance
    from commonrail.analysis.tolerance.tolerances import (
        Correlation,
        Dimension,
        Limit,
        TolerancePoint,
        Tolerances,
        Trim,
    )
    from commonrail.analysis.truth import Truth
    from commonrail.analysis.virtual_bench import PAPER_OPTIMUM, Bench, bench_curve
    from commonrail.calibration.checkpoint import Generation
    from commonrail.calibration.comparison import Comparison, compare
    from commonrail.calibration.conditions import Condition
    from commonrail.calibration.goal import Loss
    from commonrail.calibration.injector_type import FixedValue, InjectorType, TypeParameter, TypePart
    from commonrail.calibration.judgement import Judgement, LeaveOut
    from commonrail.calibration.objective import Objective
    from commonrail.calibration.optimisers import (
        Counts,
        DifferentialEvolution,
        EvolutionSettings,
        InitialSampling,
        StagedSettings,
        Treatment,
    )
    from commonrail.calibration.parameter import Parameter, percent_bounds
    from commonrail.calibration.plausibility.finding import Finding
    from commonrail.calibration.prior import Prior
    from commonrail.calibration.quick_study import study
    from commonrail.calibration.result import validate
    from commonrail.calibration.run import Calibration, Progress, calibrate, check_study
    from commonrail.calibration.sampling import sample_feasible
    from commonrail.calibration.search import steps
    from commonrail.calibration.space import Space
    from commonrail.calibration.study import Method, Study
    from commonrail.choices import Body
    from commonrail.engine.operating_point import Energising, OperatingPoint, Trace
    from commonrail.engine.simulate import simulate, simulate_batch
    from commonrail.engine.solution import Batch, Solution
    from commonrail.engine.status import Status
    from commonrail.errors import (
        CommonrailError,
        ConfigurationError,
        InputError,
        OutputError,
        PluginError,
        SimulationError,
        StudyError,
    )
    from commonrail.family.adapt import Adapted, adapt
    from commonrail.family.from_results import type_from_fleet, type_from_runs
    from commonrail.files.fuel_file import load_fuel
    from commonrail.files.injector_file import dump_injector, injector_catalogue, load_injector, load_meters
    from commonrail.files.meter_file import load_meter
    from commonrail.files.run_folder import create_run_folder, read_run, write_run
    from commonrail.files.study_file import load_study
    from commonrail.files.tolerance_file import load_tolerances
    from commonrail.files.truth_file import load_truth
    from commonrail.files.type_file import dump_type, load_type
    from commonrail.foreign.data import FmuData, FmuInputs, fmu_curve, fmu_rows
    from commonrail.foreign.fit import FmuFit, calibrate_fmu
    from commonrail.foreign.run import calibrate_fmu_into, resume_fmu
    from commonrail.foreign.statuses import FmuStatus
    from commonrail.foreign.study import FmuStudy, fmu_study
    from commonrail.foreign.study_file import load_fmu_study
    from commonrail.fuel.fuel import Fuel
    from commonrail.injector.definition import Injector, Source, parameter_quantities
    from commonrail.injector.variants import Variant
    from commonrail.kinds import FeatureData, QuantityData, RateData, ReturnData, Role
    from commonrail.kinds.features.reading import FeatureTarget
    from commonrail.kinds.maps.sister import Sister
    from commonrail.kinds.noise import Noise
    from commonrail.maps.axes import MapAxes
    from commonrail.maps.calls import map, sweep
    from commonrail.maps.choices import Beyond, CellState, Several
    from commonrail.maps.quantity_map import InjectionMap
    from commonrail.maps.sweep import Sweep
    from commonrail.observation.low_pass import LowPass
    from commonrail.observation.meter import Meter
    from commonrail.observation.metered import Metered, metered
    from commonrail.report.build import write_report
    from commonrail.report.simulation import simulation_figure
    from commonrail.reproduction.run import Reproduction, reproduce
    from commonrail.signals.features import features
    from commonrail.signals.rate_trace import RateTrace
    from commonrail.signals.result import Features, Injection
    from commonrail.signals.settings import FeatureSettings
    from commonrail.signals.shots import ShotStatistic, shot_statistics
    from commonrail.signals.status import FeatureStatus
    from commonrail.stepper.linear import LinearModel
    from commonrail.stepper.stepper import Stepper
    from commonrail.store.listing import list_runs
    from commonrail.store.run import calibrate_into, resume

    __version__: str

# Module that holds the public names; the imports above say the same to a type checker.
_HOMES = {
    "analysis.certainty.certify": "Certainty certify",
    "analysis.certainty.likelihood": "Likelihood",
    "analysis.design.candidates": "Candidate",
    "analysis.design.criteria": "Criterion",
    "analysis.design.next": "DesignSettings Plan next_measurements",
    "analysis.identifiability": "identify identify_at",
    "analysis.posterior.sample": "Posterior sample_posterior",
    "analysis.prediction.predict": "Prediction predict",
    "analysis.seeds": "SeedProgress for_seeds",
    "analysis.sensitivity.result": "Sensitivity",
    "analysis.sensitivity.run": "sensitivity",
    "analysis.sensitivity.settings": "SensitivitySettings parameters_within",
    "analysis.tolerance.distributions": "Normal Triangular Uniform",
    "analysis.tolerance.result": "ToleranceResult",
    "analysis.tolerance.run": "tolerance",
    "analysis.tolerance.tolerances": "Correlation Dimension Limit TolerancePoint Tolerances Trim",
    "analysis.truth": "Truth",
    "analysis.virtual_bench": "Bench PAPER_OPTIMUM bench_curve",
    "calibration.checkpoint": "Generation",
    "calibration.comparison": "Comparison compare",
    "calibration.conditions": "Condition",
    "calibration.goal": "Loss",
    "calibration.injector_type": "FixedValue InjectorType TypeParameter TypePart",
    "calibration.judgement": "Judgement LeaveOut",
    "calibration.objective": "Objective",
    "calibration.optimisers": "Counts DifferentialEvolution EvolutionSettings InitialSampling StagedSettings Treatment",
    "calibration.parameter": "Parameter percent_bounds",
    "calibration.plausibility.finding": "Finding",
    "calibration.prior": "Prior",
    "calibration.quick_study": "study",
    "calibration.result": "validate",
    "calibration.run": "Calibration Progress calibrate check_study",
    "calibration.sampling": "sample_feasible",
    "calibration.search": "steps",
    "calibration.space": "Space",
    "calibration.study": "Method Study",
    "choices": "Body",
    "engine.operating_point": "Energising OperatingPoint Trace",
    "engine.simulate": "simulate simulate_batch",
    "engine.solution": "Batch Solution",
    "engine.status": "Status",
    "errors": "CommonrailError ConfigurationError InputError OutputError PluginError SimulationError StudyError",
    "family.adapt": "Adapted adapt",
    "family.from_results": "type_from_fleet type_from_runs",
    "files.fuel_file": "load_fuel",
    "files.injector_file": "dump_injector injector_catalogue load_injector load_meters",
    "files.run_folder": "create_run_folder read_run write_run",
    "files.meter_file": "load_meter",
    "files.study_file": "load_study",
    "files.tolerance_file": "load_tolerances",
    "files.truth_file": "load_truth",
    "files.type_file": "dump_type load_type",
    "foreign.data": "FmuData FmuInputs fmu_curve fmu_rows",
    "foreign.fit": "FmuFit calibrate_fmu",
    "foreign.run": "calibrate_fmu_into resume_fmu",
    "foreign.statuses": "FmuStatus",
    "foreign.study": "FmuStudy fmu_study",
    "foreign.study_file": "load_fmu_study",
    "fuel.fuel": "Fuel",
    "injector.definition": "Injector Source parameter_quantities",
    "injector.variants": "Variant",
    "kinds": "FeatureData QuantityData RateData ReturnData Role",
    "kinds.features.reading": "FeatureTarget",
    "kinds.maps.sister": "Sister",
    "kinds.noise": "Noise",
    "maps.axes": "MapAxes",
    "maps.calls": "map sweep",
    "maps.choices": "Beyond CellState Several",
    "maps.quantity_map": "InjectionMap",
    "maps.sweep": "Sweep",
    "observation.low_pass": "LowPass",
    "observation.meter": "Meter",
    "observation.metered": "Metered metered",
    "report.build": "write_report",
    "report.simulation": "simulation_figure",
    "reproduction.run": "Reproduction reproduce",
    "signals.features": "features",
    "signals.rate_trace": "RateTrace",
    "signals.result": "Features Injection",
    "signals.settings": "FeatureSettings",
    "signals.shots": "ShotStatistic shot_statistics",
    "signals.status": "FeatureStatus",
    "stepper.linear": "LinearModel",
    "stepper.stepper": "Stepper",
    "store.listing": "list_runs",
    "store.run": "calibrate_into resume",
}
_MODULES = {name: f"commonrail.{home}" for home, names in _HOMES.items() for name in names.split()}

__all__ = [
    "Adapted",
    "Batch",
    "Bench",
    "Beyond",
    "Body",
    "Calibration",
    "Candidate",
    "CellState",
    "Certainty",
    "CommonrailError",
    "Comparison",
    "Condition",
    "ConfigurationError",
    "Correlation",
    "Counts",
    "Criterion",
    "DesignSettings",
    "DifferentialEvolution",
    "Dimension",
    "Energising",
    "EvolutionSettings",
    "FeatureData",
    "FeatureSettings",
    "FeatureStatus",
    "FeatureTarget",
    "Features",
    "Finding",
    "FixedValue",
    "FmuData",
    "FmuFit",
    "FmuInputs",
    "FmuStatus",
    "FmuStudy",
    "Fuel",
    "Generation",
    "InitialSampling",
    "Injection",
    "InjectionMap",
    "Injector",
    "InjectorType",
    "InputError",
    "Limit",
    "Loss",
    "Likelihood",
    "LinearModel",
    "LowPass",
    "MapAxes",
    "Meter",
    "Metered",
    "Method",
    "Noise",
    "Objective",
    "Normal",
    "OperatingPoint",
    "OutputError",
    "PluginError",
    "PAPER_OPTIMUM",
    "Plan",
    "Parameter",
    "Posterior",
    "Prediction",
    "Prior",
    "Progress",
    "QuantityData",
    "RateData",
    "RateTrace",
    "Reproduction",
    "ReturnData",
    "Role",
    "SeedProgress",
    "Sensitivity",
    "SensitivitySettings",
    "ShotStatistic",
    "Several",
    "SimulationError",
    "Sister",
    "Solution",
    "Source",
    "Space",
    "StagedSettings",
    "Status",
    "Stepper",
    "Study",
    "StudyError",
    "Sweep",
    "TolerancePoint",
    "ToleranceResult",
    "Tolerances",
    "Trace",
    "Treatment",
    "Triangular",
    "Trim",
    "Truth",
    "TypeParameter",
    "TypePart",
    "Uniform",
    "Variant",
    "__version__",
    "adapt",
    "bench_curve",
    "calibrate",
    "calibrate_fmu",
    "calibrate_fmu_into",
    "calibrate_into",
    "certify",
    "check_study",
    "compare",
    "create_run_folder",
    "dump_injector",
    "dump_type",
    "features",
    "fmu_curve",
    "fmu_rows",
    "fmu_study",
    "for_seeds",
    "identify",
    "identify_at",
    "injector_catalogue",
    "list_runs",
    "load_fmu_study",
    "load_fuel",
    "load_injector",
    "load_meter",
    "load_meters",
    "load_study",
    "load_tolerances",
    "load_truth",
    "load_type",
    "map",
    "metered",
    "next_measurements",
    "parameter_quantities",
    "parameters_within",
    "percent_bounds",
    "predict",
    "read_run",
    "reproduce",
    "resume",
    "resume_fmu",
    "sample_feasible",
    "sample_posterior",
    "sensitivity",
    "shot_statistics",
    "simulate",
    "simulate_batch",
    "simulation_figure",
    "steps",
    "study",
    "sweep",
    "tolerance",
    "type_from_fleet",
    "type_from_runs",
    "validate",
    "write_report",
    "write_run",
    "Judgement",
    "LeaveOut",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module (PEP 562)."""
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("commonrail")
    elif name in _MODULES:
        value = getattr(import_module(_MODULES[name]), name)
        _prepare_notebooks()
    else:
        raise AttributeError(f"module 'commonrail' has no attribute {name!r}")
    globals()[name] = value
    return value


def _prepare_notebooks() -> None:
    """Give results of the physics rooms their tables and figures, and say in a notebook when a kernel is compiled."""
    import_module("commonrail.display.shown").lend()
    if "ipykernel" in sys.modules:
        import_module("commonrail.display.live").watch()


def __dir__() -> list[str]:
    """Public names, loaded or not."""
    return sorted({*globals(), *__all__})
