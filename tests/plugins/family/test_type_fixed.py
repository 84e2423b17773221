"""Values that the studies of a type's parts fix: the type has them, in its file and wherever it is used."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.family.fit import type_from_fit
from commonrail.plugins.family.study import load_family
from commonrail.runs.folder import write_record
from tests.plugins.family.samples import INJECTOR, PRELOAD, injected, small_type

Edit = Callable[..., Path]

LIFT = "valve.lift"
FIXED = cr.parts.FixedValue(LIFT, 75e-6, "M", "gauge of part 1")
FIXED_TABLE = '[[fixed]]\nname = "valve.lift"\nvalue = "{}"\nmark = "M"\nsource = "gauge"\n'
UPPER = "upper = 0.95\n"


def type_with_lift(injector: cr.Injector | None = INJECTOR) -> cr.parts.InjectorType:
    return replace(small_type(), fixed=(FIXED,), injector=injector)


def measured(lift: float, source: str = "gauge of part 2") -> cr.Injector:
    return replace(
        INJECTOR.with_values({LIFT: lift}), sources={**INJECTOR.sources, LIFT: cr.models.Source("M", source)}
    )


def run_of(study: Path, folder: Path, best: float = 65.0) -> Path:
    """Run folder of a study: as `calibrate` leaves it, of one part whose valve preload [N] was fitted."""
    shutil.copytree(study.parent, folder, ignore=shutil.ignore_patterns("run*"))
    data = [{"name": "map", "role": "fit", "source": "bench"}]
    parameter = {"name": PRELOAD, "lower": 40.0, "upper": 100.0, "best": best, "standard_error": 1.0}
    record = {"schema": 1, "kind": "calibration", "title": folder.name, "synthetic": "", "data": data}
    write_record(folder / "result.json", {**record, "parameters": [parameter]})
    return folder


def test_a_type_file_keeps_the_fixed_values(tmp_path: Path) -> None:
    cr.parts.dump_type(type_with_lift(), tmp_path / "t.toml")
    assert cr.parts.load_type(tmp_path / "t.toml").fixed == (FIXED,)


def test_the_fixed_value_of_a_run_is_in_its_type(study_file: Edit, tmp_path: Path) -> None:
    run = run_of(study_file((UPPER, UPPER + FIXED_TABLE.format("75 um"))), tmp_path / "run")
    found = cr.parts.type_from_runs([run], "t")
    assert cr.parts.FixedValue(LIFT, 75e-6, "M", "gauge") in found.fixed


def test_parts_that_differ_give_their_mean_and_a_note(study_file: Edit, tmp_path: Path) -> None:
    runs = []
    for number, lift in enumerate(("70 um", "80 um")):
        run = run_of(study_file((UPPER, UPPER + FIXED_TABLE.format(lift))), tmp_path / f"run-{number}")
        runs.append(run)
    with pytest.warns(RuntimeWarning, match=r"valve\.lift .*70 um \(run-0\), 80 um"):
        (found,) = (v for v in cr.parts.type_from_runs(runs, "t").fixed if v.name == LIFT)
    assert found.value == pytest.approx(75e-6, rel=1e-12)  # rounding
    assert found.mark == "F"


def test_the_model_of_the_types_own_part_is_exact() -> None:
    """A type learnt with a lift of 75 um returns what its part injects, with the drawing's injector too."""
    truth = INJECTOR.with_values({LIFT: 75e-6})
    points = injected(truth, (160.0, 300.0), (80.0, 700.0))
    catalogue = measured(INJECTOR.values[LIFT], "drawing")  # as the catalogue's own lift is marked: it is no part's
    for adapted in (
        cr.parts.adapt(type_with_lift(), points),
        cr.parts.adapt(type_with_lift(), points, injector=INJECTOR),
        cr.parts.adapt(type_with_lift(catalogue), points),
    ):
        assert np.asarray(adapted.before) == pytest.approx(points.quantity, rel=1e-9)  # the same simulation
        assert adapted.injector.values[LIFT] == 75e-6
        assert adapted.injector.sources[LIFT] == ("F", 'type "lino": gauge of part 1')


def test_a_measured_value_of_the_part_stays_and_is_reported() -> None:
    points = injected(measured(60e-6), (120.0, 700.0))
    with pytest.warns(RuntimeWarning, match=r"valve\.lift .*60 um.*75 um"):
        adapted = cr.parts.adapt(type_with_lift(), points, injector=measured(60e-6))
    assert adapted.injector.values[LIFT] == 60e-6


def test_a_study_with_the_type_has_the_fixed_value_unless_it_states_its_own(study_file: Edit, tmp_path: Path) -> None:
    cr.parts.dump_type(type_with_lift(), tmp_path / "t.toml")
    named = ("seed = 1", 'seed = 1\ntype = "t.toml"')
    study = cr.load_study(study_file(named))
    assert study.injector.values[LIFT] == 75e-6
    assert LIFT in study.fixed  # so that the next type has it too
    own = cr.load_study(study_file(named, (UPPER, UPPER + FIXED_TABLE.format("50 um"))))
    assert own.injector.values[LIFT] == 50e-6


def test_a_joint_fit_keeps_the_fixed_value_of_its_parts(study_file: Edit, tmp_path: Path) -> None:
    study_file((UPPER, UPPER + FIXED_TABLE.format("75 um")))
    parts = 'part = [{ name = "a", study = "study.toml" }, { name = "b", study = "study.toml" }]\n'
    head = 'format = "commonrail-family/1"\nname = "t"\ntitle = "two"\n'
    (tmp_path / "family.toml").write_text(head + parts, encoding="utf-8")
    family = load_family(tmp_path / "family.toml")
    joint = {name: 1.0 for name in family.space.names} | {p.name: p.reference for p in family.space.parameters}
    found = type_from_fit(family, joint, dict.fromkeys(joint))
    assert [(v.name, v.value) for v in found.fixed] == [(LIFT, 75e-6)]


def test_an_injector_that_is_not_the_catalogues_is_not_named_so(tmp_path: Path) -> None:
    """A changed value under a name of the catalogue would be lost in the file."""
    changed = replace(small_type(), injector=INJECTOR.with_values({LIFT: 70e-6}))
    cr.parts.dump_type(changed, tmp_path / "t.toml")
    assert cr.parts.load_type(tmp_path / "t.toml").injector is None


@pytest.mark.parametrize("table", ["fixed", "parameter"])
def test_a_parameter_that_the_variant_does_not_read_is_refused(study_file: Edit, table: str) -> None:
    stated = f'[[{table}]]\nname = "rail.volume"\n'
    stated += 'value = "20 cm3"\n' if table == "fixed" else 'lower = "10 cm3"\nupper = "30 cm3"\n'
    with pytest.raises(cr.errors.ConfigurationError, match=r"name: .*rail\.volume.*@volume"):
        cr.load_study(study_file((UPPER, UPPER + stated)))
