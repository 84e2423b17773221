"""Verdicts over the seeds: each claim must be able to hold, to fail, and to stay open."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from commonrail.plugins.paper import study
from commonrail.plugins.paper.claims import FAILS, HOLDS, OPEN, Claim, claims, holm
from commonrail.plugins.paper.figures import PHASES
from commonrail.plugins.paper.run import LABELS

N = 20
RNG = np.random.default_rng(3)
START = RNG.bit_generator.state
PRESSURES = tuple(study.RAIL_PRESSURES)
SHARES = {"160 MPa": (0.0, 0.4, 0.1, 0.5), "120 MPa": (0.0, 0.4, 0.1, 0.5), "80 MPa": (0.0, 0.4, 0.4, 0.2)}
J = {"rigid": 8000.0, "rigid_fitted": 1500.0, "theoretical": 800.0, "paper": 300.0, "optimised": 160.0}


@pytest.fixture(autouse=True)
def _same_scatter() -> None:
    """The same numbers whichever tests ran before."""
    RNG.bit_generator.state = START


def each(value: float) -> np.ndarray:
    """A little scatter around a value."""
    return value * (1.0 + 0.01 * RNG.random(N))


@dataclass
class Sample:
    """Figures of twenty seeds in which every claim holds."""

    seeds: list[int] = field(default_factory=lambda: list(range(N)))
    j: dict = field(default_factory=lambda: {p: {k: each(v) for k, v in J.items()} for p in PRESSURES})
    ninety: np.ndarray = field(default_factory=lambda: np.full(N, 12.0))
    k6_high: np.ndarray = field(default_factory=lambda: np.full(N, 0.7))
    opening: float = 20e-6
    closing: float = -20e-6
    kept: float = 0.8
    fitted_opening: float = 15e-6
    fitted_closing: float = -15e-6
    random: float = 5000.0
    best: float = 150.0
    cheap: float = 165.0
    change: np.ndarray = field(
        default_factory=lambda: np.tile([1.5, 0.02, 0.02, 0.5, 0.1, 0.9, 0.1], (N, 1)),
    )
    phases: dict = field(
        default_factory=lambda: {p: {k: np.tile(np.array(SHARES[p]) * J[k], (N, 1)) for k in LABELS} for p in PRESSURES}
    )
    windows: dict = field(
        default_factory=lambda: {
            p: {"optimised": np.tile([[100.0, 480.0], [90.0, 400.0]], (N, 1, 1))} for p in PRESSURES
        }
    )
    oscillation: dict = field(
        default_factory=lambda: {p: {k: each(1.0 if "rigid" in k else 5.0) for k in LABELS} for p in PRESSURES}
    )
    theoretical_opening: float = 5e-6
    verdict: str = "determined"
    random_change: np.ndarray = field(default_factory=lambda: np.array([[1.5, 0.5, 0.02, 0.5, 0.1, 0.9, 0.1]] * 4))
    k6_high_at_random: float = 0.4

    @property
    def mean_j(self) -> dict[study.Configuration, np.ndarray]:
        return {c: each(self.best if c == study.BEST else 160.0) for c in study.CONFIGURATIONS}

    @property
    def validation_j(self) -> dict[study.Configuration, np.ndarray]:
        return {c: each(self.cheap if c == study.CONFIGURATIONS[0] else 155.0) for c in study.CONFIGURATIONS}

    def edge_errors(self, name: str, label: str, which: str) -> np.ndarray:
        assert name in PRESSURES
        fields = {"rigid": which, "rigid_fitted": f"fitted_{which}", "theoretical": f"theoretical_{which}"}
        return np.full(N, getattr(self, fields[label]) if (label, name) != ("theoretical", "160 MPa") else np.nan)

    def random_j(self, name: str) -> np.ndarray:
        assert name in PRESSURES
        return np.full((N, 5), self.random)

    def gain_kept(self, name: str) -> np.ndarray:
        assert name in study.VALIDATION
        return np.full(N, self.kept)

    def verdicts(self, parameter: int) -> dict[str, int]:
        assert 0 <= parameter < 7
        return {self.verdict: N}


def claim(sample: Sample, name: str) -> Claim:
    return next(c for c in claims(sample) if c.id == name)  # type: ignore[arg-type]


def test_every_claim_holds_where_all_seeds_say_so() -> None:
    for c in claims(Sample()):  # type: ignore[arg-type]
        assert (c.id, c.verdict, c.of) == (c.id, HOLDS, N)


def test_the_interval_is_the_exact_one() -> None:
    c = claim(Sample(), "rapid")
    # Clopper and Pearson for 20 of 20: (α/2)^(1/n) to 1
    assert c.interval == pytest.approx((0.025 ** (1.0 / N), 1.0), rel=1e-9)


def with_ordering(wrong: int) -> Sample:
    sample = Sample()
    sample.j["80 MPa"]["optimised"][:wrong] = 900.0
    return sample


# of 20 seeds 15 and more have their 95 % interval above one half, 5 and fewer below (Clopper and Pearson's tables)
@pytest.mark.parametrize(("wrong", "verdict"), [(5, HOLDS), (6, OPEN), (14, OPEN), (15, FAILS)])
def test_the_share_of_the_seeds_decides(wrong: int, verdict: str) -> None:
    sample = with_ordering(wrong)
    assert claim(sample, "ordering-80MPa").verdict == verdict
    assert claim(sample, "ordering-80MPa").true_in == N - wrong
    assert claim(sample, "ordering-120MPa").verdict == HOLDS


def test_seeds_without_a_number_are_left_out() -> None:
    sample = with_ordering(2)
    sample.j["80 MPa"]["rigid"][:4] = np.nan
    found = claim(sample, "ordering-80MPa")
    assert (found.true_in, found.of) == (N - 4, N - 4)
    sample.opening = np.nan
    assert (claim(sample, "rigid-late").verdict, claim(sample, "rigid-late").of) == (OPEN, 0)


def flat(**changes: object) -> Sample:
    return replace(Sample(), **changes)  # type: ignore[arg-type]


SLOW = np.full(N, 36.0)
ALL_UP = np.tile([1.5, 0.3, 0.02, 0.5, 0.1, 0.9, 0.1], (N, 1))
NOT_FAR = np.tile([1.5, 0.02, 0.02, 0.5, 0.1, 0.3, 0.1], (N, 1))
NOT_CLOSE = np.tile([1.5, 0.02, 0.02, 0.5, 0.1, 0.9, 0.2], (N, 1))
K4_CLOSE = np.tile([1.5, 0.02, 0.02, 0.11, 0.1, 0.9, 0.1], (N, 1))
SOFTER = np.tile([1.5, -0.02, 0.02, 0.5, 0.1, 0.9, 0.1], (N, 1))


@pytest.mark.parametrize(
    ("name", "sample"),
    [
        ("rapid", flat(ninety=SLOW)),
        ("best-configuration", flat(best=170.0)),
        ("cheap-configuration", flat(cheap=140.0)),
        ("stiffer", flat(change=SOFTER)),
        ("near-theory", flat(change=ALL_UP)),
        ("close-to-theory", flat(change=NOT_CLOSE)),
        ("k4-from-theory", flat(change=K4_CLOSE)),
        ("far-from-theory", flat(change=NOT_FAR)),
        ("k6-at-maximum", flat(k6_high=np.full(N, 0.3))),
        ("rigid-late", flat(opening=-1e-6)),
        ("rigid-early", flat(closing=1e-6)),
        ("rigid-late-fitted", flat(fitted_opening=-1e-6)),
        ("rigid-early-fitted", flat(fitted_closing=1e-6)),
        ("theoretical-late", flat(theoretical_opening=-1e-6)),
        ("no-overfitting", flat(kept=0.4)),
    ],
)
def test_a_claim_fails_on_its_own_measure(name: str, sample: Sample) -> None:
    assert [c.id for c in claims(sample) if c.verdict == FAILS] == [name]  # type: ignore[arg-type]


def test_the_ordering_is_judged_on_a_fair_rigid_body_as_well() -> None:
    sample = Sample()
    sample.j["160 MPa"]["rigid_fitted"][:] = 568.0
    assert [c.id for c in claims(sample) if c.verdict != HOLDS] == ["ordering-fitted-160MPa"]  # type: ignore[arg-type]


PAPERS = np.array([study.TABLE1_OPTIMAL[n] / study.TABLE1_THEORETICAL[n] - 1.0 for n in study.NAMES])
GROUPS = ("near-theory", "close-to-theory", "k4-from-theory", "far-from-theory")


def test_the_papers_own_stiffnesses_satisfy_its_words() -> None:
    sample = flat(change=np.tile(PAPERS, (N, 1)))
    assert {name: claim(sample, name).verdict for name in GROUPS} == dict.fromkeys(GROUPS, HOLDS)


# k2 and k3 of the paper are 2.2 and 1.7 % above theory, k5 and k7 11.3 and 10.7 %, k4 49.4 %
@pytest.mark.parametrize(
    ("name", "stiffness", "change"),
    [
        ("near-theory", 1, 0.03),
        ("near-theory", 2, -0.03),
        ("close-to-theory", 4, 0.12),
        ("close-to-theory", 6, -0.3),
        ("k4-from-theory", 3, 0.11),
        ("far-from-theory", 0, 0.49),
        ("far-from-theory", 5, 0.49),
    ],
)
def test_the_words_reach_as_far_as_the_papers_own_figures(name: str, stiffness: int, change: float) -> None:
    changes = np.tile(PAPERS, (N, 1))
    changes[:, stiffness] = change
    assert claim(flat(change=changes), name).verdict == FAILS


def test_the_measure_states_its_threshold_and_where_it_comes_from() -> None:
    measures = {c.id: c.measure for c in claims(Sample()) if c.id in GROUPS}  # type: ignore[arg-type]
    assert measures == {
        "near-theory": "both at most 2.2 % from theory, as in the paper's Table 1",
        "close-to-theory": "both at most 11.3 % from theory, as in the paper's Table 1",
        "k4-from-theory": "more than 11.3 % from theory, where very close ends there",
        "far-from-theory": "both more than 49.4 % from theory, the significant difference there",
    }


def test_the_share_of_random_points_stands_beside_a_claim_on_stiffness() -> None:
    sample = Sample()
    sample.random_change = np.array([PAPERS, PAPERS, -PAPERS, 0.5 * PAPERS])
    chances = {name: claim(sample, name).chance for name in (*GROUPS, "stiffer", "rapid")}
    assert chances == {
        "near-theory": 1.0,
        "close-to-theory": 1.0,
        "k4-from-theory": 1.0,
        "far-from-theory": 0.75,
        "stiffer": 0.75,
        "rapid": None,
    }
    assert "points 40 %" in claim(sample, "k6-at-maximum").comment


def test_the_share_of_random_points_that_beat_theory_stands_beside_the_ordering() -> None:
    assert claim(Sample(), "ordering-160MPa").chance == 0.0
    assert claim(flat(random=500.0), "ordering-160MPa").chance == 1.0
    # however good a random point is, the ordering is false where the rigid body beats theory
    sample = flat(random=500.0)
    sample.j["160 MPa"]["rigid_fitted"][: N // 4] = 10.0
    assert claim(sample, "ordering-fitted-160MPa").chance == 0.75


def test_phases_decide_their_claims() -> None:
    sample = Sample()
    sample.phases["160 MPa"]["theoretical"][:, PHASES.index("0.4–0.8 ms")] = 700.0
    assert claim(sample, "theoretical-phases").verdict == FAILS
    sample = Sample()
    sample.phases["160 MPa"]["theoretical"][:, PHASES.index("0–0.4 ms")] = (
        50.0  # below the middle, the descent above it
    )
    assert claim(sample, "theoretical-phases").verdict == FAILS
    sample = Sample()
    sample.phases["80 MPa"]["optimised"][:, 1] = 700.0
    found = claim(sample, "optimised-everywhere")
    assert found.verdict == FAILS
    assert "80 MPa, 0–0.4 ms" in found.figure


@pytest.mark.parametrize("phase", ["0–0.4 ms", "0.4–0.8 ms"])
def test_the_gain_in_each_phase_at_80_mpa_is_set_against_the_descent(phase: str) -> None:
    sample = Sample()
    sample.phases["80 MPa"]["optimised"][:, PHASES.index(phase)] = 200.0  # leaves 120 of a gain; the descent has 128
    assert [c.id for c in claims(sample) if c.verdict == FAILS] == ["gains-by-phase"]  # type: ignore[arg-type]


@pytest.mark.parametrize("against", ["theoretical", "optimised"])
def test_a_rigid_body_must_oscillate_less_than_both_flexible_models_at_every_pressure(against: str) -> None:
    sample = Sample()
    sample.oscillation["120 MPa"][against][:] = 0.5
    assert [c.id for c in claims(sample) if c.verdict == FAILS] == ["rigid-smooth", "rigid-smooth-fitted"]  # type: ignore[arg-type]
    sample = Sample()
    sample.oscillation["120 MPa"]["rigid_fitted"][:] = 6.0
    assert [c.id for c in claims(sample) if c.verdict == FAILS] == ["rigid-smooth-fitted"]  # type: ignore[arg-type]


# cylinders of small clearance are those of k1, k4 and k6
@pytest.mark.parametrize(("stiffness", "change"), [(0, 0.05), (3, -0.05), (5, 0.05), (1, -0.6), (4, 0.6)])
def test_each_stiffness_of_small_clearance_must_change_more_than_each_other(stiffness: int, change: float) -> None:
    changes = np.tile(PAPERS, (N, 1))
    assert claim(flat(change=changes), "clearance").verdict == HOLDS
    changes[:, stiffness] = change
    assert claim(flat(change=changes, random_change=changes), "clearance")[5:7] == (FAILS, 0)
    assert claim(flat(random_change=np.array([PAPERS, changes[0]])), "clearance").chance == 0.5


# J is about 160 of 520 samples: 0.31 a sample
@pytest.mark.parametrize(("i", "name", "j"), [(0, "window", 155.0), (1, "window-energising", 130.0)])
def test_j_per_sample_within_the_window_is_set_against_that_of_all_samples(i: int, name: str, j: float) -> None:
    sample = Sample()
    sample.windows["160 MPa"]["optimised"][:, i, 0] = j
    assert [c.id for c in claims(sample) if c.verdict == FAILS] == [name]  # type: ignore[arg-type]
    sample.windows["160 MPa"]["optimised"][:, i, 1] = 520.0  # nothing comes later
    assert claim(sample, name).of == 0


def test_configurations_that_differ_by_chance_leave_the_claim_open() -> None:
    found = claim(flat(best=160.0), "best-configuration")
    assert found.verdict == OPEN
    assert "no difference" in found.figure


def test_holms_correction_is_that_of_the_textbook() -> None:
    np.testing.assert_allclose(holm(np.array([0.01, 0.04, 0.03])), [0.03, 0.06, 0.06])


def test_a_stiffness_that_is_not_pinned_down_is_said_to_be_so() -> None:
    found = claim(flat(verdict="only in combination"), "near-theory")
    assert "not determine" in found.comment
    assert "not determine" not in claim(Sample(), "near-theory").comment
