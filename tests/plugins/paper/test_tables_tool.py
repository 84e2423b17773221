"""The tool that writes the figures of docs/reproduction.md: every block of the page, and nothing else."""

from __future__ import annotations

import pytest

from commonrail.plugins.paper import study
from commonrail.plugins.paper.file import reproduction_record
from commonrail.plugins.paper.run import Reproduction
from tools import reproduction_tables


@pytest.fixture(scope="module")
def blocks(done: Reproduction) -> dict[str, str]:
    record = reproduction_record(done)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction_tables, "tabulate_friction", lambda: "| of friction |")
        return reproduction_tables.make_blocks(record, record)


def test_the_page_has_every_block_and_no_other(blocks: dict[str, str]) -> None:
    page = reproduction_tables.PAGE.read_text(encoding="utf-8")
    filled = reproduction_tables.fill_page(page, blocks)
    for name, text in blocks.items():
        assert f"<!-- {name} -->\n\n{text}\n<!-- end -->" in filled
    # what stands around the blocks stays, and filling again changes nothing
    outside = [part.partition("<!-- end -->")[2] for part in page.split("<!-- ") if part.startswith("end -->")]
    assert all(part in filled for part in outside)
    assert reproduction_tables.fill_page(filled, blocks) == filled


def test_a_page_without_a_block_is_not_written(blocks: dict[str, str]) -> None:
    with pytest.raises(SystemExit):
        reproduction_tables.fill_page("<!-- claims -->\n<!-- end -->\n", blocks)


def test_every_claim_stands_in_the_page(done: Reproduction) -> None:
    page = reproduction_tables.PAGE.read_text(encoding="utf-8")
    for claim in reproduction_record(done)["claims"]:
        assert claim["claim"] in page


def test_the_truths_of_the_study_of_friction_differ_from_the_model_in_one_thing() -> None:
    truths = reproduction_tables.friction_truths()
    assert len(truths) == 4
    assert not any(set(truth.values) & set(study.NAMES) for truth in truths.values())
    coulomb = [sum(truth.friction.coulomb) for truth in truths.values()]
    assert coulomb == pytest.approx([0.0, coulomb[1], coulomb[1], 0.0])
    assert [truth.rate_meter.bandwidth < 1e6 for truth in truths.values()] == [False, False, False, True]
    assert all(truth.rate_meter.noise == 0.0 for truth in truths.values())
