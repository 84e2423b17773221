"""Readers of files, the good files that inputs are made from, and the two allowed ends: a result or one sentence."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable
from functools import cache
from io import SEEK_END, BytesIO, StringIO
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import NamedTuple
from zipfile import ZipFile, ZipInfo

import numpy as np
from openpyxl import Workbook
from scipy.io import savemat

from commonrail.base.errors import CommonrailError
from commonrail.calibration.study import Study
from commonrail.calibration.study_file import load_study
from commonrail.data.curves.data import RateData
from commonrail.data.quantities.data import QuantityData
from commonrail.engine.plan import candidate_matrix, make_job, prepare
from commonrail.engine.time_step import longest_step, medium_of
from commonrail.physics.injector import Injector, parameter_paths
from commonrail.plugins.family.injector_type import load_type
from commonrail.plugins.maps.file import write_map_file
from commonrail.plugins.paper.bench_file import load_truth
from commonrail.plugins.tolerance.file import load_tolerances
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import injector_text
from commonrail.readers.overview import survey
from commonrail.report.page import write_report
from commonrail.runs.folder import read_run
from tests.fuzz import kept
from tests.fuzz.database import spoilt_database
from tests.fuzz.mutation import BYTES, mutated
from tests.plugins.compare.samples import compared_maps, compared_rates, compared_traces
from tests.plugins.maps.tables import table
from tests.report.analysis_samples import sensitivity_record, tolerance_record
from tests.report.reproduction_sample import record as reproduction_record
from tests.report.samples import map_record, rate_record, rate_traces

__all__ = ["TARGETS", "Broken", "check", "check_reader", "write_input"]

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "src" / "commonrail"
PLANNED = 200_000  # steps of a plan that is made
LONGEST_SENTENCE = 1100
LEAKS = (
    "Traceback",
    "object at 0x",
    "<class ",
    "built-in",
    "pydantic",
    "tomllib",
    "commonrail.readers.",
    "commonrail.calibration.study_file.",
)

Files = dict[str, bytes]


class Broken(AssertionError):
    """An input after which the program did what it must not."""


class Target(NamedTuple):
    """A reader, the good files it reads, those of them that get faults, and how often it is tried among the others."""

    read: Callable[[Path], None]
    files: Callable[[], list[Files]]
    spoilt: tuple[str, ...]
    weight: int


def write_input(random: Random, name: str, folder: Path) -> None:
    """Write good files of a target into an empty folder, at least one of them with faults."""
    target = TARGETS[name]
    files = random.choice(target.files())
    open_ones = [file for file in files if file.endswith(target.spoilt)]
    chosen = {random.choice(open_ones)} | {file for file in open_ones if random.random() < 0.1}
    for file, data in files.items():
        path = folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_spoilt(random, file, data) if file in chosen else data)


def _spoilt(random: Random, file: str, data: bytes) -> bytes:
    kind = file.rpartition(".")[2]
    if kind == "xlsx":
        return _spoilt_book(random, data)
    if kind in ("parquet", "mat", "tdms", "txt"):
        return random.choice(BYTES)(random, data)
    return spoilt_database(random, data) if kind == "sqlite" else mutated(random, file, data)


def _spoilt_book(random: Random, data: bytes) -> bytes:
    """A workbook with faults in one of its parts."""
    stream = BytesIO()
    with ZipFile(BytesIO(data)) as whole, ZipFile(stream, "w") as spoilt:
        chosen = random.choice([name for name in whole.namelist() if "sheet1" in name or "workbook.xml" in name])
        for name in whole.namelist():
            part = whole.read(name)
            spoilt.writestr(ZipInfo(name), random.choice(BYTES)(random, part) if name == chosen else part)
    return stream.getvalue()


def check(name: str, folder: Path) -> str:
    """Read the input in a folder; returns the sentence of its refusal, or an empty text.

    Raises
    ------
    Broken
        If reading ended in any other way, or the sentence is not one that a user can use.
    """
    return check_reader(TARGETS[name].read, folder)


def check_reader(read: Callable[[Path], None], folder: Path) -> str:
    """As `check`, with a reader."""
    try:
        read(folder)
    except CommonrailError as error:
        _judge(str(error), folder)
        return str(error)
    except Exception as error:
        raise Broken(f"{type(error).__name__}: {str(error)[:300]}") from error
    return ""


def _judge(sentence: str, folder: Path) -> None:
    faults = [leak for leak in LEAKS if leak in sentence]
    if len(sentence.splitlines()) != 1 or len(sentence) > LONGEST_SENTENCE:
        faults.append("not one line of moderate length")
    elsewhere = ("/", f"{kept.TITLE}: not one")  # a file outside, or no file but what was simulated
    if str(folder) not in sentence and folder.name not in sentence and not sentence.startswith(elsewhere):
        faults.append("no file is named")
    if not sentence.endswith("."):
        faults.append("no sentence")
    if faults:
        raise Broken(f"{', '.join(faults)}: {sentence[:300]!r}")


def _read_study(folder: Path) -> None:
    study = load_study(folder / "study.toml")
    try:
        _plan(study.injector)
        _plan_study(study)
    except CommonrailError:
        return  # the loader has said where; a plan knows no files


def _read_injector(folder: Path) -> None:
    injector = load_injector(folder / "injector.toml")
    try:
        _plan(injector)
    except CommonrailError:
        return


def _plan(injector: Injector) -> None:
    """The cheap steps before a simulation."""
    theta = candidate_matrix(injector, (), np.zeros((1, 0)))
    longest_step(injector, theta[0, : len(parameter_paths())], medium_of(injector, 160e6))
    injector_text(injector, {}, "")


def _plan_study(study: Study) -> None:
    names = study.space.names
    bounds = np.array([study.space.lower, study.space.upper])
    theta = candidate_matrix(study.injector, names, bounds)
    for data in study.data:
        points = data.points if isinstance(data, QuantityData) else (data.point,)
        assert isinstance(data, QuantityData | RateData)
        steps = max(point.duration for point in points) / study.time_step * len(points)
        if steps <= PLANNED:
            make_job(prepare(study.injector, points, study.time_step), theta, True)


def _read_truth(folder: Path) -> None:
    load_truth(folder / "truth.toml")


def _read_type(folder: Path) -> None:
    load_type(folder / "type.toml")


def _read_tolerances(folder: Path) -> None:
    load_tolerances(folder / "tolerances.toml")


def _read_run(folder: Path) -> None:
    read_run(folder)


def _report(folder: Path) -> None:
    write_report(folder)


def _survey(folder: Path) -> None:
    for path in sorted(folder.iterdir()):
        survey(path)


@cache
def _bench_files() -> list[Files]:
    """A map as a workbook and as a MAT file."""
    book, stream, other = Workbook(), BytesIO(), BytesIO()
    rows = (
        ["quantity [mm3]"],
        ["rail pressure [bar] \\ energising time [us]", 300, 500],
        [800, 10, 25],
        [1200, 15, 40],
    )
    for row in rows:
        book.active.append(row)
    book.save(stream)
    units = {"p_unit": "bar", "et_unit": "us", "q_unit": "mm3"}
    savemat(other, {"p": [800.0, 1200.0], "et": [300.0, 500.0], "q": [[10.0, 25.0], [15.0, 40.0]], **units})
    return [{"map.xlsx": stream.getvalue()}, {"map.mat": other.getvalue()}, {"rate.tdms": _tdms()}]


def _tdms() -> bytes:
    """Two waveforms, and a group with its own times."""
    from nptdms import ChannelObject, TdmsWriter

    stream, samples = BytesIO(), np.linspace(0.0, 40.0, 30)
    wave = {"wf_increment": 1e-5, "wf_start_offset": 0.0}
    with TdmsWriter(stream) as writer:
        for unit, name in (("mm3/ms", "ROI"), ("bar", "p")):
            writer.write_segment([ChannelObject("EVI", name, samples, wave | {"unit_string": unit})])
        writer.write_segment([ChannelObject("slow", name, samples, {}) for name in ("time", "T")])
    return stream.getvalue()


@cache
def _ecu_files() -> list[Files]:
    """A map in each format of control units."""
    with TemporaryDirectory() as place:
        paths = [Path(place) / f"map{ending}" for ending in (".dcm", ".cdfx", ".table")]
        for path in paths:
            write_map_file(path, [table()])
        return [{path.name: path.read_bytes()} for path in paths]


@cache
def _tables() -> list[Files]:
    """Texts as benches write them: units in heads, notes, two header rows, a scope, German signs and encodings."""
    heads = "Gegendruck;50;bar\nMenge [mm³/Hub]\nti (µs);400 bar;800 bar\n200;0,5;1,2\n400;4,1;9,8\n"
    rows = "Prüfpunkt;Raildruck [bar];Ansteuerdauer [µs];Soll [mm³]\nVL;1600;900;60,5\nLL;300;650;3,4\n"
    scope = "Record Length,4\nVertical Units,V\nTIME,CH1\n0e-6,1\n1e-6,2\n2e-6,1\n3e-6,2\n"
    wide = "rail;p;p\nt;a;b\n(ms);(bar);[mm3/ms]\n0;1;2\n1;3;4\n2;3;4\n3;3;4\n"
    texts = [{"table.csv": text.encode()} for text in (heads, rows, scope, wide)]
    return [*texts, {"table.txt": heads.encode("cp1252")}, {"table.txt": rows.encode("utf-16")}]


def _folder(path: Path, *names: str) -> Files:
    return {name: (path / name).read_bytes() for name in names}


def _files_of(case: Path) -> list[str]:
    own = [name for name in ("study.toml", "injector.toml") if (case / name).exists()]
    return [*own, *(f"data/{path.name}" for path in sorted((case / "data").iterdir()))]


@cache
def _studies() -> list[Files]:
    templates = _folder(PACKAGE / "plugins" / "new" / "template", "study.toml", "injector.toml", "data/evi.csv")
    cases = (ROOT / "cases" / name for name in ("cri2-16", "paper"))
    case, paper = (_folder(at, *_files_of(at)) for at in cases)
    return [templates, templates, templates, case, case, paper]


@cache
def _injectors() -> list[Files]:
    fuel = (PACKAGE / "physics" / "catalogue" / "fuels" / "iso4113.toml").read_bytes()
    folder = PACKAGE / "physics" / "catalogue" / "injectors"
    own = [(folder / f"{name}.toml").read_bytes() for name in ("virtual-lino-2016", "cri2-16")]
    own.append((PACKAGE / "plugins" / "new" / "template" / "injector.toml").read_bytes())
    with_fuel = own[-1].replace(b'name = "iso4113"', b'file = "fuel.toml"')
    written = injector_text(load_injector("cri2-16"), {}, "calibrated").encode()
    files = [{"injector.toml": text} for text in (*own, written)]
    return [*files, {"injector.toml": with_fuel, "fuel.toml": fuel}]


@cache
def _truths() -> list[Files]:
    folder = PACKAGE / "plugins" / "paper" / "truths"
    texts = [path.read_bytes() for path in sorted(folder.glob("*.toml"))]
    local = texts[0].replace(b'injector = "virtual-lino-2016"', b'injector = "injector.toml"')
    return [*({"truth.toml": text} for text in texts), {"truth.toml": local, **_injectors()[0]}]


@cache
def _types() -> list[Files]:
    small = b'[[parameter]]\nname = "valve.mass"\nvalue = "4 g"\nspread = "1 g"\nlower = "2 g"\nupper = "8 g"\n'
    head = b'format = "commonrail-type/1"\nname = "t"\n'
    start = (ROOT / "cases" / "family" / "start.toml").read_bytes().replace(b"../cri2-16/injector.toml", b"cri2-16")
    own = {"type.toml": head + b'injector = "injector.toml"\n' + small, **_injectors()[0]}
    noted = {"type.toml": head + small + b"# a note, in which a fault does no harm\n" * 40}
    return [noted, {"type.toml": start}, own]


@cache
def _tolerances() -> list[Files]:
    case = (ROOT / "cases" / "tolerance" / "tolerances.toml").read_bytes()
    local = case.replace(b'injector = "virtual-lino-2016"', b'injector = "injector.toml"')
    noted = case + b"# a note, in which a fault does no harm\n" * 200
    return [{"tolerances.toml": noted}, {"tolerances.toml": local, **_injectors()[0]}]


@cache
def _runs() -> list[Files]:
    """Run folders of every kind."""
    curves = rate_record()
    compared = compared_rates()
    return [
        {"result.json": _json(curves), "traces.csv": _traces(rate_traces(curves), ("rigid", "start", "best"))},
        {"result.json": _json(map_record()), "traces.csv": _traces({}, ("start", "best"))},
        {"comparison.json": _json(compared), "traces.csv": _traces(compared_traces(compared), compared["labels"])},
        {"comparison.json": _json(compared_maps()), "traces.csv": _traces({}, ("start", "best"))},
        {"sensitivity.json": _json(sensitivity_record())},
        {"tolerance.json": _json(tolerance_record())},
        {"reproduce.json": _json(reproduction_record()), "traces.csv": REPRODUCED.encode()},
    ]


REPRODUCED = (
    "# SYNTHETIC: made up for a test\nseed,data,time [us],experiment [mm3/ms],rigid [mm3/ms],rigid_fitted [mm3/ms],\
theoretical [mm3/ms],paper [mm3/ms],optimised [mm3/ms]\n"
    + "".join(
        f"{seed},{rail} MPa,{1.5 + 3 * i},{10.5 * i},{9.0 * i},{8.5 * i},{8.0 * i},,{10.0 * i}\n"
        for seed in (4, 7)
        for rail in (160, 120, 80)
        for i in range(4)
    )
)


def _json(record: object) -> bytes:
    return json.dumps(record, indent=1).encode()


def _traces(traces: dict[str, dict[str, np.ndarray]], labels: Iterable[str]) -> bytes:
    """traces.csv with every twentieth sample."""
    stream = StringIO("# made up for a test\n")
    stream.seek(0, SEEK_END)
    columns = ("measured", *labels)
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(["data", "time [us]", *(f"{column} [mm3/ms]" for column in columns)])
    for name, trace in traces.items():
        for k in range(0, len(trace["time_s"]), 20):
            writer.writerow([name, repr(float(trace["time_s"][k] * 1e6)), *(float(trace[c][k] * 1e6) for c in columns)])
    return stream.getvalue().encode()


TARGETS = {
    "study": Target(_read_study, _studies, (".toml", ".csv"), 45),
    "injector": Target(_read_injector, _injectors, (".toml",), 18),
    "truth": Target(_read_truth, _truths, (".toml",), 12),
    "type": Target(_read_type, _types, ("type.toml",), 6),
    "tolerances": Target(_read_tolerances, _tolerances, ("tolerances.toml",), 6),
    "run": Target(_read_run, lambda: _runs()[:2], (".json", ".csv"), 5),
    "report": Target(_report, _runs, (".json", ".csv"), 6),
    "journal": Target(kept.read_journal, kept.runs, (".sqlite",), 6),
    "fleet": Target(kept.read_fleet, kept.fleets, ("fleet.toml", "study.toml", "s.csv", ".parquet"), 5),
    "table": Target(_survey, _tables, (".csv", ".txt"), 10),
    "bench file": Target(_survey, _bench_files, (".xlsx", ".mat", ".tdms"), 3),  # starts a process each time
    "control unit": Target(_survey, _ecu_files, (".dcm", ".cdfx", ".table"), 6),
    "fleet journal": Target(kept.read_fleet_journal, kept.fleet_runs, (".sqlite",), 3),
}
