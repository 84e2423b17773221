"""Injectors from TOML: what is read, and one sentence with file and key for each fault."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.choices import Actuation, Body, Boundary, Drive
from commonrail.base.errors import InputError
from commonrail.physics.injector import Source, parameter_quantities
from commonrail.physics.variants import Variant
from commonrail.readers.injector import injector_catalogue, load_injector
from commonrail.readers.injector_writer import dump_injector
from commonrail.readers.toml import UNSTATED
from tests.refused import refused

from .conftest import TEMPLATES, changed

Edit = Callable[..., Path]


def test_catalogue_lists_what_can_be_loaded() -> None:
    drawn = ["cri2-16", "crin", "direct-acting-kr", "virtual-lino-2016"]
    assert injector_catalogue() == sorted([*drawn, "cri1-0", "cri2-0", "cri2-1", "cri2-2", "crin1", "crin2", "crin3"])


@pytest.mark.parametrize("name", injector_catalogue())
def test_catalogue_states_mark_and_source_of_every_value(name: str) -> None:
    injector = load_injector(name)
    assert injector.name == name
    assert set(injector.sources) == set(injector.quantities)
    assert {source.mark for source in injector.sources.values()} <= {"M", "C", "F", "E"}
    assert all(source.text and source.text != UNSTATED.text for source in injector.sources.values())


def test_virtual_injector_has_the_papers_theoretical_stiffness() -> None:
    injector = load_injector("virtual-lino-2016")
    # Table 1 of the paper, row "theoretical" [N/m]
    table = [1.22e8, 8.08e7, 8.21e7, 9.44e7, 9.43e7, 1.86e8, 5.82e7]
    assert [injector.values[f"plunger_needle.k{i}"] for i in range(1, 8)] == table
    assert injector.sources["plunger_needle.k1"].mark == "F"
    assert injector.synthetic


def test_virtual_injectors_masses_follow_from_its_stiffness() -> None:
    injector = load_injector("virtual-lino-2016")
    lengths = [14e-3] * 5 + [15e-3, 20e-3]
    for i, length in enumerate(lengths, start=1):
        section = injector.values[f"plunger_needle.k{i}"] * length / 210e9
        # 5e-3 g: the masses are rounded to the milligram, the lengths of the drawing are round numbers
        assert injector.values[f"plunger_needle.m{i}"] == pytest.approx(7850.0 * section * length, abs=5e-6)


def test_real_injector_marks_what_is_measured() -> None:
    injector = load_injector("cri2-16")
    measured = {name for name, source in injector.sources.items() if source.mark == "M"}
    assert measured == {
        "fuel.temperature",
        "rail.volume",
        "rail.throttle_diameter",
        "feed_pipe.length",
        "feed_pipe.diameter",
        "valve.lift",
        "solenoid.resistance",
        "drive.hold_current",
        "plunger_needle.stop_lift",
        "nozzle.holes",
        "nozzle.hole_diameter",
    }
    assert injector.variant == Variant(Body.FLEXIBLE, Boundary.VOLUME, Drive.REGULATED)


def test_real_injectors_discharge_follows_from_the_catalogue_flow() -> None:
    values = load_injector("cri2-16").values
    section = values["nozzle.holes"] * math.pi / 4 * values["nozzle.hole_diameter"] ** 2
    ideal = section * math.sqrt(2 * 10e6 / 825.0)  # oil of 825 kg/m3 (ISO 4113 at 15 °C), Eq. (4)
    # 0.005: stated to two digits
    assert values["nozzle.discharge_maximum"] == pytest.approx(440e-6 / 30 / ideal, abs=0.005)


def test_heavy_duty_injectors_discharge_follows_from_the_catalogue_flow() -> None:
    values = load_injector("crin").values
    section = values["nozzle.holes"] * math.pi / 4 * values["nozzle.hole_diameter"] ** 2
    ideal = section * math.sqrt(2 * 10e6 / 825.0)
    assert values["nozzle.discharge_maximum"] == pytest.approx(900e-6 / 30 / ideal, abs=0.005)


def test_values_become_si(injector_file: Edit) -> None:
    injector = load_injector(injector_file())
    expected = {
        "control_chamber.z_hole_diameter": 0.215e-3,
        "control_chamber.volume": 18e-9,
        "plunger_needle.spring_stiffness": 35e3,
        "needle_seat.cone_angle": math.pi / 3,
        "nozzle.lift_maximum_slope": 0.25e-12,
        "nozzle.holes": 7.0,
        "fuel.temperature": 353.15,
    }
    # 1e-15: one rounding of the scale, for the degree
    assert {name: injector.values[name] for name in expected} == pytest.approx(expected, rel=1e-15)


def test_mark_and_source_of_key_of_room_and_of_neither(injector_file: Edit) -> None:
    path = injector_file(
        ('volume = "18 mm3"', 'volume = { value = "18 mm3", mark = "M", source = "drawing 4711" }'),
        ('boost_voltage = "65 V"', 'boost_voltage = { value = "65 V", source = "data sheet" }'),
        ('[feed_pipe] # from the inlet to the accumulation volume\nmark = "E"\nsource = "example"', "[feed_pipe]"),
    )
    sources = load_injector(path).sources
    assert sources["control_chamber.volume"] == Source("M", "drawing 4711")
    assert sources["control_chamber.z_hole_diameter"] == Source("E", "example")
    assert sources["drive.boost_voltage"] == Source("E", "data sheet")
    assert sources["feed_pipe.length"] == Source("E", "no source stated")
    assert sources["rail.volume"] == Source("E", "default of commonrail")


def test_what_is_left_out_takes_its_default(injector_file: Edit) -> None:
    values = load_injector(injector_file()).values
    for name, quantity in parameter_quantities().items():
        if name.startswith("rail."):
            assert values[name] == quantity.default


def test_drawing_gives_stiffness_and_mass(injector_file: Edit) -> None:
    values = load_injector(injector_file()).values
    # Eq. (8) by hand, with (radius)² instead of the area of the flow room
    assert values["plunger_needle.k1"] == pytest.approx(210e9 * math.pi * 1.61e-3**2 / 14e-3, rel=1e-14)
    assert values["plunger_needle.k7"] == pytest.approx(210e9 * math.pi * 1.33e-3**2 / 20e-3, rel=1e-14)
    assert values["plunger_needle.m6"] == pytest.approx(7850 * math.pi * 2.055e-3**2 * 15e-3, rel=1e-14)


def test_drawing_is_derived_unless_it_says_otherwise(injector_file: Edit) -> None:
    path = injector_file(('mark = "E"\nsource = "Eq. (8) from the example\'s cylinders"\n', ""))
    assert load_injector(path).sources["plunger_needle.k3"] == Source("F", "Eq. (8) from the drawing")


def test_explicit_stiffness_goes_before_the_drawing(injector_file: Edit) -> None:
    path = injector_file(('plunger_diameter = "4.3 mm"', 'plunger_diameter = "4.3 mm"\nk2 = "9e7 N/m"'))
    injector = load_injector(path)
    assert injector.values["plunger_needle.k2"] == 9e7
    assert injector.sources["plunger_needle.k2"] == Source("E", "example")


def test_variant_is_read(injector_file: Edit) -> None:
    path = injector_file(
        ('variant = "flexible"', 'variant = "rigid"'),
        ('rail_boundary = "ideal"', 'rail_boundary = "volume"'),
        ('drive_kind = "regulated"', 'drive_kind = "current trace"'),
    )
    assert load_injector(path).variant == Variant(Body.RIGID, Boundary.VOLUME, Drive.CURRENT)


def test_name_is_that_of_the_file_if_not_given(injector_file: Edit) -> None:
    path = injector_file(('name = "my-injector"\ntitle = "My injector"\n', ""))
    assert (load_injector(path).name, load_injector(path).title) == ("mine", "mine")


def test_fuel_from_a_file_beside_the_injector(injector_file: Edit, tmp_path: Path) -> None:
    catalogue = Path(str(TEMPLATES)).parents[2] / "physics" / "catalogue" / "fuels" / "n-dodecane.toml"
    (tmp_path / "own.toml").write_text(catalogue.read_text(encoding="utf-8"), encoding="utf-8")
    fuel = load_injector(injector_file(('name = "iso4113"', 'file = "own.toml"'))).fuel
    assert (fuel.name, fuel.title.startswith("n-dodecane")) == ("own", True)


def test_unknown_catalogue_name() -> None:
    with refused(InputError, "unknown-name"):
        load_injector("cri216")


def test_missing_file(tmp_path: Path) -> None:
    with refused(InputError, "missing-file", "absent.toml"):
        load_injector(str(tmp_path / "absent.toml"))


CYLINDER = '    { diameter = "2.66 mm", length = "20 mm" },\n'
GRAMS = 'mass = "5 g"'
FAULTS = {
    "not TOML": ('temperature = "80 degC"', "temperature = 80 degC", "syntax line 18"),
    "no format": ('format = "commonrail-injector/1"', "", "wrong-format"),
    "other format": (
        "commonrail-injector/1",
        "commonrail-injector/9",
        "wrong-format",
    ),
    "unknown table": ("[sac]", "[sack]", "unknown-key"),
    "unknown key": (
        "seat_diameter",
        "seat_diametre",
        "unknown-key valve",
    ),
    "missing key": (
        'seat_diameter = "0.50 mm"',
        "",
        "missing-value",
    ),
    "missing keys": (
        'mass = "5 g"\nlift = "55 um"',
        "",
        "missing-value",
    ),
    "no unit": (GRAMS, "mass = 5", "no-unit valve.mass"),
    "wrong unit": (GRAMS, 'mass = "5 mm"', "wrong-unit valve.mass"),
    "unknown unit": (GRAMS, 'mass = "5 gx"', "unknown-unit valve.mass"),
    "no number": (GRAMS, "mass = [5]", "not-a-number valve.mass"),
    "domain": (GRAMS, 'mass = "-5 g"', "out-of-range valve.mass"),
    "room no table": (
        '[sac]\nvolume = { value = "0.8 mm3", mark = "E", source = "example" }',
        "[[sac]]",
        "model_type sac",
    ),
    "inline without value": (GRAMS, 'mass = { mark = "M" }', "missing valve.mass"),
    "inline unknown key": (GRAMS, 'mass = { val = "5 g" }', "unknown-key valve.mass"),
    "knots do not rise": (
        "holes = 7",
        'holes = 7\nknot_2 = "30 um"',
        "order nozzle.knot_2",
    ),
    "first knot beyond the default of the second": (
        "holes = 7",
        'holes = 7\nknot_1 = "95 um"',
        "order nozzle.knot_1",
    ),
    "half a hole": ("holes = 7", "holes = 7.5", "not-whole"),
    "no such mark": (GRAMS, 'mass = { value = "5 g", mark = "X" }', "unknown-mark valve.mass.mark"),
    "source no text": (GRAMS, 'mass = { value = "5 g", source = 3 }', "string_type valve.mass.source"),
    "variant": (
        'variant = "flexible"',
        'variant = "flex"',
        "unknown-name variant",
    ),
    "drive": ('"regulated"', '"regulatd"', "unknown-name drive_kind"),
    "title": ('title = "My injector"', "title = 3", "string_type title"),
    "fuel unknown": ('"iso4113"', '"iso4114"', "unknown-name fuel.name"),
    "fuel not given": (
        'name = "iso4113"',
        "",
        "missing-value",
    ),
    "fuel given twice": ('name = "iso4113"', 'name = "iso4113"\nfile = "a.toml"', "conflict fuel"),
    "fuel key": ('name = "iso4113"', 'nam = "iso4113"', "unknown-key fuel"),
    "fuel file": ('name = "iso4113"', 'file = "a.toml"', "missing-file fuel.file"),
    "no temperature": ('temperature = "80 degC"', "", "missing-value"),
    "temperature": ('"80 degC"', '"180 degC"', "out-of-range fuel.temperature"),
    "temperature below": ('"80 degC"', '"10 degC"', "out-of-range fuel.temperature"),
    "drawing no table": (
        "[plunger_needle.drawing]",
        "[[plunger_needle.drawing]]",
        "model_type plunger_needle.drawing",
    ),
    "drawing unknown key": ('density = "7850', 'densty = "7850', "unknown-key plunger_needle.drawing"),
    "drawing no modulus": ('elastic_modulus = "210 GPa"', "", "missing plunger_needle.drawing.elastic_modulus"),
    "six cylinders": (CYLINDER, "", "wrong-number plunger_needle.drawing.cylinders"),
    "cylinder no table": (CYLINDER, "    3,\n", "wrong-type plunger_needle.drawing.cylinders[7]"),
    "cylinder no length": (
        CYLINDER,
        '    { diameter = "2.66 mm" },\n',
        "missing plunger_needle.drawing.cylinders[7].length",
    ),
    "cylinder key": (CYLINDER, '    { radius = "1 mm" },\n', "unknown-key plunger_needle.drawing.cylinders[7]"),
    "cylinder size": ('"4.11 mm"', '"0 mm"', "out-of-range plunger_needle.drawing.cylinders[6].diameter"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_named(injector_file: Edit, fault: str) -> None:
    old, new, message = FAULTS[fault]
    with refused(InputError, message) as caught:
        load_injector(injector_file((old, new)))
    text = str(caught.value)
    assert ".toml" in text
    assert text.endswith(".")
    assert "\n" not in text


BOUNDARY = (
    'rail_boundary = "ideal" # ideal: the rail pressure at the inlet is given; volume: a rail behind a throttle, [rail]'
)
HALF = """format = "commonrail-injector/1"
base = "cri2-16"
[valve]
lift = { value = "41 um", mark = "M", source = "drawing 4711" }
"""


def half(tmp_path: Path, *replacements: tuple[str, str]) -> Path:
    """A drawing that states one value, and takes the others from another injector."""
    path = tmp_path / "half.toml"
    path.write_text(changed(HALF, *replacements), encoding="utf-8")
    return path


def test_what_half_a_drawing_does_not_state_is_the_bases_and_is_marked_so(tmp_path: Path) -> None:
    base, found = load_injector("cri2-16"), load_injector(half(tmp_path))
    assert found.values == {**base.values, "valve.lift": 41e-6}
    assert (found.name, found.variant, found.fuel, found.synthetic) == ("half", base.variant, base.fuel, base.synthetic)
    assert found.sources["valve.lift"] == Source("M", "drawing 4711")
    # what was measured of another injector is not measured of this one
    assert {source.mark for name, source in found.sources.items() if name != "valve.lift"} == {"E"}
    assert found.sources["nozzle.holes"].text == f"base cri2-16: M, {base.sources['nozzle.holes'].text}"


def test_a_base_may_be_a_file_beside_and_gives_fuel_and_variant_where_they_are_not_stated(tmp_path: Path) -> None:
    dump_injector(load_injector("virtual-lino-2016"), tmp_path / "type.toml")
    warm = ('"cri2-16"', '"type.toml"\nrail_boundary = "volume"\nfuel = { temperature = "60 degC" }')
    found = load_injector(half(tmp_path, warm))
    assert found.variant == load_injector("virtual-lino-2016").variant._replace(boundary=Boundary.VOLUME)
    assert (found.fuel.name, found.values["fuel.temperature"]) == ("iso4113", pytest.approx(333.15))
    assert found.synthetic  # what rests on a synthetic injector is no measured one


def test_a_base_of_the_catalogue_may_have_a_base_there(tmp_path: Path) -> None:
    base, found = load_injector("cri2-1"), load_injector(half(tmp_path, ('"cri2-16"', '"cri2-1"')))
    assert found.values == {**base.values, "valve.lift": 41e-6}
    assert found.sources["nozzle.holes"].text.startswith("base cri2-1: E, base cri2-16: M, ")


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (('"cri2-16"', '"cri2-166"'), "unknown-name base"),
        (('"cri2-16"', '"direct-acting-kr"'), "unknown-part valve"),
        (('"cri2-16"', '"cri2-16"\nactuation = "direct"'), "conflict base"),
        (('"cri2-16"', '"half.toml"'), "base-of-base base"),
        (('"cri2-16"', '"other.toml"'), "missing-file base"),
        (('"cri2-16"', '"../other.toml"'), "outside-folder base"),
        (
            ('"cri2-16"', '"virtual-lino-2016"\nrail = { volume = "20 cm3" }'),
            "not-read rail.volume",
        ),
    ],
)
def test_a_base_that_does_not_serve_is_refused(tmp_path: Path, edit: tuple[str, str], message: str) -> None:
    with refused(InputError, message):
        load_injector(half(tmp_path, edit))


def test_all_gaps_of_a_drawing_are_told_at_once_with_values_and_marks_of_the_catalogue(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'base = "cri2-16" .*"crin"') as caught:
        load_injector(half(tmp_path, ('base = "cri2-16"\n', "")))
    lacking = {name for name, q in parameter_quantities(Actuation.SERVO).items() if q.default is None} - {"valve.lift"}
    notes = {note.split()[0].rstrip(","): note for note in caught.value.__notes__[:-1]}
    assert set(notes) == lacking | {"fuel.name"}
    holes = "number of nozzle holes: cri2-16 8 M, crin 9 M, virtual-lino-2016 7 E"
    assert notes["nozzle.holes"] == f"  nozzle.holes, {holes}"


RAIL = '\n[rail]\nvolume = { value = "20 cm3", mark = "E", source = "drawing" }\n'


def test_a_table_that_the_default_variant_does_not_read_is_refused(injector_file: Callable[..., Path]) -> None:
    """The file has to say whether its rail is a volume: a table of the rail without that word was ignored."""
    with_rail = ("[feed_pipe]", f"{RAIL.lstrip()}\n[feed_pipe]")
    with refused(InputError, "not-read rail.volume"):
        load_injector(injector_file(with_rail, (BOUNDARY, "")))
    assert load_injector(injector_file(with_rail)).values["rail.volume"] == pytest.approx(20e-6)  # stated: "ideal"


def test_a_flexible_direct_acting_injector_is_refused(tmp_path: Path) -> None:
    dumped = tmp_path / "direct.toml"
    dump_injector(load_injector("direct-acting-kr"), dumped)
    text = dumped.read_text(encoding="utf-8")
    dumped.write_text(text.replace('variant = "rigid"', 'variant = "flexible"'), encoding="utf-8")
    with refused(InputError, "conflict variant"):
        load_injector(dumped)


@pytest.mark.parametrize("name", ["cri2-16", "crin", "cri1-0", "cri2-0", "cri2-1", "cri2-2", "crin1", "crin2", "crin3"])
def test_servo_injectors_plunger_and_needle_are_rods_of_steel(name: str) -> None:
    values = load_injector(name).values
    rods = [(4.3e-3, 14e-3)] * 5 + [(4.0e-3, 20e-3), (2.7e-3, 20e-3)]  # diameters and lengths that the entries state
    for i, (diameter, length) in enumerate(rods, start=1):
        section = math.pi / 4.0 * diameter**2
        # 1e-3: values are stated with four digits
        assert values[f"plunger_needle.m{i}"] == pytest.approx(7850.0 * section * length, rel=1e-3)
        assert values[f"plunger_needle.k{i}"] == pytest.approx(210e9 * section / length, rel=1e-3)
    assert math.degrees(values["needle_seat.cone_angle"]) == pytest.approx(60.0)
    assert values["plunger_needle.gap_widening"] > 0.0
    assert values["valve.stop_disc"] > 0.0
