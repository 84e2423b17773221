"""Truths of the virtual bench from TOML: what the files say is read, and each fault is one sentence with its place."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import pytest

from commonrail.base.choices import Boundary
from commonrail.base.errors import CommonrailError, InputError
from commonrail.plugins.paper.bench import Friction, Scatter, Sensor
from commonrail.plugins.paper.bench_file import load_truth, truth_catalogue
from commonrail.readers.toml import UNSTATED
from tests.readers.conftest import editor
from tests.refused import refused

TRUTHS = resources.files("commonrail.plugins.paper") / "truths"
PAGE = Path(__file__).resolve().parents[3] / "docs" / "howto" / "virtual-bench.md"

Edit = Callable[..., Path]


@pytest.fixture
def truth_file(tmp_path: Path) -> Edit:
    """Write the default truth with some parts replaced; returns its path."""
    return editor(TRUTHS / "virtual-lino-2016.toml", tmp_path / "mine.toml")


def test_the_catalogue_has_two_truths_that_load() -> None:
    assert truth_catalogue() == ["virtual-lino-2016", "virtual-lino-2016-ideal"]
    for name in truth_catalogue():
        truth = load_truth(name)
        assert (truth.name, truth.injector) == (name, "virtual-lino-2016")
        assert truth.text == (TRUTHS / f"{name}.toml").read_text(encoding="utf-8")
        assert "SYNTHETIC" in truth.text


def test_the_default_truth_is_what_its_file_says() -> None:
    truth = load_truth("virtual-lino-2016")
    optimal = (3.03e8, 8.26e7, 8.35e7, 1.41e8, 1.05e8, 3.50e8, 6.44e7)  # Table 1
    assert tuple(truth.values[f"plunger_needle.k{i}"] for i in range(1, 8)) == optimal
    assert truth.values["rail.volume"] == 40e-6
    assert truth.boundary is Boundary.VOLUME
    assert (truth.resolution.cells, truth.resolution.method) == ((480, 120), "explicit")
    assert truth.resolution.step == pytest.approx(5e-8, rel=1e-15)
    assert truth.friction.coulomb == (1.5, 0.5, 0.3, 1.0, 1.0, 0.3, 1.5, 1.0, 0.0)
    assert truth.friction.viscous == (1.0, 0.3, 0.2, 0.6, 0.6, 0.2, 1.0, 0.6, 0.0)
    assert truth.rate_meter == Sensor(60e3, 0.3e-6, 0.01e-6)
    assert truth.rail_sensor == Sensor(100e3, 0.1e6, 0.01e6)
    assert truth.scatter == Scatter(0.3e6, 0.5e-6, 0.3)


def test_the_ideal_truth_has_only_the_stiffness_and_the_rail() -> None:
    ideal, default = load_truth("virtual-lino-2016-ideal"), load_truth("virtual-lino-2016")
    assert (ideal.friction, ideal.scatter) == (Friction(), Scatter())
    assert ideal.rate_meter == ideal.rail_sensor == Sensor(math.inf, 0.0, 0.0)
    assert (ideal.values, ideal.boundary, ideal.resolution) == (default.values, default.boundary, default.resolution)


def test_every_number_has_mark_and_source() -> None:
    sources = load_truth("virtual-lino-2016").sources
    assert len(sources) == 7 + 3 + 2 + 6 + 3
    assert sources["plunger_needle.k6"] == ("F", "Lino et al. 2016, Table 1, optimal")
    assert sources["rate_meter.noise"].text.startswith("chosen so that J")
    assert {name for name in sources if name.startswith("scatter.")} == {
        "scatter.rail_pressure",
        "scatter.energising_time",
        "scatter.boost_voltage",
    }
    assert all(source.text != UNSTATED.text for source in sources.values())


def test_a_file_of_the_user_is_read(truth_file: Edit) -> None:
    path = truth_file(('noise = "0.1 MPa"', 'noise = "2 bar"'), ('rail_boundary = "volume"', 'rail_boundary = "ideal"'))
    for truth in (load_truth(path), load_truth(str(path))):
        assert truth.name == "mine"
        assert truth.rail_sensor.noise == 2e5
        assert truth.boundary is Boundary.IDEAL


def test_an_injector_beside_the_truth_is_found(truth_file: Edit, tmp_path: Path) -> None:
    catalogue = resources.files("commonrail.physics") / "catalogue" / "injectors"
    (tmp_path / "own.toml").write_text((catalogue / "virtual-lino-2016.toml").read_text(encoding="utf-8"))
    path = truth_file(('injector = "virtual-lino-2016"', 'injector = "own.toml"'))
    assert load_truth(path).injector == str(tmp_path / "own.toml")


BAD = [
    (("commonrail-truth/1", "commonrail-study/1"), r"mine.toml: this is a study file"),
    (("[friction]", "[frictions]"), r'mine.toml: there is no key "frictions" \(did you mean "friction"\?\)'),
    (('injector = "virtual-lino-2016"', 'injector = "virtual-lino"'), 'mine.toml, injector: There is no injector "vir'),
    (('injector = "virtual-lino-2016" #', "#"), "mine.toml, injector: this key is missing; add injector = "),
    (('injector = "virtual-lino-2016"', "injector = 3"), "mine.toml, injector: this must be a text in quotes"),
    (("[values.rail]", "[values.rial]"), r'mine.toml, values: there is no key "rial" \(did you mean "rail"\?\)'),
    (('volume = "40 cm3"', 'volumes = "40 cm3"'), r'mine.toml, values.rail: there is no key "volumes" \(did you mean'),
    (('volume = "40 cm3"', 'volume = "40 cm2"'), 'mine.toml, values.rail.volume: "40 cm2" is an area'),
    (('volume = "40 cm3"', "volume = 40"), 'mine.toml, values.rail.volume: "40.0" has no unit'),
    (
        ('volume = "40 cm3"', 'volume = "-40 cm3"'),
        "mine.toml, values.rail.volume: the volume of the rail must be greater",
    ),
    (('k1 = "3.03e8 N/m"', 'k1 = "nan N/m"'), "mine.toml, values.plunger_needle.k1: .* is not finite"),
    (
        ('"0.3 N", "1.5 N", "1 N", "0 N"]', '"0.3 N", "1.5 N"]'),
        "mine.toml, friction.coulomb: this must be a list of 9 v",
    ),
    (('["1.5 N", "0.5 N"', '["1.5 N", "-0.5 N"'), r"mine.toml, friction.coulomb\[2\]: .* must be zero or greater"),
    (('["1.5 N", "0.5 N"', '["1.5 N", "0.5 Pa"'), r"mine.toml, friction.coulomb\[2\]: \"0.5 Pa\" is a pressure"),
    (('["1.5 N", "0.5 N"', '["1.5 N", [1]'), r'mine.toml, friction.coulomb\[2\]: "\[1\]" is not a number with a unit'),
    (
        ('rail_boundary = "volume"', 'rail_boundary = "big"'),
        'mine.toml, rail_boundary: "big" is not known; write one of',
    ),
    (
        ("feed_pipe_cells = 480", "feed_pipe_cells = 4.5"),
        "mine.toml, numerics.feed_pipe_cells: this must be a whole num",
    ),
    (("feed_pipe_cells = 480", "feed_pipe_cells = true"), "numerics.feed_pipe_cells: this must be a whole .* not True"),
    (
        ("return_line_cells = 120", "return_line_cells = 100000"),
        "numerics.return_line_cells: .* from 10 to 2000, not 1000",
    ),
    (
        ('time_step = "0.05 us"', 'time_step = "1 us"'),
        "numerics.time_step: the time step must lie between 1 ns and 100",
    ),
    (
        ('bandwidth = "60 kHz"', 'bandwidth = "0 kHz"'),
        "mine.toml, rate_meter.bandwidth: the corner frequency .* greater",
    ),
    (
        ('noise = "0.1 MPa"', 'noise = "-0.1 MPa"'),
        "mine.toml, rail_sensor.noise: the standard deviation .* zero or greater",
    ),
    (('noise = "0.1 MPa"', 'noise = "0.1 mm3/ms"'), 'mine.toml, rail_sensor.noise: "0.1 mm3/ms" is a volume flow'),
    (
        ('energising_time = "0.5 us"', 'energising_times = "0.5 us"'),
        'mine.toml, scatter: there is no key "energising_tim',
    ),
    (("[scatter] #", "[scatter.deep] #"), 'mine.toml, scatter: there is no key "deep"'),
    (("[scatter] #", "[[scatter]] #"), r"mine.toml, scatter: this must be a table, written \[scatter\]"),
    (('title = "', 'title = 3 # "'), "mine.toml, title: this must be a text in quotes"),
    (('injector = "virtual-lino-2016"', 'injector = "cri2-16.toml"'), "mine.toml, injector: .*there is no such file"),
]


@pytest.mark.parametrize(("edit", "words"), BAD, ids=[words[:60] for _, words in BAD])
def test_a_fault_is_one_sentence_with_file_and_key(truth_file: Edit, edit: tuple[str, str], words: str) -> None:
    with pytest.raises(CommonrailError, match=words) as raised:
        load_truth(truth_file(edit))
    message = str(raised.value)
    assert raised.value.exit_code == 2
    assert str(truth_file(edit)) in message
    assert "\n" not in message
    assert message.endswith(".")


def test_a_truth_that_does_not_exist_is_refused() -> None:
    with pytest.raises(InputError, match=r'"virtual-lino" .*"virtual-lino-2016"\?.*-ideal'):
        load_truth("virtual-lino")
    with refused(InputError, "missing-file", "none.toml"):
        load_truth("none.toml")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('variant = "flexible"', 'variant = "rigid"', "friction: .*rigid body"),  # it needs nine masses
        ('drive_kind = "pwm"', 'drive_kind = "current trace"', "injector: .*measured trace"),
    ],
)
def test_an_injector_that_the_bench_cannot_take_is_refused(
    truth_file: Edit, tmp_path: Path, old: str, new: str, words: str
) -> None:
    catalogue = resources.files("commonrail.physics") / "catalogue" / "injectors"
    editor(catalogue / "virtual-lino-2016.toml", tmp_path / "own.toml")((old, new))
    path = truth_file(('injector = "virtual-lino-2016"', 'injector = "own.toml"'))
    with pytest.raises(InputError, match=rf"mine\.toml, {words}"):
        load_truth(path)


def test_the_truth_may_be_driven_with_a_free_wheel(truth_file: Edit, tmp_path: Path) -> None:
    catalogue = resources.files("commonrail.physics") / "catalogue" / "injectors"
    editor(catalogue / "virtual-lino-2016.toml", tmp_path / "own.toml")(
        ('drive_kind = "pwm"', 'drive_kind = "free-wheel"')
    )
    truth = load_truth(truth_file(('injector = "virtual-lino-2016"', 'injector = "own.toml"')))
    assert truth.injector == str(tmp_path / "own.toml")


def test_the_howtos_example_is_accepted(tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    path = tmp_path / "my-truth.toml"
    path.write_text(example, encoding="utf-8")
    truth = load_truth(path)
    assert truth.rate_meter.noise == 0.5e-6
    assert truth.sources["plunger_needle.k1"].mark == "E"
