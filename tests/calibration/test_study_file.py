"""Studies from TOML: what is read, and one sentence with file and dotted key for each fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from commonrail.base.choices import Precision
from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.calibration.optimisers.evolution import InitialSampling, Treatment
from commonrail.calibration.study_file import load_study
from commonrail.data.base import Role
from tests.refused import refused

Edit = Callable[..., Path]

UPPER = "upper = 0.95\n"


def test_study_is_read(study_file: Edit) -> None:
    path = study_file()
    study = load_study(str(path))
    assert study.title == "My first calibration"
    assert study.injector.name == "my-injector"
    assert (study.seed, study.time_step) == (1, 1e-6)
    assert [d.role for d in study.data] == [Role.FIT]
    assert study.text == path.read_text(encoding="utf-8")
    assert study.note == "The example's data are synthetic."
    assert study.synthetic.startswith("The injector is an example")


def test_precision_is_double_unless_said_otherwise(study_file: Edit) -> None:
    assert load_study(study_file()).precision is Precision.F64
    single = study_file(('time_step = "auto"', 'time_step = "auto"\nprecision = "f32"'))
    assert load_study(single).precision is Precision.F32


def test_percent_bounds_follow_eq_16(study_file: Edit) -> None:
    path = study_file(
        ('below = "10 %" # bounds around the injector\'s value, Eq. (16)\nabove = "10 %"', 'below="20%"\nabove="150 %"')
    )
    parameter = load_study(path).space.parameters[0]
    # (1 - 0.2) and (1 + 1.5) times 0.215 mm; 1e-15: rounding of the product
    assert (parameter.lower, parameter.upper) == pytest.approx((0.172e-3, 0.5375e-3), rel=1e-15)
    assert parameter.reference == 0.215e-3


def test_percent_bounds_around_a_given_reference(study_file: Edit) -> None:
    path = study_file(
        (UPPER, UPPER + '[[parameter]]\nname = "valve.mass"\nreference = "4 g"\nbelow = "50 %"\nabove = "50 %"\n')
    )
    parameter = load_study(path).space.parameters[3]
    assert (parameter.lower, parameter.reference, parameter.upper) == pytest.approx((2e-3, 4e-3, 6e-3), rel=1e-15)


def test_bounds_outright(study_file: Edit) -> None:
    text = '[[parameter]]\nname = "valve.lift"\nlower = "40 um"\nupper = "0.08 mm"\nscale = "log"\n'
    text += 'mark = "M"\nsource = "drawing"\n'
    parameter = load_study(study_file((UPPER, UPPER + text))).space.parameters[3]
    assert (parameter.lower, parameter.upper, parameter.unit) == (40e-6, 80e-6, "m")
    assert (parameter.scale, parameter.mark, parameter.source) == ("log", "M", "drawing")


def test_mark_and_source_are_those_of_the_injector_if_not_given(study_file: Edit) -> None:
    parameter = load_study(study_file()).space.parameters[0]
    assert (parameter.mark, parameter.source) == ("E", "example")


def test_constraints_become_rows(study_file: Edit) -> None:
    order = '[constraints]\norder = ["control_chamber.z_hole_diameter < control_chamber.a_hole_diameter"]\n'
    linear = 'linear = ["2*nozzle.discharge_maximum <= 1.8"]\n'
    space = load_study(study_file(("[optimiser]", order + linear + "[optimiser]"))).space
    np.testing.assert_array_equal(space.rows.matrix, [[-1.0, 1.0, 0.0], [0.0, 0.0, -2.0]])
    assert space.rows.strict_rows.tolist() == [True, False]


def test_optimiser_settings(study_file: Edit) -> None:
    given = 'crossover = 0.9\nfactor = [0.5, 0.9]\ntreatment = "resample"\ninitial = "uniform"\n'
    given += "redraws = 3\npolish_iterations = 7\n"
    method = load_study(study_file(("generations = 30\n", f"generations = 30\n{given}"))).method
    settings = method.evolution
    assert (settings.members, settings.generations, settings.crossover) == (24, 30, 0.9)
    assert (settings.factor, settings.redraws) == ((0.5, 0.9), 3)
    assert (settings.treatment, settings.initial) == (Treatment.RESAMPLE, InitialSampling.UNIFORM)
    assert (method.polish, method.polish_iterations) == (3, 7)


def test_a_search_may_start_from_the_injectors_own_values(study_file: Edit) -> None:
    method = load_study(study_file(("generations = 30\n", 'generations = 30\ninitial = "reference"\n'))).method
    assert method.evolution.initial is InitialSampling.REFERENCE


def test_without_settings_the_optimiser_is_the_papers(study_file: Edit) -> None:
    path = study_file(("members = 24\ngenerations = 30\npolish = 3\n", ""))
    method = load_study(path).method
    assert (method.evolution.members, method.evolution.generations, method.polish) == (50, 70, 0)


def test_injector_of_the_catalogue(study_file: Edit) -> None:
    study = load_study(study_file(('injector = "injector.toml"', 'injector = "virtual-lino-2016"')))
    assert study.injector.name == "virtual-lino-2016"


def test_paths_start_at_the_studys_folder(study_file: Edit, monkeypatch: pytest.MonkeyPatch) -> None:
    path = study_file()
    (path.parent / "elsewhere").mkdir()
    monkeypatch.chdir(path.parent / "elsewhere")
    assert len(load_study("../study.toml").data) == 1


MASS = '[[parameter]]\nname = "valve.mass"\n'
DATA = '[[data]]\nkind = "rate"'
TWIN = """[[data]]
name = "160 MPa"
kind = "rate"
role = "fit"
file = "data/evi.csv"
rail_pressure = "1 MPa"
cylinder_pressure = "1 MPa"
return_pressure = "1 MPa"
energising_time = "1 ms"

"""
FAULTS: dict[str, tuple[type[CommonrailError], str, str, str]] = {
    "not TOML": (InputError, "seed = 1", "seed = ", "syntax line 7"),
    "no format": (InputError, 'format = "commonrail-study/1"', "", "wrong-format"),
    "other format": (
        InputError,
        "study/1",
        "study/2",
        "wrong-format",
    ),
    "unknown key": (
        InputError,
        "seed = 1",
        "sead = 1",
        "unknown-key",
    ),
    "unknown data key": (
        InputError,
        "window =",
        "windw =",
        "unknown-key data[1]",
    ),
    "unknown parameter key": (
        InputError,
        "upper = ",
        "uper = ",
        "unknown-key parameter[3]",
    ),
    "unknown optimiser key": (
        InputError,
        "members =",
        "member =",
        "unknown-key optimiser",
    ),
    "missing key": (
        InputError,
        'cylinder_pressure = "5 MPa"',
        "",
        "missing data[1].cylinder_pressure",
    ),
    "no title": (
        InputError,
        'title = "My first calibration"',
        'title = ""',
        "string_too_short title",
    ),
    "text for number": (InputError, "seed = 1", 'seed = "1"', "int_type seed"),
    "number for text": (
        InputError,
        'file = "data/evi.csv"',
        "file = 3",
        "string_type data[1].file",
    ),
    "negative seed": (InputError, "seed = 1", "seed = -1", "greater_than_equal seed"),
    "weight": (
        InputError,
        'role = "fit"',
        'role = "fit"\nweight = 0',
        "greater_than data[1].weight",
    ),
    "data no list": (
        InputError,
        "[[data]]",
        "[data]",
        "list_type data",
    ),
    "role": (
        InputError,
        'role = "fit"',
        'role = "fitt"',
        "literal_error data[1].role",
    ),
    "kind": (
        InputError,
        'kind = "rate"',
        'kind = "evi"',
        "unknown-name data[1]",
    ),
    "treatment": (
        InputError,
        "members = 24",
        'treatment = "mend"',
        "enum optimiser.treatment",
    ),
    "reference outside the constraints": (
        ConfigurationError,
        "[optimiser]",
        '[constraints]\norder = ["control_chamber.a_hole_diameter < control_chamber.z_hole_diameter"]\n'
        '[optimiser]\ninitial = "reference"\n',
        "infeasible-start optimiser.initial",
    ),
    "factor": (InputError, "members = 24", "factor = [0.4]", "too_short optimiser.factor"),
    "polish": (InputError, "polish = 3", "polish = -1", "greater_than_equal optimiser.polish"),
    "value no text": (
        InputError,
        'rail_pressure = "160 MPa"',
        "rail_pressure = true",
        "not-a-number data[1].rail_pressure",
    ),
    "no injector": (
        InputError,
        "injector.toml",
        "injectr.toml",
        "missing-file injector",
    ),
    "no catalogue injector": (InputError, '"injector.toml"', '"cri216"', "unknown-name injector"),
    "time step unit": (
        InputError,
        '"auto"',
        '"1 um"',
        "wrong-unit time_step",
    ),
    "time step": (ConfigurationError, '"auto"', '"1 s"', "out-of-range time_step"),
    "precision": (
        InputError,
        'time_step = "auto"',
        'time_step = "auto"\nprecision = "single"',
        "enum precision",
    ),
    "precision no text": (
        InputError,
        'time_step = "auto"',
        'time_step = "auto"\nprecision = 32',
        "enum precision",
    ),
    "same name twice": (
        InputError,
        DATA,
        TWIN + DATA,
        "repeated data[2].name",
    ),
    "unknown parameter": (
        InputError,
        '"nozzle.discharge_maximum"',
        '"nozzle.discharge_max"',
        "unknown-name parameter[3].name",
    ),
    "parameter twice": (
        ConfigurationError,
        UPPER,
        UPPER + '[[parameter]]\nname = "nozzle.discharge_maximum"\nlower = 0.7\nupper = 0.9\n',
        "repeated",
    ),
    "no bounds": (InputError, UPPER, UPPER + MASS, "conflict parameter[4]"),
    "mixed bounds": (
        InputError,
        UPPER,
        UPPER + MASS + 'below = "5 %"\nupper = "9 g"\n',
        "conflict parameter[4]",
    ),
    "bounds unit": (
        InputError,
        UPPER,
        UPPER + MASS + 'lower = "1 mm"\nupper = "9 g"\n',
        "wrong-unit parameter[4].lower",
    ),
    "percent sign": (
        InputError,
        UPPER,
        UPPER + MASS + 'below = 50\nabove = "50 %"\n',
        "no-percent parameter[4].below",
    ),
    "percent range": (
        ConfigurationError,
        UPPER,
        UPPER + MASS + 'below = "120 %"\nabove = "50 %"\n',
        "out-of-range parameter[4]",
    ),
    "zero bound": (
        ConfigurationError,
        UPPER,
        UPPER + MASS + 'below = "100 %"\nabove = "50 %"\n',
        "bound-out-of-range parameter[4]",
    ),
    "crossed bounds": (
        ConfigurationError,
        UPPER,
        UPPER + MASS + 'lower = "9 g"\nupper = "1 g"\n',
        "wrong-bounds parameter[4]",
    ),
    "reference outside": (
        ConfigurationError,
        UPPER,
        UPPER + MASS + 'lower = "1 g"\nupper = "4 g"\n',
        "start-outside parameter[4]",
    ),
    "temperature outside": (
        ConfigurationError,
        UPPER,
        UPPER + '[[parameter]]\nname = "fuel.temperature"\nlower = "0 degC"\nupper = "90 degC"\n',
        "out-of-range parameter[4]",
    ),
    "unknown in constraint": (
        InputError,
        "[optimiser]",
        '[constraints]\norder = ["valve.mass < valve.lift"]\n[optimiser]',
        "not-free",
    ),
    "infeasible": (
        ConfigurationError,
        "[optimiser]",
        '[constraints]\nlinear = ["nozzle.discharge_maximum > 1"]\n[optimiser]',
        "infeasible",
    ),
    "members": (ConfigurationError, "members = 24", "members = 3", "out-of-range optimiser"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(study_file: Edit, fault: str) -> None:
    kind, old, new, message = FAULTS[fault]
    path = study_file((old, new))
    with refused(kind, message) as caught:
        load_study(path)
    assert ".toml" in str(caught.value) or fault == "no catalogue injector"
    assert str(caught.value).count(str(path)) <= 1
    assert "\n" not in str(caught.value)


def test_missing_study(tmp_path: Path) -> None:
    with refused(InputError, "missing-file", "study.toml"):
        load_study(tmp_path / "study.toml")


def test_author_and_logo_are_kept_for_the_report(study_file: Edit) -> None:
    study = load_study(study_file())
    assert (study.author, study.logo) == ("", "")
    path = study_file(("seed = 1 ", 'author = "A. Author"\nlogo = "logo.png"\nseed = 1 '))
    (path.parent / "logo.png").write_bytes(b"\x89PNG\r\n\x1a\nrest")
    study = load_study(path)
    assert study.author == "A. Author"
    assert study.logo == "data:image/png;base64,iVBORw0KGgpyZXN0"
    assert path.parent / "logo.png" in study.files


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"GIF89a", "no-picture logo"), (b"\xff\xd8\xff" * 70_000, "too-large")],
)
def test_a_logo_that_is_no_picture_or_too_large_is_refused(study_file: Edit, content: bytes, words: str) -> None:
    path = study_file(("seed = 1 ", 'logo = "logo.png"\nseed = 1 '))
    (path.parent / "logo.png").write_bytes(content)
    with refused(InputError, words):
        load_study(path)
