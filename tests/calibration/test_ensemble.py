"""Members of a fit: which optima they are, and the mean of what they predict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.input import SUMS
from commonrail.calibration import scoring
from commonrail.calibration.optimisers.base import Best
from commonrail.calibration.scoring import injector_of, members_of
from commonrail.runs.fit import STUDIES, calibrate_into
from commonrail.runs.folder import write_results
from tests.plugins.family.samples import INJECTOR, MASS, PRELOAD, study_of

POINTS = (80.0, 400.0), (80.0, 900.0), (160.0, 300.0), (160.0, 900.0)


def study(starts: int = 3, generations: int = 2) -> cr.Study:
    """Fit whose descents are too short to agree."""
    truth = INJECTOR.with_values({PRELOAD: 1.1 * INJECTOR.values[PRELOAD]})
    settings = cr.fit.StagedSettings(
        members=16, generations=generations, starts=starts, trial_iterations=0, finalists=starts, stage_iterations=1
    )
    return replace(study_of(truth, POINTS, PRELOAD, MASS), method=cr.fit.Method(settings))


@pytest.mark.parametrize(
    ("title", "calibrated"),
    [("A part, start values", "A part, calibrated"), ("A part, calibrated", "A part, calibrated"), ("", "calibrated")],
)
def test_the_title_of_a_calibrated_injector_does_not_call_its_values_those_of_the_start(
    title: str, calibrated: str
) -> None:
    given = study()
    given = replace(given, injector=replace(given.injector, title=title))
    assert injector_of(given, {PRELOAD: given.injector.values[PRELOAD]}).title == calibrated


def test_members_cost_at_most_twice_the_best() -> None:
    ends = [Best(np.array([0.0]), cost) for cost in (10.0, 19.9, 20.1)]
    assert [end.cost for end in members_of(ends)] == [10.0, 19.9]


def test_the_mean_is_scored_beside_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "WORST", np.inf)
    found = cr.calibrate(study())
    assert len(found.members) == 3
    assert found.members[0] == found.injector
    (data,) = found.study.data
    each = [cr.simulate_batch(one, data.points, time_step=1e-6).injected_volume[0] for one in found.members]
    assert np.ptp(each, axis=0).max() > 1e-12  # they differ
    (mean,) = found.scores["mean"]
    # the same kernel in batches of other sizes: rounding
    assert mean.values == pytest.approx(np.mean(each, axis=0), rel=1e-12)


def test_one_descent_has_no_mean() -> None:
    found = cr.calibrate(study(starts=1))
    assert found.members == ()
    assert "mean" not in found.scores


def test_the_run_folder_holds_the_members(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "WORST", np.inf)
    found = calibrate_into(tmp_path / "run", study())
    for number, injector in enumerate(found.members[1:], 2):
        kept = cr.load_injector(tmp_path / "run" / f"member-{number}.toml")
        assert kept.values == injector.values
        assert kept.sources[PRELOAD].mark == "F"
    sums = (tmp_path / "run" / SUMS).read_text()
    assert "member-2.toml" in sums
    assert "member-3.toml" in sums
    record = json.loads((tmp_path / "run" / "result.json").read_text())
    assert "members" in record["labels"]["mean"]
    values = [row["mean"] for row in record["data"][0]["rows"]]
    (mean,) = found.scores["mean"]
    assert values == mean.values.tolist()
    write_results(tmp_path / "run", replace(found, members=found.members[:2]), {})
    assert sorted(path.name for path in (tmp_path / "run").glob("member-*")) == ["member-2.toml"]
    assert "member-3.toml" not in (tmp_path / "run" / SUMS).read_text()


def test_an_input_with_the_name_of_a_member_is_kept_apart(tmp_path: Path) -> None:
    files = {tmp_path / name: "0" for name in ("study.toml", "member-2.toml", "Member-3.TOML", "members.toml")}
    kept = STUDIES.copies(replace(study(), files=files))
    assert kept == ["study.toml", "inputs/member-2.toml", "inputs/Member-3.TOML", "members.toml"]
