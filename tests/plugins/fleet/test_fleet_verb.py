"""commonrail fleet."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commonrail.plugins import cluster
from tests.cli.conftest import Command
from tests.plugins.fleet.conftest import edited
from tools.make_fleet import make_fleet

FILES = {"fleet.sqlite", "fleet.lock", "fleet.json", "results.csv", "report.html", "injectors"}


@pytest.fixture
def fleet_file(tmp_path: Path) -> Path:
    """Two injectors with the shortest of searches."""
    return make_fleet(tmp_path / "line-3", 2, members=4, generations=1)


def test_a_fleet_from_end_to_end(
    command: Command, fleet_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command("fleet", fleet_file, "--workers", "1")
    assert done.status == 0, done.err
    folder = tmp_path / "runs" / "line-3"
    assert {path.name for path in folder.iterdir()} >= FILES
    assert "SYNTHETIC: " in done.out
    assert re.search(r"2 injectors in .* injectors/s", done.err)
    assert "injectors 2/2: 0 failed" in done.err
    assert (folder / "report.html").read_text(encoding="utf-8").count("Synthetic, not measured") == 1

    again = command("fleet", fleet_file, "--json").record
    assert again["result"]["clock"]["calibrated_now"] == 0
    assert (again["result"]["counts"]["finished"], again["result"]["counts"]["failed"]) == (2, 0)
    assert again["report"] == str(Path("runs/line-3/report.html"))

    edited(fleet_file, "seed = 1", "seed = 2")
    refused = command("fleet", fleet_file)
    assert refused.status == 2
    assert re.search('seed "1".*"2"', refused.sentence)


@pytest.mark.usefixtures("forked_workers")
def test_a_failure_is_told_as_it_comes_and_listed(command: Command, fleet_file: Path, tmp_path: Path) -> None:
    (fleet_file.parent / "data" / "SN000002_160MPa.csv").unlink()
    done = command("fleet", fleet_file, "--workers", "1", "--out", tmp_path / "run", "--full")
    assert done.status == 4, done.err  # the others are calibrated; a script must not overlook this one
    assert "SN000002 " in done.err
    assert "SN000002_160MPa.csv: " in " ".join(done.out.split())


def test_ctrl_c_ends_in_order_with_130(
    command: Command, fleet_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("commonrail.plugins.fleet.run._Run.calibrate", stopped)
    done = command("fleet", fleet_file, "--out", tmp_path / "run")
    assert done.status == 130
    assert str(tmp_path / "run") in done.sentence
    assert (tmp_path / "run" / "results.csv").is_file()


def test_a_fault_in_the_file_is_one_sentence(command: Command, fleet_file: Path, tmp_path: Path) -> None:
    edited(fleet_file, 'files = "injectors.csv"', 'files = "injectors.xlsx"')
    done = command("fleet", fleet_file, "--out", tmp_path / "run")
    assert done.status == 2
    assert "injectors.xlsx: " in done.sentence
    assert not (tmp_path / "run").exists()


def test_a_cluster_has_its_own_number_of_workers(command: Command, fleet_file: Path, tmp_path: Path) -> None:
    there = ("--cluster", "tcp://127.0.0.1:1", "--out", tmp_path / "run")
    done = command("fleet", fleet_file, "--workers", "2", *there)
    assert done.status == 2
    assert done.sentence.startswith("--workers: ")
    assert not (tmp_path / "run").exists()


@pytest.mark.usefixtures("forked_workers")
def test_a_scheduler_that_is_not_there_is_a_sentence_and_the_fleet_can_go_on_without(
    command: Command, fleet_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    monkeypatch.setattr(cluster, "CONNECT", 0.5)
    done = command("fleet", fleet_file, "--cluster", "tcp://127.0.0.1:1", "--out", tmp_path / "run")
    assert done.status == 2
    assert "tcp://127.0.0.1:1" in done.sentence
    assert command("fleet", fleet_file, "--workers", "1", "--out", tmp_path / "run").status == 0
