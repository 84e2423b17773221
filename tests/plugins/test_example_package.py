"""The example package, put on the path: each of its parts works as one that ships."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import commonrail
from commonrail.base import registry
from commonrail.base.errors import ConfigurationError, InputError
from commonrail.calibration.optimisers.base import Optimiser
from commonrail.calibration.optimisers.registry import find_optimiser, size_in_words
from commonrail.calibration.study_file import load_study
from commonrail.data.registry import get_kind
from commonrail.data.simulator import Simulator
from commonrail.physics.injector import Injector
from commonrail.plugins.doctor.run import find_plugins
from commonrail.report.page import write_report
from commonrail.runs.fit import calibrate_into, resume
from commonrail.runs.listing import list_runs
from tests.calibration.conformance import CHECKS, SPACES, Case
from tests.cli.conftest import check_made_again, run_command, small_study
from tests.data import contract
from tests.data.samples import SAMPLES, map_table
from tests.distribution import package, run_tests
from tests.refused import refused
from tests.runs.conftest import stopped_run, timeless

ROOT = Path(__file__).parents[2] / "examples" / "commonrail-example"
SEARCH = '[optimiser]\nmethod = "random search"\nmembers = 6\ngenerations = 3\n'


@pytest.fixture(autouse=True)
def example(tmp_path: Path) -> Iterator[None]:
    """The package, installed."""
    with package(ROOT, tmp_path / "site"):
        yield


def test_all_its_parts_are_found() -> None:
    found = {entry.distribution for group in registry.GROUPS for entry in registry.find_installed(group).values()}
    assert "commonrail-example" in found


def test_an_injector_is_written_and_read_with_its_nozzle_law(tmp_path: Path) -> None:
    """Its own tests simulate with it."""
    plain, file = commonrail.load_injector("virtual-lino-2016"), tmp_path / "gradual.toml"
    commonrail.dump_injector(replace(plain, variant=plain.variant._replace(nozzle_law="gradual")), file)
    assert commonrail.load_injector(file).variant.nozzle_law == "gradual"


def test_an_unknown_nozzle_law_is_named_with_its_key(tmp_path: Path) -> None:
    file = tmp_path / "unknown.toml"
    commonrail.dump_injector(commonrail.load_injector("virtual-lino-2016"), file)
    text = file.read_text(encoding="utf-8").replace("variant = ", 'nozzle_law = "gradul"\nvariant = ', 1)
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r'nozzle_law: .*"gradul" .*"gradual"'):
        commonrail.load_injector(file)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """Small study with its optimiser."""
    study = small_study(tmp_path / "small")
    head, _, _ = study.read_text(encoding="utf-8").partition("[optimiser]")
    study.write_text(head + SEARCH, encoding="utf-8")
    return study


def test_a_study_is_calibrated_by_its_optimiser(study: Path, tmp_path: Path) -> None:
    calibrate_into(tmp_path / "run", load_study(study), threads=1)
    result = json.loads((tmp_path / "run" / "result.json").read_text(encoding="utf-8"))
    assert (result["optimiser"]["method"], result["optimiser"]["members"]) == ("random search", 6)
    assert len(result["generations"]) == 4
    page = write_report(tmp_path / "run").read_text(encoding="utf-8")
    assert re.search(r"random search, 3 .*\b6 members", page)
    assert "The commonrail authors" in run_command("cite", tmp_path / "run", "--json").record["used"][-1]["source"]
    (found,) = list_runs(tmp_path / "run")
    assert found.generation == found.generations == 4
    run = stopped_run(tmp_path / "again", load_study(study), 2)
    resume(run, threads=1)
    assert timeless(run) == timeless(tmp_path / "run")


def _calibrated(study: Path, folder: Path) -> dict[str, object]:
    calibrate_into(folder, load_study(study), threads=1)
    record: dict[str, object] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return record


def test_a_curve_is_read_from_its_format(study: Path) -> None:
    curve = study.parent / "data" / "evi.csv"
    rows = list(csv.reader(line for line in curve.read_text(encoding="utf-8").splitlines() if line[0] != "#"))
    lines = [json.dumps(rows[0]), *(json.dumps([float(cell) for cell in row]) for row in rows[1:])]
    curve.with_suffix(".jsonl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    of_csv = load_study(study)
    study.write_text(study.read_text(encoding="utf-8").replace("evi.csv", "evi.jsonl"), encoding="utf-8")
    assert (load_study(study).data[0].measured == of_csv.data[0].measured).all()
    done = run_command("inspect", curve.with_suffix(".jsonl"))
    assert (done.status, "mm3/ms" in done.out) == (0, True)


@pytest.mark.parametrize(
    ("text", "reason"),
    [("", "expected lines"), ('["time [us]"]\n[1, 2]\n', "expected lines"), ("[1]\n", "expected lines")],
)
def test_a_damaged_file_of_its_format_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    (tmp_path / "damaged.jsonl").write_text(text, encoding="utf-8")
    done = run_command("inspect", tmp_path / "damaged.jsonl")
    assert done.status != 0
    assert reason in done.sentence


def test_its_injector_and_fuel_are_of_the_catalogue(tmp_path: Path) -> None:
    injector = commonrail.load_injector("example-injector")
    assert injector.fuel == commonrail.load_fuel("example-fuel")
    listed = run_command("catalogue", "injectors", "--json").record["injectors"]
    assert "example-injector" in [entry["name"] for entry in listed]
    done = run_command("simulate", "example-injector", "--rail-pressure", "160MPa", "--energising-time", "700us")
    assert done.status == 0
    commonrail.dump_injector(injector, tmp_path / "kept.toml")
    assert 'name = "example-fuel"\ntitle' in (tmp_path / "kept.toml").read_text(encoding="utf-8")  # law by law


def test_its_kind_of_data_is_calibrated_and_reported(study: Path, tmp_path: Path) -> None:
    text = study.read_text(encoding="utf-8")
    head, rest = text.partition("[[data]]")[0], text.partition("[[parameter]]")[2]
    data = """[[data]]
kind = "supply quantities"
name = "taken"
role = "fit"
file = "supply.csv"
absolute = "0.5 mm3"
relative = 0.05
cylinder_pressure = "5 MPa"
return_pressure = "0.5 MPa"

"""
    study.write_text(f"{head}{data}[[parameter]]{rest}", encoding="utf-8")
    rows = "".join(f"160,{time},{time / 10}\n" for time in (400, 500, 600, 700))
    table = f"rail_pressure [MPa],energising_time [us],supply_quantity [mm3]\n{rows}"
    (study.parent / "supply.csv").write_text(table, encoding="utf-8")
    (found,) = _calibrated(study, tmp_path / "run")["data"]  # type: ignore[misc]
    assert found["kind"] == "supply quantities"
    assert "Supply quantity" in write_report(tmp_path / "run").read_text(encoding="utf-8")
    listed = study.read_text(encoding="utf-8").replace("relative = 0.05\n", 'relative = "much"\n')
    study.write_text(listed, encoding="utf-8")
    with pytest.raises(InputError, match=r"data\[1\]\.relative"):
        load_study(study)


def test_a_block_names_its_meter(study: Path) -> None:
    text = study.read_text(encoding="utf-8").replace('role = "fit"', 'role = "fit"\nmeter = "example_rate_tube"')
    study.write_text(text, encoding="utf-8")
    read = load_study(study)
    assert read.data[0].meter is not None
    assert read.data[0].meter.values["delay"] == pytest.approx(5e-6)
    assert "meter.example_rate_tube.gain" in read.space.names


def test_its_feature_is_a_target_and_an_output_of_a_sensitivity_study(study: Path, regulated: Injector) -> None:
    text = (
        study.read_text(encoding="utf-8")
        .replace('kind = "rate"', 'kind = "features"')
        .replace('role = "fit"', 'role = "fit"\nfeatures = [{ feature = "energised_rate", tolerance = "1 mm3/ms" }]')
    )
    study.write_text(text, encoding="utf-8")
    (data,) = load_study(study).data
    assert 0.0 < data.measured[0] < 100e-6
    assert data.score(Simulator(regulated, (), 1e-6)).values[0] > 0.0
    listed = run_command("catalogue", "features", "--json").record["features"]
    assert {"name": "energised_rate", "unit": "m3/s"}.items() <= listed[-1].items()
    spread = commonrail.design.parameters_within(regulated, ["valve.lift"])
    settings = commonrail.design.SensitivitySettings(design="morris", samples=4)
    point = commonrail.OperatingPoint("160 MPa", "700 us")
    found = commonrail.design.sensitivity(regulated, spread, [point], ["quantity", "energised_rate"], settings=settings)
    whole, rate = (output.base for output in found.outputs)
    assert rate == pytest.approx(whole / 700e-6)


def test_its_meter_is_of_the_catalogue() -> None:
    (meter,) = run_command("catalogue", "meters", "--json").record["meters"]
    assert meter["name"] == "example_rate_tube"
    assert "delay" in meter["quantities"]


def test_its_page_is_written_beside_the_report(study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calibrate_into(tmp_path / "run", load_study(study), threads=1)
    monkeypatch.setattr(
        "commonrail.cli.verbs.report.registry.entries", registry.find_installed
    )  # bench.html takes long
    made = run_command("report", tmp_path / "run", "--page", "--json").record
    assert made["pages"] == [str(tmp_path / "run" / "summary.html")]
    assert "<h1>" in (tmp_path / "run" / "summary.html").read_text(encoding="utf-8")


def test_its_verb_writes_its_kind_of_result(tmp_path: Path) -> None:
    point = ("--rail-pressure", "160MPa", "--energising-time", "700us")
    done = run_command("spread", "example-injector", *point, "--out", tmp_path / "spread")
    assert done.status == 0, done.err
    record = json.loads((tmp_path / "spread" / "spread.json").read_text(encoding="utf-8"))
    assert sorted(record["volumes"]) == record["volumes"]
    check_made_again(run_command, tmp_path / "spread")


def test_doctor_lists_its_parts_and_how_to_cite_it() -> None:
    (found,) = [plugin for plugin in find_plugins() if plugin.distribution == "commonrail-example"]
    assert (found.version, found.broken) == ("1.0", [])
    assert "optimisers random search" in found.parts
    assert found.citation.startswith("The commonrail authors")


def test_its_own_tests_pass(tmp_path: Path) -> None:
    run_tests(ROOT, tmp_path / "site")


def test_a_name_that_it_does_not_have_is_refused_with_those_that_it_has(study: Path) -> None:
    text = study.read_text(encoding="utf-8").replace("random search", "random serach")
    study.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r'optimiser\.method: .*"random search"'):
        load_study(study)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("check", CHECKS)
def test_its_optimiser_keeps_what_all_promise(check: Callable[[Case], None], space: str) -> None:
    found = find_optimiser("random search")
    assert found is not None

    def make(seed: int, steps: int) -> Optimiser:
        settings = found.settings(members=6, generations=steps)
        return found.begin(SPACES[space], np.random.default_rng(seed), settings)  # type: ignore[no-any-return]

    check(Case("random search", SPACES[space], make))


@pytest.mark.parametrize("clause", contract.CLAUSES, ids=lambda clause: clause.__name__)
def test_its_kind_of_data_keeps_the_contract(
    clause: Callable[..., None], regulated: Injector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = get_kind("supply quantities")
    sample = replace(SAMPLES["return quantities"], table=partial(map_table, column="supply_quantity"))
    monkeypatch.setitem(SAMPLES, kind.kind, sample)
    clause(kind, regulated, tmp_path)


def test_a_report_of_a_removed_kind_of_data_says_what_is_missing() -> None:
    with refused(InputError, "unknown-kind"):
        get_kind("swirl")


def test_the_size_of_a_search_whose_package_is_gone_is_told_in_steps() -> None:
    record = {"method": "annealing", "generations": 3, "members": 6}
    assert size_in_words(record) == "3 generations of 6 members"
