"""Optimisers that propose trials and are told what became of them; none of them simulates."""

from __future__ import annotations

from commonrail.calibration.optimisers.base import Best, Counts, Optimiser, Settings, Trials, Wanted
from commonrail.calibration.optimisers.differential_evolution import DifferentialEvolution
from commonrail.calibration.optimisers.evolution_settings import EvolutionSettings, InitialSampling
from commonrail.calibration.optimisers.members import diverse_members
from commonrail.calibration.optimisers.multistart import MultiStartLeastSquares, MultiStartSettings
from commonrail.calibration.optimisers.refinement import Refinement, RefinementSettings
from commonrail.calibration.optimisers.staged import StagedLeastSquares
from commonrail.calibration.optimisers.staged_settings import StagedSettings
from commonrail.calibration.optimisers.treatments import Treatment
from commonrail.calibration.optimisers.verdict import Convergence

__all__ = [
    "Best",
    "Counts",
    "DifferentialEvolution",
    "EvolutionSettings",
    "InitialSampling",
    "MultiStartLeastSquares",
    "MultiStartSettings",
    "Optimiser",
    "Refinement",
    "RefinementSettings",
    "Settings",
    "StagedLeastSquares",
    "StagedSettings",
    "Treatment",
    "Trials",
    "Convergence",
    "Wanted",
    "diverse_members",
]
