"""Fuels from TOML: what the catalogue holds, and one clear sentence for each way to get it wrong."""

from __future__ import annotations

import copy
import tomllib
from importlib import resources
from typing import Any

import pytest

from commonrail.base.errors import InputError
from commonrail.readers.fuel import fuel_catalogue, load_fuel, parse_fuel


def document(name: str = "n-dodecane") -> dict[str, Any]:
    text = (resources.files("commonrail.physics") / "catalogue" / "fuels" / f"{name}.toml").read_text("utf-8")
    return tomllib.loads(text)


def test_catalogue_lists_what_can_be_loaded() -> None:
    assert fuel_catalogue() == ["iso4113", "n-dodecane", "n-dodecane-eq2"]
    for name in fuel_catalogue():
        assert load_fuel(name).name == name


def test_marks_and_kinds_are_declared() -> None:
    kinds = {name: (load_fuel(name).mark, load_fuel(name).density_kind) for name in fuel_catalogue()}
    assert kinds == {
        "iso4113": ("E", "integrated"),
        "n-dodecane": ("F", "integrated"),
        "n-dodecane-eq2": ("F", "eq2"),
    }


def test_mark_of_a_fuel_is_its_weakest() -> None:
    data = document()
    data["density"]["mark"], data["vapour_pressure"]["mark"] = "M", "C"
    assert parse_fuel(data, "x", "x.toml").mark == "F"
    data["vapour_pressure"]["mark"] = "E"
    assert parse_fuel(data, "x", "x.toml").mark == "E"


def test_unknown_name_proposes_the_nearest() -> None:
    with pytest.raises(InputError, match=r'"ISO-4113".*"iso4113"'):
        load_fuel("ISO-4113")


LAWS = ["density", "bulk_modulus", "isentropic_bulk_modulus", "kinematic_viscosity"]


@pytest.mark.parametrize("law", [*LAWS, "vapour_pressure"])
def test_each_law_must_state_unit_mark_source_error_and_coefficients(law: str) -> None:
    for key in document()[law]:
        data = document()
        del data[law][key]
        with pytest.raises(
            InputError,
            match=rf'my\.toml, {law}(\.{key}: this key is missing; add it|: {key} must be "eq2" or "integrated")',
        ):
            parse_fuel(data, "mine", "my.toml")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("density", "kind"), "tait", r'density: kind must be "eq2" or "integrated"'),
        (("density", "kind"), "eq2", r"\[bulk_modulus\] if, and only if"),
        (("bulk_modulus", "unit"), "GPa", r'unit is "GPa", convert the coefficients to "MPa"'),
        (("bulk_modulus", "mark"), "MF", "write one of M, C, F, E"),
        (("bulk_modulus", "mark"), "X", "write one of M, C, F, E"),
        (("density", "error"), -0.1, r"density\.error: this must be greater than or equal to 0, not -0\.1"),
        (("density", "error"), True, r"density\.error: this must be a number, not True"),
        (("bulk_modulus", "k1"), [], r"bulk_modulus\.k1: this must be a list of numbers"),
        (("bulk_modulus", "k1"), ["1"], r"bulk_modulus\.k1: this must be a list of numbers"),
        (("bulk_modulus", "k1"), [float("nan")], r"bulk_modulus\.k1: this must be a list of numbers"),
        (("range", "pressure_MPa"), [250.0, 0.0], "0 <= lower < upper"),
        (("range", "temperature_K"), [293.15], "0 <= lower < upper"),
    ],
)
def test_wrong_values_are_named(path: tuple[str, str], value: Any, message: str) -> None:
    data = document()
    data[path[0]][path[1]] = value
    with pytest.raises(InputError, match=message):
        parse_fuel(data, "mine", "my.toml")


@pytest.mark.parametrize("key", ["title", "source", "range", "density", "kinematic_viscosity"])
def test_missing_top_level_entries_are_named(key: str) -> None:
    data = document()
    del data[key]
    with pytest.raises(InputError, match=rf"my\.toml, {key}: .*missing"):
        parse_fuel(data, "mine", "my.toml")


def test_missing_isentropic_law_means_equal_moduli() -> None:
    data = document()
    del data["isentropic_bulk_modulus"]
    fuel = parse_fuel(data, "mine", "my.toml")
    assert fuel.isentropic_law is None
    assert fuel.isentropic_bulk_modulus(1e8, 353.15) == fuel.bulk_modulus(1e8, 353.15)


def test_reading_leaves_the_document_alone() -> None:
    data = document()
    before = copy.deepcopy(data)
    parse_fuel(data, "mine", "my.toml")
    assert data == before
