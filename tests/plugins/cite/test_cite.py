"""What a run or an injector used, and the works to be cited for it."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import pytest

from commonrail.calibration.study_file import load_study
from commonrail.plugins.cite.run import list_references, list_uses, read_bibtex
from commonrail.readers.injector import load_injector
from commonrail.runs.fit import calibrate_into
from tests.cli.conftest import Command, small_study
from tests.distribution import distribution

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of the study of ``commonrail new``, with data that are said to be measured at an address."""
    folder = tmp_path_factory.mktemp("cite")
    study = small_study(folder / "small")
    text = re.sub(
        r"^source = .*$", 'source = "Rate tube 50 % & {one}, doi:10.1234/rate"', study.read_text("utf-8"), flags=re.M
    )
    study.write_text(re.sub(r"^synthetic = .*\n", "", text, flags=re.M), encoding="utf-8")
    calibrate_into(folder / "run", load_study(study), threads=1)
    return folder / "run"


def test_a_run_names_its_model_data_priors_and_optimiser(run: Path) -> None:
    uses = {use.kind: use.source for use in list_uses(str(run))}
    assert uses["model"] == "Lino et al. 2016"
    assert uses["optimiser"].startswith("Storn & Price 1997")
    assert uses["data (fit)"].startswith("Rate tube")
    assert uses["fuel"].endswith(load_injector(run / "calibrated.toml").fuel.source)


@pytest.mark.parametrize(
    ("file", "key", "value"),
    [
        ("study.toml", "injector", "a"),
        ("result.json", "software", 3),
        ("result.json", "software", {}),
        ("result.json", "injector", "a"),
        ("result.json", "injector", {"name": ["a"]}),
        ("result.json", "data", [{"name": "a"}]),
        ("result.json", "data", {"name": "a"}),
        ("result.json", "optimiser", {"method": ["a"]}),
        ("result.json", "certainty", 3),
    ],
)
def test_a_record_of_another_form_is_refused_by_file_and_key(
    file: str, key: str, value: object, run: Path, tmp_path: Path, command: Command
) -> None:
    folder = Path(shutil.copytree(run, tmp_path / "run"))
    (folder / "SHA256SUMS").unlink()
    path = folder / file
    if file == "study.toml":
        text = re.sub(r"^injector = .*$", f'injector = ["{value}"]', path.read_text("utf-8"), flags=re.M)
    else:
        text = json.dumps(json.loads(path.read_text("utf-8")) | {key: value})
    path.write_text(text, encoding="utf-8")
    done = command("cite", folder)
    assert done.status == 2
    assert f"{file}, {key}" in done.err


@pytest.mark.parametrize("verb", ["cite", "predict", "next", "simulate", "plan"])
def test_a_run_without_results_is_to_be_resumed(verb: str, run: Path, tmp_path: Path, command: Command) -> None:
    folder = tmp_path / "killed"
    folder.mkdir()
    for name in ("study.toml", "journal.sqlite"):
        shutil.copy(run / name, folder)
    point = ("--rail-pressure", "160MPa", "--energising-time", "700us")
    plan = ROOT / "examples" / "test-plan" / "plan.csv"
    more = {"predict": point, "simulate": point, "plan": (str(plan),)}.get(verb, ())
    done = command(verb, folder, *more)
    assert done.status == 2
    assert f"commonrail resume {folder}" in done.err
    (folder / "result.json").write_text("[]", encoding="utf-8")  # broken, so not to be resumed
    assert "commonrail resume" not in command(verb, folder, *more).err


def test_all_sources_of_an_injector_are_told(command: Command) -> None:
    record = command("cite", "cri2-16", "--json").record
    told = "\n".join(use["source"] for use in record["used"])
    assert all(source.text in told for source in load_injector("cri2-16").sources.values())
    # once for each of two maps, whatever the number of groups that name it
    maps = sorted(one["text"][-7:] for one in record["references"] if "AI_ETMAP" in one["text"])
    assert maps == ["map 164", "map 165"]


def test_works_are_cited_that_a_source_names_and_no_others() -> None:
    keys = [one.key for one in list_references(list_uses("cri2-16"))]
    assert keys[:2] == ["commonrail", "lino2016"]
    assert not {"storn1997", "lemmon2004", "foremanmackey2013"} & set(keys)


def test_the_file_has_each_work_once_with_measured_data(run: Path, tmp_path: Path, command: Command) -> None:
    done = command("cite", run, "--out", tmp_path / "used.bib")
    assert done.status == 0, done.err
    text = (tmp_path / "used.bib").read_text(encoding="utf-8")
    found = {one.key: one for one in read_bibtex(text)}
    assert len(found) == text.count("\n@") + 1
    assert text.count("{") == text.count("}")
    assert {"commonrail", "lino2016", "storn1997"} < set(found)
    (data,) = [one for one in found.values() if one.key.startswith("data")]
    assert data.fields["note"] == r"Rate tube 50 \% \& one, doi:10.1234/rate"  # LaTeX would read the rest as a comment


@pytest.mark.parametrize(
    ("asked", "key"),
    [("The makers, 2025", "package-makers-1-2"), ("@misc{makers2025,\n  title = {Injectors},\n}", "makers2025")],
)
def test_a_package_is_cited_as_it_asks_for(asked: str, key: str, tmp_path: Path) -> None:
    parts = "[commonrail.injectors]\ncri2-16-own = makers_parts:FILE\n"
    file = tmp_path / "own.toml"
    module = f"__citation__ = {asked!r}\nFILE = {str(file)!r}\n"
    from commonrail.readers.injector import CATALOGUE

    file.write_text(CATALOGUE.text("cri2-16"), encoding="utf-8")
    with distribution(tmp_path, {"makers_parts": module}, parts, "makers"):
        assert key in [one.key for one in list_references(list_uses("cri2-16-own"))]
    assert key not in [one.key for one in list_references(list_uses("cri2-16"))]


def test_what_is_no_model_is_refused(tmp_path: Path, command: Command) -> None:
    done = command("cite", tmp_path)
    assert (done.status, "calibrated.toml" in done.sentence) == (2, True)


def test_the_citation_file_names_the_same_tool_and_paper() -> None:
    """CITATION.cff is what the forge reads; this package's own texts are what `cite` prints."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = dict(re.findall(r"^(\w+): (.*)$", text, re.MULTILINE))
    assert stated["version"] == project["version"]
    assert stated["abstract"] == project["description"]
    assert stated["license"] == project["license"]
    paper = next(one for one in list_references(list_uses("cri2-16")) if one.key == "lino2016")
    assert all(f": {paper.fields[name]}\n" in text for name in ("title", "journal", "doi", "year"))
