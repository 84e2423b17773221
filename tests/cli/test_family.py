"""commonrail family and adapt: from a calibrated part to the type, and to the model of the next part."""

from __future__ import annotations

from pathlib import Path

import pytest

import commonrail as cr
from tests.cli.conftest import Command
from tests.fleet.conftest import edited

HEAD = "rail_pressure [MPa],energising_time [us],quantity [mm3]\n"


def test_a_run_becomes_a_type_a_study_and_a_model(command: Command, study: Path, tmp_path: Path) -> None:
    run, file = tmp_path / "run", study.parent / "mine.toml"
    assert command("calibrate", study, "--out", run).status == 0
    done = command("family", run, "--out", file, "--part-spread", "3%")
    assert done.status == 0
    assert "SYNTHETIC" in done.out
    known = cr.load_type(file)
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
    solution = cr.simulate(cr.load_injector(model), cr.OperatingPoint(160e6, 700e-6))
    assert solution.injected_volume == pytest.approx(60e-9, rel=1e-9)
    assert "flow factor" in model.read_text(encoding="utf-8").splitlines()[0]
    table = command("adapt", file, "--from", points, *own, "--out", model)
    assert "60.000 mm3" in table.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("family", "nothing", "--out", "t.toml"), "nothing: not a run folder of commonrail calibrate"),
        (("family", "nothing", "--out", "nowhere/t.toml"), "--out: there is no folder nowhere"),
        (("family", "nothing", "--out", "t.toml", "--part-spread", "3mm"), "--part-spread: "),
        (("adapt", "nothing.toml", "--from", "points.csv", "--out", "m.toml"), "nothing.toml: there is no such file"),
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


def test_a_bad_column_of_points_is_named(command: Command, tmp_path: Path) -> None:
    from commonrail.files.type_file import dump_type
    from tests.family.samples import small_type

    file, points = tmp_path / "t.toml", tmp_path / "points.csv"
    dump_type(small_type(), file)
    points.write_text(HEAD.replace("[mm3]", "[mm]") + "160,700,60\n", encoding="utf-8")
    done = command("adapt", file, "--from", points, "--out", tmp_path / "m.toml")
    assert done.status == 2
    assert f'{points}, column "quantity": ' in done.sentence


def test_a_family_file_fits_its_parts_together(command: Command, tmp_path: Path) -> None:
    from commonrail.files.scaffold import write_new

    for part in ("a", "b"):
        write_new(tmp_path / part)
        # the kernel in f32 that other tests compile too
        edited(tmp_path / part / "injector.toml", 'drive_kind = "regulated"', 'drive_kind = "pwm"')
    file, models = tmp_path / "family.toml", tmp_path / "parts"
    parts = "".join(f'[[part]]\nname = "{part}"\nstudy = "{part}/study.toml"\n' for part in ("a", "b"))
    search = '[optimiser]\nmethod = "staged least squares"\nmembers = 8\nstarts = 1\ngenerations = 2\n'
    head = 'format = "commonrail-family/1"\nname = "lino"\ntitle = "Two parts"\nflow = "3 %"\n'
    file.write_text(head + parts + search, encoding="utf-8")
    done = command("family", file, "--out", tmp_path / "type.toml", "--models", models, "--json")
    record = done.record
    known = cr.load_type(tmp_path / "type.toml")
    assert [part.name for part in known.parts] == ["a", "b"]
    assert "evi.csv" in known.parts[0].files
    for part in ("a", "b"):
        own = cr.load_injector(models / f"{part}.toml")
        assert record["fits"][part]["best"] == {name: own.values[name] for name in record["fits"][part]["best"]}
        for parameter in known.parameters:  # all are common
            assert own.values[parameter.name] == parameter.value
    # the parts have the same data, so they have the same flow
    assert record["fits"]["a"]["best"] == pytest.approx(record["fits"]["b"]["best"], rel=0.02)
    refused = command("family", file, "--out", tmp_path / "type.toml", "--models", models)
    assert (refused.status, refused.sentence.endswith("nothing was overwritten.")) == (2, True)
