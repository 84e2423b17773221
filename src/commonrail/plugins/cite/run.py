"""Parts of a run or an injector with the source of each, and the works to cite for them, as BibTeX."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import ConfigDict, Field, field_validator

from commonrail.base import registry
from commonrail.base.input import read_plain
from commonrail.base.output import write_text
from commonrail.base.text import count_noun
from commonrail.calibration.optimisers.registry import find_optimiser
from commonrail.cli.model_name import read_model_name
from commonrail.compiler.target import package_versions
from commonrail.physics.injector import Injector, Source
from commonrail.physics.meters import Meter
from commonrail.physics.variants import INSTALLED_LAWS
from commonrail.readers.location import Place
from commonrail.readers.toml import UNSTATED, FileModel, fault, read_model, read_toml
from commonrail.runs.folder import RESULT, STUDY, read_result

MARKS = {"M": "measured", "C": "ECU calibration", "F": "fitted or derived", "E": "estimate"}
MODEL = "Lino et al. 2016"  # equations of the injector
LIBRARIES = ("numpy", "scipy", "numba")
SYNTHETIC = "; synthetic: "  # marks the source of synthetic data
_ADDRESS = re.compile(r"(?:doi:|arXiv:|\S*\w\.(?:com|org|net|edu|io)/).*")  # address in a source
_ENTRY = re.compile(r"^@(\w+)\{([^,]+),\n(.*?)^\}", re.DOTALL | re.MULTILINE)
_FIELD = re.compile(r"^ *(\w+) = \{(.*)\},?$", re.MULTILINE)


class Use(NamedTuple):
    """Part of a run: its kind, its name, and its source in words."""

    kind: str
    name: str
    source: str


class Reference(NamedTuple):
    """Work to be cited: key, kind of BibTeX entry, and its fields."""

    key: str
    kind: str
    fields: Mapping[str, str]

    def bibtex(self) -> str:
        """BibTeX entry."""
        lines = "".join(f"  {name} = {{{value}}},\n" for name, value in self.fields.items() if name != "shorthand")
        return f"@{self.kind}{{{self.key},\n{lines}}}\n"

    def sentence(self) -> str:
        """Work in one line, without BibTeX's braces."""
        f = self.fields
        issue = " ".join(f[name] for name in ("journal", "booktitle", "volume", "version") if name in f)
        where = [issue, f.get("pages", ""), f.get("year", "")]
        ends = [f"doi:{f['doi']}" if "doi" in f else "", f"arXiv:{f['eprint']}" if "eprint" in f else ""]
        parts = [f.get("author", "").replace(" and ", "; "), f["title"], ", ".join(filter(None, where)), *ends]
        return re.sub(r"[{}\\]", "", ". ".join(filter(None, [*parts, f.get("note", "")]))).replace("--", "–")


class Citation(NamedTuple):
    """Parts of a run, and the works to cite for them."""

    uses: tuple[Use, ...]
    works: tuple[Reference, ...]


def cite(model: str | Path) -> Citation:
    """List the parts of a model with their sources, and the works to cite.

    Parameters
    ----------
    model : str or path
        Run folder of `calibrate`, injector file, or injector of the catalogue.

    Raises
    ------
    InputError
        If `model` is none of these, or a record of the run is broken.
    """
    uses = list_uses(str(model))
    return Citation(tuple(uses), tuple(list_references(uses)))


def read_bibtex(text: str) -> list[Reference]:
    """Read the entries of a BibTeX text with one field in braces on each line."""
    return [Reference(key, kind, dict(_FIELD.findall(body))) for kind, key, body in _ENTRY.findall(text)]


def list_uses(model: str) -> list[Use]:
    """List the parts of a run folder of ``commonrail calibrate``, an injector file or a catalogue injector.

    Raises `InputError` if `model` is none of these, or a record of the run is broken.
    """
    model_and_run = read_model_name(model)
    injector, run = model_and_run.injector, model_and_run.folder
    record, study = _records(run)
    software = record.get("software") or package_versions()
    summary = metadata.metadata("commonrail")["Summary"]
    uses = [
        Use("software", f"commonrail {software['commonrail']}", summary),
        Use("model", injector.variant.label, MODEL),
        Use("injector", injector.name, _source(injector.title, injector.synthetic)),
        *_values(injector.sources, "injector value"),
        Use("fuel", injector.fuel.name, f"{injector.fuel.title}, {MARKS[injector.fuel.mark]}: {injector.fuel.source}"),
    ]
    for meter in model_and_run.meters:
        uses += _values(meter.sources, f"meter {meter.name}")
    uses += _record_uses(record)
    uses += [Use("library", f"{name} {software[name]}", name) for name in LIBRARIES if software.get(name)]
    stated = {model, injector.name, record.get("injector", {}).get("name"), study.get("injector")}
    return [*uses, *_packages(injector, model_and_run.meters, record, stated)]


class _Part(FileModel):
    """Table of a record; other keys than the fields are ignored."""

    model_config = ConfigDict(extra="ignore")


class _Data(_Part):
    name: str
    role: str
    source: str
    synthetic: str
    kind: str


class _Prior(_Part):
    source: str


class _Parameter(_Part):
    name: str
    prior: _Prior = _Prior(source="")


class _Optimiser(_Part):
    method: str | None = None


class _Injector(_Part):
    name: str | None = None


class _Record(_Part):
    software: dict[str, str | None] | None = None
    injector: _Injector = _Injector()
    data: list[_Data] = Field(default_factory=list)
    parameters: list[_Parameter] = Field(default_factory=list)
    optimiser: _Optimiser = _Optimiser()
    certainty: dict[str, Any] = Field(default_factory=dict)

    @field_validator("software")
    @classmethod
    def _has_version(cls, software: dict[str, str | None] | None) -> dict[str, str | None] | None:
        if software is not None and software.get("commonrail") is None:
            raise fault('the version of "commonrail" is missing; calibrate again')
        return software


class _Study(_Part):
    injector: str | None = None


def _records(run: Path | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return record and study of a run, empty if absent; raises `InputError` with file and key if one is malformed."""
    if run is None:
        return {}, {}
    record = read_result(run)
    read_model(_Record, record, Place(str(run / RESULT)))
    study = read_toml(run / STUDY)[0] if (run / STUDY).is_file() else {}
    read_model(_Study, study, Place(str(run / STUDY)))
    return record, study


def _source(text: str, synthetic: str) -> str:
    return f"{text}{SYNTHETIC}{synthetic}" if synthetic else text


def _values(sources: Mapping[str, Source], kind: str) -> Iterator[Use]:
    """One line for all values of one source."""
    stated = {name: source for name, source in sources.items() if source != UNSTATED}
    for source in dict.fromkeys(stated.values()):
        names = [name for name, other in stated.items() if other == source]
        others = f" and {count_noun(len(names) - 1, 'other')}" if len(names) > 1 else ""
        yield Use(kind, names[0] + others, f"{MARKS[source.mark]}: {source.text}")


def _record_uses(record: Mapping[str, Any]) -> Iterator[Use]:
    """Data, priors, optimiser and intervals of a run's record."""
    for data in record.get("data", ()):
        yield Use(f"data ({data['role']})", data["name"], _source(data["source"], data["synthetic"]))
    for parameter in record.get("parameters", ()):
        if "prior" in parameter:
            yield Use("prior", parameter["name"], parameter["prior"]["source"])
    if method := record.get("optimiser", {}).get("method"):
        entry = find_optimiser(method)
        yield Use("optimiser", method, entry.citation if entry else "from a package that is not installed")
    if "certainty" in record:
        yield Use("intervals", "smoothed importance sampling", "Vehtari et al. 2024")


def _packages(
    injector: Injector, meters: Sequence[Meter], record: Mapping[str, Any], stated: Collection[object]
) -> Iterator[Use]:
    """Installed packages that supply parts of a run, each with its `__citation__`.

    `stated`: catalogue names of the injector.
    """
    used: dict[str, Collection[object]] = {
        "injectors": stated,
        "fuels": {injector.fuel.name},
        **{group: {getattr(injector.variant, field)} for field, (group, _) in INSTALLED_LAWS.items()},
        "meters": {meter.name for meter in meters},
        "optimisers": {record.get("optimiser", {}).get("method")},
        "data": {data["kind"] for data in record.get("data", ())},
    }
    entries: dict[str, registry.Entry] = {}
    for group, names in used.items():
        for name, entry in registry.find_installed(group).items():
            if name in names:
                entries.setdefault(entry.distribution, entry)
    for name, entry in entries.items():
        yield Use("package", f"{name} {entry.version}", entry.citation())


def list_references(uses: Sequence[Use]) -> list[Reference]:
    """List the works to cite: the tool, works named in sources, packages, sources of data or with an address."""
    text = read_plain(Path(__file__).with_name("references.bib")).decode()
    named_in = "\n".join(use.source for use in uses)
    references = [_tool(uses[0])]
    references += [
        reference
        for reference in read_bibtex(text)
        if re.search(rf"(?<!\w){re.escape(reference.fields['shorthand'])}", named_in)
    ]
    notes: dict[str, Use] = {}
    for use in uses:
        if use.kind == "package" and use.source.lstrip().startswith("@"):
            references += read_bibtex(use.source.strip() + "\n")
        elif use.kind == "package" or (use.kind.startswith("data") and SYNTHETIC not in use.source):
            notes.setdefault(use.source, use)
        elif address := _ADDRESS.search(use.source):
            notes.setdefault(address[0], use)
    for note, use in notes.items():
        key = re.sub(r"\W+", "-", f"{use.kind.split()[0]}-{use.name}").strip("-")
        title = use.name if use.kind == "package" else f"{use.kind}: {use.name}"
        references.append(Reference(key, "misc", {"title": _escape(title), "note": _escape(note)}))
    return list({reference.key: reference for reference in references}.values())


def _tool(use: Use) -> Reference:
    about = metadata.metadata("commonrail")
    version = use.name.partition(" ")[2]
    authors = "{" + str(about["Author"] or "The commonrail authors") + "}"
    fields = {"author": authors, "title": f"commonrail: {use.source.rstrip('.')}", "version": version}
    return Reference("commonrail", "software", fields | {"note": f"Licence {about['License-Expression']}"})


def _escape(text: str) -> str:
    """Escape a text for a BibTeX field."""
    return re.sub(r"([&%#_$])", r"\\\1", re.sub(r"[{}\\]", "", text))


def write_bibtex(path: Path, references: Sequence[Reference]) -> None:
    """Write a BibTeX file atomically; raises `OutputError` if it cannot be written."""
    write_text(path, "\n".join(reference.bibtex() for reference in references))
