"""Protocol of the optimisers: each proposes trials, is told what became of them, and never simulates."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from commonrail.base.arrays import Bools, Floats, IndexArray
from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.calibration.space import Space

# Verdict of a search on itself: converged or not, by which rule, and with which figures.

# Restarts agree if at least so many of them end within so much of the best 2 ln L, and the search has arrived if a full
# step from there is predicted to gain less than SMALL_GAIN of it.
AGREEING, ALIKE, SMALL_GAIN = 3, 0.5, 0.01


class Convergence(NamedTuple):
    """Verdict on convergence.

    Attributes
    ----------
    converged : bool
    sentence : str
        Rule and figures for the user, without its full stop.
    figures : dict
        JSON-able numbers that the rule was applied to.
    """

    converged: bool
    sentence: str
    figures: dict[str, Any]

    @classmethod
    def of(cls, converged: bool, sentence: str, figures: dict[str, Any]) -> Convergence:
        """Convergence whose sentence opens with the result.

        Parameters
        ----------
        converged : bool
        sentence : str
            Rule and figures.
        figures : dict
        """
        return cls(converged, f"{'' if converged else 'not '}converged: {sentence}", figures)

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        return {"converged": self.converged, "sentence": self.sentence, **self.figures}


def noise_of(cost: float, residuals: int, parameters: int, units: float) -> float:
    """Change of an objective that changes 2 ln L by 1, by the objective's own residual noise.

    The objective is read as the likelihood of errors whose size is what it leaves: Gaussian for sums of squares,
    Laplacian for sums of absolute errors. Then 2 ln L changes by `units` (N − d) times its relative change.

    Parameters
    ----------
    cost : float
        Objective of the best.
    residuals : int
        Number N of residuals.
    parameters : int
        Number d of free parameters.
    units : float
        1 for squares, 2 for absolute errors.
    """
    return max(cost, 1e-300) / (units * max(residuals - parameters, 1))


MOST_GENERATIONS = 1_000_000  # far above what anybody calibrates; below what would fill the memory


class Wanted(Enum):
    """Answers that an optimiser asks for."""

    COSTS = "costs"  # one for each trial (n,)
    RESIDUALS = "residuals"  # one row for each trial (n, m)
    SCREENED = "screened"  # residuals from simulations that are coarser and cheaper
    COSTS_AGAIN = "costs again"  # of points whose residuals were told before: their simulations are not counted twice


class Trials(NamedTuple):
    """Points (n, d) to be tried, SI, which of them (n,) are to be simulated, and what is asked of them.

    A trial that the treatment of constraints rejects is not simulated; whatever is told of it is ignored.
    """

    x: Floats
    simulate: Bools
    wanted: Wanted = Wanted.COSTS


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

    def plus(self, costs: Floats, simulate: Bools) -> Counts:
        """These counts and those of one batch, with its cleaned costs (n,) and mask (n,)."""
        return Counts(
            self.slots + len(costs),
            self.simulated + int(simulate.sum()),
            self.failed + int((simulate & ~np.isfinite(costs)).sum()),
        )


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


class Optimiser(ABC):
    """A search as a conversation: `ask` for trials, simulate them elsewhere, `tell` what became of them.

    `ask` repeats itself until it is answered. A step may take several questions. `state` describes the search as it
    was after the last step that is done, so that one restored from it asks for the same trials, bit by bit; nobody
    else looks into it. Subclasses say what is proposed and kept.

    Parameters
    ----------
    space : Space
    rng : numpy.random.Generator
        Source of every draw.

    Attributes
    ----------
    method : str
        Its name, in study files and states.
    phase : str
        What it does, in a word for the user.
    steps : int
        Steps done.
    counts : Counts
        Slots, simulations and failures of the trials whose costs were asked for.
    """

    method: ClassVar[str]
    phase: ClassVar[str]

    def __init__(self, space: Space, rng: np.random.Generator) -> None:
        self.space, self._rng = space, rng
        self.steps, self.counts = 0, Counts()
        self._asked: Trials | None = None
        self._begun: Mapping[str, Any] = {}  # state of the generator before the step under way

    @property
    @abstractmethod
    def total(self) -> int:
        """Steps wanted."""

    @property
    def finished(self) -> bool:
        """Return whether the search has stopped."""
        return self.steps >= self.total

    @property
    def reason(self) -> str:
        """Reason for the end of the search; empty before it."""
        return self._ended if self.finished else ""

    @property
    def verdict(self) -> Convergence | None:
        """Own verdict on convergence; None of a search that does not judge itself, see `calibration/search.py`."""
        return None

    @property
    @abstractmethod
    def best(self) -> Best:
        """The best feasible point; one at +inf until a simulation has succeeded."""

    @property
    def ends(self) -> tuple[Best, ...]:
        """Optima of searches side by side, the best first; the best alone where there is one search."""
        return (self.best,)

    @property
    @abstractmethod
    def population(self) -> Floats:
        """Points (n, d) from which another optimiser may go on, SI; no rows before the first step."""

    @property
    @abstractmethod
    def costs(self) -> Floats:
        """Costs (n,) of those points; +inf where the simulation failed or there was none."""

    def ask(self) -> Trials:
        """Return the next trials, the same ones until they are answered.

        Raises
        ------
        StudyError
            If the search has finished.
        """
        if self.finished:
            raise StudyError(f"the search has finished ({self.reason}): read its best member")
        if self._asked is None:
            self._begun = self._rng.bit_generator.state
            self._asked = self._propose()
        return self._asked._replace(x=self._asked.x.copy())

    def tell(self, answers: ArrayLike) -> None:
        """Take what was asked for: costs (n,) or residuals (n, m); one that is not finite never wins.

        Raises
        ------
        StudyError
            If nothing was asked for, or there is not one answer for each trial.
        """
        if self._asked is None:
            raise StudyError("answers were told before any trials were asked for: ask first")
        told = _checked(answers, self._asked)
        if self._asked.wanted is Wanted.COSTS:
            self.counts = self.counts.plus(told, self._asked.simulate)
        self._asked = self._take(self._asked, told)
        self.steps += self._asked is None

    def state(self) -> dict[str, Any]:
        """All that is needed to go on later: texts, numbers and arrays, in lists and mappings."""
        now = self._rng.bit_generator.state
        return {
            **self._origin(),
            "steps": self.steps,
            "counts": asdict(self.counts),
            "rng": dict(now if self._asked is None else self._begun),
            **self._kept(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a `state`; a step that was under way is begun anew.

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
                    "saved with"
                )
        try:
            self._rng.bit_generator.state = state["rng"]
        except (KeyError, TypeError, ValueError) as error:
            kind = type(self._rng.bit_generator).__name__
            raise ConfigurationError(
                f"state: it holds no state for a {kind} generator, use the kind it was saved with"
            ) from error
        if not all(isinstance(count, int) and count >= 0 for count in (state["steps"], *state["counts"].values())):
            raise ConfigurationError("state: its counts are no whole numbers")
        self.steps, self.counts, self._asked = state["steps"], Counts(**state["counts"]), None
        self._restore(state)

    def _origin(self) -> dict[str, Any]:
        """Values that a state must share with the search that resumes from it; subclasses may add to them."""
        space = self.space
        names = list(space.names)
        return {"method": self.method, "names": names, "lower": space.lower.copy(), "upper": space.upper.copy()}

    def _settings(self, settings: Any) -> dict[str, Any]:
        """Part of `_origin` for settings: all but the steps, of which a search that resumes may want more."""
        values = {name: value for name, value in asdict(settings).items() if name != "generations"}
        return {"settings": [str(value) for value in values.values()]}

    @property
    @abstractmethod
    def _ended(self) -> str:
        """Reason for the end of the search."""

    @abstractmethod
    def _propose(self) -> Trials:
        """First trials of the next step."""

    @abstractmethod
    def _take(self, trials: Trials, told: Floats) -> Trials | None:
        """Take the answers, and return further trials of the same step, or None if it is done."""

    @abstractmethod
    def _kept(self) -> dict[str, Any]:
        """Own part of `state`."""

    @abstractmethod
    def _restore(self, state: Mapping[str, Any]) -> None:
        """Take up what `_kept` returned; ConfigurationError if it is not whole."""


def _checked(answers: ArrayLike, trials: Trials) -> Floats:
    """Residuals (n, m) as they are; costs (n,) with +inf for trials not simulated and those that are not finite."""
    told = np.asarray(answers, dtype=float)
    residuals = trials.wanted in (Wanted.RESIDUALS, Wanted.SCREENED)
    if told.ndim != 1 + residuals or len(told) != len(trials.x):
        what, one = ("residuals", "row") if residuals else ("costs", "cost")
        raise StudyError(
            f"{what}: an array of shape {told.shape} was told for {len(trials.x)} trials, expected one {one} for each "
            "trial in the order asked for"
        )
    if residuals:
        return told
    return np.where(trials.simulate & np.isfinite(told), told, np.inf)


# Members of a population with their costs: the best of them, and their part of a state.

MOST_MEMBERS = 100_000  # far above what anybody calibrates; below what would fill the memory


def diverse_members(unit: ArrayLike, costs: ArrayLike, n: int) -> IndexArray:
    """Choose members of low cost that lie far apart, the best one first.

    From the better half of the members with a finite cost (at least `n` of them), each further
    choice is the one farthest from those chosen already.

    Parameters
    ----------
    unit : (k, d) array
        Members in unit coordinates (`Space.to_unit`).
    costs : (k,) array
        Their costs.
    n : int
        How many to choose; fewer come back if fewer distinct ones have a finite cost.

    Returns
    -------
    (<= n,) array of int
        Rows of the chosen members.
    """
    points, cost = np.asarray(unit, dtype=float), np.asarray(costs, dtype=float)
    order = np.argsort(cost, kind="stable")
    order = order[np.isfinite(cost[order])]
    pool = order[: max(n, (len(order) + 1) // 2)]
    return np.asarray(pool[farthest(points[pool], min(n, len(pool)))])


def farthest(points: Floats, n: int) -> IndexArray:
    """Rows of up to n distinct ones of the points (k, d), the first one first, each farthest from those before."""
    chosen: list[int] = []
    distance = np.full(len(points), np.inf)
    while len(chosen) < n:
        row = int(np.argmax(distance))
        if distance[row] == 0.0:
            break
        chosen.append(row)
        distance = np.minimum(distance, np.linalg.norm(points - points[row], axis=1))
    return np.array(chosen, dtype=np.intp)


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
        By the key to blame, what raises a ConfigurationError if settings do not suit a space.
    """

    begin: type[Any]
    settings: type[Any]
    checks: Mapping[str, Callable[[Any, Space], None]] = MappingProxyType({})

    @property
    def name(self) -> str:
        """Key `method` of that table."""
        return str(self.begin.method)
