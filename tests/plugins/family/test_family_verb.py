"""commonrail type and adapt: from a calibrated part to the type, and to the model of the next part."""

from __future__ import annotations

import json
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.plugins.family.run import fit_type, resume_family
from commonrail.plugins.family.study import load_family
from commonrail.plugins.new.study import write_new
from tests.cli.conftest import Command
from tests.plugins.fleet.conftest import edited
from tests.runs.conftest import Stopped, stop_after, timeless

HEAD = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n"


def test_a_run_becomes_a_type_a_study_and_a_model(command: Command, study: Path, tmp_path: Path) -> None:
    run, file = tmp_path / "run", study.parent / "mine.toml"
    assert command("calibrate", study, "--out", run).status == 0
    shutil.copytree(run, tmp_path / "copy")
    for again in (run, tmp_path / "copy"):
        done = command("type", run, again, "--out", file)
        assert (done.status, done.sentence.startswith(f"{again}: "), str(run) in done.sentence) == (2, True, True)
    done = command("type", run, "--out", file, "--part-spread", "3%")
    assert done.status == 0
    assert "SYNTHETIC" in done.out
    full = command("type", run, "--out", file, "--part-spread", "3%", "--full")
    assert full.out.count(" mm³") >= 8  # median and range at four points
    known = cr.parts.load_type(file)
    calibrated = cr.load_injector(run / "calibrated.toml")
    assert {p.name: p.value for p in known.parameters} == {p.name: calibrated.values[p.name] for p in known.parameters}
    assert "data/evi.csv" in known.parts[0].files

    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace("seed = 1", 'seed = 1\ntype = "mine.toml"'), encoding="utf-8")
    following = cr.load_study(study)
    assert [p.prior for p in following.space.parameters] == [p.prior for p in known.parameters]
    # the run folder of the next part keeps the type
    assert command("calibrate", study, "--out", tmp_path / "next").status == 0
    assert (tmp_path / "next" / "mine.toml").read_bytes() == file.read_bytes()

    points, model = tmp_path / "points.csv", tmp_path / "model.toml"
    points.write_text(f"{HEAD}160,700,60\n", encoding="utf-8")
    own = ("--injector", study.parent / "injector.toml")
    adapted = command("adapt", file, "--from", points, *own, "--out", model, "--json")
    assert adapted.record["adapted"] == pytest.approx([60e-9], rel=1e-9)
    of_run = command("adapt", file, "--from", points, "--injector", run, "--out", model, "--json")
    assert of_run.record["adapted"] == adapted.record["adapted"]  # the values that differ are those of the type
    adapted = command("adapt", file, "--from", points, *own, "--out", model, "--json")
    solution = cr.simulate(cr.load_injector(model), cr.OperatingPoint(160e6, 700e-6))
    assert solution.injected_volume == pytest.approx(60e-9, rel=1e-9)
    assert f"{adapted.record['flow_factor']:.5g}" in model.read_text(encoding="utf-8").splitlines()[0]
    table = command("adapt", file, "--from", points, *own, "--out", model)
    assert "60.000 mm³" in table.out
    points.write_text(f"{HEAD}160,700,30\n", encoding="utf-8")  # half of it: no part of the type
    strict = command("adapt", file, "--from", points, *own, "--out", model, "--strict")
    assert strict.status == 2
    assert "0.6 to 1.6" in strict.sentence or str(model) in strict.sentence
    for read in (points, file, study.parent / "injector.toml"):
        before = read.read_bytes()
        done = command("adapt", file, "--from", points, *own, "--out", read)
        assert (done.status, done.sentence[:6]) == (2, "--out:")

        assert read.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("type", "nothing", "--out", "t.toml"),
            "nothing: ",
        ),
        (("type", "nothing", "--out", "nowhere/t.toml"), "--out: "),
        (("type", "nothing", "--out", "t.toml", "--part-spread", "3mm"), "--part-spread: "),
        (("type", "nothing", "--out", "t.toml", "--run", "r"), "--run"),
        (("type", "nothing", "--out", "t.toml", "--seed", "0"), "--seed"),
        (("adapt", "nothing.toml", "--from", "points.csv", "--out", "m.toml"), "nothing.toml: "),
    ],
)
def test_bad_input_ends_with_2_and_one_sentence(
    command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(*arguments)
    assert (done.status, done.out) == (2, "")
    assert words in done.sentence
    assert list(tmp_path.iterdir()) == []


def test_reference_points_are_ranked_before_anything_is_measured(command: Command, tmp_path: Path) -> None:
    from commonrail.plugins.family.injector_type import dump_type
    from tests.plugins.family.samples import small_type

    file, points = tmp_path / "t.toml", tmp_path / "points.csv"
    dump_type(small_type(), file)
    points.write_text("rail_pressure [MPa],energising_time [us]\n160,500\n160,900\n", encoding="utf-8")
    record = command("adapt", file, "--from", points, "--advise", "--json").record
    assert len(record["points"]) == 2
    assert record["order"][0] == min((0, 1), key=lambda i: record["points"][i]["expected_rms"])
    assert 0.0 < record["points"][0]["expected_rms"] < record["without_reference"]
    shown = command("adapt", file, "--from", points, "--advise", "--full").out
    assert f"{record['points'][record['order'][0]]['expected_rms'] * 1e9:.2f} mm³" in next(
        line for line in shown.splitlines() if " µs " in line
    )
    assert f"{record['without_reference'] * 1e9:.2f} mm³" in shown
    done = command("adapt", file, "--from", points)
    assert (done.status, done.sentence.startswith("--out ")) == (2, True)


def test_the_command_that_follows_advice_runs_as_it_is_printed(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from commonrail.plugins.family.injector_type import dump_type
    from tests.plugins.family.samples import small_type

    monkeypatch.chdir(tmp_path)
    (tmp_path / "my types").mkdir()
    dump_type(small_type(), tmp_path / "my types" / "t.toml")
    candidates = tmp_path / "candidates.csv"
    candidates.write_text("rail_pressure [MPa],energising_time [us]\n160,500\n160,900\n", encoding="utf-8")
    asked = command("adapt", "my types/t.toml", "--from", candidates, "--advise", "--return-pressure", "0.4MPa")
    (tmp_path / "points.csv").write_text(HEAD + "160,700,60\n", encoding="utf-8")
    (line,) = [line for line in asked.out.splitlines() if line.startswith("  commonrail adapt ")]
    words = shlex.split(line)[1:]
    assert command(*words).status == 0
    assert (tmp_path / "model.toml").is_file()
    assert words[words.index("--return-pressure") + 1] == "400kPa"


def test_a_bad_column_of_points_is_named(command: Command, tmp_path: Path) -> None:
    from commonrail.plugins.family.injector_type import dump_type
    from tests.plugins.family.samples import small_type

    file, points = tmp_path / "t.toml", tmp_path / "points.csv"
    dump_type(small_type(), file)
    points.write_text(HEAD.replace("[mm3]", "[mm]") + "160,700,60\n", encoding="utf-8")
    done = command("adapt", file, "--from", points, "--out", tmp_path / "m.toml")
    assert done.status == 2
    assert f'{points}, column "quantity": ' in done.sentence


SEARCH = '[optimiser]\nmethod = "staged least squares"\nmembers = 8\nstarts = 1\ngenerations = 2\n'


def two_parts(folder: Path) -> Path:
    """Family file of two scaffolded studies, which have the same data."""
    for part in ("a", "b"):
        write_new(folder / part)
        # the kernel in f32 that other tests compile too
        edited(folder / part / "injector.toml", 'drive_kind = "regulated"', 'drive_kind = "pwm"')
    parts = "".join(f'[[part]]\nname = "{part}"\nstudy = "{part}/study.toml"\n' for part in ("a", "b"))
    head = 'format = "commonrail-family/1"\nname = "lino"\ntitle = "Two parts"\nflow = "3 %"\n'
    file = folder / "family.toml"
    file.write_text(head + parts + SEARCH, encoding="utf-8")
    return file


def test_a_family_file_fits_its_parts_together(command: Command, tmp_path: Path) -> None:
    file, run, models = two_parts(tmp_path), tmp_path / "run", tmp_path / "models"
    done = command("type", file, "--out", tmp_path / "type.toml", "--run", run, "--models", models, "--json")
    record = done.record
    known = cr.parts.load_type(tmp_path / "type.toml")
    assert [part.name for part in known.parts] == ["a", "b"]
    assert "evi.csv" in known.parts[0].files
    for part in ("a", "b"):
        own = cr.load_injector(models / f"{part}.toml")
        assert record["fits"][part]["best"] == {name: own.values[name] for name in record["fits"][part]["best"]}
        for parameter in known.parameters:  # all are common
            assert own.values[parameter.name] == parameter.value
        assert (run / "models" / f"{part}.toml").read_bytes() == (models / f"{part}.toml").read_bytes()
    assert (run / "type.toml").read_bytes() == (tmp_path / "type.toml").read_bytes()
    # the parts have the same data, so they have the same flow
    assert record["fits"]["a"]["best"] == pytest.approx(record["fits"]["b"]["best"], rel=0.02)
    page = (run / "report.html").read_text(encoding="utf-8").replace("<wbr>", "")
    assert all(parameter.name in page for parameter in known.parameters)
    for part in ("a", "b"):
        assert f"{part}: {record['fits'][part]['data'][0]['name']}" in page
    (listed,) = command("runs", run.parent, "--json").record["runs"]
    assert (listed["state"], listed["title"], listed["best"]) == ("finished", "Two parts", record["cost"])
    for option in ("--models", "--run"):
        used = models if option == "--models" else run
        refused = command("type", file, "--out", tmp_path / "type.toml", option, used)
        assert (refused.status, str(used) in refused.sentence) == (2, True)


def test_a_joint_fit_that_was_killed_is_resumed_to_the_same_bits(command: Command, tmp_path: Path) -> None:
    file, whole, killed = two_parts(tmp_path / "family"), tmp_path / "whole", tmp_path / "killed"
    own = ("--run", whole, "--seed", "5", "--threads", "1")
    assert command("type", file, "--out", tmp_path / "whole.toml", *own).status == 0
    with pytest.raises(Stopped):
        fit_type(killed, replace(load_family(file), seed=5), threads=1, listener=stop_after(2))
    moved = killed.rename(tmp_path / "moved")
    done = command("resume", moved)
    assert done.status == 0, done.err
    assert "2/3" not in done.err  # the first two steps are not done again
    for name in ("type.toml", "models/a.toml", "models/b.toml"):
        assert (moved / name).read_bytes() == (whole / name).read_bytes()
    assert timeless(moved, "family.json") == timeless(whole, "family.json")
    record = json.loads((moved / "family.json").read_text(encoding="utf-8"))
    assert record["seed"] == 5  # of the command; the file that was given has 1
    assert [load_family(run / "family.toml").seed for run in (whole, moved)] == [5, 5]


@pytest.mark.usefixtures("forked_workers")
def test_workers_find_the_same_bits_in_a_joint_fit(command: Command, tmp_path: Path) -> None:
    file = two_parts(tmp_path / "family")
    for name, how in (("threads", ("--threads", "1")), ("workers", ("--workers", "2"))):
        assert command("type", file, "--out", tmp_path / f"{name}.toml", "--run", tmp_path / name, *how).status == 0
    assert timeless(tmp_path / "threads", "family.json") == timeless(tmp_path / "workers", "family.json")


def test_a_family_that_was_changed_is_not_resumed(command: Command, tmp_path: Path) -> None:
    file, run = two_parts(tmp_path / "family"), tmp_path / "run"
    with pytest.raises(Stopped):
        fit_type(run, load_family(file), threads=1, listener=stop_after(1))
    study = file.parent / "a" / "study.toml"
    study.write_text(study.read_text(encoding="utf-8").replace("seed = 1", "seed = 2"), encoding="utf-8")
    done = command("resume", run)
    assert done.status == 2
    assert str(study) in done.sentence
    (run / "a" / "study.toml").unlink()
    lost = command("resume", run, "--as-begun")
    assert (lost.status, "study.toml" in lost.sentence) == (2, True)


def test_a_joint_fit_is_extended_to_that_of_a_longer_family(command: Command, tmp_path: Path) -> None:
    file, run = two_parts(tmp_path / "family"), tmp_path / "run"
    with pytest.raises(Stopped):
        fit_type(run, load_family(file), threads=1, listener=stop_after(2))
    assert command("resume", run, "--generations", "1").status == 0
    edited(file, "generations = 2", "generations = 3")
    fit_type(tmp_path / "longer", load_family(file), threads=1)
    assert timeless(run, "family.json") == timeless(tmp_path / "longer", "family.json")


def test_a_family_that_was_made_in_python_is_asked_for_again(tmp_path: Path) -> None:
    family, run = load_family(two_parts(tmp_path / "family")), tmp_path / "run"
    changed = replace(family, title="Two parts, renamed")  # which no option does
    with pytest.raises(Stopped):
        fit_type(run, changed, threads=1, listener=stop_after(1))
    with pytest.raises(cr.errors.StudyError, match="family=family"):
        resume_family(run)
    assert resume_family(run, family=changed, threads=1).status == "finished"
