"""The small verbs: catalogue, new, verify, virtual-bench."""

from __future__ import annotations

import errno
import math
import re
from pathlib import Path
from typing import Any

import pytest

from commonrail.physics.injector import parameter_quantities
from commonrail.plugins.new.study import TEMPLATES
from commonrail.plugins.verification.closed_forms import check
from commonrail.readers.injector import load_injector
from tests.cli.conftest import Command


def test_the_catalogue_lists_all_three_kinds(command: Command) -> None:
    record = command("catalogue", "--json").record
    assert {"iso4113", "n-dodecane"} <= {fuel["name"] for fuel in record["fuels"]}
    assert {"cri2-16", "virtual-lino-2016"} <= {i["name"] for i in record["injectors"]}
    assert [p["name"] for p in record["parameters"]] == list(parameter_quantities())


def test_the_catalogue_tells_the_usual_range_of_a_parameter(command: Command) -> None:
    done = command("catalogue", "parameters", "--search", "valve.lift", "--json")
    assert [p["usual"] for p in done.record["parameters"]] == [[5e-6, 1e-3]]
    assert "5e-06 to 0.001" in command("catalogue", "parameters", "--search", "valve.lift").out


def test_the_catalogue_can_be_searched(command: Command) -> None:
    done = command("catalogue", "parameters", "--search", "SPRING")
    assert "valve.spring_preload" in done.out
    assert "nozzle.holes" not in done.out


def test_a_vain_search_says_so(command: Command) -> None:
    done = command("catalogue", "--search", "zebra")
    assert (done.status, done.out) == (0, "")
    assert '"zebra"' in done.sentence


def test_the_file_of_an_injector_is_written_to_start_from_and_nothing_is_overwritten(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert command("catalogue", "injectors", "--write", "crin").status == 0
    assert load_injector("crin.toml") == load_injector("crin")
    assert "crin.toml" in command("catalogue", "injectors", "--write", "crin").sentence
    assert "--write" in command("catalogue", "fuels", "--write", "crin").sentence
    assert '"../x"' in command("catalogue", "--write", "../x").sentence


def test_the_gaps_of_a_drawing_are_listed_below_the_sentence(command: Command, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('format = "commonrail-injector/1"\n', encoding="utf-8")
    done = command("simulate", tmp_path / "a.toml", "--rail-pressure", "80MPa", "--energising-time", "500us")
    assert done.status == 2
    assert sum(line.startswith("  nozzle.holes, ") for line in done.err.splitlines()[1:]) == 1


def test_new_writes_its_files_and_names_the_next_step(command: Command, tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    done = command("new", folder)
    assert done.status == 0
    assert all((folder / name).is_file() for name in TEMPLATES)
    assert done.out.splitlines()[-1] == f"next: commonrail calibrate {folder / 'study.toml'}"


def test_new_as_json_lists_its_files(command: Command, tmp_path: Path) -> None:
    record = command("new", tmp_path / "mine", "--json").record
    assert len(record["files"]) == len(TEMPLATES)


def test_new_overwrites_nothing(command: Command, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    done = command("new", tmp_path)
    assert done.status == 2
    assert "overwritten" in done.sentence
    assert [p.name for p in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.parametrize("verb", ["new", "lab virtual-bench"])
def test_a_folder_that_cannot_be_written_ends_with_3(
    command: Command, verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    done = command(*verb.split(), tmp_path / "x")
    assert done.status == 3
    assert "(Permission denied)" in done.sentence


def test_the_virtual_bench_passes_folder_and_seed_on(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(folder: Path, seed: int, truth: object) -> list[Path]:
        return [folder / f"seed-{seed}.csv"]

    monkeypatch.setattr("commonrail.plugins.paper.bench_file.virtual_bench", write)
    done = command("lab", "virtual-bench", tmp_path, "--seed", "5", "--json")
    assert done.record == {
        "kind": "virtual-bench",
        "seed": 5,
        "truth": "virtual-lino-2016",
        "files": [str(tmp_path / "seed-5.csv")],
    }
    assert command("lab", "virtual-bench", tmp_path).out == f"{tmp_path / 'seed-1.csv'}\n"


GOOD, BAD = check("a", 0.1, 0.2, "%", "why"), check("b", math.nan, 0.2, "%", "why")


def patch_checks(monkeypatch: pytest.MonkeyPatch, *checks: Any) -> None:
    """Let the verification study find these."""

    def verify(_injector: object, progress: Any, quick: bool) -> list[Any]:
        progress("comparing")
        assert quick
        return list(checks)

    monkeypatch.setattr("commonrail.plugins.verification.run.verify", verify)


def test_verify_passes_with_0(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_checks(monkeypatch, GOOD)
    done = command("lab", "verify", "--quick")
    assert done.status == 0
    assert "passed" in done.out
    assert done.err.splitlines() == ["comparing", "all 1 checks passed"]


def test_verify_fails_with_1_and_names_the_check(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_checks(monkeypatch, GOOD, BAD)
    done = command("lab", "verify", "--quick")
    assert done.status == 1
    assert "FAILED" in done.out
    assert re.search(r"^1 of 2 .*: b\.$", done.sentence)


def test_verify_as_json_has_null_for_what_is_not_finite(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    patch_checks(monkeypatch, GOOD, BAD)
    record = command("lab", "verify", "--quick", "--json").record
    assert record["passed"] is False
    assert [c["value"] for c in record["checks"]] == [0.1, None]
    assert [c["limit"] for c in record["checks"]] == [0.2, 0.2]
    assert [c["margin"] for c in record["checks"]] == [0.5, None]
