"""Part numbers as people write them lead to the injector of the catalogue that names them."""

from __future__ import annotations

import pytest

import commonrail as cr
from commonrail.base.errors import InputError
from tests.cli.conftest import run_command


@pytest.mark.parametrize(
    "text",
    [
        "0445110191",
        "0 445 110 191",
        "0.445.110.191",
        "0445-110-191",
        "445110191",
        "110191",
        "Bosch 0445110191",
        "\t0445110191 ",
    ],
)
def test_a_number_is_recognised_however_it_is_written(text: str) -> None:
    (match,) = cr.models.find_part(text)
    assert (match.injector, match.numbers) == ("cri2-1", ("0445110191",))
    assert match.kind == ("partial" if text == "110191" else "exact")


def test_a_part_of_a_family_leads_to_its_type() -> None:
    (match,) = cr.models.find_part("0445110260")
    assert (match.injector, match.kind) == ("cri2-0", "exact")
    assert "another part" in match.reason


def test_an_unnamed_part_leads_to_the_nearest_numbers_of_its_kind() -> None:
    (match,) = cr.models.find_part("0445110183")
    assert (match.injector, match.kind, match.numbers) == ("cri2-1", "nearest", ("0445110176", "0445110191"))
    assert {m.injector for m in cr.models.find_part("0445120001")} == {"crin1"}
    assert cr.models.find_part("0950005550") == ()  # another maker's


@pytest.mark.parametrize("text", ["", "cri2-16", "191", "0445110191 0445110192", "iso4113"])
def test_what_is_no_part_number_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        cr.models.find_part(text)


@pytest.mark.parametrize(
    ("search", "kinds", "injectors"),
    [
        ("0 445 110 260", ["exact"], ["cri2-0"]),
        ("0445110183", ["nearest"], ["cri2-1"]),
        ("0950005550", [], []),
        ("CRI 2.2", [], ["cri2-2"]),
    ],
)
def test_the_catalogue_is_searched_by_part_number_and_by_name(
    search: str, kinds: list[str], injectors: list[str]
) -> None:
    done = run_command("catalogue", "injectors", "--search", search, "--json")
    assert [part["kind"] for part in done.record["parts"]] == kinds
    assert [entry["name"] for entry in done.record["injectors"]] == injectors
    assert done.status == 0
