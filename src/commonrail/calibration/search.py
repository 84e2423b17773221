"""The search of a study: its optimisers one after the other, each step told and kept as it is done."""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from commonrail.base.arrays import Floats
from commonrail.base.display import Live, in_notebook
from commonrail.base.errors import ConfigurationError, SimulationError, StudyError
from commonrail.base.hooks import StopRequest, compiling_seconds
from commonrail.calibration.objective import NOT_SIMULATED, FitObjective, Loss, Objective
from commonrail.calibration.optimisers.base import (
    AGREEING,
    ALIKE,
    SMALL_GAIN,
    Best,
    Convergence,
    Counts,
    Optimiser,
    Question,
    Trials,
    noise_of,
)
from commonrail.calibration.optimisers.polish import Refinement, RefinementSettings
from commonrail.calibration.optimisers.registry import blamed, registered
from commonrail.calibration.space import Space
from commonrail.calibration.study import Method

if TYPE_CHECKING:
    from commonrail.workers.workers import Workers

# Steps of a search as they are told, so that they can be kept, and the state from which it goes on.


class CheckpointError(StudyError):
    """A checkpoint is damaged, or another search's."""


class Step(NamedTuple):
    """One step of an optimiser: trials (n, d) [SI], their costs (n,), and the single injections that it took.

    A cost is +inf where a simulation failed or there was none; a status is a value of `Status`, -1 of a trial that was
    not simulated.
    """

    x: Floats
    costs: Floats
    statuses: NDArray[np.int8]
    simulations: int


class Generation(NamedTuple):
    """Objective after a step: best so far, and mean of the population's finite ones."""

    generation: int
    best: float
    mean: float

    @classmethod
    def of(cls, generation: int, optimiser: Optimiser) -> Generation:
        """Snapshot of an optimiser after its last completed step."""
        costs = optimiser.costs
        finite = costs[np.isfinite(costs)]
        return cls(generation, optimiser.best.cost, float(finite.mean()) if len(finite) else float("inf"))


class Stage(NamedTuple):
    """A search after the latest step of one of its optimisers.

    `state` is `Optimiser.state`, `failures` the failed candidates of the first optimiser by the name of their status;
    single injections and time [s] are those so far.
    """

    state: Mapping[str, Any]
    simulations: int
    failures: Mapping[str, int]
    seconds: float


@dataclass(frozen=True)
class Checkpoint:
    """A search between two steps: all it needs to go on to the same bits.

    One stage for each optimiser that has begun, in the order in which they run; the history is that of the first one.
    """

    stages: tuple[Stage, ...]
    history: tuple[Generation, ...]


class Recorder(Protocol):
    """Keeps a search step by step; what it raises ends the search."""

    def step(self, step: Step, reached: Generation, after: Checkpoint) -> None:
        """Take one step of the last of the checkpoint's stages, and the objective and checkpoint after it."""


# Verdict on the convergence of a search that does not judge itself: restarts that agree, or a collapsed population.

ONE_POINT = "the search ended with one point and compared it with no other; refinements (polish = 3) would"
LATEST = 20  # generations over which the gain of one is the mean


def noise_in(cost: float, residuals: int, parameters: int, goal: tuple[Loss, Sequence[Any]]) -> float:
    """Change of an objective that changes 2 ln L by 1, by the noise of its residuals (`noise_of`).

    From the objective of the best, the numbers of residuals (those of priors included) and of free parameters, and the
    loss and fitted data: J of a curve is a sum of absolute errors.
    """
    loss, data = goal
    absolute = loss is Loss.KINDS and any(data_set.bounds is not None for data_set in data)
    return noise_of(cost, residuals, parameters, 2.0 if absolute else 1.0)


def judge_population(costs: Floats, history: Sequence[Generation], noise: float) -> Convergence:
    """Verdict on an evolution: converged if its population has collapsed and its best no longer gains.

    `costs` (n,) are those of the members, `noise` is the change of the objective that changes 2 ln L by 1.
    """
    finite = costs[np.isfinite(costs)]
    if len(finite) < 2:
        why = ONE_POINT if len(costs) == 1 else "fewer than two members could be simulated"
        return Convergence.of(False, why, {"members": len(finite), "cut_short": len(costs) > 1})
    spread = float(finite.max() - finite.min()) / noise
    past = history[max(len(history) - 1 - LATEST, 0)]
    done = max(history[-1].generation - past.generation, 1)
    gain = (past.best - history[-1].best) / noise / done
    has_gain = len(history) > LATEST and bool(np.isfinite(gain))
    converged = spread <= ALIKE and has_gain and gain <= SMALL_GAIN
    figures = {"members": len(finite), "spread": spread, "gain_per_generation": gain if np.isfinite(gain) else None}
    figures["cut_short"] = not converged
    sentence = (
        f"the members differ by {spread:.2g} of 2 ln L, and the last {done} generations gained {gain:.2g} each; "
        f"{ALIKE} and {SMALL_GAIN} over {LATEST} generations are asked for"
    )
    return Convergence.of(converged, sentence, figures)


def judge_restarts(costs: Floats, noise: float) -> Convergence:
    """Verdict on refinements: converged if enough of their `costs` (n,) lie within `ALIKE` of the best 2 ln L.

    `noise` is the change of the objective that changes 2 ln L by 1.
    """
    finite = costs[np.isfinite(costs)]
    agreeing = int((finite <= finite.min(initial=np.inf) + ALIKE * noise).sum())
    converged = agreeing >= AGREEING
    sentence = f"{agreeing} of {len(costs)} refinements end within {ALIKE} of the best 2 ln L; {AGREEING} are asked for"
    return Convergence.of(converged, sentence, {"starts": len(costs), "agreeing": agreeing, "cut_short": False})


_Begin = Callable[[Optimiser | None], Optimiser]  # begins an optimiser, given the one before it in the row


class Progress(NamedTuple):
    """Progress of a calibration. `phase` is the optimiser's, such as "evolution"; `seconds` as in `SearchResult`."""

    phase: str
    generation: int
    generations: int
    best: float
    mean: float
    simulated: int
    seconds: float


class Listeners(NamedTuple):
    """Listeners to each step, and the source of a request to stop."""

    progress: Callable[[Progress], None] | None
    recorder: Recorder | None
    stop: StopRequest


class Searched(Protocol):
    """Settings of a fit: of a study, of several that are fitted together, or of an FMU."""

    @property
    def title(self) -> str:
        """Title in messages."""

    @property
    def space(self) -> Space:
        """Parameters that are searched."""

    @property
    def method(self) -> Method:
        """Settings of the optimisers."""

    @property
    def seed(self) -> int:
        """Seed of all draws."""

    @property
    def same_bits(self) -> bool:
        """As in `Study`."""

    @property
    def synthetic(self) -> str:
        """Synthetic parts of the data, empty if there are none."""


def steps(optimiser: Optimiser, objective: FitObjective) -> Iterator[Step]:
    """Run an optimiser to its end, and yield each step once it has been answered.

    `PluginError` if the optimiser of an installed package fails.
    """
    simulations, kind = 0, type(optimiser)
    while not optimiser.finished:
        with blamed(kind):
            done, trials = optimiser.steps, optimiser.ask()
            if trials.x.shape[1:] != (optimiser.space.dimension,):
                raise ValueError(f"asks for points of shape {trials.x.shape}")
        if trials.question in (Question.RESIDUALS, Question.SCREENED):
            screening = trials.question is Question.SCREENED
            answers = objective.screened(trials.x) if screening else objective.residuals(trials.x)
            with blamed(kind):
                optimiser.tell(answers)
            simulations += len(trials.x) * objective.injections
            continue
        step = _costs(trials, objective)
        with blamed(kind):
            optimiser.tell(step.costs)
        if trials.question is Question.COSTS:
            simulations += step.simulations
        if optimiser.steps > done:
            yield step._replace(simulations=simulations)
            simulations = 0


def _costs(trials: Trials, objective: FitObjective) -> Step:
    if trials.simulate.all():
        return Step(trials.x, *objective.costs(trials.x))
    costs = np.full(len(trials.x), np.inf)
    statuses = np.full(len(trials.x), NOT_SIMULATED, np.int8)
    simulations = 0
    if trials.simulate.any():
        scores = objective.costs(trials.x[trials.simulate])
        costs[trials.simulate], statuses[trials.simulate], simulations = scores
    return Step(trials.x, costs, statuses, simulations)


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """Result of a search: the part that the results of all kinds of fit share.

    Attributes
    ----------
    best : dict of str to float
        Best values of the free parameters [SI; of an FMU in its units].
    cost, start_cost : float
        Objective of the best and of the start values; +inf if these failed.
    history : tuple of Generation
    counts : Counts
        Slots offered, candidates simulated and candidates failed, of the first optimiser.
    status, reason : str
        "finished" or "interrupted", and why it stopped.
    seconds : float
        Time of the search, without that in which this process compiled its kernels.
    simulations : int
        Single injections, or simulations of an FMU.
    failures : mapping of str to int
        Failed candidates by the name of their status.
    convergence : Convergence or None
        Whether the search has converged, by which rule; None of one that was interrupted.
    ends : tuple of Best
        Optima that the search has found side by side, the best first.
    """

    best: dict[str, float]
    cost: float
    start_cost: float
    history: tuple[Generation, ...]
    counts: Counts
    status: str
    reason: str
    seconds: float
    simulations: int
    failures: Mapping[str, int]
    convergence: Convergence | None
    ends: tuple[Best, ...]


class Search:
    """Search of a fit on its way; with `workers`, they simulate in place of the objective's threads.

    `CheckpointError` if the checkpoint belongs to another search. `check_stop` raises `KeyboardInterrupt` while the
    search runs, if a stop was asked for.
    """

    def __init__(
        self,
        study: Searched,
        objective: FitObjective,
        workers: Workers | None,
        listeners: Listeners,
        checkpoint: Checkpoint | None = None,
    ) -> None:
        self.study, self.listeners, self.objective = study, listeners, objective
        if workers is not None:
            assert isinstance(objective, Objective)
            from commonrail.calibration.distributed_objective import SpreadObjective

            self.objective = SpreadObjective(objective, workers, study.space.reference)
        self.check_stop = listeners.stop.check
        self.history: list[Generation] = []
        self.simulations = 0
        self.failures: Counter[str] = Counter()
        self._row = _row(study.method, study.space, study.seed)
        self._begun = [self._row[0](None)]
        self._before: tuple[Stage, ...] = ()  # of the optimisers that have finished
        self._residuals = 0  # number of residuals, once it is known
        self._start = time.perf_counter() - compiling_seconds()
        if checkpoint is not None:
            try:
                self._take_up(checkpoint)
            except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, ConfigurationError) as error:
                raise CheckpointError(
                    f"{study.title}: what was kept of the search is damaged or another study's ({error})."
                ) from error

    def to_end(self) -> SearchResult:
        """Run each optimiser to its end, the next one from what it has found, or until the user stops it.

        `KeyboardInterrupt` if it was stopped before a candidate could be simulated, `SimulationError` if none could be.
        """
        status = "finished"
        try:
            self.check_stop()
            self._run()
        except KeyboardInterrupt:
            status = "interrupted"
        self.check_stop = lambda: None  # what follows is short
        seconds, last = self._seconds(), self._begun[-1]
        x, cost = last.best
        if not np.isfinite(cost):
            if status == "interrupted":
                raise KeyboardInterrupt
            raise SimulationError(_all_failed(self.study.title, self.failures, self.objective))
        names, start = self.study.space.names, self.study.space.reference[None, :]
        return SearchResult(
            best=dict(zip(names, x.tolist(), strict=True)),
            cost=cost,
            start_cost=float(self.objective.costs(start).costs[0]),
            history=tuple(self.history),
            counts=self._begun[0].counts,
            status=status,
            reason=self._reason() if status == "finished" else "stopped by the user",
            seconds=seconds,
            simulations=self.simulations,
            failures=dict(self.failures),
            convergence=self._verdict() if status == "finished" else None,
            ends=last.ends,
        )

    def _run(self) -> None:
        while True:
            while not self._ends(self._begun[-1]):
                self._note(next(steps(self._begun[-1], self.objective)))
            if len(self._begun) == len(self._row):
                return
            self._before = self._checkpoint().stages
            self._begun.append(self._row[len(self._begun)](self._begun[-1]))

    def _seconds(self) -> float:
        """Time spent, that before a restart included, without that of compiling, which is spent once [s]."""
        return time.perf_counter() - compiling_seconds() - self._start

    def _reason(self) -> str:
        """Reason for the end of the first optimiser; where refinements are judged, its own verdict is not in it."""
        first, last = self._begun[0], self._begun[-1]
        judges_itself = first.finished or first.verdict is not None
        reason = first.reason if judges_itself else self._of_population(first).sentence
        if "converged: " not in reason or not isinstance(last, Refinement):
            return reason
        return f"{first.phase}: {re.sub('(not )?converged: ', '', reason)}; then {last.phase}"

    def _verdict(self) -> Convergence:
        """Verdict on convergence: that of the refinements, else of the first optimiser or on its population."""
        first, last = self._begun[0], self._begun[-1]
        if isinstance(last, Refinement) and len(last.end_costs):
            return judge_restarts(last.end_costs, self._noise(last))
        return first.verdict or self._of_population(first)

    def _of_population(self, optimiser: Optimiser) -> Convergence:
        return judge_population(optimiser.costs, self.history, self._noise(optimiser))

    def _noise(self, optimiser: Optimiser) -> float:
        """Change of the objective that changes 2 ln L by 1."""
        objective, space = self.objective, self.study.space
        if not self._residuals:
            self._residuals = objective.residuals(space.reference[None, :]).shape[1]
        goal = objective.goal.loss, objective.data
        return noise_in(max(optimiser.best.cost, objective.least_cost), self._residuals, space.dimension, goal)

    def _ends(self, optimiser: Optimiser) -> bool:
        """Return whether an optimiser has no more to do, by itself or because the study stops it when it has converged.

        Refinements are all done.
        """
        if optimiser.finished or not self.study.method.stop_when_converged or not self.history:
            return optimiser.finished
        first = optimiser is self._begun[0] and optimiser.verdict is None
        return first and np.isfinite(optimiser.best.cost) and self._of_population(optimiser).converged

    def _note(self, step: Step) -> None:
        self.simulations += step.simulations
        optimiser = self._begun[-1]
        with blamed(type(optimiser)):
            reached = Generation.of(optimiser.steps - 1, optimiser)
        if len(self._begun) == 1:
            failed = step.statuses[step.statuses > 0].tolist()
            self.failures.update(self.objective.statuses(status).name.lower() for status in failed)
            self.history.append(reached)
        if self.listeners.recorder is not None:
            self.listeners.recorder.step(step, reached, self._checkpoint())
        if self.listeners.progress is not None:
            figures = (
                optimiser.phase,
                optimiser.steps,
                optimiser.total,
                *reached[1:],
                self.simulations,
                self._seconds(),
            )
            with suppress(OSError, ValueError):  # a terminal that went away must not end the search
                self.listeners.progress(Progress(*figures))
        self.check_stop()

    def _checkpoint(self) -> Checkpoint:
        with blamed(type(self._begun[-1])):
            state = self._begun[-1].state()
        now = Stage(state, self.simulations, dict(self.failures), self._seconds())
        return Checkpoint((*self._before, now), tuple(self.history))

    def _take_up(self, checkpoint: Checkpoint) -> None:
        """Go on with the last optimiser whose forerunners have all finished: they may have been given more to do."""
        self.history = list(checkpoint.history)
        spent = 0.0
        for number, stage in enumerate(checkpoint.stages):
            if number:
                if not self._ends(self._begun[-1]):
                    break
                self._before = checkpoint.stages[:number]
                self._begun.append(self._row[number](self._begun[-1]))
            self._begun[-1].restore(stage.state)
            self.simulations, self.failures = stage.simulations, Counter(stage.failures)
            spent = stage.seconds
        self._start -= spent


def _all_failed(title: str, failures: Counter[str], objective: FitObjective) -> str:
    """Sentence on a search in which nothing could be simulated: the most frequent reason and its cure."""
    if not failures:
        return (
            f"{title}: not one candidate satisfied the constraints, so none was simulated; widen the bounds or "
            'take initial = "feasible".'
        )
    (name, count), total = failures.most_common(1)[0], failures.total()
    why = objective.why_failed(objective.statuses[name.upper()])
    return f"{title}: not one of {total} candidates could be simulated; {count} of them: {why}"


def _row(method: Method, space: Space, seed: int) -> list[_Begin]:
    """Optimisers of a fit in the order in which they run: the one that it names, then refinements of its result."""
    first = registered(method.evolution)
    assert first is not None  # Method has checked it

    def begun(_: Optimiser | None) -> Optimiser:
        with blamed(first.begin):
            optimiser: Optimiser = first.begin(space, np.random.default_rng(seed), method.evolution)
        return optimiser

    stages: list[_Begin] = [begun]
    if method.polish:
        settings = RefinementSettings(method.polish, method.polish_iterations)
        stages.append(lambda before: Refinement(space, seed, settings, before))  # type: ignore[arg-type]
    return stages


# Bar of a calibration in a notebook.


def live_progress() -> Callable[[Progress], None] | None:
    """Listener that draws a bar in a notebook's output; None elsewhere."""
    if not in_notebook():
        return None
    live = Live()

    def show(p: Progress) -> None:
        live.show(f"{p.phase}: best {p.best:.4g}, mean {p.mean:.4g}, {p.seconds:.0f} s", p.generation, p.generations)

    return show
