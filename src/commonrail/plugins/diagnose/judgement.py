"""Judgement of a part: pass or fail by its plan, the likely fault, and the trim."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import Any

from commonrail.base.arguments import Quantity
from commonrail.base.display import Shown
from commonrail.base.errors import InputError
from commonrail.base.hooks import quiet
from commonrail.base.record import to_record
from commonrail.data.records import record_head
from commonrail.physics.injector import Injector
from commonrail.plugins.diagnose.faults import FaultTable
from commonrail.plugins.diagnose.run import SOUND, Diagnosis, diagnose
from commonrail.plugins.diagnose.trim import STEP, PartTrim, trim
from commonrail.plugins.plans.run import InjectorFacts, PlanResult
from commonrail.plugins.plans.run import plan as run_plan
from commonrail.plugins.plans.study import TestPlan, load_plan


@dataclass(frozen=True, repr=False)
class PartJudgement(Shown):
    """Judgement of a part on the bench.

    Attributes
    ----------
    plan : PlanResult
    diagnosis : Diagnosis
    trim : PartTrim or None
    reason : str
        Why the part cannot be trimmed; empty if it can.
    """

    presenter = "commonrail.plugins.diagnose.page:JUDGEMENT"

    plan: PlanResult
    diagnosis: Diagnosis
    trim: PartTrim | None
    reason: str = ""

    @property
    def verdict(self) -> str:
        """Verdict of the plan: "pass", "fail", or "open" if a test has no result."""
        return self.plan.judged.verdict or "open"

    def record(self) -> dict[str, Any]:
        """JSON-able form, SI units."""
        data = self.plan.score.data
        return {
            **record_head("judgement", f"Part on the bench: {data.name}", data.synthetic),
            "injector": to_record(InjectorFacts.of(self.plan.injector)),
            "verdict": self.verdict,
            "plan": self.plan.record(),
            "diagnosis": self.diagnosis.record(),
            "trim": None if self.trim is None else self.trim.record(),
            "reason": self.reason,
        }


def judge(
    injector: Injector,
    results: TestPlan | str | PathLike[str],
    *,
    sound: float | str = SOUND,
    step: Quantity = STEP,
    stroke_rate: Quantity | None = None,
    noise: float | str | None = None,
    nominal: bool = False,
    faults: FaultTable | str | PathLike[str] | None = None,
    **bench: Any,
) -> PartJudgement:
    """Judge a part by its test plan, find the fault that explains its results, and trim it.

    Arguments are as in `diagnose` and `trim`, each with its default noise unless `noise` is given; `bench` are
    arguments of `plan`. Errors are as in `plan`. If the part cannot be trimmed, `reason` says why.
    """
    plan = results if isinstance(results, TestPlan) else load_plan(results)
    settings: dict[str, Any] = {"nominal": nominal, "faults": faults, **bench}
    settings |= {} if noise is None else {"noise": noise}
    diagnosis = diagnose(injector, plan, sound=sound, stroke_rate=stroke_rate, **settings)
    judged = run_plan(injector, plan, stroke_rate=stroke_rate, **bench)
    try:
        with quiet():  # the diagnosis has given these notes
            return PartJudgement(judged, diagnosis, trim(injector, plan, step=step, **settings))
    except InputError as error:
        return PartJudgement(judged, diagnosis, None, str(error))
