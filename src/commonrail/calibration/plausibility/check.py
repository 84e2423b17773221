"""Plausibility: what about a study, its data and its result is too odd to be believed without a look.

Two moments: before the fit (`settings`, `start`) and after it (`fit`). Every limit stands in `limits`, and the usual
range of a parameter at the parameter; docs/howto/plausibility.md tells what each finding means.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from commonrail.calibration.plausibility.finding import Finding
from commonrail.calibration.plausibility.fit import Fit, fit_findings, model_findings
from commonrail.calibration.plausibility.settings import (
    bounds_findings,
    data_findings,
    injector_findings,
    signal_findings,
    step_findings,
)
from commonrail.calibration.plausibility.start import share_findings, start_findings
from commonrail.calibration.study import Study
from commonrail.data.base import DataSet, Score
from commonrail.physics.injector import Injector


def of_settings(study: Study) -> tuple[Finding, ...]:
    """Findings about what a study says: no simulation is needed."""
    findings = [f for data in study.data for f in data_findings(data, study.injector)]
    findings += [*injector_findings(study.injector), *bounds_findings(study.space), *step_findings(study)]
    return tuple(findings)


def of_values(study: Study, scores: Sequence[Score], of: str = "start values") -> tuple[Finding, ...]:
    """Findings about the data beside their simulation with values `of` the parameters, one score for each data set."""
    findings = [f for data, score in _judged(study, scores) for f in start_findings(data, score)]
    return (*findings, *share_findings(study.data, scores, of))


def after_fit(fit: Fit, injector: Injector, before: Iterable[Finding] = ()) -> tuple[Finding, ...]:
    """Findings about a finished search and its calibrated injector, those about start values again with its values.

    `injector`: the calibrated one; `before`: what the settings tell already.
    """
    now = of_values(fit.study, fit.scores, "calibrated values")
    findings = [*fit_findings(fit), *_of_scores(fit.study, injector, fit.scores)]
    return (*now, *_unknown(findings, (*before, *now)))


def of_model(study: Study, injector: Injector, scores: Sequence[Score], fitted: bool) -> tuple[Finding, ...]:
    """Findings about any injector on the data of a study.

    `scores`: of the injector, one for each data set; `fitted`: judge errors, shifts and gains too.
    """
    findings = [f for data in study.data for f in data_findings(data, injector)]
    findings += injector_findings(injector)
    findings += [f for data, score in _judged(study, scores) for f in start_findings(data, score)]
    return tuple(findings) + (_unknown(_of_scores(study, injector, scores), findings) if fitted else ())


def _unknown(findings: Iterable[Finding], before: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings that those before do not tell already."""
    known = {(f.code, f.subject) for f in before}
    # A quantity that is wrong by a factor makes a large error in any case.
    known |= {("misfit", subject) for code, subject in known if code == "quantity"}
    return tuple(f for f in findings if (f.code, f.subject) not in known)


def _of_scores(study: Study, injector: Injector, scores: Sequence[Score]) -> list[Finding]:
    return [f for data, score in _judged(study, scores) for f in model_findings(data, score, injector)]


def _judged(study: Study, scores: Sequence[Score]) -> Iterable[tuple[DataSet, Score]]:
    """Data sets with their scores, without those that lack a signal or are upside down: all else follows from that."""
    for data, score in zip(study.data, scores, strict=True):
        if not any(signal_findings(data)):
            yield data, score
