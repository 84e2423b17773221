"""An objective spread over workers: the same bits for any number of them, whatever becomes of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from commonrail.base.errors import ConfigurationError, StudyError
from commonrail.calibration import distributed_objective as module
from commonrail.calibration.distributed_objective import BLOCK, LONGEST, SHORTEST, SpreadObjective, cut
from commonrail.calibration.objective import Objective
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from commonrail.data.registry import of_role
from commonrail.workers.pool import Limits
from commonrail.workers.workers import Workers
from tests.calibration.misbehaving import Misbehaving
from tests.workers.crews import CREWS, processes

CASES = Path(__file__).parents[2] / "cases"
CANDIDATES = 45  # five full blocks and a part of one
MARKED = 20
# A piece of these takes some ms: a second without an answer is a worker that hangs, or a machine with much other work;
# what is taken for hanging by mistake is simulated once more.
HASTY = Limits(failures=10_000, least=1.0)

Floats = NDArray[np.float64]

pytestmark = [pytest.mark.process, pytest.mark.usefixtures("forked_workers")]


@pytest.fixture(scope="module")
def objective() -> Objective:
    study = load_study(CASES / "paper" / "study.toml")
    return Objective(study.injector, study.space.names, of_role(study.data, Role.FIT), study.time_step, threads=1)


def spread_over(objective: Objective, workers: Workers) -> SpreadObjective:
    own = np.array([objective.injector.values[name] for name in objective.names])
    return SpreadObjective(objective, workers, own)


@pytest.fixture(scope="module")
def population(objective: Objective) -> Floats:
    own = np.array([objective.injector.values[name] for name in objective.names])
    found: Floats = own * np.random.default_rng(1).uniform(0.8, 1.25, (CANDIDATES, len(own)))
    return found


@pytest.fixture(scope="module")
def expected(objective: Objective, population: Floats) -> bytes:
    return objective.costs(population).costs.tobytes()


@pytest.fixture(scope="module", params=CREWS)
def two(forked_workers: None, request: pytest.FixtureRequest) -> Iterator[Workers]:
    with CREWS[request.param](2) as workers:
        yield workers


@pytest.fixture
def many_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A population that lasts some ms is cut up too."""
    monkeypatch.setattr(module, "SHORTEST", 1e-9)


Bad = Callable[[str, int], Misbehaving]


@pytest.fixture
def bad(objective: Objective, population: Floats, tmp_path: Path) -> Bad:
    return lambda what, times: Misbehaving(objective, population[MARKED, 0], what, times, tmp_path)


@pytest.mark.usefixtures("many_pieces")
def test_a_population_in_pieces(two: Workers, objective: Objective, population: Floats, expected: bytes) -> None:
    spread = spread_over(objective, two)
    spread._seconds["costs"] = 1e-3  # for a block, in place of what was measured here
    assert len(cut(CANDIDATES, two.backend.count, 1e-3)) > 1
    scores = spread.costs(population)
    assert scores.costs.tobytes() == expected
    assert scores.simulations == CANDIDATES
    assert spread.residuals(population[:19]).tobytes() == objective.residuals(population[:19]).tobytes()


def test_a_population_in_one_piece(two: Workers, objective: Objective, population: Floats, expected: bytes) -> None:
    assert spread_over(objective, two).costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_a_failed_candidate_is_a_cost_and_no_failure_of_its_worker(
    two: Workers, objective: Objective, population: Floats
) -> None:
    some = population.copy()
    some[3] = np.nan
    some[11] *= -1.0
    costs = spread_over(objective, two).costs(some).costs
    assert np.flatnonzero(np.isinf(costs)).tolist() == [3, 11]
    assert costs.tobytes() == objective.costs(some).costs.tobytes()


@pytest.mark.usefixtures("many_pieces")
@pytest.mark.parametrize("what", ["die", "fail"])
def test_a_lost_piece_is_repeated_to_the_same_bits(
    two: Workers, bad: Bad, population: Floats, expected: bytes, what: str, tmp_path: Path
) -> None:
    spread = spread_over(bad(what, 1), two)
    assert spread.costs(population).costs.tobytes() == expected
    tries = len(list(tmp_path.iterdir()))
    assert tries == 2
    assert spread.costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_a_piece_that_takes_much_longer_than_expected_is_repeated(
    bad: Bad, population: Floats, expected: bytes, tmp_path: Path
) -> None:
    with processes(2, HASTY) as workers:
        assert spread_over(bad("hang", 1), workers).costs(population).costs.tobytes() == expected
    assert len(list(tmp_path.iterdir())) >= 2


@pytest.mark.usefixtures("many_pieces")
def test_a_piece_that_always_kills_its_worker_ends_the_run_and_names_few_candidates(
    bad: Bad, objective: Objective, population: Floats, expected: bytes
) -> None:
    with processes(2) as workers:
        spread = spread_over(bad("die", 99), workers)
        spread._seconds["costs"] = 1e-12  # one piece: halved twice, 45 candidates are 16
        with pytest.raises(StudyError) as caught:
            spread.costs(population)
        said = str(caught.value)
        assert said.startswith("Candidates 17 to 24 of 45 were lost 3 times (the worker was ended by SIGKILL), the fir")
        assert f"plunger_needle.k1 = {population[16, 0]:.6g} N/m, " in said
        # the workers can go on
        assert spread_over(objective, workers).costs(population).costs.tobytes() == expected


@pytest.mark.usefixtures("many_pieces")
def test_what_the_objective_refuses_is_refused_at_once_in_its_own_words(
    two: Workers, bad: Bad, population: Floats, tmp_path: Path
) -> None:
    with pytest.raises(ConfigurationError, match=r"^This cannot be simulated\.$"):
        spread_over(bad("refuse", 99), two).costs(population)
    assert len(list(tmp_path.iterdir())) <= 1  # not repeated


def test_two_objectives_can_take_turns(two: Workers, objective: Objective, population: Floats, expected: bytes) -> None:
    other = Objective(objective.injector, objective.names, objective.data, 2e-6, threads=1)
    first, second = spread_over(objective, two), spread_over(other, two)
    for _ in range(2):
        assert first.costs(population).costs.tobytes() == expected
        assert second.costs(population).costs.tobytes() == other.costs(population).costs.tobytes()


@pytest.mark.parametrize("case", ["paper", pytest.param("cri2-16", marks=pytest.mark.slow)])  # a kernel of its own
def test_a_candidate_does_not_know_its_neighbours(case: str) -> None:
    # lengths and temperature set the delays of the waves: lanes that differ in them take another path in the kernel
    study = load_study(CASES / case / "study.toml")
    names = (*study.space.names[:3], "feed_pipe.length", "fuel.temperature", "return_line.length")
    objective = Objective(study.injector, names, of_role(study.data, Role.FIT), study.time_step, threads=1)
    own = np.array([study.injector.values[name] for name in names])
    values = own * np.random.default_rng(2).uniform(0.97, 1.03, (11, len(names)))
    together = objective.costs(values).costs
    assert np.isfinite(together).sum() > 5
    alone = np.concatenate([objective.costs(v[None, :]).costs for v in values])
    assert alone.tobytes() == together.tobytes()
    assert objective.costs(values[::-1]).costs[::-1].tobytes() == together.tobytes()
    backwards = objective.residuals(values[::-1])[::-1]
    assert np.ascontiguousarray(backwards).tobytes() == objective.residuals(values).tobytes()


@given(st.integers(1, 30_000), st.integers(1, 64), st.floats(1e-6, 5.0))
def test_pieces_are_whole_blocks_long_enough_and_spread_evenly(candidates: int, workers: int, seconds: float) -> None:
    pieces = cut(candidates, workers, seconds)
    assert [piece.first for piece in pieces[1:]] == [piece.stop for piece in pieces[:-1]]
    assert (pieces[0].first, pieces[-1].stop) == (0, candidates)
    assert all(piece.first % BLOCK == 0 for piece in pieces)
    longest = max(piece.blocks for piece in pieces)
    for piece in pieces[:-1]:
        assert piece.blocks == longest
        assert piece.blocks * seconds >= 0.999 * SHORTEST or len(pieces) <= 1
    # one block is the least; rounding up to whole blocks at most doubles a piece
    assert longest == 1 or longest * seconds <= 2.0 * LONGEST or len(pieces) >= workers


def test_pieces_of_the_populations_that_are_met() -> None:
    assert len(cut(50, 4, 0.7e-3)) == 1  # the paper's: 5 ms
    assert len(cut(512, 2, 2.3e-3)) == 2  # 147 ms for two: not three pieces
    assert len(cut(100, 2, 35e-3)) == 7  # 13 blocks, two in each
    assert len(cut(20_000, 2, 35e-3)) == 44  # 87 s in pieces of 2 s
