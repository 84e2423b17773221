"""Results are booked under the fingerprints of what was read, not of what was there when the fleet began."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest

from commonrail.base.errors import InputError, StudyError
from commonrail.plugins.fleet.member import Attempt, hash_shared_files, write_study
from commonrail.plugins.fleet.run import Booking, FleetProgress
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from tests.plugins.fleet.conftest import COUNT, calibrated, edited, small_fleet

LAST = f"SN{COUNT:06d}"
RECORD = calibrated(1.0)


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.process
@pytest.mark.usefixtures("forked_workers")
def test_data_changed_at_work_are_booked_as_they_were_read(fleet_file: Path, tmp_path: Path) -> None:
    data = fleet_file.parent / "data" / f"{LAST}_160MPa.csv"
    before = digest(data)

    def change(p: FleetProgress) -> None:
        if p.done == 1:
            data.write_text(data.read_text(encoding="utf-8") + "# measured again\n", encoding="utf-8")

    run = run_fleet(load_fleet(fleet_file), tmp_path / "run", workers=1, progress=change)
    booked = run.entries[-1].inputs["160 MPa"]
    assert run.entries[-1].status == "finished"
    assert booked == digest(data) != before
    assert run_fleet(load_fleet(fleet_file), tmp_path / "run").record["clock"]["calibrated_now"] == 0
    edited(data, "# measured again\n", "")
    with pytest.raises(StudyError, match=f'"{LAST}" .*"160 MPa"'):
        run_fleet(load_fleet(fleet_file), tmp_path / "run")


def handed(layout: str, folder: Path) -> tuple[Booking, Path, dict[str, str]]:
    """Booking of a small fleet of which the last injector was handed out: its study, and the data's fingerprints."""
    fleet = load_fleet(small_fleet(folder / "fleet", layout))
    booking = Booking(fleet.supply, hash_shared_files(fleet.template))
    return booking, booking.hand_out(LAST, write_study(fleet, LAST, folder / "own")), fleet.supply.fingerprints(LAST)


@pytest.mark.parametrize("layout", ["files", "rows"])
def test_what_was_read_as_written_is_booked_as_it_was(layout: str, tmp_path: Path) -> None:
    booking, study, inputs = handed(layout, tmp_path)
    own = sorted((tmp_path / "fleet" / "data").glob(f"{LAST}_*")) if layout == "files" else study.parent.glob("*.csv")
    attempt = Attempt(RECORD, "", 1.0, {path: digest(path) for path in [study, *own]})
    assert booking.book(LAST, attempt, inputs) == (attempt, inputs)


@pytest.mark.parametrize("name", ["study.toml", "rows-1.csv"])
def test_a_file_of_the_fleets_own_that_was_changed_fails_the_attempt(name: str, tmp_path: Path) -> None:
    booking, study, inputs = handed("rows", tmp_path)
    attempt = Attempt(RECORD, "", 1.0, {study.with_name(name): "0" * 64})
    found, kept = booking.book(LAST, attempt, inputs)
    assert found.reason.startswith(f"{study.with_name(name)}: ")
    assert (found.record, kept) == (None, {})  # not the data's fingerprints: it is pending in the next run


def test_a_file_that_injectors_share_and_that_was_changed_fails_the_attempt(tmp_path: Path) -> None:
    booking, study, inputs = handed("files", tmp_path)
    shared = tmp_path / "drive.csv"
    assert not booking.book("SN000001", Attempt(RECORD, "", 1.0, {shared: "a"}), inputs)[0].reason
    found, _ = booking.book(LAST, Attempt(RECORD, "", 1.0, {shared: "b", study: digest(study)}), inputs)
    assert found.reason.startswith(f"{shared}: ")


def test_a_lost_attempt_keeps_the_fingerprints_of_the_beginning(tmp_path: Path) -> None:
    booking, _, inputs = handed("files", tmp_path)
    attempt = Attempt(None, "Each of 3 attempts was lost.", 0.0)
    assert booking.book(LAST, attempt, inputs) == (attempt, inputs)


def test_files_that_the_injectors_file_names_are_shared_too(tmp_path: Path) -> None:
    from commonrail.plugins.new.study import write_new

    fleet = load_fleet(small_fleet(tmp_path / "fleet"))
    write_new(tmp_path / "new")
    template = replace(fleet.template, path=tmp_path / "new" / "study.toml")
    template = replace(template, model=template.model.model_copy(update={"injector": "injector.toml"}))
    assert hash_shared_files(template) == {
        tmp_path / "new" / "injector.toml": digest(tmp_path / "new" / "injector.toml")
    }
    (tmp_path / "new" / "injector.toml").unlink()
    with pytest.raises(InputError, match=r"study\.toml: .*injector\.toml: "):
        hash_shared_files(template)
