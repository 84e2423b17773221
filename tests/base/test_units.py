"""Text with units to SI floats and back, and the sentences for what cannot be read."""

import math
import re
import subprocess
import sys

import numpy as np
import pint
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from commonrail.base.errors import InputError
from commonrail.base.units import FACTORS, FAST, NAMES, SHOWN, compatible, convert, parse, parse_difference, to_text

# One rounding in the table's factor and a few inside pint.
ROUNDING = 1e-14


@pytest.fixture(scope="module")
def registry() -> pint.UnitRegistry:
    made = pint.UnitRegistry(autoconvert_offset_to_baseunit=True)
    made.define("stroke = count")
    made.define("inj = count")
    return made


def in_pint_spelling(name: str) -> str:
    return re.sub(r"(?<=[A-Za-z])(\d+)", r"**\1", name)


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [("2 degC", "K", 2.0), ("0.5 K", "degC", 0.5), ("2 degC", "degC", 2.0), ("9 degF", "K", 5.0), ("3 mm", "m", 0.003)],
)
def test_a_difference_has_no_zero_of_its_scale(text: str, unit: str, expected: float) -> None:
    assert parse_difference(text, unit) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("name", FAST)
def test_table_agrees_with_pint(name: str, registry: pint.UnitRegistry) -> None:
    scale = FAST[name]
    for value in (1.0, 80.0):
        quantity = registry.Quantity(value, in_pint_spelling(name))
        expected = quantity.to(in_pint_spelling(scale.kind)).magnitude
        assert value * scale.factor + scale.offset == pytest.approx(expected, rel=ROUNDING)


def test_kinds_of_the_table_are_si_and_all_different(registry: pint.UnitRegistry) -> None:
    bases = [registry.Quantity(1.0, in_pint_spelling(kind)).to_base_units() for kind in FACTORS]
    assert [base.magnitude for base in bases] == [1.0] * len(bases)
    assert len({str(base.dimensionality) for base in bases}) == len(bases)


def test_examples_and_prefixes_belong_to_their_kind() -> None:
    for kind, (_, example) in NAMES.items():
        assert math.isfinite(parse(example, kind))
    for unit, choices in SHOWN.items():
        factors = [FAST[name].factor for name in choices]
        assert {FAST[name].kind for name in choices} == {FAST[unit].kind}
        assert factors == sorted(factors, reverse=True)


# Each expected value is the literal that a person would write: no tolerance.
@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("160 MPa", "Pa", 160e6),
        ("160MPa", "Pa", 160e6),
        ("1600 bar", "Pa", 160e6),
        ("1.22e8 N/m", "N/m", 1.22e8),
        ("-3 um", "m", -3e-6),
        ("-3 µm", "m", -3e-6),  # micro sign
        ("-3 μm", "m", -3e-6),  # Greek mu
        ("−3 um", "m", -3e-6),  # typographic minus
        ("215 um", "m", 215e-6),
        ("+.7 ms", "s", 7e-4),
        ("700.us", "s", 7e-4),
        ("80 degC", "K", 353.15),
        ("80 °C", "K", 353.15),
        ("-273.15 degC", "K", 0.0),
        ("0 degC", "K", 273.15),
        ("353.15 K", "degC", 80.0),
        ("18 mm³", "m3", 18e-9),
        ("18 mm^3", "m3", 18e-9),
        ("18 mm**3", "m3", 18e-9),
        ("18 mm ^ 3", "m3", 18e-9),
        ("2.6 mm2 / s", "m2/s", 2.6e-6),
        ("3 mPa*s", "Pa s", 3e-3),
        ("3 mPa·s", "Pa s", 3e-3),
        ("8e-4 1/K", "1/K", 8e-4),
        ("8e-4/K", "1/K", 8e-4),
        ("20 mg/ms", "kg/s", 20e-3),
        ("51.7 mm3/stroke", "m3", 51.7e-9),
        ("0.36 Ω", "ohm", 0.36),
        ("70 %", "1", 0.7),
        ("70%", "1", 0.7),
        ("0.7", "1", 0.7),
        (0.7, "1", 0.7),
        (7, "1", 7.0),
        (np.int64(7), "1", 7.0),
        (np.float32(0.5), "1", 0.5),
        ("1e-400 Pa", "Pa", 0.0),
        ("1e-9999999999999999999 Pa", "Pa", 0.0),
    ],
)
def test_parse_reads_the_nearest_float(text: str | float, unit: str, expected: float) -> None:
    assert parse(text, unit) == expected


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("2320 psi", "Pa", 2320 * 6894.757293168361),  # 1 psi = 0.45359237 · 9.80665 / 0.0254² Pa
        ("176 degF", "K", 353.15),
        ("3000 rpm", "rad/s", 100 * math.pi),
        ("1.5 cm^2", "m2", 1.5e-4),
        ("7.2 um s^-1", "m/s", 7.2e-6),
        ("60 arcmin", "1", math.pi / 180.0),
        ("2 kJ/(kg K)", "J/(kg K)", 2000.0),
    ],
)
def test_parse_reads_other_units_through_pint(text: str, unit: str, expected: float) -> None:
    # Pint's own chain of factors rounds a few times.
    assert parse(text, unit) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(
    ("text", "unit", "told"),
    [
        ("160", "Pa", ["no unit", "a pressure", '"160 MPa"']),
        (160.0, "Pa", ["no unit", "a pressure"]),
        (np.float64(160.0), "Pa", ['"160.0" has no']),
        ("3 mm", "Pa", ['"3 mm" is a length', "a pressure"]),
        ("3 mm", "1", ["is a length", "plain number"]),
        ("3000 rpm", "1/s", ["radian / second", "a frequency"]),  # not 314 Hz
        ("3 mm", "J/K", ["is a length", "J/K"]),
        ("160 Mpa", "Pa", ['"Mpa" is not', 'mean "MPa"', '"160 MPa"']),
        ("160 MPa up", "Pa", ['"MPa up" is not']),
        ("1,6 MPa", "Pa", ["comma"]),
        ("١٦٠ MPa", "Pa", []),
        ("1,600 bar", "Pa", ["comma"]),
        ("fast", "s", ['"fast" does', "a time"]),
        ("", "s", ["not start"]),
        ("MPa", "Pa", ["not start"]),
        (" ? ", "Pa", ["state it", "a pressure"]),
        ("nan MPa", "Pa", ["not finite"]),
        ("-inf MPa", "Pa", ["not finite"]),
        ("1e400 Pa", "Pa", ["not finite"]),
        ("1e305 MPa", "Pa", ["not finite"]),
        (math.nan, "1", ["not finite"]),
        (math.inf, "1", ["not finite"]),
        (10**400, "1", ["not finite"]),
        (True, "1", ['"True" is not']),
        (None, "Pa", ['"None" is not']),
        (["160 MPa"], "Pa", ["a number"]),
        ("3\nMPa" * 5000, "Pa", ['"MPa3 MPa3', '..."']),
        ("3 dB", "1", ["known unit"]),  # a logarithm, no factor
        ("3 m^9^9^9^9", "m", ["known unit"]),  # would keep pint busy for minutes
        ("3 km^99999999", "m", ["known unit"]),
    ],
)
def test_parse_refuses_with_one_sentence(text: object, unit: str, told: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        parse(text, unit, where="injector.toml, rail.pressure")  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith("injector.toml, rail.pressure: ")
    assert message.endswith(".")
    assert "\n" not in message
    for part in told:
        assert part in message
    assert len(message) < 250


@settings(deadline=None)  # the first call builds pint's registry
@given(text=st.text(max_size=20) | st.from_regex(r"[0-9e.+-]{1,6} ?[a-zA-Z0-9/*^ µ°%()_.-]{0,12}"))
def test_parse_gives_a_finite_float_or_an_input_error(text: str) -> None:
    try:
        value = parse(text, "Pa")
    except InputError:
        return
    assert math.isfinite(value)


def test_convert_floats_and_arrays() -> None:
    assert convert(1600.0, "bar", "MPa") == 160.0
    assert convert(80.0, "degC", "K") == 353.15
    assert convert(353.15, "K", "degC") == pytest.approx(80.0, rel=1e-13)  # 353.15 − 273.15
    grid = np.array([[40, 80], [120, 160]])
    converted = convert(grid, "MPa", "Pa")
    assert converted.shape == (2, 2)
    np.testing.assert_allclose(converted, grid * 1e6, rtol=1e-15)  # one rounding
    assert convert(grid, "MPa", "MPa").dtype == np.float64


def test_convert_leaves_its_argument_alone_and_passes_not_a_number() -> None:
    trace = np.array([1.0, np.nan])
    converted = convert(trace, "mg/ms", "mg/ms")
    converted[0] = 5.0
    np.testing.assert_array_equal(trace, [1.0, np.nan])
    assert math.isnan(convert(math.nan, "bar", "Pa"))


@pytest.mark.parametrize(
    ("source", "target", "told"),
    [("bar", "mm", "a pressure"), ("bar", "mmm", '"mmm"'), ("rpm", "Hz", "radian / second")],
)
def test_convert_refuses_other_kinds(source: str, target: str, told: str) -> None:
    with pytest.raises(InputError, match=r"^map\.csv, column 2: ") as caught:
        convert(1.0, source, target, where="map.csv, column 2")
    assert told in str(caught.value)


def test_compatible() -> None:
    assert compatible("bar", "MPa")
    assert compatible("psi", "MPa")
    assert compatible("degC", "K")
    assert compatible("N s/m", "kg/s")
    assert not compatible("bar", "mm")
    assert not compatible("rpm", "Hz")
    with pytest.raises(InputError, match='"brr"'):
        compatible("brr", "Pa")


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (160e6, "Pa", "160 MPa"),
        (0.1013e6, "Pa", "101.3 kPa"),
        (2.562e9, "Pa", "2.562 GPa"),
        (215e-6, "m", "215 um"),
        (0.215, "m", "215 mm"),
        (-3e-6, "m", "-3 um"),
        (7e-4, "s", "700 us"),
        (9.999999999e-4, "s", "1 ms"),  # not "1000 us"
        (1.8e-8, "m3", "18 mm3"),
        (5e-5, "m3/s", "50 mm3/ms"),
        (0.02, "kg/s", "20 mg/ms"),
        (1e-13, "m", "0.0001 nm"),
        (353.15, "K", "353.15 K"),
        (0.0, "Pa", "0 Pa"),
        (math.nan, "Pa", "nan Pa"),
        (math.inf, "s", "inf s"),
        (0.82, "1", "0.82"),
        (50.0, "Hz", "50 Hz"),
        (3.5, "kg m/s", "3.5 kg m/s"),
    ],
)
def test_to_text_chooses_a_prefix(value: float, unit: str, expected: str) -> None:
    assert to_text(value, unit) == expected


def test_to_text_writes_few_digits_without_an_exponent() -> None:
    assert to_text(1.23e-7, "s", 2) == "120 ns"
    assert to_text(163e6, "Pa", 1) == "200 MPa"


@given(
    value=st.floats(min_value=-1e12, max_value=1e12).filter(lambda v: abs(v) > 1e-12),
    unit=st.sampled_from([*SHOWN, "K", "1", "kg/m3"]),
    digits=st.integers(min_value=1, max_value=15),
)
def test_parse_reads_what_to_text_wrote(value: float, unit: str, digits: int) -> None:
    # The number is rounded twice, before and after the division by the prefix: one unit of the
    # last digit, which is at most 10^(1 − digits) of the value.
    tolerance = 10.0 ** (1 - digits)
    assert parse(to_text(value, unit, digits), unit) == pytest.approx(value, rel=tolerance)


def test_ordinary_units_never_load_pint() -> None:
    code = (
        "import sys; from commonrail.base.units import parse, to_text, compatible, convert;"
        "parse('1600 bar', 'Pa'); parse('80 °C', 'K'); parse('2.6 mm²/s', 'm2/s');"
        "to_text(160e6, 'Pa'); compatible('bar', 'MPa'); convert(1.0, 'mg/ms', 'kg/s');"
        "sys.exit('pint' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("per", ["Hub", "hub", "inj", "inj.", "Takt", "str", "stk", "shot", "Einspritzung"])
def test_a_quantity_per_stroke_has_the_words_of_benches(per: str) -> None:
    assert parse(f"2 mg/{per}", "kg") == 2e-6
    assert parse(f"2 mm³ / {per}", "m3") == 2e-9
