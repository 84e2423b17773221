"""Studies of FMUs from files: what is refused, what a run folder keeps, and that a stopped run resumes to the same."""

from __future__ import annotations

import json
import math
import re
import zipfile
from dataclasses import replace

import pytest

from commonrail.base.errors import CommonrailError, StudyError
from commonrail.plugins.foreign_fmu.run import calibrate_fmu_into, resume_fmu
from commonrail.plugins.foreign_fmu.study import load_fmu_study
from commonrail.runs.fit import Listener
from tests.cli.conftest import run_command
from tests.plugins.foreign_fmu.samples import TIMES, TRUTH, decay

STUDY = """format = "commonrail-fmu-study/1"
title = "Dahlquist's equation"
fmu = "decay.fmu"
step = "100 ms"
set = { "failing.share" = 0.2, "failing.kind" = 2 }

[[parameter]]
name = "k"
lower = 0.2
upper = "4 1/s"

[[data]]
name = "decay"
file = "decay.csv"
synthetic = "the solution itself"
output = [{ variable = "x", tolerance = "10 mm" }]

[[data]]
name = "ends"
file = "ends.csv"
role = "validation"
synthetic = "the solution itself"
stop = "2 s"
rows = { x0 = "first" }
output = [{ variable = "x", column = "last", tolerance = 0.01 }]

[optimiser]
members = 8
generations = 4
polish = 1
"""


@pytest.fixture
def study(decay_fmu, tmp_path):
    """Study file beside its FMU and data; lengths are in mm, times in ms."""
    (tmp_path / "decay.fmu").write_bytes(decay_fmu.read_bytes())
    rows = "".join(f"{1e3 * t:.6g},{1e3 * x!r}\n" for t, x in zip(TIMES.tolist(), decay().tolist(), strict=True))
    (tmp_path / "decay.csv").write_text("time [ms],x [mm]\n" + rows)
    ends = "".join(f"{x0},{x0 * math.exp(-2.0 * TRUTH)!r}\n" for x0 in (1.0, 2.0, 3.0))
    (tmp_path / "ends.csv").write_text("first,last\n" + ends)
    path = tmp_path / "study.toml"
    path.write_text(STUDY)
    return path


def test_units_of_file_and_study_become_those_of_the_fmu(study):
    found = load_fmu_study(study)
    assert found.step == 0.1
    assert found.data[0].runs[0].times == pytest.approx(TIMES)
    assert found.data[0].measured == pytest.approx(decay())
    assert set(found.data[0].tolerances) == {0.01}
    assert [run.start["x0"] for run in found.data[1].runs] == [1.0, 2.0, 3.0]
    (free,) = found.space.parameters
    assert (free.reference, free.lower, free.upper, free.unit) == (1.0, 0.2, 4.0, "1/s")
    assert {path.name for path in found.files} == {"study.toml", "decay.fmu", "decay.csv", "ends.csv"}


def test_times_without_a_unit_are_in_seconds(study, tmp_path):
    rows = "".join(f"{t!r},{x!r}\n" for t, x in zip(TIMES.tolist(), decay().tolist(), strict=True))
    (tmp_path / "decay.csv").write_text('"time","x"\n' + rows)
    (found, _) = load_fmu_study(study).data
    assert (found.runs[0].times.tolist(), found.measured.tolist()) == (TIMES.tolist(), decay().tolist())


def test_a_tolerance_in_degrees_celsius_is_a_difference(study, decay_fmu, tmp_path):
    with zipfile.ZipFile(decay_fmu) as given, zipfile.ZipFile(tmp_path / "decay.fmu", "w") as warm:
        for name in given.namelist():
            warm.writestr(name, given.read(name).replace(b'<Real unit="m"/>', b'<Real unit="K"/>'))
    (tmp_path / "decay.csv").write_text("time [ms],x [degC]\n1,20\n2,30\n")
    study.write_text(STUDY.replace('"10 mm"', '"2 degC"'))
    (warmed, _) = load_fmu_study(study).data
    assert warmed.measured == pytest.approx([293.15, 303.15])
    assert set(warmed.tolerances) == {2.0}


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('name = "k"', 'name = "kk"', r'parameter\[1\]: .*no variable "kk"'),
        ('x0 = "first"', 'x = "first"', "x cannot"),
        ('variable = "x", tolerance', 'variable = "y", tolerance', r'output\[1\]: .*"y"'),
        ('"10 mm"', '"10 s"', "tolerance: .*s"),
        ('"failing.share"', '"failing.part"', "set.failing.part: "),
        ("members = 8", "member = 8", '"member"'),
        ('fmu = "decay.fmu"', 'fmu = "decay.csv"', r"decay\.csv: "),
        ('fmu = "decay.fmu"', 'fmu = "../decay.fmu"', r"fmu: .*\.\./decay\.fmu"),
        ('step = "100 ms"', 'step = "0 ms"', "step"),
        ('name = "ends"', 'name = "decay"', "Two data"),
        ('rows = { x0 = "first" }', 'rows = { k = "first" }', r": k is .*free"),
        ('stop = "2 s"\n', "", "stop: "),
    ],
)
def test_a_mistake_is_a_sentence_with_its_place(study, old, new, sentence):
    study.write_text(STUDY.replace(old, new, 1))
    with pytest.raises(CommonrailError, match=sentence):
        load_fmu_study(study)


def figures(folder):
    """Record of a run without what belongs to its last session: times, and what the FMU said."""
    record = json.loads((folder / "fmu-result.json").read_text())
    del record["clock"], record["messages"]
    return record


@pytest.mark.process
def test_a_run_that_was_stopped_resumes_to_the_same_result(study, tmp_path):
    seeded = replace(load_fmu_study(study), seed=7)  # as by --seed: the file that was given has another
    whole = calibrate_fmu_into(tmp_path / "whole", seeded, processes=1)
    assert whole.best["k"] == pytest.approx(TRUTH, rel=1e-4)

    def stop(p):
        if p.generation == 3:
            raise KeyboardInterrupt

    half = calibrate_fmu_into(tmp_path / "half", seeded, processes=1, listener=Listener(stop))
    assert half.status == "interrupted"
    # an FMU that hangs would hang about the best values too, after Ctrl-C
    assert re.match("not judged: .*stopped$", figures(tmp_path / "half")["parameters"][0]["verdict"])
    resume_fmu(tmp_path / "half", processes=1)
    assert figures(tmp_path / "half") == figures(tmp_path / "whole")
    assert figures(tmp_path / "half")["seed"] == 7
    assert load_fmu_study(tmp_path / "half" / "fmu-study.toml").seed == 7
    # the validation data, rows of another file, were simulated and not fitted
    data = figures(tmp_path / "whole")["data"]
    assert [one["role"] for one in data] == ["fit", "validation"]
    assert data[1]["rms"]["best"] < 0.01


@pytest.mark.process
def test_the_command_line_calibrates_reports_and_refuses_other_data(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study.write_text(STUDY.replace('step = "100 ms"', 'step = "200 ms"'))
    run = ["calibrate", "study.toml", "--out", "run", "--threads", "1", "--json"]
    told = "The samples of decay are 100 ms apart, and the communication points 200 ms"
    with pytest.warns(RuntimeWarning, match=told):
        done = run_command(*run)
    assert done.status == 0, done.err
    record = done.record
    # half of the samples lie between communication points: a line is (k step)^2/8 = 1.5 % above exp(-k t) there
    assert record["result"]["parameters"][0]["best"] == pytest.approx(TRUTH, rel=1.5e-2)
    assert record["result"]["evaluations"]["failures"][0]["status"] == "fmu_error"
    page = (tmp_path / "run" / "report.html").read_text()
    for text in (told, "Dahlquist", "no solution", "1/s", "SHA-256"):
        assert text in page
    (tmp_path / "decay.csv").write_text("time [ms],x [mm]\n0.1,1\n")
    with pytest.raises(StudyError, match=r"decay\.csv .*changed"):
        resume_fmu(tmp_path / "run", processes=1)
    refused = run_command("resume", "run", "--workers", "2")
    assert refused.status == 2
    assert "--threads" in refused.sentence


def test_an_fmu_with_a_huge_description_is_refused_before_it_is_read(study, monkeypatch):
    monkeypatch.setattr("commonrail.plugins.foreign_fmu.fmu.LARGEST_DESCRIPTION", 1000)
    with pytest.raises(CommonrailError, match=r"modelDescription\.xml"):
        load_fmu_study(study)
