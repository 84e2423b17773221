"""Problems on which optimisers are compared: the paper's case, studies from files, and virtual benches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from commonrail.analysis.virtual_bench import Bench
from commonrail.bench.case import INJECTOR, TIME_STEP, injector, paper_study
from commonrail.bench.contest import Problem
from commonrail.calibration.sampling import sample_feasible
from commonrail.files.study_file import load_study
from commonrail.files.truth_file import load_truth
from commonrail.kinds import QuantityData
from commonrail.reproduction import paper
from commonrail.reproduction.repetition import measure

__all__ = ["problems_of"]

FINE, WIDE = 1e-4, 1e-2  # differences of the range for curves, and for maps, whose quantities jump


def problems_of(files: Sequence[Path], benches: int) -> list[Problem]:
    """The paper's case if no file is named, the studies of files, and so many virtual benches.

    Parameters
    ----------
    files : sequence of Path
        Study files.
    benches : int
        Each has stiffnesses of its own, drawn from what the paper's bounds and ordering allow, and noise and scatter of
        its own. The curves are SYNTHETIC.
    """
    found = [] if files else [Problem("paper", paper_study(), FINE)]
    for file in files:
        study = load_study(file)
        maps = any(isinstance(data, QuantityData) for data in study.data)
        name = file.absolute().parent.name if file.stem == "study" else file.stem
        found.append(Problem(name, study, WIDE if maps else FINE))
    return found + [_bench(number) for number in range(1, benches + 1)]


def _bench(number: int) -> Problem:
    """Virtual bench of a number: the default truth with drawn stiffnesses, and the paper's search for them."""
    truth, study = load_truth(INJECTOR), paper_study()
    drawn = sample_feasible(study.space, 1, np.random.default_rng([number, 7]))[0]
    values = {**truth.values, **dict(zip(study.space.names, drawn.tolist(), strict=True))}
    bench = Bench(replace(truth, values=values), injector(), TIME_STEP)
    (data,) = [one for one in measure(bench, number) if one.name == paper.FIT]
    return Problem(f"virtual bench {number}", replace(study, title=f"virtual bench {number}", data=(data,)), FINE)
