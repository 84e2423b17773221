"""The verb draws from the posterior of a run, and refuses intervals of chains that do not agree."""

from __future__ import annotations

import errno
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.certainty.posterior_file import RefusedDrawsError, read_posterior
from commonrail.plugins.new.study import write_new
from tests.cli.conftest import run_command


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run of the example of `commonrail new`, its search cut short: the certainty climbs on from there."""
    folder = tmp_path_factory.mktemp("posterior") / "own"
    write_new(folder)
    text = (folder / "study.toml").read_text(encoding="utf-8").replace("generations = 30", "generations = 2")
    (folder / "study.toml").write_text(text.replace("polish = 3", "polish = 0"), encoding="utf-8")
    found = folder.parent / "run"
    assert run_command("calibrate", folder / "study.toml", "--out", found, "--threads", 1).status == 0
    return found


def test_the_posterior_agrees_with_the_curvature_where_the_model_is_nearly_linear(run: Path) -> None:
    done = run_command("certainty", run, "--local", "--posterior", "--threads", 1, "--json")
    assert done.status == 0, done.err
    local, drawn = done.record["certainty"]["parameters"], done.record["certainty"]["posterior"]
    assert drawn["refused"] == ""
    for one, other in zip(local, drawn["parameters"], strict=True):
        assert other["r_hat"] <= 1.05
        assert other["effective"] >= 400
        # ends of 95 % intervals of 400 draws scatter by 8 % of the half width, 4 of them together by chance no more
        half = 0.5 * (one["upper"] - one["lower"])
        np.testing.assert_allclose([other["lower"], other["upper"]], [one["lower"], one["upper"]], atol=0.3 * half)
    with np.load(run / "posterior.npz") as kept:
        assert kept["points"].shape == (drawn["chains"], drawn["steps"], len(local))
        assert list(kept["names"]) == [one["name"] for one in local]
        assert "posterior.npz" in (run / "SHA256SUMS").read_text(encoding="utf-8")
    assert "Posterior" in (run / "report.html").read_text(encoding="utf-8")


def test_a_better_fit_is_said_first_and_left_as_an_injector(run: Path) -> None:
    """The search of this run was cut short, so that the most likely values are far from the calibrated ones."""
    done = run_command("certainty", run, "--local", "--threads", 1, "--json")
    assert done.status == 0, done.err
    likely = cr.load_injector(run / "most-likely.toml")
    for one in done.record["certainty"]["parameters"]:
        assert likely.values[one["name"]] == pytest.approx(one["value"], rel=1e-12)
    assert done.record["certainty"]["gain"] > 100.0
    assert "most-likely.toml" in (run / "SHA256SUMS").read_text(encoding="utf-8")
    page = (run / "report.html").read_text(encoding="utf-8")
    assert page.index("2 ln L is higher by") < page.index("<h2>Fit")  # on the first screen
    headings = re.findall(r"<h[23][^>]*>([^<]+)", page)
    assert len(headings) == len(set(headings))


def result_of(run: Path) -> dict[str, Any]:
    """The result without what depends on the clock."""
    record: dict[str, Any] = json.loads((run / "result.json").read_text(encoding="utf-8"))
    return {key: value for key, value in record.items() if key != "clock"}


def test_a_resume_that_changes_nothing_keeps_the_profiles(run: Path, tmp_path: Path) -> None:
    own = shutil.copytree(run, tmp_path / "own")
    assert run_command("certainty", own, "--starts", 2, "--threads", 1).status == 0
    before, likely = result_of(own), (own / "most-likely.toml").read_bytes()
    assert len(before["certainty"]["profiles"]) == len(before["parameters"])
    assert run_command("resume", own, "--threads", 1).status == 0
    assert result_of(own) == before
    assert (own / "most-likely.toml").read_bytes() == likely


def test_adopted_values_are_those_of_all_of_the_run_and_stay_so(run: Path, tmp_path: Path) -> None:
    own = shutil.copytree(run, tmp_path / "own")
    assert run_command("certainty", own, "--local", "--starts", 3, "--threads", 1).status == 0
    likely = {one["name"]: one["value"] for one in result_of(own)["certainty"]["parameters"]}
    done = run_command("certainty", own, "--adopt", "--threads", 1, "--json")
    assert done.status == 0, done.err
    record = result_of(own)
    assert {p["name"]: p["best"] for p in record["parameters"]} == likely
    calibrated = cr.load_injector(own / "calibrated.toml")
    assert all(calibrated.values[name] == pytest.approx(value, rel=1e-12) for name, value in likely.items())
    assert record["certainty"]["gain"] == 0.0
    assert record["convergence"]["converged"] == record["certainty"]["settled"]
    (listed,) = cr.list_runs(own)
    assert listed.best == record["objective"]["best"]
    study = cr.load_study(own / "study.toml")
    scored = cr.compare({"best": calibrated}, study, threads=1).scores["best"]
    assert [score.j for score in scored] == pytest.approx([d["J"]["best"] for d in record["data"]], rel=1e-9)
    assert run_command("resume", own, "--threads", 1).status == 0
    assert result_of(own) == record
    longer = run_command("resume", own, "--generations", 30, "--threads", 1)
    assert longer.status == 0, longer.err
    assert "have changed" in longer.err
    assert "taken" not in result_of(own)["certainty"]
    assert cr.list_runs(own)[0].best == result_of(own)["objective"]["best"]


def test_too_few_starts_leave_the_verdict_of_the_search(run: Path, tmp_path: Path) -> None:
    own = shutil.copytree(run, tmp_path / "own")
    (own / "SHA256SUMS").unlink()
    record = json.loads((own / "result.json").read_text(encoding="utf-8"))
    found = record["certainty"] | {"starts": 2, "agreeing": 2, "settled": True}
    (own / "result.json").write_text(json.dumps(record | {"certainty": found}), encoding="utf-8")
    assert run_command("certainty", own, "--adopt", "--threads", 1).status == 0
    after = result_of(own)
    assert "taken" in after["certainty"]
    assert after["convergence"] == record["convergence"]


def test_no_interval_is_told_of_chains_that_do_not_agree(run: Path) -> None:
    done = run_command("certainty", run, "--local", "--posterior", "--most", 1000, "--threads", 1, "--json")
    assert done.status == 0, done.err
    drawn = done.record["certainty"]["posterior"]
    assert "fewer than 400" in drawn["refused"]
    assert all(one["lower"] is None and one["upper"] is None for one in drawn["parameters"])


def test_draws_with_other_quantities_drawn_too_are_not_simulated_without_them(run: Path) -> None:
    assert run_command("certainty", run, "--local", "--posterior", "--threads", 1).status == 0
    with np.load(run / "posterior.npz") as kept:
        arrays = dict(kept)
    names = [str(name) for name in arrays["names"]]
    assert arrays["beside"].shape == (0,)
    assert read_posterior(run, names).shape[1] == len(names)
    np.savez(run / "posterior.npz", **(arrays | {"beside": np.array(["plunger_needle.friction"])}))
    (run / "SHA256SUMS").unlink()
    with pytest.raises(RefusedDrawsError, match=r"plunger_needle\.friction drawn too"):
        read_posterior(run, names)


def test_a_certainty_without_a_posterior_removes_the_former_draws(run: Path) -> None:
    assert run_command("certainty", run, "--local", "--threads", 1).status == 0
    assert not (run / "posterior.npz").exists()


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def barred(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", barred)
    monkeypatch.setattr("commonrail.plugins.certainty.run.certify", None)
    done = run_command("certainty", run)
    assert done.status == 3
    assert f"{run} cannot be written (Permission denied)" in done.sentence
