"""Studies that are far too large are counted before they fill the memory; faults that fuzzing found stay mended."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commonrail.base.errors import CommonrailError
from commonrail.calibration import study_file as loader
from commonrail.calibration.study_file import load_study
from commonrail.data.quantities import reading
from commonrail.readers.injector import load_injector
from tests.readers.conftest import Edit

CASE = Path(__file__).resolve().parents[2] / "cases" / "cri2-16"


def refused(path: Path) -> str:
    with pytest.raises(CommonrailError) as caught:
        load_study(path)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_samples_are_counted_over_all_data(study_file: Edit, monkeypatch: pytest.MonkeyPatch) -> None:
    path = study_file()
    count = len(load_study(path).data[0].rate)  # type: ignore[union-attr]
    monkeypatch.setattr(loader, "MOST_SAMPLES", count)
    assert load_study(path).data
    monkeypatch.setattr(loader, "MOST_SAMPLES", count - 1)
    assert f"more than {count - 1} samples" in refused(path)


def test_samples_of_courses_count_too(study_file: Edit, monkeypatch: pytest.MonkeyPatch) -> None:
    path = study_file()
    count = len(load_study(path).data[0].rate)  # type: ignore[union-attr]
    course = 'rail_pressure = { file = "rail.csv", column = "p" }'
    path.write_text(path.read_text(encoding="utf-8").replace('rail_pressure = "160 MPa"', course), encoding="utf-8")
    (path.parent / "rail.csv").write_text("time [us],p [MPa]\n0,160\n1,160\n2,160\n3,160\n")
    monkeypatch.setattr(loader, "MOST_SAMPLES", count + 4)
    assert load_study(path).data
    monkeypatch.setattr(loader, "MOST_SAMPLES", count + 3)
    assert f"more than {count + 3} samples" in refused(path)


def test_rows_of_a_map_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MOST_POINTS", 20)
    assert "21 rows" in refused(CASE / "study.toml")


def test_relations_are_counted(study_file: Edit) -> None:
    chain = " < ".join(["plunger_needle.k1"] * 300)
    more = "seed = 1\nconstraints.order = [\n" + f'"{chain}",\n' * 4 + "]"
    path = study_file(("seed = 1", more))
    path.write_text(re.sub(r"(?m)^\[constraints\][^\[]*", "", path.read_text(encoding="utf-8")), encoding="utf-8")
    assert re.search(r"constraints: .*1196 relations, .*1000", refused(path))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("members = 100001", "equal to 100000"),
        ("generations = 1000001", "equal to 1000000"),
        ("redraws = 1001", "equal to 1000"),
        ("polish = 10001", "equal to 10000"),
        ("members = 9223372036854775807", "equal to 100000"),
    ],
)
def test_settings_of_the_optimiser_have_an_end(study_file: Edit, line: str, words: str) -> None:
    path = study_file()
    head = re.sub(r"(?ms)^\[optimiser\].*?(?=^\[|\Z)", "", path.read_text(encoding="utf-8"))
    path.write_text(f"{head}\n[optimiser]\n{line}\n", encoding="utf-8")
    assert words in refused(path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("x" * 201, "200 characters"),
        ("two\\nlines", "one line"),
    ],
)
def test_names_are_short_and_printed(study_file: Edit, name: str, words: str) -> None:
    path = study_file()
    text = re.sub(r'(?m)^name = "[^"]*"$', f'name = "{name}"'.replace("\\", r"\\"), path.read_text("utf-8"), count=1)
    path.write_text(text, encoding="utf-8")
    assert words in refused(path)


def test_an_unknown_injector_of_the_catalogue_names_the_study(study_file: Edit) -> None:
    path = study_file(('injector = "injector.toml"', 'injector = "cri2-166"'))
    assert re.search(r'injector: .*"cri2-166" .*"cri2-16"', refused(path))


def test_a_variant_behind_the_injector_is_refused_with_the_place_where_it_is_stated(study_file: Edit) -> None:
    """`simulate` and `compare` take cri2-16@ideal, so somebody will write it here."""
    path = study_file(('injector = "injector.toml"', 'injector = "cri2-16@ideal"'))
    assert re.search(r'injector: "cri2-16@ideal" .*variant', refused(path))


def test_a_drawing_beyond_numbers_names_the_injectors_file(injector_file: Edit) -> None:
    path = injector_file()
    text = path.read_text(encoding="utf-8")
    drawing = (
        "[plunger_needle.drawing]\nelastic_modulus = '1e300 Pa'\ndensity = '7800 kg/m3'\ncylinders = ["
        + "{ diameter = '1e9 m', length = '1 mm' }," * 7
        + "]\n"
    )
    path.write_text(re.sub(r"(?ms)^\[plunger_needle\.drawing\].*?(?=^\[|\Z)", "", text) + "\n" + drawing, "utf-8")
    with pytest.raises(CommonrailError, match=r"mine\.toml: .*plunger_needle\.k1 .* not inf"):
        load_injector(path)
