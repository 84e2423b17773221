"""An injector that was read before is the same one, and is not found where anything that decides over it differs."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from commonrail.errors import InputError
from commonrail.files import checked, injector_file
from commonrail.files.injector_file import injector_catalogue, load_injector
from commonrail.files.injector_writer import injector_text
from commonrail.kernel_cache import _COMPILERS, _PHYSICS_ROOMS, read, write

SRC = Path(checked.__file__).parents[1]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty folder in place of that of the kernels."""
    made = tmp_path / "kernels"
    made.mkdir(mode=0o700)
    monkeypatch.setattr(checked, "cache_folder", lambda: made)
    monkeypatch.setattr(checked, "_new", 0)
    return made


def kept(folder: Path) -> list[Path]:
    """Injectors that are kept."""
    return sorted(folder.glob(f"*{checked.ENDING}"))


@pytest.fixture
def no_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever reads the tables of a file fails."""
    monkeypatch.setattr(injector_file, "parse_toml", lambda *_: pytest.fail("the text was read again"))


@pytest.mark.parametrize("name", injector_catalogue())
def test_the_second_reading_gives_the_same_injector(folder: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    first = load_injector(name)
    assert len(kept(folder)) == 1
    monkeypatch.setattr(injector_file, "parse_toml", lambda *_: pytest.fail("the text was read again"))
    second = load_injector(name)
    assert second == first
    assert repr(second) == repr(first)  # types and the order of values too: both become result files
    assert injector_text(second, {}, "") == injector_text(first, {}, "")


def test_another_text_or_name_is_read_anew(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    text = (SRC / "injector/catalogue/cri2-16.toml").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    values = load_injector(path).values
    path.write_text(text + "\n# another comment\n", encoding="utf-8")
    assert load_injector(path).values == values
    assert len(kept(folder)) == 2
    unnamed = "\n".join(line for line in text.splitlines() if not line.startswith('name = "cri'))
    for stem in ("b", "c"):
        path = tmp_path / f"{stem}.toml"
        path.write_text(unnamed, encoding="utf-8")
        assert load_injector(path).name == stem
    assert len(kept(folder)) == 4


def test_a_refused_text_is_refused_again(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('format = "commonrail-injector/1"\n', encoding="utf-8")
    for _ in range(2):
        with pytest.raises(InputError, match="fuel"):
            load_injector(path)
    assert kept(folder) == []


def test_an_injector_whose_fuel_is_in_another_file_is_not_kept(folder: Path, tmp_path: Path) -> None:
    text = (SRC / "injector/catalogue/cri2-16.toml").read_text(encoding="utf-8")
    fuel = (SRC / "fuel/catalogue/iso4113.toml").read_text(encoding="utf-8")
    (tmp_path / "fuel.toml").write_text(fuel, encoding="utf-8")
    assert 'name = "iso4113"' in text
    (tmp_path / "a.toml").write_text(text.replace('name = "iso4113"', 'file = "fuel.toml"'), encoding="utf-8")
    assert load_injector(tmp_path / "a.toml").fuel.name == "fuel"
    assert kept(folder) == []


@pytest.mark.parametrize("damage", [b"", b"x", b'{"name": 1}'])
def test_a_damaged_one_is_read_anew(folder: Path, damage: bytes) -> None:
    first = load_injector("cri2-16")
    (path,) = kept(folder)
    path.write_bytes(damage)
    assert load_injector("cri2-16") == first


def leaves(record: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all parts of a record, of numbers in a row the first."""
    row = record[:1] if isinstance(record, list) and {*map(type, record)} == {float} else record
    items = row.items() if isinstance(row, dict) else enumerate(row) if isinstance(row, list) else ()
    return [path, *(deeper for key, part in items for deeper in leaves(part, (*path, key)))]


def forged(record: Any, path: tuple[Any, ...], junk: Any) -> Any:
    """Record with something else at a path."""
    if not path:
        return junk
    found, (key, *rest) = copy.copy(record), path
    found[key] = forged(record[key], tuple(rest), junk)
    return found


@pytest.mark.parametrize("junk", ["x", 1e400, -1.0, [], None], ids=repr)
def test_a_forged_one_under_a_right_digest_is_usable_or_read_anew(folder: Path, junk: Any) -> None:
    """Anything in place of any part: never a fault, neither now nor where the injector is used."""
    first = load_injector("cri2-16")
    (path,) = kept(folder)
    record = json.loads(read(path)[0] or b"")
    many = {key: dict(list(record[key].items())[:3]) for key in ("values", "sources")}  # of a kind
    for place in leaves(record | many):
        write(path, json.dumps(forged(record, place, junk)).encode())
        found = load_injector("cri2-16")
        if found != first:
            assert checked._injector(json.loads(json.dumps(checked._record(found)))) == found
            assert isinstance(injector_text(found, {}, ""), str)
            assert found.fuel.density(1e8, found.fuel.temperature_range[0]).shape == ()


def test_content_that_no_parser_takes_is_read_anew(folder: Path) -> None:
    first = load_injector("cri2-16")
    (path,) = kept(folder)
    for payload in (b"[" * 100_000, b"\xff", b"", b"null", b"[]", b'"x"', b"1"):
        write(path, payload)
        assert load_injector("cri2-16") == first


def test_nothing_is_kept_or_found_once_the_package_was_changed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As by an upgrade beneath a running process: its code is that of before, the sources are those of after."""
    load_injector("cri2-16")
    before = kept(folder)
    changed = [(name, size, time + 1) for name, size, time in checked._AT_START]
    monkeypatch.setattr(checked, "_AT_START", changed)
    assert checked.find((SRC / "injector/catalogue/cri2-16.toml").read_text(encoding="utf-8"), "cri2-16") is None
    load_injector("crin")
    assert kept(folder) == before


def test_without_a_folder_nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checked, "cache_folder", lambda: None)
    assert load_injector("cri2-16") == load_injector("cri2-16")


def test_the_number_of_kept_ones_is_limited(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    injector = load_injector("cri2-16")
    monkeypatch.setattr(checked, "MOST", 3)
    for number in range(20):
        checked.keep("text", str(number), injector)
    assert len(kept(folder)) == 3
    assert checked._new == checked.MOST_NEW


# Modules that an injector's file is read with, after everything about it was imported.
READ = """
import sys
from commonrail.files.injector_model import injector_of
from commonrail.files import injector_file, checked
checked.find = lambda *_: None
injector_file.load_injector("cri2-16")
print(*(name for name in sys.modules if name.startswith("commonrail.")))
"""
# They say where a file is, or write one, and decide over no value in it.
NOT_DECIDING = {"cli", "kernel_cache", "compile_target", "notice", "files.atomic", "files.injector_writer"}
NOT_DECIDING |= {"files.sums", "files.toml_text"}


@pytest.mark.process
def test_all_sources_that_an_injector_is_read_with_are_in_its_name() -> None:
    done = subprocess.run([sys.executable, "-c", READ], capture_output=True, text=True, check=True)
    loaded = {name.removeprefix("commonrail.") for name in done.stdout.split()}
    modules = {name for name in loaded if (SRC / f"{name.replace('.', '/')}.py").is_file()}
    others = {name for name in modules if name.partition(".")[0] not in (*_PHYSICS_ROOMS, "flow", *_COMPILERS)}
    assert others - set(checked.DECIDING) - NOT_DECIDING == set()


@pytest.mark.process
def test_a_second_start_loads_no_pydantic(tmp_path: Path) -> None:
    code = "import sys; from commonrail.files.injector_file import load_injector; load_injector('crin');"
    code += "print('pydantic' in sys.modules)"
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
