"""Family files: parts, what they share, and faults with their places."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import commonrail as cr
from commonrail.plugins.family.drawn import FLOW
from commonrail.plugins.family.study import Share, Shared, load_family
from commonrail.plugins.new.study import write_new

Z, A, C_D = "control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter", "nozzle.discharge_maximum"
TEXT = """format = "commonrail-family/1"
name = "lino"
title = "Two parts"
flow = "4 %"
per_part = ["nozzle.discharge_*"]
part = [{ name = "one", study = "a/study.toml" }, { name = "two", study = "b/study.toml" }]

[[around]]
name = "control_chamber.z_hole_diameter"
spread = "2 um"
"""

Edit = Callable[..., Path]


@pytest.fixture
def family_file(tmp_path: Path) -> Edit:
    """Write the family of two scaffolded studies with some parts of the text replaced; returns its path."""

    def write(*replacements: tuple[str, str]) -> Path:
        for folder in ("a", "b"):
            if not (tmp_path / folder).exists():
                write_new(tmp_path / folder)
        text = TEXT
        for old, new in replacements:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / "family.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_family_is_read_with_what_its_parts_share(family_file: Edit) -> None:
    family = load_family(family_file())
    own = family.parts["one"].space.names
    assert own[-1] == FLOW
    assert {Z, A, C_D} <= set(own)
    assert family.shared == {FLOW: Shared(Share.PER_PART), C_D: Shared(Share.PER_PART), Z: Shared(Share.AROUND, 2e-6)}
    single = [f"{name} of part {part}" for part in ("one", "two") for name in (Z, C_D, FLOW)]
    assert set(family.space.names) == {*own, *single} - {C_D, FLOW}
    assert family.method.evolution == cr.fit.StagedSettings()


def test_a_joint_point_gives_each_part_its_own(family_file: Edit) -> None:
    family = load_family(family_file())
    x = family.space.reference.copy()
    x[family.space.names.index(f"{Z} of part two")] = 1.5
    parts = [
        dict(zip(study.space.names, family.sharing.of_part(k, x), strict=True))
        for k, study in enumerate(family.parts.values())
    ]
    common = family.space.reference[family.space.names.index(Z)]
    assert parts[0][Z] == common
    assert parts[1][Z] == pytest.approx(common + 3e-6, rel=1e-12)
    assert parts[0][A] == parts[1][A]
    assert np.all(family.sharing.of_part(1, 10.0 * x) <= family.parts["two"].space.upper)


def test_spreads_of_priors_are_the_family_s_own(family_file: Edit) -> None:
    alone = load_family(family_file())
    file = family_file(("[[around]]", '[[prior]]\nname = "control_chamber.a_hole*"\nspread = "7 um"\n\n[[around]]'))
    family = load_family(file)
    for space in (family.space, *(study.space for study in family.parts.values())):
        own = next(p for p in space.parameters if p.name == A)
        assert own.prior == cr.Prior(own.reference, 7e-6, own.source)  # the studies have none: about their start
    others = [p for p in family.space.parameters if p.name != A]
    assert others == [p for p in alone.space.parameters if p.name != A]


def test_the_flow_has_the_spread_of_the_area(family_file: Edit) -> None:
    study = load_family(family_file()).parts["two"]
    flow = study.space.parameters[-1]
    drawn = study.injector.values[FLOW]
    assert flow.prior is not None
    assert (flow.prior.value, flow.prior.sigma) == (drawn, pytest.approx(0.02 * drawn))
    assert FLOW not in load_family(family_file(('flow = "4 %"\n', ""))).parts["two"].space.names


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name = "two"', 'name = "one"', "part[2].name: "),
        ('name = "two"', 'name = "../two"', "part[2].name: "),
        ('"nozzle.discharge_*"', '"nozle.*"', "per_part[1]: "),
        ('spread = "2 um"', 'spread = "2 N"', "around[1].spread: "),
        ('spread = "2 um"', 'spread = "0 um"', "around[1].spread: "),
        ('name = "control_chamber.z_hole_diameter"', 'name = "nozzle.discharge_maximum"', "around[1].name: "),
        ("[[around]]", f'[[prior]]\nname = "{FLOW}"\nspread = "1 um"\n[[around]]', "prior[1].name: "),
        ('study = "b/study.toml"', 'study = "../study.toml"', "part[2].study: "),
        ("[[around]]", '[[prior]]\nname = "nozle.*"\nspread = 1\n\n[[around]]', "prior[1].name: "),
        ("[[around]]", f'[[prior]]\nname = "{A}"\nspread = "1 N"\n\n[[around]]', "prior[1].spread: "),
        ("commonrail-family/1", "commonrail-study/1", "commonrail-study/1"),
        (', { name = "two", study = "b/study.toml" }', "", "part: "),
    ],
)
def test_a_bad_family_is_refused_with_its_place(family_file: Edit, old: str, new: str, words: str) -> None:
    path = family_file((old, new))
    with pytest.raises(cr.CommonrailError) as found:
        load_family(path)
    assert words in str(found.value)
    assert str(path) in str(found.value)


def test_a_known_type_gives_starts_and_priors(family_file: Edit, tmp_path: Path) -> None:
    from commonrail.plugins.family.injector_type import dump_type

    alone = load_family(family_file())
    lower, upper = (next(p for p in alone.space.parameters if p.name == A).__dict__[key] for key in ("lower", "upper"))
    value, spread = 0.5 * (lower + upper), 0.1 * (upper - lower)
    known = cr.parts.InjectorType(
        "lino", "made up", (cr.parts.TypeParameter(A, value, spread, lower, upper, "F", "made up"),)
    )
    dump_type(known, tmp_path / "known.toml")
    family = load_family(family_file(('name = "lino"', 'name = "lino"\ntype = "known.toml"')))
    for space in (family.space, *(study.space for study in family.parts.values())):
        own = next(p for p in space.parameters if p.name == A)
        assert (own.reference, own.prior) == (value, cr.Prior(value, spread, "made up"))
    assert tmp_path / "known.toml" in family.files  # and so comes into the run folder
    others = [p for p in family.space.parameters if p.name != A]
    assert others == [p for p in alone.space.parameters if p.name != A]


def test_bounds_of_a_common_value_that_exclude_one_another_are_refused(family_file: Edit) -> None:
    """A part would silently have another value than the common one."""
    path = family_file(('per_part = ["nozzle.discharge_*"]\n', ""))
    study = path.parent / "b" / "study.toml"
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace("lower = 0.70", "reference = 0.97\nlower = 0.96").replace("0.95", "0.99"))
    with pytest.raises(cr.CommonrailError):
        load_family(path)
