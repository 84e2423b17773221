"""The error classes keep what the command line and library users rely on."""

import pickle

import pytest

from commonrail.base import errors
from commonrail.base.errors import CommonrailError, nearest
from commonrail.physics.injector import parameter_quantities

EXIT_CODES = {
    "InputError": 2,
    "ConfigurationError": 2,
    "StudyError": 2,
    "OutputError": 3,
    "PluginError": 2,
    "SimulationError": 4,
}


def test_every_error_is_listed_with_its_exit_code() -> None:
    found = {leaf.__name__: leaf.exit_code for leaf in CommonrailError.__subclasses__()}
    assert found == EXIT_CODES


@pytest.mark.parametrize("name", EXIT_CODES)
def test_an_error_crosses_a_process_boundary(name: str) -> None:
    error = getattr(errors, name)("a.toml, p: a pressure is expected.", code="wrong-unit", file="a.toml", place="p")
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error)
    assert str(copy) == "a.toml, p: a pressure is expected."
    assert (copy.code, copy.file, copy.place) == ("wrong-unit", "a.toml", "p")


def test_one_handler_catches_every_leaf_and_no_programming_error() -> None:
    assert all(issubclass(getattr(errors, name), CommonrailError) for name in EXIT_CODES)
    assert not issubclass(CommonrailError, ValueError | TypeError | OSError)


@pytest.mark.parametrize(
    ("name", "options", "meant"),
    [
        ("presure", ["voltage", "pressure"], "pressure"),
        ("PRESSURE", ["voltage", "pressure"], "pressure"),  # only the case differs
        ("rail_presure", ["rail_pressure", "rail_volume"], "rail_pressure"),
        ("mpa", ["MPa", "mPa"], "MPa"),  # the first listed wins
    ],
)
def test_nearest_suggests_what_was_meant(name: str, options: list[str], meant: str) -> None:
    assert nearest(name, options) == f' (did you mean "{meant}"?)'


DOTTED = ["control_chamber.z_hole_diameter", "nozzle.hole_diameter", "valve.mass", "rail.volume", "sac.volume"]


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("z_hole_diameter", '"control_chamber.z_hole_diameter"'),
        ("z_hole_diamter", '"control_chamber.z_hole_diameter"'),
        ("z_hole", '"control_chamber.z_hole_diameter"'),
        ("Z-Hole diameter", '"control_chamber.z_hole_diameter"'),
        ("control_chamber.z_hole_diamter", '"control_chamber.z_hole_diameter"'),
        ("control_chamber.hole_diameter", '"control_chamber.z_hole_diameter" or "nozzle.hole_diameter"'),
        ("hole", '"control_chamber.z_hole_diameter" or "nozzle.hole_diameter"'),
        ("volume", '"rail.volume" or "sac.volume"'),
        ("valve", '"valve.mass"'),
        ("control_chamber", '"control_chamber.z_hole_diameter"'),
        ("valv.mass", '"valve.mass"'),
    ],
)
def test_a_part_of_a_dotted_name_is_understood(name: str, meant: str) -> None:
    assert nearest(name, DOTTED) == f" (did you mean {meant}?)"


def _typos(name: str) -> dict[str, str]:
    """Names that people write when they mean a parameter."""
    room, _, end = name.partition(".")
    middle = len(end) // 2
    swapped = end[: middle - 1] + end[middle] + end[middle - 1] + end[middle + 1 :]
    return {
        "last part": end,
        "capitals": name.upper(),
        "dashes": name.replace("_", "-"),
        "spaces": name.replace("_", " ").replace(".", " . ").replace(" . ", "."),
        "letter missing": f"{room}.{end[:middle]}{end[middle + 1 :]}" if len(end) > 2 else f"{room[1:]}.{end}",
        "letters swapped": f"{room}.{swapped if len(end) > 2 else end}",
        "letter twice": f"{room}.{end[:middle]}{end[middle : middle + 1] * 2}{end[middle + 1 :]}",
        "last part, letters swapped": swapped if len(end) > 4 else end,
        "last part, letter missing": end[:middle] + end[middle + 1 :] if len(end) > 4 else end,
        "another room": f"injector.{end}",
        "room without underscore": f"{room.replace('_', '')}.{end}",
        "word at the end missing": f"{room}.{end.rpartition('_')[0] or end}" if room else end,
    }


@pytest.mark.parametrize("name", list(parameter_quantities()))
def test_typos_of_every_parameter_find_it(name: str) -> None:
    end = name.partition(".")[2]
    shared = [other for other in parameter_quantities() if other.partition(".")[2] == end]
    for kind, typo in _typos(name).items():
        if typo == name or (kind == "another room" and len(shared) > 1):
            continue
        suggested = nearest(typo, parameter_quantities())
        meant = name.rpartition("_")[0] if kind == "word at the end missing" else name
        assert meant in suggested or any(other in suggested for other in shared), (kind, typo, suggested)


@pytest.mark.parametrize("options", [[], ["needle", "plunger"]])
def test_nearest_says_nothing_when_nothing_is_close(options: list[str]) -> None:
    assert nearest("voltage", options) == ""


def test_nearest_takes_any_iterable_once() -> None:
    assert nearest("presure", (name for name in ("pressure", "voltage"))).endswith('"pressure"?)')


def test_a_message_is_one_line_without_what_moves_a_cursor() -> None:
    error = errors.InputError("a\nb\x1b[2J\u2028c\u202ed\ud800.csv: \tµ, é, 🙂 stay.")
    assert str(error) == "a b [2J c d .csv:  µ, é, 🙂 stay."


def test_a_long_message_keeps_its_place_and_its_advice() -> None:
    text = str(errors.InputError("study.toml: " + "x" * 100_000 + "; shorten it."))
    assert len(text) == 1005
    assert text.startswith("study.toml: xxx")
    assert text.endswith("xxx; shorten it.")


def test_no_search_for_a_name_that_nobody_wrote() -> None:
    assert nearest("a" * 100, ["a" * 99])
    assert nearest("a" * 101, ["a" * 100]) == ""
