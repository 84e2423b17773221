"""The folder of a project: data files, injector, studies, runs, exports, and the commands that made them."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import unicodedata
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from commonrail.base.child import python, same_modules
from commonrail.base.errors import InputError
from commonrail.base.input import read_plain
from commonrail.base.output import write_text, writing
from commonrail.plugins.app.preview import Preview

STATE, COMMANDS = "app.json", "commands.sh"
LONGEST_NAME = 100  # of a file [letters]
_NOT_IN_NAMES = re.compile(r"[^\w.\- ()+=,@\[\]]")
_DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com\d|lpt\d)(\..*)?")  # of Windows
EFFORTS: dict[str, dict[str, Any]] = {  # settings of the staged search; `new` writes the normal ones
    "quick": {"members": 60, "inversions": 1, "generations": 6, "polish": 1, "polish_iterations": 8},
    "normal": {"members": 400, "inversions": 12, "generations": 64, "polish": 3, "polish_iterations": 30},
    "thorough": {"members": 1200, "inversions": 16, "generations": 128, "polish": 8, "polish_iterations": 30},
}


def safe_name(name: str) -> str:
    """Name of a file without folders, control characters, leading points and names of devices."""
    name = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem, dot, ending = _NOT_IN_NAMES.sub("_", name).strip(". ").rpartition(".")
    stem, ending = (stem, ending) if dot else (ending, "")
    stem = (stem.strip(" -.") or "file")[:LONGEST_NAME]
    return ("_" if _DEVICES.fullmatch(stem) else "") + stem + (f".{ending[:12]}" if ending else "")


class Project:
    """The folder of a project.

    Attributes
    ----------
    folder : Path
    window : function, optional
        Name of the window whose action is under way.
    state : dict
        Choices that no other file holds: injector, pressures of the bench and of each data file.
    version, author : int, str
        Number of the last change and the window that made it; the pages of all other windows follow.
    preview : Preview
        Process that simulates.
    """

    def __init__(self, folder: Path, window: Callable[[], str] = str) -> None:
        self._window, self.author = window, ""
        self.folder = folder.absolute()
        with writing(folder):
            for name in ("files", "runs", "out"):
                (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.folder = self.folder.resolve()
        self.types: dict[str, str] = {}  # titles of the catalogue's injectors by name
        self.version, self.preview, self.busy = 0, Preview(), asyncio.Lock()
        self.state: dict[str, Any] = {"files": {}, "bench": {}, "injector": "", "unticked": {}}
        place = self.folder / STATE
        if place.is_file():
            try:
                self.state |= json.loads(read_plain(place))
            except ValueError as error:
                raise InputError(f"{place}: this is not a file of the app ({error}); remove it.") from error

    def save(self) -> None:
        """Write the state."""
        write_text(self.folder / STATE, json.dumps(self.state, indent=1, ensure_ascii=False) + "\n")
        self._notify_change()

    def _notify_change(self) -> None:
        self.version, self.author = self.version + 1, self._window()

    def inside(self, path: str) -> Path | None:
        """A file of the folder, or None: neither `..` nor a link leads out of it."""
        with contextlib.suppress(OSError, ValueError):
            place = (self.folder / path).resolve()
            if place.is_file() and place.is_relative_to(self.folder):
                return place
        return None

    # Data files

    async def add_file(self, name: str, chunks: AsyncIterator[bytes], folder: str = "files") -> str:
        """Write an uploaded file under a safe name; a name that exists gets a number. Returns the name."""
        name = safe_name(name)
        stem, dot, ending = name.rpartition(".") if "." in name else (name, "", "")
        number = 1
        with writing(self.folder / folder):
            while True:
                try:
                    file = (self.folder / folder / name).open("xb")
                    break
                except FileExistsError:
                    number += 1
                    name = f"{stem}-{number}{dot}{ending}"
            with file:
                async for chunk in chunks:
                    file.write(chunk)
        return name

    async def take_data(self, name: str, chunks: AsyncIterator[bytes]) -> str:
        """Write a data file and inspect it; a file that cannot be interpreted is not used."""
        name = await self.add_file(name, chunks)
        self.state["files"][name] = entry = {"role": "fit"}
        await self.inspect(name)
        if entry["reason"]:
            entry["role"] = "unused"
            self.save()
        return name

    async def inspect(self, name: str) -> None:
        """Inspect a data file by the options stated for it."""
        entry = self.state["files"][name]
        entry["facts"], entry["reason"] = {}, ""
        try:
            record = await self.run("inspect", f"files/{name}", *self._form(entry), "--json", logged=False)
            entry["facts"] = {k: v for k, v in record.items() if k not in ("kind", "file")}
            entry["reason"] = entry["facts"].pop("reason", "")
        except InputError as error:
            entry["reason"] = str(error)
        self.save()

    def remove(self, name: str) -> None:
        """Remove a data file; studies and runs have copies of their own."""
        del self.state["files"][name]
        (self.folder / "files" / name).unlink(missing_ok=True)
        self.save()

    def _form(self, entry: dict[str, Any]) -> list[str]:
        keys = ("sheet", "encoding", "decimal", "pressure-unit", "time-unit", "quantity-unit")
        return [text for key in keys if entry.get(key) for text in (f"--{key}", entry[key])]

    # Injector

    def edit_injector(self, change: Callable[[Any], None], base: str = "") -> None:
        """Change the injector's file, or create it from a type of the catalogue; the study's copy is updated."""
        import tomlkit

        place = self.folder / "injector.toml"
        if base:
            document = tomlkit.document()
            document["format"] = "commonrail-injector/1"
            document["name"] = re.sub(r"[^a-z0-9-]+", "-", self.folder.name.lower()).strip("-") or "injector"
            document["base"] = base
        else:
            document = tomlkit.parse(read_plain(place))
        change(document)
        write_text(place, tomlkit.dumps(document))
        self.state["injector"] = base or self.state["injector"]
        if (study := self.study) and (copy := study.parent / "injector.toml").is_file():
            shutil.copyfile(place, copy)
        self.save()

    def set_dimension(self, name: str, value: str, mark: str) -> None:
        """State a dimension of the injector, with its mark."""

        def change(document: Any) -> None:
            table, _, key = name.rpartition(".")
            document.setdefault(table, {})[key] = {"value": value, "mark": mark, "source": "stated in commonrail app"}

        self.edit_injector(change)

    # Studies

    @property
    def study(self) -> Path | None:
        """File of the latest study."""
        return next(iter(self._list_numbered("study", "study.toml")), None)

    @property
    def runs(self) -> list[Path]:
        """Folders of the runs, latest first."""
        return [place.parent for place in self._list_numbered("runs/run", "journal.sqlite")]

    def _list_numbered(self, stem: str, file: str) -> list[Path]:
        parent, _, prefix = stem.rpartition("/")
        paths = (
            p for p in (self.folder / parent).glob(f"{prefix}-*/{file}") if p.parent.name[len(prefix) + 1 :].isdecimal()
        )
        return sorted(paths, key=lambda p: -int(p.parent.name.rpartition("-")[2]))

    def _free(self, stem: str) -> str:
        numbers = [1]
        parent, _, prefix = stem.rpartition("/")
        for place in (self.folder / parent).glob(f"{prefix}-*"):
            number = place.name[len(prefix) + 1 :].partition(".")[0]
            numbers += [int(number) + 1] if number.isdecimal() else []
        return f"{stem}-{max(numbers)}"

    async def new_study(self) -> None:
        """Write a study of the files by `commonrail new`, and add the statements on each file.

        `InputError` without a file or an injector, or if the command fails.
        """
        used = {name: entry for name, entry in self.state["files"].items() if entry["role"] != "unused"}
        if not used or not self.state["injector"]:
            raise InputError("Choose an injector, and drop a data file to be fitted.")
        folder, sources, forms = self._free("study"), {}, list[str]()
        for name, entry in used.items():
            source = f"files/{name}"
            form = self._form(entry)
            if form and "quantity" in str(entry.get("facts", {}).get("taken for")):
                source = f"files/{name.rpartition('.')[0]}.read.csv"
                await self.run("inspect", f"files/{name}", *form, "--out", source, "--json")
            else:
                forms += [text for text in form if text not in forms]
            sources[name] = source
        from_options = [text for source in sources.values() for text in ("--from", source)]
        bench = [text for key, value in self.state["bench"].items() if value for text in (f"--{key}", value)]
        record = await self.run("new", folder, "--injector", "injector.toml", *from_options, *bench, *forms, "--json")

        def change(document: Any) -> None:
            for block in document["data"]:
                owner = next(n for n, s in sources.items() if Path(s).name == Path(block["file"]).name)
                _state_block(document, block, used[owner])

        self._write_study(self.folder / folder / "study.toml", change)
        self.state |= {"unticked": {}, "open": record["open"]}
        self.save()

    def state_open(self, key: str, value: str) -> None:
        """Write a value that `commonrail new` has left open into the study, as return_pressure or data[2].time_zero."""

        def change(document: Any) -> None:
            *path, last = re.split(r"[.\[\]]+", key)
            table = document
            for name in path:
                table = table[int(name) - 1] if name.isdecimal() else table[name]
            table[last] = value

        self.edit_study(change)
        self.state["open"].remove(key)
        self.save()

    def read_study(self) -> Any:
        """Document of the latest study, or None."""
        import tomlkit

        return tomlkit.parse(read_plain(self.study)) if self.study else None

    def edit_study(self, change: Callable[[Any], None]) -> None:
        """Change the latest study; `undo` takes it back."""
        assert self.study is not None
        history = self.study.parent / ".history"
        history.mkdir(exist_ok=True)
        count = len(list(history.iterdir()))
        shutil.copyfile(self.study, history / f"{count + 1:04d}.toml")
        self._write_study(self.study, change)
        self.save()

    def undo(self) -> bool:
        """Take back the latest change of the study; False without a change."""
        steps = sorted((self.study.parent / ".history").glob("*.toml")) if self.study else []
        if not steps or self.study is None:
            return False
        os.replace(steps[-1], self.study)
        self.save()
        return True

    def _write_study(self, place: Path, change: Callable[[Any], None]) -> None:
        import tomlkit

        document = tomlkit.parse(read_plain(place))
        change(document)
        write_text(place, tomlkit.dumps(document))

    # Commands, each in a process of its own

    async def run(self, *arguments: str, logged: bool = True) -> dict[str, Any]:
        """Record of a command that is run in the folder; what succeeds is added to the commands.

        `InputError` with the command's own sentence if it fails.
        """
        process = await asyncio.create_subprocess_exec(
            *python("-m", "commonrail", *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, **self._place()
        )
        out, said = await process.communicate()
        lines = [line.strip() for line in said.decode("utf-8", "replace").replace("\r", "\n").split("\n")]
        message = next((line for line in reversed(lines) if line), "")
        if process.returncode:
            raise InputError(message or f"The command ended with status {process.returncode}.")
        if logged:
            self._log(arguments)
        record: dict[str, Any] = json.loads(out)
        return record

    def _place(self) -> dict[str, Any]:
        return {"cwd": self.folder, "env": same_modules(), "stdin": subprocess.DEVNULL}

    def _log(self, arguments: tuple[str, ...]) -> None:
        with (self.folder / COMMANDS).open("a", encoding="utf-8") as file:
            file.write(shlex.join(["commonrail", *(text for text in arguments if text != "--json")]) + "\n")

    def start_fit(self, run: Path | None = None) -> str:
        """Start a calibration of the latest study, or continue a run; it outlives this server. Returns its name."""
        if run is None:
            assert self.study is not None
            name = self._free("runs/run")
            self._start(name, "calibrate", f"{self.study.parent.name}/study.toml", "--out", name)
        else:
            name = f"runs/{run.name}"
            self._start(name, "resume", name)
        return run.name if run else name.removeprefix("runs/")

    def start_update(self, run: str, file: str) -> str:
        """Start the update of a run with a new data file. Returns the name of the new run."""
        name = self._free("runs/run")
        self._start(name, "update", f"runs/{run}", "--with", f"files/{file}", "--out", name)
        return name.removeprefix("runs/")

    def _start(self, name: str, *arguments: str) -> None:
        self._log(arguments)
        with (self.folder / f"{name}.log").open("wb") as log:
            subprocess.Popen(
                python("-m", "commonrail", *arguments),
                stdout=subprocess.DEVNULL,
                stderr=log,
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # of Windows
                **self._place(),
            )
        self._notify_change()

    def said(self, run: str) -> str:
        """Last line that the process of a run has written."""
        log = self.folder / f"runs/{run}.log"
        if not log.is_file():
            return ""
        with log.open("rb") as file:
            file.seek(max(log.stat().st_size - 4000, 0))
            text = file.read().decode("utf-8", "replace")
        return next((line.strip() for line in reversed(re.split(r"[\r\n]", text)) if line.strip()), "")

    def latest(self) -> str:
        """Name of the run that was started or continued last, or of the latest; empty without a run."""
        logs = sorted(self.folder.glob("runs/run-*.log"), key=lambda p: p.stat().st_mtime)
        return logs[-1].stem if logs else next((run.name for run in self.runs), "")

    def stop(self, process: int) -> None:
        """Ask a calibration to stop; it scores and writes the best values so far.

        SIGINT does not work if a shell started the server in the background: its children inherit that SIGINT is
        ignored.
        """
        with contextlib.suppress(OSError):
            os.kill(process, signal.SIGTERM if os.name == "posix" else getattr(signal, "CTRL_BREAK_EVENT"))  # noqa: B009


def _state_block(document: Any, block: Any, entry: dict[str, Any]) -> None:
    """Write the statements on a file into its block of a study."""
    block["role"] = entry["role"]
    for key in ("rail_pressure", "energising_time", "time_zero", "cylinder_pressure", "return_pressure"):
        if entry.get(key) and (block["kind"] == "rate" or not key.startswith(("rail", "energ", "time"))):
            block[key] = entry[key]
    meter = entry.get("meter", "")
    if meter == "none":
        block.pop("meter", None)
    elif meter and block["kind"] == "rate":
        if meter not in document.get("meters", {}):
            delay = {"lower": "-100 us", "upper": "600 us", "start": "0 us"}
            tables = document.setdefault("meters", {})
            tables[meter] = {"delay": delay, "mark": "E", "source": "stated in commonrail app"}
        block["meter"] = meter
