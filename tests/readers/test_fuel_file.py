"""Fuels from TOML: what the catalogue holds, and one clear sentence for each way to get it wrong."""

from __future__ import annotations

import copy
import tomllib
from importlib import resources
from typing import Any

import pytest

from commonrail.base.errors import InputError
from commonrail.readers.fuel import fuel_catalogue, load_fuel, parse_fuel
from tests.refused import refused


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
    with refused(InputError, "unknown-name"):
        load_fuel("ISO-4113")


LAWS = ["density", "bulk_modulus", "isentropic_bulk_modulus", "kinematic_viscosity"]


@pytest.mark.parametrize("law", [*LAWS, "vapour_pressure"])
def test_each_law_must_state_unit_mark_source_error_and_coefficients(law: str) -> None:
    for key in document()[law]:
        data = document()
        del data[law][key]
        with refused(InputError, f"missing-form {law}" if key == "kind" else f"missing {law}.{key}", "my.toml"):
            parse_fuel(data, "mine", "my.toml")


@pytest.mark.parametrize(
    ("path", "value", "fault"),
    [
        (("density", "kind"), "tait", "unknown-name density"),
        (("density", "kind"), "eq2", "conflict"),
        (("bulk_modulus", "unit"), "GPa", "wrong-unit bulk_modulus.unit"),
        (("bulk_modulus", "mark"), "MF", "unknown-mark bulk_modulus.mark"),
        (("bulk_modulus", "mark"), "X", "unknown-mark bulk_modulus.mark"),
        (("density", "error"), -0.1, "greater_than_equal density.error"),
        (("density", "error"), True, "float_type density.error"),
        (("bulk_modulus", "k1"), [], "wrong-type bulk_modulus.k1"),
        (("bulk_modulus", "k1"), ["1"], "wrong-type bulk_modulus.k1"),
        (("bulk_modulus", "k1"), [float("nan")], "wrong-type bulk_modulus.k1"),
        (("range", "pressure_MPa"), [250.0, 0.0], "wrong-range range.pressure_MPa"),
        (("range", "temperature_K"), [293.15], "wrong-range range.temperature_K"),
    ],
)
def test_wrong_values_are_named(path: tuple[str, str], value: Any, fault: str) -> None:
    data = document()
    data[path[0]][path[1]] = value
    with refused(InputError, fault, "my.toml"):
        parse_fuel(data, "mine", "my.toml")


@pytest.mark.parametrize("key", ["title", "source", "range", "density", "kinematic_viscosity"])
def test_missing_top_level_entries_are_named(key: str) -> None:
    data = document()
    del data[key]
    with refused(InputError, f"missing {key}", "my.toml"):
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
