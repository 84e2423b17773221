"""Public names of the package and their homes; `commonrail.__getattr__` imports each when it is first used."""

from .base.choices import (
    Body as Body,
)
from .base.errors import (
    CommonrailError as CommonrailError,
)
from .base.errors import (
    ConfigurationError as ConfigurationError,
)
from .base.errors import (
    InputError as InputError,
)
from .base.errors import (
    OutputError as OutputError,
)
from .base.errors import (
    PluginError as PluginError,
)
from .base.errors import (
    SimulationError as SimulationError,
)
from .base.errors import (
    StudyError as StudyError,
)
from .calibration.identifiability import (
    identify as identify,
)
from .calibration.identifiability import (
    identify_at as identify_at,
)
from .calibration.objective import (
    Loss as Loss,
)
from .calibration.objective import (
    Objective as Objective,
)
from .calibration.optimisers.base import (
    Counts as Counts,
)
from .calibration.optimisers.evolution import (
    DifferentialEvolution as DifferentialEvolution,
)
from .calibration.optimisers.evolution import (
    EvolutionSettings as EvolutionSettings,
)
from .calibration.optimisers.evolution import (
    InitialSampling as InitialSampling,
)
from .calibration.optimisers.evolution import (
    Treatment as Treatment,
)
from .calibration.optimisers.staged import (
    StagedSettings as StagedSettings,
)
from .calibration.parameter import (
    Condition as Condition,
)
from .calibration.parameter import (
    Parameter as Parameter,
)
from .calibration.parameter import (
    Prior as Prior,
)
from .calibration.parameter import (
    percent_bounds as percent_bounds,
)
from .calibration.plausibility import (
    Finding as Finding,
)
from .calibration.run import (
    Calibration as Calibration,
)
from .calibration.run import (
    calibrate as calibrate,
)
from .calibration.run import (
    check_study as check_study,
)
from .calibration.search import (
    Generation as Generation,
)
from .calibration.search import (
    Progress as Progress,
)
from .calibration.search import (
    steps as steps,
)
from .calibration.space import (
    Space as Space,
)
from .calibration.space import (
    sample_feasible as sample_feasible,
)
from .calibration.study import (
    Judgement as Judgement,
)
from .calibration.study import (
    LeaveOut as LeaveOut,
)
from .calibration.study import (
    Method as Method,
)
from .calibration.study import (
    Study as Study,
)
from .calibration.study import (
    study as study,
)
from .calibration.study_file.file import (
    load_meter as load_meter,
)
from .calibration.study_file.file import (
    load_study as load_study,
)
from .data.base import (
    Role as Role,
)
from .data.curves.data import (
    RateData as RateData,
)
from .data.noise import (
    Noise as Noise,
)
from .data.quantities.baselines import (
    Sister as Sister,
)
from .data.quantities.data import (
    QuantityData as QuantityData,
)
from .data.quantities.returned import (
    ReturnData as ReturnData,
)
from .engine.operating_point import (
    Energising as Energising,
)
from .engine.operating_point import (
    OperatingPoint as OperatingPoint,
)
from .engine.operating_point import (
    Trace as Trace,
)
from .engine.simulate import (
    simulate as simulate,
)
from .engine.simulate import (
    simulate_batch as simulate_batch,
)
from .engine.solution import (
    Batch as Batch,
)
from .engine.solution import (
    Metered as Metered,
)
from .engine.solution import (
    Solution as Solution,
)
from .engine.solution import (
    metered as metered,
)
from .engine.status import (
    Status as Status,
)
from .physics.fuel import (
    Fuel as Fuel,
)
from .physics.injector import (
    Injector as Injector,
)
from .physics.injector import (
    Source as Source,
)
from .physics.injector import (
    parameter_quantities as parameter_quantities,
)
from .physics.meters import (
    LowPass as LowPass,
)
from .physics.meters import (
    Meter as Meter,
)
from .physics.variants import (
    Variant as Variant,
)
from .plugins.certainty.file import (
    Certainty as Certainty,
)
from .plugins.certainty.likelihood import (
    Likelihood as Likelihood,
)
from .plugins.certainty.posterior.sample import (
    Posterior as Posterior,
)
from .plugins.certainty.posterior.sample import (
    sample_posterior as sample_posterior,
)
from .plugins.certainty.run import (
    certify as certify,
)
from .plugins.compare.run import (
    Comparison as Comparison,
)
from .plugins.compare.run import (
    compare as compare,
)
from .plugins.family.adapt import (
    Adapted as Adapted,
)
from .plugins.family.adapt import (
    adapt as adapt,
)
from .plugins.family.injector_type import (
    FixedValue as FixedValue,
)
from .plugins.family.injector_type import (
    InjectorType as InjectorType,
)
from .plugins.family.injector_type import (
    TypeParameter as TypeParameter,
)
from .plugins.family.injector_type import (
    TypePart as TypePart,
)
from .plugins.family.injector_type import (
    dump_type as dump_type,
)
from .plugins.family.injector_type import (
    load_type as load_type,
)
from .plugins.family.type import (
    type_from_fleet as type_from_fleet,
)
from .plugins.family.type import (
    type_from_runs as type_from_runs,
)
from .plugins.features.measures import (
    FeatureStatus as FeatureStatus,
)
from .plugins.features.rate_trace import (
    RateTrace as RateTrace,
)
from .plugins.features.result import (
    Features as Features,
)
from .plugins.features.result import (
    Injection as Injection,
)
from .plugins.features.run import (
    features as features,
)
from .plugins.features.settings import (
    FeatureSettings as FeatureSettings,
)
from .plugins.features.shots import (
    ShotStatistic as ShotStatistic,
)
from .plugins.features.shots import (
    shot_statistics as shot_statistics,
)
from .plugins.features.targets import (
    FeatureData as FeatureData,
)
from .plugins.features.targets_file import (
    FeatureTarget as FeatureTarget,
)
from .plugins.foreign_fmu.data import (
    FmuData as FmuData,
)
from .plugins.foreign_fmu.data import (
    FmuInputs as FmuInputs,
)
from .plugins.foreign_fmu.data import (
    fmu_curve as fmu_curve,
)
from .plugins.foreign_fmu.data import (
    fmu_rows as fmu_rows,
)
from .plugins.foreign_fmu.fit import (
    FmuFit as FmuFit,
)
from .plugins.foreign_fmu.fit import (
    calibrate_fmu as calibrate_fmu,
)
from .plugins.foreign_fmu.fmu import (
    FmuStatus as FmuStatus,
)
from .plugins.foreign_fmu.run import (
    calibrate_fmu_into as calibrate_fmu_into,
)
from .plugins.foreign_fmu.run import (
    resume_fmu as resume_fmu,
)
from .plugins.foreign_fmu.study import (
    FmuStudy as FmuStudy,
)
from .plugins.foreign_fmu.study import (
    fmu_study as fmu_study,
)
from .plugins.foreign_fmu.study import (
    load_fmu_study as load_fmu_study,
)
from .plugins.maps.axes import (
    MapAxes as MapAxes,
)
from .plugins.maps.choices import (
    Beyond as Beyond,
)
from .plugins.maps.choices import (
    CellState as CellState,
)
from .plugins.maps.choices import (
    Several as Several,
)
from .plugins.maps.run import (
    InjectionMap as InjectionMap,
)
from .plugins.maps.run import (
    map as map,
)
from .plugins.maps.run import (
    sweep as sweep,
)
from .plugins.maps.sweep import (
    Sweep as Sweep,
)
from .plugins.next.run import (
    DesignSettings as DesignSettings,
)
from .plugins.next.run import (
    Plan as Plan,
)
from .plugins.next.run import (
    next_measurements as next_measurements,
)
from .plugins.next.study import (
    Candidate as Candidate,
)
from .plugins.next.study import (
    Criterion as Criterion,
)
from .plugins.paper.bench import (
    PAPER_OPTIMUM as PAPER_OPTIMUM,
)
from .plugins.paper.bench import (
    Bench as Bench,
)
from .plugins.paper.bench import (
    Truth as Truth,
)
from .plugins.paper.bench import (
    bench_curve as bench_curve,
)
from .plugins.paper.bench_file import (
    load_truth as load_truth,
)
from .plugins.paper.run import (
    Reproduction as Reproduction,
)
from .plugins.paper.run import (
    reproduce as reproduce,
)
from .plugins.paper.seeds import (
    SeedProgress as SeedProgress,
)
from .plugins.paper.seeds import (
    for_seeds as for_seeds,
)
from .plugins.prediction.run import (
    Prediction as Prediction,
)
from .plugins.prediction.run import (
    predict as predict,
)
from .plugins.sensitivity.file import (
    Sensitivity as Sensitivity,
)
from .plugins.sensitivity.run import (
    sensitivity as sensitivity,
)
from .plugins.sensitivity.study import (
    SensitivitySettings as SensitivitySettings,
)
from .plugins.sensitivity.study import (
    parameters_within as parameters_within,
)
from .plugins.stepper.linear import (
    LinearModel as LinearModel,
)
from .plugins.stepper.run import (
    Stepper as Stepper,
)
from .plugins.tolerance.file import (
    ToleranceResult as ToleranceResult,
)
from .plugins.tolerance.file import (
    load_tolerances as load_tolerances,
)
from .plugins.tolerance.run import (
    tolerance as tolerance,
)
from .plugins.tolerance.study import (
    Correlation as Correlation,
)
from .plugins.tolerance.study import (
    Dimension as Dimension,
)
from .plugins.tolerance.study import (
    Limit as Limit,
)
from .plugins.tolerance.study import (
    Normal as Normal,
)
from .plugins.tolerance.study import (
    TolerancePoint as TolerancePoint,
)
from .plugins.tolerance.study import (
    Tolerances as Tolerances,
)
from .plugins.tolerance.study import (
    Triangular as Triangular,
)
from .plugins.tolerance.study import (
    Trim as Trim,
)
from .plugins.tolerance.study import (
    Uniform as Uniform,
)
from .readers.fuel import (
    load_fuel as load_fuel,
)
from .readers.injector.file import (
    injector_catalogue as injector_catalogue,
)
from .readers.injector.file import (
    load_injector as load_injector,
)
from .readers.injector.file import (
    load_meters as load_meters,
)
from .readers.injector.writer import (
    dump_injector as dump_injector,
)
from .report.page import (
    write_report as write_report,
)
from .report.simulation import (
    simulation_figure as simulation_figure,
)
from .runs.fit import (
    calibrate_into as calibrate_into,
)
from .runs.fit import (
    resume as resume,
)
from .runs.folder import (
    create_run_folder as create_run_folder,
)
from .runs.folder import (
    read_run as read_run,
)
from .runs.folder import (
    write_run as write_run,
)
from .runs.listing import (
    list_runs as list_runs,
)

__version__: str
