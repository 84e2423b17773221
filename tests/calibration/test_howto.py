"""The examples in the how-to pages are accepted as they stand."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import pytest
from pydantic import TypeAdapter

from commonrail.calibration.objective import Loss
from commonrail.calibration.parameter import Wanted
from commonrail.calibration.study_keys import ConditionModel, ConstraintsModel, ParameterModel, read_optimisers
from commonrail.data.curves.samples import RateModel
from commonrail.data.quantities.reading import QuantitiesModel
from commonrail.data.quantities.returned import ReturnsModel
from commonrail.physics.injector import parameter_quantities
from commonrail.readers.columns import Column
from commonrail.readers.injector import component_quantities
from commonrail.readers.tables import read_columns
from commonrail.readers.toml import ParameterTable, Quantities

PAGES = Path(__file__).resolve().parents[2] / "docs" / "howto"


def tables(page: str) -> dict[str, list[Any]]:
    """Tables of all TOML examples of a page by name."""
    found: dict[str, list[Any]] = {}
    for block in re.findall(r"```toml\n(.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.S):
        for name, value in tomllib.loads(block).items():
            found.setdefault(name, []).extend(value if isinstance(value, list) else [value])
    return found


def test_study_page() -> None:
    found = tables("study-file.md")
    rate, quantities = found["data"]
    RateModel.model_validate(rate)
    # The page leaves out what the first example has explained.
    QuantitiesModel.model_validate({"name": "map", "role": "fit"} | quantities)
    of_map_alone = {"dead_times", "rail_pressure"}  # which measure and select injected quantities
    shared = {key: value for key, value in quantities.items() if key not in of_map_alone}
    ReturnsModel.model_validate(shared | {"kind": "return quantities"})
    ConditionModel.model_validate(found["condition"][0])
    text = (PAGES / "study-file.md").read_text(encoding="utf-8")
    assert [wanted for wanted in Wanted if f'"{wanted.value}"' not in text] == []
    assert [loss for loss in Loss if f'"{loss.value}"' not in text] == []
    models = [ParameterModel.model_validate(parameter) for parameter in found["parameter"]]
    assert {model.name for model in models} <= set(parameter_quantities())
    ConstraintsModel.model_validate(found["constraints"][0])
    assert read_optimisers(found["optimiser"][0]).settings["members"] == 50


def test_injector_page() -> None:
    (valve,) = tables("injector-file.md")["valve"]
    table: TypeAdapter[ParameterTable] = TypeAdapter(
        Annotated[ParameterTable, Quantities(component_quantities("valve"))]
    )
    given = table.validate_python(valve).values()
    assert given["lift"].source.mark == "M"


def test_injector_page_lists_every_table() -> None:
    text = (PAGES / "injector-file.md").read_text(encoding="utf-8")
    rooms = {path.split(".")[0] for path in parameter_quantities()} - {"fuel"}
    assert [room for room in sorted(rooms) if f"`{room}`" not in text] == []


def test_blocks_of_the_data_page() -> None:
    models = {"rate": RateModel, "quantities": QuantitiesModel}
    blocks = tables("data-files.md")["data"]
    assert [models[block["kind"]].model_validate(block).kind for block in blocks] == ["quantities", "rate", "rate"]


def test_data_page(table_file: Callable[[str], Path]) -> None:
    text = (PAGES / "data-files.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```text\n(# bench.*?)```", text, re.S)
    table = read_columns(
        table_file(example), [Column("time", "s"), Column("rate", "m3/s"), Column("current", "A")], least=2
    )
    assert table.columns["current"][1] == pytest.approx(1.2)
