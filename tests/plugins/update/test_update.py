"""Update of a run: judgement of new data, fit from the calibrated values, what is kept of run and study."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.record import from_record
from commonrail.calibration.record import ParameterRecord
from commonrail.calibration.study_file import edit_study
from commonrail.plugins.new.study import WEIGHT, StatedByUser, write_new
from commonrail.plugins.update import run as update_run
from commonrail.plugins.update.page import update_lines
from commonrail.plugins.update.record import UpdateRecord
from commonrail.plugins.update.study import LOCAL, make_updated_study, read_addition
from commonrail.readers.toml import read_toml
from commonrail.runs.folder import read_result, write_record
from tests.cli.conftest import run_command
from tests.plugins.update.conftest import FREE, TRUTH, Bench


@pytest.fixture(scope="module")
def updated(bench: Bench) -> cr.fit.Update:
    """Data of the same injector, and those of another one that only judge."""
    files, held_out = [bench.folder / "april.csv"], [bench.folder / "other-part.csv"]
    return cr.update(bench.run, files, held_out=held_out, out=bench.folder / "updated", threads=1)


def content(folder: Path) -> dict[str, bytes]:
    """Files of a folder; SQLite may touch those beside the journal."""
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file() and not p.name.startswith("journal")}


def test_data_of_the_same_injector_agree_and_those_of_another_one_contradict(updated: cr.fit.Update) -> None:
    assert updated.agreements == {"april": cr.fit.Agreement.AGREES, "other-part": cr.fit.Agreement.CONTRADICTS}


def test_more_data_of_the_truth_bring_the_value_closer(updated: cr.fit.Update, bench: Bench) -> None:
    record = read_result(bench.run)
    before = next(p["best"] for p in record["parameters"] if p["name"] == FREE)
    after = updated.calibration.best[FREE]
    assert abs(after / TRUTH[FREE] - 1.0) < max(abs(before / TRUTH[FREE] - 1.0), 0.005)
    moved = {one["name"]: one for one in updated.content["moved"]}
    interval = next(p for p in record["certainty"]["parameters"] if p["name"] == FREE)
    half = 0.5 * (interval["upper"] - interval["lower"])
    assert moved[FREE]["moved"] == pytest.approx((after - before) / half)


def test_the_new_study_is_the_old_one_with_the_new_data(updated: cr.fit.Update, bench: Bench) -> None:
    old, new = cr.load_study(bench.study), cr.load_study(updated.folder / "study.toml")
    assert [(d.name, d.role.value) for d in new.data] == [
        ("march", "fit"),
        ("check", "validation"),
        ("april", "fit"),
        ("other-part", "validation"),
    ]
    assert [p.prior for p in new.space.parameters] == [p.prior for p in old.space.parameters]
    np.testing.assert_array_equal(new.space.lower, old.space.lower)
    np.testing.assert_array_equal(new.space.upper, old.space.upper)
    best = {p["name"]: p["best"] for p in read_result(bench.run)["parameters"]}
    assert {name: new.injector.values[name] for name in best} == best  # bit by bit
    assert [d.absolute for d in (old.data[0], new.data[2])] == [0.3e-9, 0.3e-9]  # type: ignore[attr-defined]
    assert new.data[2].points[0].cylinder_pressure == 0.5e6
    assert "# the user's comment" in new.text
    assert not (updated.folder / "study.toml").samefile(bench.study)


def test_the_new_folder_is_a_run_for_the_other_verbs(updated: cr.fit.Update, bench: Bench, tmp_path: Path) -> None:
    report = (updated.folder / "report.html").read_text(encoding="utf-8")
    assert updated.content["lines"][0] in report.replace("&#39;", "'")
    assert run_command("report", updated.folder).status == 0
    own, former = (read_toml(folder / "study.toml")[0]["optimiser"] for folder in (updated.folder, bench.run))
    assert own == LOCAL
    assert updated.content["optimiser"] == former  # of the user, for --global
    again = run_command(
        "update", updated.folder, "--with", updated.folder / "inputs" / "april.csv", "--out", tmp_path / "b"
    )
    assert again.status == 2  # in its study by now
    copy = shutil.copytree(updated.folder, tmp_path / "moved")
    assert run_command("resume", copy, "--as-begun", "--json").status == 0


def test_the_old_run_and_the_study_stay_as_they_were(bench: Bench, tmp_path: Path) -> None:
    before, text = content(bench.run), bench.study.read_bytes()
    cr.update(bench.run, [bench.folder / "april.csv"], out=tmp_path / "new", threads=1)
    assert content(bench.run) == before
    assert bench.study.read_bytes() == text


def test_a_held_out_set_that_is_met_worse_is_said_first(updated: cr.fit.Update) -> None:
    found = json.loads(json.dumps(updated.content))
    one = next(e for e in found["errors"] if e["name"] == "check")
    one |= {"after": {"size": 2.0 * one["before"]["size"] + 1e-3, "in_tolerances": False}, "rises": True}
    first = update_lines(from_record(UpdateRecord, found))[0]
    assert "check" in first
    assert first not in updated.content["lines"]


def test_an_error_that_rises_is_found(updated: cr.fit.Update) -> None:
    """Data of another injector spoil the fit: the old ones are met worse, and the record says so."""
    errors = {one["name"]: one for one in updated.content["errors"]}
    for one in errors.values():
        rise = one["after"]["size"] / one["before"]["size"] - 1.0
        assert one["rises"] == (rise > update_run.RISEN)


def test_fitting_contradicting_data_raises_errors(bench: Bench, tmp_path: Path) -> None:
    found = cr.update(bench.run, [bench.folder / "other-part.csv"], out=tmp_path / "new", threads=1)
    assert [one["name"] for one in found.content["errors"] if one["rises"]]
    assert any(abs(one["moved"] or 0.0) > 1.0 for one in found.content["moved"])


def test_ctrl_c_leaves_no_folder(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(update_run, "calibrate_into", stop)
    before = content(bench.run)
    with pytest.raises(KeyboardInterrupt):
        cr.update(bench.run, [bench.folder / "april.csv"], out=tmp_path / "new")
    assert list(tmp_path.iterdir()) == []
    assert content(bench.run) == before


def test_where_the_old_data_are_gone_the_earlier_result_is_the_prior(bench: Bench, tmp_path: Path) -> None:
    run = shutil.copytree(bench.run, tmp_path / "run")
    (run / "march.csv").unlink()
    found = cr.update(run, [bench.folder / "april.csv"], out=tmp_path / "new", threads=1)
    assert found.content["gone"] == ["march"]
    assert found.agreements == {"april": cr.fit.Agreement.UNJUDGED}
    assert [d.name for d in found.calibration.study.data] == ["check", "april"]
    parameters = {p.name: p for p in found.calibration.study.space.parameters}
    draws = np.load(run / "draws.npz")
    sigma = dict(zip(draws["names"].tolist(), draws["points"].std(axis=0).tolist(), strict=True))
    assert {name: p.prior.sigma for name, p in parameters.items() if p.prior} == pytest.approx(sigma)


@pytest.mark.parametrize(
    "case", ["no run", "no file", "garbage", "in the study", "renamed copy", "changed", "unfinished", "twice", "study"]
)
def test_bad_input_is_refused_in_one_sentence(bench: Bench, tmp_path: Path, case: str) -> None:
    folder = shutil.copytree(bench.folder, tmp_path / "bench", ignore=shutil.ignore_patterns("updated"))
    study = folder / "small.toml"
    cr.runs.calibrate_into(folder / "own", cr.load_study(study), threads=1) if case in ("changed", "study") else None
    run = folder / ("own" if case in ("changed", "study") else "run")
    file = folder / "april.csv"
    if case == "no run":
        run = folder / "nothing"
    elif case == "no file":
        file = folder / "nothing.csv"
    elif case == "garbage":
        file.write_text("a,b\n1,x\n", encoding="utf-8")
    elif case == "in the study":
        file = folder / "march.csv"
    elif case == "renamed copy":
        file = Path(shutil.copy(folder / "march.csv", folder / "more.csv"))
    elif case == "changed":
        file = folder / "march.csv"
        file.write_text(file.read_text(encoding="utf-8") + "60,600,20\n", encoding="utf-8")
    elif case == "unfinished":
        record = json.loads((run / "result.json").read_text(encoding="utf-8")) | {"status": "interrupted"}
        (run / "result.json").write_text(json.dumps(record), encoding="utf-8")
        (run / "SHA256SUMS").unlink()
    elif case == "study":
        study.write_text(study.read_text(encoding="utf-8").replace("0.95", "0.9"), encoding="utf-8")
    more = [file, shutil.copy(file, folder / "again.csv")] if case == "twice" else [file]
    done = run_command("update", run, "--with", *more, "--out", tmp_path / "new")
    assert done.status == 2
    assert done.sentence
    assert not (tmp_path / "new").exists()


def test_python_refuses_no_files(bench: Bench, tmp_path: Path) -> None:
    with pytest.raises(CommonrailError):
        cr.update(bench.run, [], out=tmp_path / "new")


def test_a_file_is_read_beside_data_of_other_kinds(bench: Bench, tmp_path: Path) -> None:
    """A map beside curves has the weight that `new --from` gives it; a second one has that of the first."""
    write_new(tmp_path)
    stated = StatedByUser({"cylinder_pressure": "0.5 MPa", "return_pressure": "0.1 MPa"})
    (block,) = read_addition(tmp_path, [], [bench.folder / "april.csv"], [], stated).blocks
    assert block["weight"] == WEIGHT
    study = tmp_path / "study.toml"
    text = study.read_text(encoding="utf-8")
    maps = "".join(f'{key} = "{value}"\n' for key, value in block.items() if key not in ("weight", "name"))
    study.write_text(f'{text}\n[[data]]\nname = "first"\nweight = 7\n{maps}', encoding="utf-8")
    addition = read_addition(tmp_path, [], [bench.folder / "check.csv"], [], stated)
    assert addition.blocks[0]["weight"] == 7
    parameters = [
        ParameterRecord(p.name, p.unit, lower=p.lower, upper=p.upper, best=p.reference)
        for p in edit_study(study, lambda _: None).space.parameters
    ]
    found = make_updated_study(tmp_path, parameters, addition, [], None, LOCAL)
    assert [d.weight for d in found.data] == [1, 7, 7]


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("result.json", {"status": None}, r"result\.json: status: a text was expected, and null was read"),
        ("result.json", {"schema": 2}, "another version of commonrail; calibrate again"),
        ("result.json", {"kind": "fleet"}, "is not the result of commonrail calibrate"),
        ("update.json", {}, r"update\.json: run: this key is missing; make it again"),
        ("update.json", {"run": "a", "optimiser": [1]}, r"update\.json: optimiser: an object was expected"),
    ],
)
def test_a_broken_record_is_not_updated(
    bench: Bench, tmp_path: Path, file: str, change: dict[str, object], words: str
) -> None:
    run = tmp_path / "run"
    shutil.copytree(bench.run, run)
    (run / "SHA256SUMS").unlink()
    record = read_result(run) if file == "result.json" else {}
    write_record(run / file, record | change)
    with pytest.raises(InputError, match=words):
        cr.update(run, [bench.folder / "april.csv"], out=tmp_path / "out", threads=1)
    assert not (tmp_path / "out").exists()
