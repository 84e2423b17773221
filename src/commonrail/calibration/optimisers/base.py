"""Protocol of the optimisers: each proposes trials, is told what became of them, and never simulates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arguments import instance, integer, settle
from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.calibration.space import Space

# Verdict of a search on itself: converged or not, by which rule, and with which figures.

# Restarts agree if at least AGREEING of them end within ALIKE of the best 2 ln L. A search has converged if the
# predicted gain of a full step is below SMALL_GAIN in 2 ln L.
AGREEING, ALIKE, SMALL_GAIN = 3, 0.5, 0.01


class Convergence(NamedTuple):
    """Verdict on convergence."""

    converged: bool
    sentence: str  # rule and figures for the user, without its full stop
    figures: dict[str, Any]  # JSON-able numbers that the rule was applied to

    @classmethod
    def of(cls, converged: bool, sentence: str, figures: dict[str, Any]) -> Convergence:
        """Convergence whose sentence opens with the result.

        `sentence`: rule and figures.
        """
        return cls(converged, f"{'' if converged else 'not '}converged: {sentence}", figures)

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        return {"converged": self.converged, "sentence": self.sentence, **self.figures}


def noise_of(cost: float, residuals: int, parameters: int, units: float) -> float:
    """Change of an objective that corresponds to a change of 2 ln L by 1.

    The errors are assumed to have the size of the remaining residuals, and a distribution that is Gaussian for sums of
    squares, Laplacian for sums of absolute errors. Then 2 ln L changes by `units` (N − d) times its relative change.

    `cost`: objective of the best; `residuals`: number N of residuals; `parameters`: number d of free parameters;
    `units`: 1 for squares, 2 for absolute errors.
    """
    return max(cost, 1e-300) / (units * max(residuals - parameters, 1))


# Largest settings: far above practical needs, and below what fills the memory.
MOST_GENERATIONS, MOST_MEMBERS, MOST_STARTS = 1_000_000, 100_000, 1000


def count(default: int, most: int, least: int = 0) -> Any:
    """Integer field of settings with its limits, which also apply to study files."""
    return field(default=default, metadata={"least": least, "most": most})


def check_counts(settings: Any) -> None:
    """Read the counts among the fields of settings as whole numbers within their limits.

    Raises
    ------
    ConfigurationError
        If one is not whole or beyond its limits.
    """
    for setting in fields(settings):
        if "most" in setting.metadata:
            value = integer(
                getattr(settings, setting.name), setting.name, setting.metadata["least"], setting.metadata["most"]
            )
            settle(settings, **{setting.name: value})


class Question(Enum):
    """Kind of answer that an optimiser requests."""

    COSTS = "costs"  # one for each trial (n,)
    RESIDUALS = "residuals"  # one row for each trial (n, m)
    SCREENED = "screened"  # residuals from simulations that are coarser and cheaper
    COSTS_AGAIN = "costs again"  # for points with known residuals: simulations are not counted twice


class Trials(NamedTuple):
    """Points (n, d) to be tried, SI, which of them (n,) are to be simulated, and the requested answer.

    A trial that the treatment of constraints rejects is not simulated; whatever is told of it is ignored.
    """

    x: Floats
    simulate: Bools
    question: Question = Question.COSTS


class Best(NamedTuple):
    """The best feasible point (d,) so far, SI, and its cost: +inf until a simulation succeeds."""

    x: Floats
    cost: float


@dataclass(frozen=True)
class Counts:
    """Effort of a search: slots offered, trials simulated, and simulations that failed."""

    slots: int = 0
    simulated: int = 0
    failed: int = 0

    def plus(self, simulate: Bools, sound: Bools) -> Counts:
        """These counts and those of one batch, with the masks (n,) of its simulations and of those that succeeded."""
        simulated, failed = int(simulate.sum()), int((simulate & ~sound).sum())
        return Counts(self.slots + len(simulate), self.simulated + simulated, self.failed + failed)


class Settings(Protocol):
    """Settings of an optimiser: a frozen dataclass whose fields are the keys of a study file."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def members(self) -> int:
        """Trials of a step."""
        ...

    @property
    def generations(self) -> int:
        """Steps after the first one; a finished search can be lengthened by more of them."""
        ...


Work = Generator[Trials, Floats, None]
"""One step of a search: a generator that yields trials and receives their costs or residuals."""


def asked(x: Floats, question: Question = Question.COSTS) -> Trials:
    """Question about points (n, d), SI, all of which are simulated."""
    return Trials(x, np.ones(len(x), bool), question)


class Optimiser(ABC):
    """A search as a conversation: `ask` for trials, simulate them elsewhere, `tell` what became of them.

    `ask` returns the same trials until `tell` is called. A subclass writes a step as one generator, `_step`: it yields
    trials, receives their costs (n,) or residuals (n, m), and finally sets `population` and `costs`. `state` is the
    state after the last complete step; a search restored from it asks for bit-identical trials. Its content is private.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.
    settings : Settings

    Attributes
    ----------
    steps : int
        Steps done.
    counts : Counts
        Slots, simulations and failures of the trials whose costs were asked for.
    best : Best
        The best feasible point; the centre of the space, at +inf, until a simulation has succeeded.
    population : (n, d)
        Points from which another optimiser may go on, SI; no rows before the first step.
    costs : (n,)
        Their costs; +inf where the simulation failed or there was none.
    """

    method: ClassVar[str]  # its name, in study files and states
    phase: ClassVar[str]  # what it does, in a word for the user
    ended: ClassVar[str] = "all {generations} steps after the first one are done"  # reason, with the settings

    def __init__(self, space: Space, rng: np.random.Generator, settings: Any) -> None:
        self.space, self.settings, self._rng = instance(space, Space, "space"), settings, rng
        self.steps, self.counts, self.best = 0, Counts(), Best(space.centre.copy(), np.inf)
        self.population, self.costs = np.empty((0, space.dimension)), np.empty(0)
        self._asked: Trials | None = None
        self._work: Work | None = None
        self._started: Mapping[str, Any] = {}  # state of the generator before the step under way

    @property
    def total(self) -> int:
        """Steps wanted, the first one included."""
        return int(1 + self.settings.generations)

    @property
    def finished(self) -> bool:
        """Return whether the search has stopped."""
        return self.steps >= self.total

    @property
    def reason(self) -> str:
        """Reason for the end of the search; empty before it."""
        return self.ended.format(generations=self.settings.generations) if self.finished else ""

    @property
    def verdict(self) -> Convergence | None:
        """Own verdict on convergence; None of a search that does not judge itself, see `calibration/search.py`."""
        return None

    @property
    def ends(self) -> tuple[Best, ...]:
        """Optima of searches side by side, the best first; the best alone where there is one search."""
        return (self.best,)

    def ask(self) -> Trials:
        """Return the next trials, the same ones until they are answered.

        Raises
        ------
        StudyError
            If the search has finished.
        """
        if self.finished:
            raise StudyError(f"the search has finished ({self.reason}): read its best member", code="finished")
        if self._asked is None:
            self._started = self._rng.bit_generator.state
            self._work = self._step()
            self._asked = next(self._work)
        return self._asked._replace(x=self._asked.x.copy())

    def tell(self, answers: ArrayLike) -> None:
        """Take what was asked for: costs (n,) or residuals (n, m); one that is not finite never wins.

        Raises
        ------
        StudyError
            If nothing was asked for, or there is not one answer for each trial.
        """
        if self._asked is None or self._work is None:
            raise StudyError("answers were told before any trials were asked for: ask first", code="not-asked")
        trials, checked = self._asked, _checked(answers, self._asked)
        if trials.question is not Question.COSTS_AGAIN:
            finite = np.isfinite(checked)
            self.counts = self.counts.plus(trials.simulate, finite if checked.ndim == 1 else np.all(finite, axis=1))
        try:
            self._asked = self._work.send(checked)
        except StopIteration:
            self._asked = None
            self.steps += 1

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later: texts, numbers and arrays, in lists and mappings."""
        now = self._rng.bit_generator.state
        return {
            **self._origin(),
            "steps": self.steps,
            "counts": asdict(self.counts),
            "rng": dict(now if self._asked is None else self._started),
            "best": self.best.x.copy(),
            "cost": self.best.cost,
            **self._kept(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state`; a step that was under way is started again.

        Raises
        ------
        ConfigurationError
            If it belongs to another optimiser, space, generator or settings (more steps may be wanted), or is not
            whole.
        """
        for key, mine in self._origin().items():
            if key not in state or not np.array_equal(state[key], mine):
                raise ConfigurationError(
                    f"state: its {key} differs from this search's: restore it with the space and settings that it was "
                    "saved with",
                    code="other-search",
                )
        try:
            self._rng.bit_generator.state = state["rng"]
        except (KeyError, TypeError, ValueError) as error:
            kind = type(self._rng.bit_generator).__name__
            raise ConfigurationError(
                f"state: it holds no state for a {kind} generator, use the kind it was saved with",
                code="other-generator",
            ) from error
        if not all(isinstance(count, int) and count >= 0 for count in (state["steps"], *state["counts"].values())):
            raise ConfigurationError("state: its counts are no whole numbers", code="damaged-state")
        best = Best(np.array(state["best"], dtype=float), float(state["cost"]))
        if best.x.shape != (self.space.dimension,) or not inside(self.space.to_unit(best.x)) or np.isnan(best.cost):
            raise ConfigurationError(
                "state: its best point lies outside the bounds or has no cost; use an intact state",
                code="damaged-state",
            )
        self.steps, self.counts, self._asked, self.best = state["steps"], Counts(**state["counts"]), None, best
        self._restore(state)

    def _origin(self) -> dict[str, Any]:
        """Values that must agree between a state and the search that resumes from it.

        The number of steps may differ.
        """
        space = self.space
        values = [str(value) for name, value in asdict(self.settings).items() if name != "generations"]
        bounds = {"lower": space.lower.copy(), "upper": space.upper.copy()}
        return {"method": self.method, "names": list(space.names), **bounds, "settings": values}

    def _offer(self, x: Floats, costs: Floats) -> None:
        """Take the cheapest of points (n, d), SI, as the best if it is."""
        winner = int(np.argmin(costs)) if len(costs) else -1
        if winner >= 0 and costs[winner] < self.best.cost:
            self.best = Best(x[winner].copy(), float(costs[winner]))

    @abstractmethod
    def _step(self) -> Work:
        """One step, from its first question to its end."""

    @abstractmethod
    def _kept(self) -> dict[str, Any]:
        """Own part of `state`, beside the best point."""

    @abstractmethod
    def _restore(self, state: Mapping[str, Any]) -> None:
        """Take up what `_kept` returned; ConfigurationError if it is not whole."""


def inside(unit: Floats) -> bool:
    """Return whether points lie within the bounds, up to the rounding of a conversion to unit coordinates."""
    return bool(np.all(np.abs(unit - 0.5) <= 0.5 + 1e-9))


def _checked(answers: ArrayLike, trials: Trials) -> Floats:
    """Residuals (n, m) as they are; costs (n,) with +inf for trials not simulated and those that are not finite."""
    array = np.asarray(answers, dtype=float)
    residuals = trials.question in (Question.RESIDUALS, Question.SCREENED)
    if array.ndim != 1 + residuals or len(array) != len(trials.x):
        what, item = ("residuals", "row") if residuals else ("costs", "cost")
        raise StudyError(
            f"{what}: an array of shape {array.shape} was given for {len(trials.x)} trials, expected one {item} for "
            "each trial in the order asked for",
            code="wrong-shape",
        )
    if residuals:
        return array
    return np.where(trials.simulate & np.isfinite(array), array, np.inf)


# Members of a population with their costs: the best of them, and their part of a state.


def diverse_members(unit: ArrayLike, costs: ArrayLike, n: int) -> IndexArray:
    """Choose members of low cost that lie far apart, the best one first.

    From the better half of the members with a finite cost (at least `n` of them), each further
    choice is the one farthest from those chosen already.

    `unit` (k, d): members in unit coordinates (`Space.to_unit`); `costs` (k,): their costs; `n`: how many to choose;
    fewer come back if fewer distinct ones have a finite cost. Returns rows of the chosen members (<= n,) int.
    """
    points, cost = np.asarray(unit, dtype=float), np.asarray(costs, dtype=float)
    order = np.argsort(cost, kind="stable")
    order = order[np.isfinite(cost[order])]
    pool = order[: max(n, (len(order) + 1) // 2)]
    return np.asarray(pool[farthest(points[pool], min(n, len(pool)))])


def farthest(points: Floats, n: int) -> IndexArray:
    """Rows of up to n distinct points of (k, d): the first point, then the point farthest from all chosen ones."""
    rows: list[int] = []
    distance = np.full(len(points), np.inf)
    while len(rows) < n:
        row = int(np.argmax(distance))
        if distance[row] == 0.0:
            break
        rows.append(row)
        distance = np.minimum(distance, np.linalg.norm(points - points[row], axis=1))
    return np.array(rows, dtype=np.intp)


HOP = 0.06  # standard deviation of a hop away from the best, as a share of each range


def hop(space: Space, best: Floats, rng: np.random.Generator) -> Floats:
    """A feasible point (d,) a normal step away from the best (d,), drawn back where it breaks a constraint, SI."""
    target = space.from_unit(np.clip(space.to_unit(best) + rng.normal(0.0, HOP, space.dimension), 0.0, 1.0))
    return np.asarray(space.pull_back(best[None, :], target[None, :])[0])


def ranked(best: Best, x: Floats, costs: Floats) -> tuple[Best, ...]:
    """End points (n, d) [SI] of descents by rising cost (n,); the best point of the search replaces the first."""
    ends = [Best(point, float(cost)) for point, cost in zip(x, costs, strict=True) if np.isfinite(cost)]
    return (best, *sorted(ends, key=lambda end: end.cost)[1:])


class Registered(NamedTuple):
    """An optimiser that a study can name.

    Attributes
    ----------
    begin : type
        The `Optimiser`, made of a space, a random generator and settings.
    settings : type
        Its `Settings`. The fields are keys of a study file's table [optimiser]; their metadata may limit them ("most").
        Its `size`, if it has one, is the template of `size_in_words`.
    checks : mapping of str to callable
        Checks by key of the settings; each raises a ConfigurationError if settings do not suit a space.
    citation : str
        Works that the method is from, as "Storn & Price 1997"; `commonrail cite` names them.
    """

    begin: type[Any]
    settings: type[Any]
    checks: Mapping[str, Callable[[Any, Space], None]] = MappingProxyType({})
    citation: str = ""

    @property
    def name(self) -> str:
        """Key `method` of that table."""
        return str(self.begin.method)
