"""Type files, and studies that name one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

import commonrail as cr
from commonrail.plugins.family.injector_type import dump_type, load_type, type_text
from commonrail.runs.fit import STUDIES
from tests.plugins.family.samples import MASS, PRELOAD, small_type

Edit = Callable[..., Path]

SEED, UPPER = "seed = 1", "upper = 0.95\n"
WITH_TYPE = (SEED, f'{SEED}\ntype = "types/lino.toml"')
FREE_MASS = f'[[parameter]]\nname = "{MASS}"\n'


@pytest.fixture
def type_file(tmp_path: Path) -> Path:
    """Type file of `small_type`, below the folder of the study."""
    path = tmp_path / "types" / "lino.toml"
    path.parent.mkdir()
    dump_type(small_type(), path)
    return path


def test_a_type_is_read_back_bit_by_bit(tmp_path: Path) -> None:
    third = cr.parts.TypeParameter("nozzle.shape_1", -1.0 / 3.0, math.pi / 100.0, -0.5, 0.5, "F", 'a "source"')
    fine = cr.parts.TypeParameter("valve.lift", 4e-5 / 3.0, 1e-6 / 7.0, 1e-5, 8e-5 / 3.0, "F", "of a third", 1e-6 / 9.0)
    own = replace(small_type(), parameters=(*small_type().parameters, third, fine), synthetic="simulated")
    dump_type(own, tmp_path / "t.toml")
    assert load_type(tmp_path / "t.toml") == own


def test_a_type_says_what_it_was_learnt_from() -> None:
    text = type_text(small_type())
    assert 'injector = "virtual-lino-2016"' in text
    assert '"data.csv" = "0a"' in text
    assert "spring" in text.partition("spring_preload")[2].splitlines()[1]  # the meaning is beside the value


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("commonrail-type/1", "commonrail-study/1", "commonrail-study/1"),
        ('name = "valve.mass"', 'name = "valve.mas"', "parameter[2].name: "),
        ('mark = "F"', 'mark = "X"', "parameter[1].mark: "),
        ('name = "valve.mass"', 'name = "valve.spring_preload"', "value: "),
        ("spread = ", "sprea = ", '"sprea"'),
        ("virtual-lino-2016", "virtual-lino", "injector: "),
        ("virtual-lino-2016", "../mine.toml", "injector: "),
    ],
)
def test_a_bad_type_is_refused_with_its_place(type_file: Path, old: str, new: str, words: str) -> None:
    text = type_file.read_text(encoding="utf-8")
    assert old in text
    type_file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(cr.CommonrailError) as found:
        load_type(type_file)
    assert words in str(found.value)
    assert str(found.value).startswith(str(type_file))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"spread": 0.0}, "valve.mass: .*spread"),
        ({"spread": math.inf}, "spread of valve.mass"),
        ({"between": -1e-9}, "valve.mass: .*between"),
        ({"between": 1e3}, "valve.mass: .*between"),
        ({"value": 1.0}, "valve.mass: .*bounds"),
        ({"name": "valve.mas"}, "valve.mas"),
    ],
)
def test_a_parameter_of_a_type_makes_sense(changes: dict[str, object], words: str) -> None:
    with pytest.raises(cr.errors.ConfigurationError, match=words):
        replace(small_type().parameters[1], **changes)  # type: ignore[arg-type]


def test_a_parameter_is_given_once() -> None:
    one = small_type().parameters[0]
    with pytest.raises(cr.errors.ConfigurationError, match=PRELOAD):
        replace(small_type(), parameters=(one, one))


def test_a_free_parameter_starts_at_the_types_value_with_its_prior(study_file: Edit, type_file: Path) -> None:
    study = cr.load_study(study_file(WITH_TYPE, (UPPER, UPPER + FREE_MASS)))
    known, mass = small_type().by_name[MASS], study.space.parameters[3]
    assert mass.prior == cr.Prior(known.value, known.spread, "made up")
    assert (mass.reference, mass.lower, mass.upper) == (known.value, known.lower, known.upper)
    assert (mass.mark, mass.source) == ("F", "made up")
    # what is not free takes the type's value
    assert study.injector.values[PRELOAD] == small_type().by_name[PRELOAD].value
    assert study.injector.sources[PRELOAD] == ("F", "made up")
    assert study.space.names[:3] == cr.load_study(study_file()).space.names


def test_what_the_study_states_itself_counts(study_file: Edit, type_file: Path) -> None:
    own = 'lower = "2 g"\nupper = "8 g"\nprior = { value = "4 g", sigma = "0.5 g", source = "weighed" }\n'
    fixed = f'[[fixed]]\nname = "{PRELOAD}"\nvalue = "66 N"\n'
    study = cr.load_study(study_file(WITH_TYPE, (UPPER, UPPER + FREE_MASS + own + fixed)))
    assert study.space.parameters[3].prior == cr.Prior(4e-3, 0.5e-3, "weighed")
    assert (study.space.parameters[3].lower, study.space.parameters[3].upper) == (2e-3, 8e-3)
    assert study.injector.values[PRELOAD] == 66.0
    start = cr.load_study(study_file(WITH_TYPE, (UPPER, UPPER + FREE_MASS + 'start = "5 g"\n')))
    assert start.space.parameters[3].reference == 5e-3
    assert start.space.parameters[3].prior == small_type().by_name[MASS].prior


def test_a_value_that_was_measured_on_the_injector_stays(study_file: Edit, type_file: Path, tmp_path: Path) -> None:
    plain = cr.load_study(study_file())
    measured = replace(plain.injector, sources={**plain.injector.sources, PRELOAD: cr.models.Source("M", "tester")})
    measured = measured.with_values({PRELOAD: 61.0})
    cr.dump_injector(measured, tmp_path / "injector.toml")
    assert cr.load_study(study_file(WITH_TYPE)).injector.values[PRELOAD] == 61.0


def test_a_study_without_free_parameters_frees_those_of_its_type(study_file: Edit, type_file: Path) -> None:
    path = study_file(WITH_TYPE)
    text = path.read_text(encoding="utf-8")
    head, _, rest = text.partition("[[parameter]]")
    path.write_text(f"{head}[optimiser]{rest.rpartition('[optimiser]')[2]}", encoding="utf-8")
    assert cr.load_study(path).space.names == (PRELOAD, MASS)
    path.write_text(path.read_text(encoding="utf-8").replace(WITH_TYPE[1], SEED), encoding="utf-8")
    with pytest.raises(cr.errors.InputError, match=r"study\.toml, parameter: "):
        cr.load_study(path)


def test_the_type_is_among_the_files_of_the_study(study_file: Edit, type_file: Path) -> None:
    study = cr.load_study(study_file(WITH_TYPE))
    assert type_file in study.files
    assert "types/lino.toml" in STUDIES.copies(study)


def test_a_type_from_elsewhere_is_copied_and_the_copy_is_named(study_file: Edit, tmp_path: Path) -> None:
    elsewhere = tmp_path.parent / f"{tmp_path.name}-types"
    elsewhere.mkdir()
    dump_type(small_type(), elsewhere / "lino.toml")
    named = f'{SEED}\nallow_outside = true\ntype = "../{elsewhere.name}/lino.toml"'
    study = cr.load_study(study_file((SEED, named)))
    (tmp_path / "run").mkdir()
    STUDIES.copy(study, tmp_path / "run")
    (elsewhere / "lino.toml").unlink()
    own = cr.load_study(tmp_path / "run" / "study.toml")
    assert own.injector.values == study.injector.values
    assert tmp_path / "run" / "inputs" / "lino.toml" in own.files


def test_a_type_outside_the_studys_folder_is_refused(study_file: Edit, type_file: Path) -> None:
    path = study_file((SEED, f'{SEED}\ntype = "../lino.toml"'))
    with pytest.raises(cr.errors.InputError, match=r'type: "\.\./lino\.toml"'):
        cr.load_study(path)
