"""Tolerance files: what is read, and the sentence for what cannot be."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base.errors import CommonrailError
from commonrail.plugins.tolerance.file import load_tolerances
from commonrail.plugins.tolerance.study import (
    Correlation,
    Limit,
    Normal,
    Sampling,
    SeriesTrim,
    Triangular,
    Uniform,
)

CASE = Path(__file__).resolve().parents[3] / "cases" / "tolerance" / "tolerances.toml"

HEAD = """format = "commonrail-tolerance/1"
title = "t"
injector = "virtual-lino-2016"
mark = "E"
source = "assumed"
[[point]]
name = "full"
rail_pressure = "160 MPa"
energising_time = "700 us"
lower = "-4 %"
upper = "56 mm3"
"""
HOLE = '[[dimension]]\nname = "nozzle.hole_diameter"\ndistribution = "normal"\nsigma = "0.6 um"\n'


def written(folder: Path, text: str) -> Path:
    file = folder / "tolerances.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_case_is_read_and_declared_synthetic() -> None:
    study = load_tolerances(CASE)
    assert study.synthetic.startswith("Injector and tolerances are virtual")
    assert {dimension.source.mark for dimension in study.dimensions} == {"E"}
    assert study.trim == SeriesTrim(("full load", "part load"), 8192, 1e-6, 0.1e-9)
    assert [(c.first, c.value) for c in study.correlations] == [("control_chamber.a_hole_diameter", 0.3)]
    assert study.sampling is Sampling.QUASI_RANDOM
    assert study.text == CASE.read_text(encoding="utf-8")


def test_distributions_are_about_the_drawing_unless_they_say_otherwise(tmp_path: Path) -> None:
    dimensions = """
[[dimension]]
distribution = "uniform" # keys may stand before the name
tolerance = "2 %"
name = "valve.lift"
[[dimension]]
name = "valve.spring_preload"
distribution = "triangular"
lower = "70 N"
mode = "71 N"
upper = "75 N"
mark = "M"
[[dimension]]
name = "nozzle.discharge_maximum"
distribution = "normal"
mean = 0.8
sigma = "1 %"
tolerance = "2 %"
"""
    study = load_tolerances(written(tmp_path, HEAD + HOLE + dimensions))
    hole, lift, spring, discharge = (dimension.distribution for dimension in study.dimensions)
    assert hole == Normal(130e-6, 0.6e-6)
    assert isinstance(lift, Uniform)
    assert (lift.lower, lift.upper) == pytest.approx((0.98 * 55e-6, 1.02 * 55e-6))
    assert spring == Triangular(70.0, 71.0, 75.0)
    assert isinstance(discharge, Normal)
    # widths in percent are of the drawing's value, 0.82, though the mean is another
    numbers = (discharge.mean, discharge.sigma, discharge.lower, discharge.upper)
    assert numbers == pytest.approx((0.8, 0.0082, 0.8 - 0.0164, 0.8 + 0.0164))
    assert [dimension.source.mark for dimension in study.dimensions] == ["E", "E", "M", "E"]
    assert (study.points[0].lower, study.points[0].upper) == (Limit(-0.04, True), Limit(pytest.approx(56e-9)))


def test_an_injector_beside_the_file_is_read_and_one_elsewhere_is_not(tmp_path: Path) -> None:
    from commonrail.plugins.new.study import write_new

    write_new(tmp_path / "own")
    text = HEAD.replace("virtual-lino-2016", "own/injector.toml") + HOLE
    assert load_tolerances(written(tmp_path, text)).injector.name == "my-injector"
    (tmp_path / "below").mkdir()
    outside = HEAD.replace("virtual-lino-2016", "../own/injector.toml") + HOLE
    with pytest.raises(CommonrailError, match=r"tolerances\.toml, injector: "):
        load_tolerances(written(tmp_path / "below", outside))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD, "dimension: "),
        (
            HEAD + HOLE.replace("hole_diameter", "hole_diamter"),
            '"nozzle.hole_diamter"',
        ),
        (HEAD + HOLE.replace('"0.6 um"', '"0.6 MPa"'), 'dimension[1].sigma: "0.6 MPa"'),
        (HEAD + HOLE.replace('"0.6 um"', "0.6"), 'dimension[1].sigma: "0.6" '),
        (HEAD + HOLE.replace('"normal"', '"gauss"'), "dimension[1].distribution: "),
        (HEAD + HOLE.replace('sigma = "0.6 um"\n', ""), 'needs "sigma"'),
        (HEAD + HOLE.replace('"normal"', '"uniform"'), 'no key "sigma"'),
        (
            HEAD + HOLE.replace('"normal"\nsigma', '"uniform"\nlower'),
            '"tolerance", or "lower" and "upper"',
        ),
        (HEAD + HOLE + 'tolerance = "1 um"\nlower = "129 um"\n', '"tolerance"'),
        (HEAD + HOLE + HOLE, "nozzle.hole_diameter more"),
        (HEAD + HOLE + '[trim]\npoints = ["ful"]\n', 'ful (did you mean "full"?)'),
        (HEAD + HOLE + "[trim]\npoints = []\n", "trim.points: "),
        (HEAD.replace('"56 mm3"', '"56 mg"') + HOLE, 'point[1].upper: "56 mg" is a mass'),
        (HEAD.replace('"160 MPa"', '"160 Pa"') + HOLE, "point[1]: The rail pressure"),
        (HEAD.replace("/1", "/2") + HOLE, "format = "),
        (HEAD.replace("title =", "parts = 10\ntitle =") + HOLE, "from 1000 to"),
        (
            HEAD.replace("title =", 'samplng = "random"\ntitle =') + HOLE,
            '"samplng" (did you mean "sampling"?)',
        ),
        (
            HEAD + HOLE + '[[correlation]]\nbetween = ["valve.lift"]\nvalue = 0.5\n',
            "between: ",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_with_file_and_key(tmp_path: Path, text: str, words: str) -> None:
    file = written(tmp_path, text)
    with pytest.raises(CommonrailError) as refused:
        load_tolerances(file)
    assert str(refused.value).startswith(f"{file}")
    assert words in str(refused.value)


def test_a_correlation_is_read(tmp_path: Path) -> None:
    lift = '[[dimension]]\nname = "valve.lift"\ndistribution = "uniform"\ntolerance = "2 um"\n'
    both = '[[correlation]]\nbetween = ["nozzle.hole_diameter", "valve.lift"]\nvalue = -0.5\n'
    study = load_tolerances(written(tmp_path, HEAD + HOLE + lift + both))
    assert study.correlations == (Correlation("nozzle.hole_diameter", "valve.lift", -0.5),)
