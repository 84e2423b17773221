"""Priors, start and fixed values, loss, conditions and constraints between products in study files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.errors import CommonrailError
from commonrail.calibration.objective import Loss
from commonrail.calibration.optimisers.staged import StagedSettings
from commonrail.calibration.parameter import Prior, Wanted
from commonrail.calibration.study_file import load_study
from commonrail.runs.fingerprint import hash_study
from tests.refused import refused

Edit = Callable[..., Path]

UPPER = "upper = 0.95\n"
MASS = '[[parameter]]\nname = "valve.mass"\nlower = "2 g"\nupper = "8 g"\n'
PRIOR = 'prior = { value = "4 g", sigma = "0.5 g", source = "a sister part" }\n'


def with_mass(study_file: Edit, *lines: str) -> Path:
    return study_file((UPPER, UPPER + MASS + "".join(lines)))


def test_a_prior_is_read_and_is_where_the_search_starts(study_file: Edit) -> None:
    study = load_study(with_mass(study_file, PRIOR))
    mass = study.space.parameters[3]
    assert mass.prior == Prior(4e-3, 0.5e-3, "a sister part")
    assert mass.reference == study.injector.values["valve.mass"] == 4e-3
    assert (mass.mark, mass.source) == ("F", "a sister part")
    assert study.injector.sources["valve.mass"].text == "a sister part"


def test_a_start_value_may_differ_from_the_prior(study_file: Edit) -> None:
    study = load_study(with_mass(study_file, PRIOR, 'start = "5 g"\n'))
    assert study.space.parameters[3].reference == study.injector.values["valve.mass"] == 5e-3


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('prior = { value = "4 g", sigma = "0 g", source = "x" }\n', "than zero"),
        ('prior = { value = "4 mm", sigma = "1 g", source = "x" }\n', "parameter[4].prior.value"),
        ('prior = { value = "4 g", sigma = "1 mm", source = "x" }\n', "parameter[4].prior.sigma"),
        ('prior = { value = "4 g", sigma = "1 g" }\n', "source"),
        ('prior = { value = "9 g", sigma = "1 g", source = "x" }\n', "lies outside"),
        (PRIOR + 'reference = "4 g"\n', "reference and start (or prior)"),
        ('start = "9 g"\n', "its bounds"),
    ],
)
def test_a_bad_prior_is_refused_with_its_place(study_file: Edit, line: str, words: str) -> None:
    path = with_mass(study_file, line)
    with pytest.raises(CommonrailError) as caught:
        load_study(path)
    assert words in str(caught.value)
    assert f"{path}, parameter[4]" in str(caught.value)


def test_fixed_values_are_those_of_the_injector(study_file: Edit) -> None:
    fixed = '[[fixed]]\nname = "valve.mass"\nvalue = "6 g"\nmark = "M"\nsource = "weighed"\n'
    study = load_study(study_file((UPPER, UPPER + fixed)))
    assert study.injector.values["valve.mass"] == 6e-3
    assert study.injector.sources["valve.mass"] == ("M", "weighed")
    with refused(CommonrailError, "repeated fixed[1].name"):
        load_study(study_file((UPPER, UPPER + fixed + MASS)))


def test_loss_conditions_and_products_are_read(study_file: Edit) -> None:
    more = (
        '[[condition]]\nwanted = "stays shut"\nrail_pressure = ["40 MPa", "160 MPa"]\nenergising_time = ["50 us"]\n'
        'cylinder_pressure = "5 MPa"\nreturn_pressure = "0.5 MPa"\n'
        '[constraints]\nproducts = ["control_chamber.z_hole_diameter^2 < 2 * control_chamber.a_hole_diameter^2"]\n'
    )
    path = study_file((UPPER, UPPER + more), ("seed = 1", 'seed = 1\nloss = "squares"'))
    study = load_study(path)
    assert study.loss is Loss.SQUARES
    assert [(c.wanted, c.point.rail_pressure) for c in study.conditions] == [(Wanted.SHUT, 40e6), (Wanted.SHUT, 160e6)]
    assert len(study.space.products) == 1
    assert study.space.labels[-1].startswith("control_chamber.z_hole_diameter^2")


def test_the_staged_optimiser_is_chosen_by_its_name(study_file: Edit) -> None:
    path = study_file(("members = 24\ngenerations = 30\npolish = 3", 'method = "staged least squares"\nstarts = 5'))
    assert load_study(path).method.evolution == StagedSettings(starts=5)


def test_each_of_them_makes_another_study(study_file: Edit) -> None:
    prints = [hash_study(load_study(with_mass(study_file)))]
    for lines in (PRIOR, PRIOR.replace("0.5 g", "0.6 g"), 'start = "6 g"\n'):
        prints.append(hash_study(load_study(with_mass(study_file, lines))))
    loss = (UPPER, UPPER + MASS), ("seed = 1", 'seed = 1\nloss = "squares"')
    prints.append(hash_study(load_study(study_file(*loss))))
    assert len(set(prints)) == len(prints)


def test_soft_l1_takes_a_scale_and_other_losses_refuse_one(study_file: Edit) -> None:
    prints = []
    for lines in ('loss = "soft_l1"', 'loss = "soft_l1"\nloss_scale = 2.0', 'loss = "squares"'):
        study = load_study(study_file(("seed = 1", f"seed = 1\n{lines}")))
        prints.append((study.loss.value, study.loss_scale, hash_study(study)))
    assert [one[:2] for one in prints] == [("soft_l1", 1.0), ("soft_l1", 2.0), ("squares", 1.0)]
    assert len({one[2] for one in prints}) == 3
    path = study_file(("seed = 1", "seed = 1\nloss_scale = 2.0"))
    with pytest.raises(CommonrailError) as caught:
        load_study(path)
    assert f'{path}, loss_scale: it has no effect with the loss "kinds"' in str(caught.value)


@pytest.mark.parametrize("by", ["rail_pressure", "energising_time"])
def test_rows_to_be_left_out_need_a_map(study_file: Edit, by: str) -> None:
    path = study_file((UPPER, UPPER + f'[judgement]\nleave_out = ["{by}"]\n'))
    with pytest.raises(CommonrailError) as caught:
        load_study(path)
    assert str(caught.value).startswith(f'{path}: judgement.leave_out names "{by}", and no map')
