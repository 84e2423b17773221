"""A folder that is made as one: it is there when it is complete, and an end before that leaves the place free."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from commonrail.base.errors import InputError
from commonrail.base.hooks import catch_stops
from commonrail.report.analysis import run_into
from commonrail.runs.folder import final_text, new_folder, refuse_used


@pytest.fixture(params=[True, False], ids=["new", "empty"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A free place: nothing, or an empty folder."""
    folder = tmp_path / "a b" / "out"
    if not request.param:
        folder.mkdir(parents=True)
    return folder


def test_a_folder_is_there_when_it_is_complete(place: Path) -> None:
    with new_folder(place) as part:
        (part / "data").mkdir()
        (part / "data" / "x").touch()
        refuse_used(place)
        assert final_text(f"report '{part.as_posix()}' --out {part.as_posix()}/x", part) == (
            f"report '{place.as_posix()}' --out {place.as_posix()}/x"
        )
    assert [path.relative_to(place).as_posix() for path in sorted(place.rglob("*"))] == ["data", "data/x"]
    assert list(place.parent.iterdir()) == [place]
    with pytest.raises(InputError):
        refuse_used(place)


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
def test_an_error_leaves_nothing(place: Path, error: type[BaseException]) -> None:
    def fill() -> None:
        with new_folder(place) as part:
            (part / "x").touch()
            raise error

    existed = place.exists()
    with pytest.raises(error):
        fill()
    assert [*place.parent.rglob("*")] == [place] * existed


def test_what_a_killed_process_leaves_is_no_obstacle(place: Path) -> None:
    killed = new_folder(place)
    (killed.__enter__() / "x").touch()  # and nothing after it
    with new_folder(place) as part:
        (part / "y").touch()
    assert (place / "y").is_file()
    assert not (place / "x").exists()


def test_an_analysis_that_has_lost_a_stop_writes_nothing(place: Path) -> None:
    def run() -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    existed = place.exists()
    with catch_stops(), pytest.raises(KeyboardInterrupt):
        run_into(place, "x.csv", lambda: _Result(run()))
    assert [*place.parent.rglob("*")] == [place] * existed


class _Result:
    def __init__(self, _: None) -> None: ...

    def record(self) -> dict[str, object]:
        return {"title": "", "synthetic": ""}

    def rows(self) -> list[dict[str, object]]:
        return [{"x": 1.0}]
