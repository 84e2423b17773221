"""Files that a study, an injector or a truth names lie in its folder or below, unless it says otherwise."""

from __future__ import annotations

from pathlib import Path

import pytest

from commonrail.base.errors import InputError
from commonrail.calibration.study_file import load_study
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.readers.injector import load_injector
from tests.readers.conftest import TEMPLATES, Edit
from tests.refused import refused

FILE = 'file = "data/evi.csv"'
ALLOWED = ("seed = 1", "seed = 1\nallow_outside = true")


@pytest.fixture
def outside(tmp_path: Path, study_file: Edit) -> Path:
    """The injector and the curve once more, beside the study's folder."""
    study_file()
    folder = tmp_path.parent / "elsewhere"
    folder.mkdir(exist_ok=True)
    for name in ("injector.toml", "data/evi.csv"):
        (folder / Path(name).name).write_bytes((tmp_path / name).read_bytes())
    return folder


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        (FILE, 'file = "../elsewhere/evi.csv"', "data[1].file"),
        (FILE, 'file = "{outside}/evi.csv"', "data[1].file"),
        (FILE, 'file = "data/../../elsewhere/evi.csv"', "data[1].file"),
        ('injector = "injector.toml"', 'injector = "../elsewhere/injector.toml"', "injector"),
        (
            'rail_pressure = "160 MPa"',
            'rail_pressure = { file = "/etc/passwd", column = "p" }',
            "data[1].rail_pressure.file",
        ),
    ],
)
def test_a_name_that_leads_out_is_refused_with_what_to_write(
    study_file: Edit, outside: Path, old: str, new: str, key: str
) -> None:
    path = study_file((old, new.replace("{outside}", str(outside))))
    with refused(InputError, f"outside-folder {key}", "study.toml") as caught:
        load_study(path)
    assert "allow_outside = true" in str(caught.value)


def test_a_study_may_allow_it(study_file: Edit, outside: Path) -> None:
    path = study_file(
        (FILE, f'file = "{outside}/evi.csv"'),
        ('injector = "injector.toml"', 'injector = "../elsewhere/injector.toml"'),
        ALLOWED,
    )
    with pytest.warns(RuntimeWarning, match="allow_outside") as announced:  # once, for all files
        assert len(load_study(path).data) == 1
    assert len(announced) == 1


def test_dead_times_are_held_too(study_file: Edit, outside: Path) -> None:
    text = study_file().read_text(encoding="utf-8")
    head, _, rest = text.partition("[[data]]")
    table = (
        '[[data]]\nkind = "quantities"\nname = "map"\nrole = "fit"\nfile = "data/q.csv"\ncylinder_pressure = "5 MPa"\n'
        'return_pressure = "1 bar"\ndead_times = { file = "../elsewhere/dead.csv", quantity = "0.5 mm3" }\n'
    )
    folder = outside.parent / "dead"
    (folder / "data").mkdir(parents=True)
    (folder / "injector.toml").write_bytes((TEMPLATES / "injector.toml").read_bytes())
    (folder / "data" / "q.csv").write_text("rail_pressure [MPa],energising_time [us],quantity [mm3]\n160,500,20\n")
    (folder / "study.toml").write_text(head + table + "\n[[parameter]]" + rest.partition("[[parameter]]")[2])
    with refused(InputError, "outside-folder data[1].dead_times.file", "study.toml"):
        load_study(folder / "study.toml")


def test_a_link_that_leads_out_is_refused(study_file: Edit, outside: Path, tmp_path: Path) -> None:
    path = study_file()
    (tmp_path / "data" / "evi.csv").unlink()
    (tmp_path / "data" / "evi.csv").symlink_to(outside / "evi.csv")
    with refused(InputError, "outside-folder data[1].file", "study.toml"):
        load_study(path)


def test_what_stays_inside_is_read_however_it_is_written(study_file: Edit, tmp_path: Path) -> None:
    assert load_study(study_file((FILE, f'file = "data/../../{tmp_path.name}/data/evi.csv"'))).data
    assert load_study(study_file((FILE, f'file = "{tmp_path}/data/evi.csv"'))).data
    (tmp_path.parent / "linked").symlink_to(tmp_path)
    assert load_study(tmp_path.parent / "linked" / "study.toml").data


def test_an_injectors_fuel_is_held_by_the_file_that_was_named(study_file: Edit, tmp_path: Path) -> None:
    study = study_file(('injector = "injector.toml"', 'injector = "parts/injector.toml"'))
    own = (tmp_path / "injector.toml").read_text(encoding="utf-8").replace('name = "iso4113"', 'file = "../fuel.toml"')
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "injector.toml").write_text(own, encoding="utf-8")
    fuel = Path(__file__).parents[2] / "src" / "commonrail" / "physics" / "catalogue" / "fuels" / "iso4113.toml"
    (tmp_path / "fuel.toml").write_bytes(fuel.read_bytes())
    assert load_study(study).injector.fuel.name == "fuel"  # beside the study
    with refused(InputError, "outside-folder fuel.file", "injector.toml"):
        load_injector(tmp_path / "parts" / "injector.toml")  # above the injector
    (tmp_path / "parts" / "free.toml").write_text(f"allow_outside = true\n{own}", encoding="utf-8")
    assert load_injector(tmp_path / "parts" / "free.toml").fuel.name == "fuel"


def test_an_injector_cannot_lift_what_its_study_holds(study_file: Edit, tmp_path: Path) -> None:
    study = study_file()
    own = (tmp_path / "injector.toml").read_text(encoding="utf-8").replace('name = "iso4113"', 'file = "/etc/passwd"')
    (tmp_path / "injector.toml").write_text(f"allow_outside = true\n{own}", encoding="utf-8")
    with refused(InputError, "outside-folder fuel.file"):
        load_study(study)


def test_a_truths_injector_is_held(tmp_path: Path) -> None:
    truths = Path(__file__).parents[2] / "src" / "commonrail" / "plugins" / "paper" / "truths"
    text = (truths / "virtual-lino-2016.toml").read_text(encoding="utf-8")
    path = tmp_path / "own.toml"
    path.write_text(text.replace('injector = "virtual-lino-2016"', 'injector = "../../x.toml"'), encoding="utf-8")
    with refused(InputError, "outside-folder injector", "own.toml"):
        load_truth(path)


@pytest.mark.parametrize("value", ["1", '"true"', "[]"])
def test_permission_is_true_or_false(tmp_path: Path, study_file: Edit, value: str) -> None:
    with refused(InputError, "bool_type allow_outside"):
        load_study(study_file(("seed = 1", f"seed = 1\nallow_outside = {value}")))
    text = (tmp_path / "injector.toml").read_text(encoding="utf-8")
    (tmp_path / "injector.toml").write_text(f"allow_outside = {value}\n{text}", encoding="utf-8")
    with refused(InputError, "bool_type allow_outside"):
        load_injector(tmp_path / "injector.toml")
