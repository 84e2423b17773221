"""TOML of README and docs: each block is read as the file that it is, or as part of the smallest such file."""

from __future__ import annotations

import base64
import shutil
import tomllib
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import tomlkit

import commonrail as cr
from commonrail.base.registry import GROUPS
from commonrail.calibration.study_keys import StudyModel
from commonrail.plugins.family.injector_type import load_type
from commonrail.plugins.family.study import load_family
from commonrail.plugins.fleet.study import load_fleet
from commonrail.plugins.foreign_fmu.study import _StudyModel as FmuStudyModel
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.tolerance.file import load_tolerances
from commonrail.readers.toml import read_model_file
from tests.cli.conftest import run_command
from tests.docs.pages import PAGES, ROOT, TOML

PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
CURVE = {
    "kind": "rate",
    "name": "curve",
    "role": "fit",
    "file": "data/evi.csv",
    "rail_pressure": "160 MPa",
    "cylinder_pressure": "5 MPa",
    "return_pressure": "0.5 MPa",
    "energising_time": "700 us",
}
MAP = {
    "kind": "quantities",
    "name": "map",
    "role": "fit",
    "file": "data/quantity.csv",
    "cylinder_pressure": "0.5 MPa",
    "return_pressure": "0.1 MPa",
}
FREE = {"name": "valve.mass", "below": "10 %", "above": "10 %"}
NAMES = [f"plunger_needle.{name}" for name in ("k2", "k3", "k7", "spring_preload")] + ["valve.spring_preload"]
STUDY = {"format": "commonrail-study/1", "title": "t", "injector": "virtual-lino-2016", "parameter": [FREE]}
# Files that a block is part of, by the words of its comment: a key of the block replaces that of the file.
FILES: dict[str, dict[str, Any]] = {
    "study": STUDY | {"data": [CURVE]},
    "study with a map": STUDY | {"data": [MAP]},
    "study with a metered curve": STUDY | {"data": [CURVE | {"meter": "bench"}]},
    "study with a meter": STUDY | {"meters": {"bench": {"cutoff": "60 kHz", "source": "s", "mark": "E"}}},
    "study with these parameters free": STUDY | {"data": [CURVE], "parameter": [FREE | {"name": n} for n in NAMES]},
    "data of a study": STUDY,  # whose files are not here
    "injector": {"format": "commonrail-injector/1", "base": "cri2-16"},
    "direct-acting injector": {"format": "commonrail-injector/1", "base": "direct-acting-kr"},
    "map": STUDY,  # a key of its [[data]]
    "pyproject": {},
}
WITHOUT_DATA = "data of a study"


def blocks_of_toml() -> Iterator[Any]:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for found in TOML.finditer(text):
            if found["said"] != "not read":
                line = text.count("\n", 0, found.start("code"))
                yield pytest.param(found["code"], found["text"] or "", id=f"{page.relative_to(ROOT).as_posix()}:{line}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the files that the blocks name."""
    folder = tmp_path_factory.mktemp("blocks")
    example, family = resources.files("commonrail.plugins.new") / "template", ROOT / "cases" / "family"
    shutil.copytree(ROOT / "cases" / "cri2-16" / "data", folder / "data")
    rows = (folder / "data" / "quantity.csv").read_text(encoding="utf-8").splitlines()
    head = next(i for i, row in enumerate(rows) if row.startswith("rail_pressure"))
    rows[head:] = [f"{rows[head]},return_quantity [mm3]", *(f"{row},20" for row in rows[head + 1 :])]
    (folder / "data" / "quantity.csv").write_text("\n".join(rows), encoding="utf-8")
    (folder / "data" / "sister_quantity.csv").rename(folder / "data" / "sister.csv")
    (folder / "data" / "evi.csv").write_bytes((example / "data" / "evi.csv").read_bytes())
    shutil.copy(ROOT / "examples" / "test-plan" / "plan.csv", folder)
    (folder / "types").mkdir()
    copies = {name: name for name in ("164.toml", "165.toml", "start.toml")}
    copies |= dict.fromkeys(("known.toml", "cri2.toml", "types/cri2.toml"), "found-on-164.toml")
    for name, source in copies.items():
        text = (family / source).read_text(encoding="utf-8").replace("../cri2-16/data/", "data/")
        (folder / name).write_text(text.replace("../cri2-16/injector.toml", "cri2-16"), encoding="utf-8")
    shutil.copy(ROOT / "src/commonrail/physics/catalogue/fuels/iso4113.toml", folder / "hvo.toml")
    for name in ("part.toml", "injector.toml"):
        (folder / name).write_text(tomlkit.dumps(FILES["injector"]), encoding="utf-8")
    (folder / "logo.png").write_bytes(base64.b64decode(PNG))
    sets = [CURVE | {"name": name} for name in ("160 MPa", "120 MPa", "80 MPa")]
    (folder / "template.toml").write_text(tomlkit.dumps(STUDY | {"data": sets}), encoding="utf-8")
    (folder / "injectors.csv").write_text("serial number,EVI 160,120 MPa\n1,data/evi.csv,\n", encoding="utf-8")
    return folder


def read(path: Path, document: dict[str, Any]) -> None:
    """Read a file of any format of a reader's; an injector as `new` does, too."""
    match document["format"]:
        case "commonrail-injector/1":
            cr.load_injector(path)
            words = ("--injector", path, "--from", path.parent / "data" / "evi.csv", "--free", "nozzle.hole_diameter")
            done = run_command("new", path.with_suffix(""), *words)
            assert done.status == 0, done.err
            cr.load_injector(path.with_suffix("") / "injector.toml")
        case "commonrail-study/1":
            cr.load_study(path)
        case "commonrail-truth/1":
            load_truth(path)
        case "commonrail-tolerance/1":
            load_tolerances(path)
        case "commonrail-type/1":
            load_type(path)
        case "commonrail-family/1":
            load_family(path)
        case "commonrail-fleet/1":
            shutil.copy(path.with_name("template.toml"), path.with_name("study.toml"))
            load_fleet(path)
        case "commonrail-fmu-study/1":
            read_model_file(FmuStudyModel, path)
        case other:
            pytest.fail(f"no reader of {other}")


@pytest.mark.parametrize(("code", "part_of"), list(blocks_of_toml()))
def test_a_block_is_read(code: str, part_of: str, folder: Path) -> None:
    document = (FILES[part_of] if part_of else {}) | tomllib.loads(code)
    if part_of == "map":
        document = STUDY | {"data": [MAP | tomllib.loads(code)]}
    if "\n# …" in code or "\n# ..." in code:  # the keys of a curve are left out
        document["data"] = [CURVE | data for data in document["data"]]
    if part_of == "pyproject":
        assert all(group.removeprefix("commonrail.") in GROUPS for group in document["project"]["entry-points"])
        return
    path = folder / "block.toml"
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    shutil.rmtree(path.with_suffix(""), ignore_errors=True)
    if part_of == WITHOUT_DATA:
        read_model_file(StudyModel, path)
    else:
        read(path, document)
