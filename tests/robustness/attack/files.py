"""Attacks with files: pipes, sizes, formulas and arguments that are none."""

from __future__ import annotations

import os
from pathlib import Path

import commonrail as cr
from commonrail.calibration.study_file import load_study
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import load_fleet
from commonrail.readers.columns import Column
from commonrail.readers.table_sheet import WrittenTable
from commonrail.runs.fit import calibrate_into
from tests.robustness.attack.base import attack, command, python
from tests.robustness.attack.samples import LINK, contents, edited, refusal, rows, small_fleet, small_run, small_study

SPARSE = 20_000_000_000  # [bytes]
MOST_MEMORY = 1_500_000  # [kB] of a process that refuses a table

# Each reader on a pipe that nobody writes to; an alarm ends one that waits.
PIPES = """
import os, signal, sys
from pathlib import Path
import commonrail as cr
from commonrail.base.errors import CommonrailError
from commonrail.runs.folder import read_run
from commonrail.plugins.fleet.study import load_fleet
from commonrail.plugins.fleet.run import fleet as run_fleet
from commonrail.plugins.fleet.study import read_table

class Hung(BaseException):
    pass

def ring(*_):
    raise Hung

folder, fleet, study = map(Path, sys.argv[1:])
signal.signal(signal.SIGALRM, ring)
READERS = {
    "injector.toml": cr.load_injector, "study.toml": cr.load_study, "truth.toml": cr.lab.load_truth,
    "fuel.toml": cr.load_fuel, "fleet.toml": load_fleet, "t.csv": read_table, "t.parquet": read_table,
    "result.json": lambda path: read_run(path.parent), "journal.sqlite": lambda path: cr.resume(path.parent),
    "journal.lock": lambda path: cr.runs.calibrate_into(path.parent, study_of_new),
    "fleet.sqlite": lambda path: run_fleet(fleet_of_new, path.parent),
    "journal.sqlite in a list": lambda path: print("damaged", cr.runs.list_runs(path.parent)[0].state),
    "injector of a fleet": lambda path: run_fleet(pipe_fleet(path), path.parent / "run"),
}
study_of_new, fleet_of_new = cr.load_study(study), load_fleet(fleet)

def pipe_fleet(path):
    text = (fleet.parent / "study.toml").read_text().replace('injector = "virtual-lino-2016"', 'injector = "pipe.toml"')
    (path.parent / "study.toml").write_text(text)
    (path.parent / "fleet.toml").write_text(fleet.read_text())
    (path.parent / "injectors.csv").write_text((fleet.parent / "injectors.csv").read_text())
    os.rename(path, path.with_name("pipe.toml"))
    return load_fleet(path.parent / "fleet.toml")

for number, (name, reader) in enumerate(READERS.items()):
    for linked in (False, True):
        place = folder / f"{number}{linked}"
        place.mkdir()
        path = place / name.split()[0]
        os.mkfifo(place / "real" if linked else path)
        if linked:
            path.symlink_to("real")
        signal.alarm(60)
        try:
            reader(path)
            end = "ended"
        except Hung:
            end = "HUNG"
        except CommonrailError as error:
            end = "refused"
        except Exception as error:
            end = f"RAISED {type(error).__name__}: {error}"
        signal.alarm(0)
        print(f"{name}{' by a link' * linked}: {end}")
"""


@attack()
def pipes(folder: Path, times: int) -> str:
    """A pipe in place of a file that is read is refused, also through a link, and never waited for."""
    script = folder / "pipes.py"
    script.write_text(PIPES, encoding="utf-8")
    answer = python(script, folder, small_fleet(folder / "a", 1), small_study(folder / "study"))
    faults = [line for line in answer.out.splitlines() if "HUNG" in line or "RAISED" in line]
    return answer.fault or (answer.said if answer.status else "; ".join(faults))


@attack(few=0)
def pipe_as_injector(folder: Path, times: int) -> str:
    """A pipe as a fleet's injector ends the command with a sentence."""
    fleet = small_fleet(folder, 1)
    edited(fleet.parent / "study.toml", 'injector = "virtual-lino-2016"', 'injector = "pipe.toml"')
    os.mkfifo(fleet.parent / "pipe.toml")
    answer = command("fleet", fleet, "--out", folder / "run")
    if answer.fault or answer.status != 2:
        return answer.fault or f"exit status {answer.status}"
    return "" if "pipe.toml: this is a pipe, and a file is expected" in answer.said else answer.said


TABLE = """
import resource, sys
from pathlib import Path
from commonrail.base.errors import InputError
from commonrail.plugins.fleet.study import read_table
try:
    print(len(read_table(Path(sys.argv[1])).groups([0])))
except InputError as error:
    print(error)
print(max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))
"""


@attack(few=0)
def dense_parquet(folder: Path, times: int) -> str:
    """A small Parquet file with a huge table is refused, or read, within little memory."""
    import numpy as np
    import pyarrow
    from pyarrow import parquet

    count = 40_000_000
    text = pyarrow.DictionaryArray.from_arrays(np.zeros(count // 5, np.int32), ["A" * 900])
    zeros = np.zeros(count)
    tables = {"rows": pyarrow.table({"injector": zeros}), "texts": pyarrow.table({"injector": text, "b": text})}
    tables["columns"] = pyarrow.table([zeros[:1_000_000]] * 300, [str(i) for i in range(300)])
    script = folder / "table.py"
    script.write_text(TABLE, encoding="utf-8")
    for name, table in tables.items():
        path = folder / f"{name}.parquet"
        parquet.write_table(table, path, compression="zstd", store_schema=False)
        answer = python(script, path)
        if answer.fault or answer.status:
            return f"{name}: {answer.fault or answer.said}"
        if (kilobytes := int(answer.out.split()[-1])) > MOST_MEMORY:
            return f"{name}: {path.stat().st_size / 1e6:.1f} MB took {kilobytes / 1e6:.1f} GB"
    return ""


@attack()
def sparse_data(folder: Path, times: int) -> str:
    """A data file that has grown to 20 GB is told as changed, and not read, when its run is resumed."""
    run = small_run(folder)
    data = folder / "study" / "data" / "evi.csv"
    os.truncate(data, SPARSE)
    script = folder / "limited.py"
    script.write_text(
        "import resource\nresource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))\n"
        "from commonrail.cli.start import main\nmain()\n",
        encoding="utf-8",
    )
    answer = python(script, "resume", run)
    data.unlink()
    if answer.fault or answer.status != 2 or "evi.csv has been changed" not in answer.said:
        return answer.fault or answer.said or f"exit status {answer.status}"
    return ""


@attack()
def formulas(folder: Path, times: int) -> str:
    """A formula as title, name or reason is no formula in a table, and is read back as it was."""
    study = small_study(folder / "study")
    text = study.read_text(encoding="utf-8")
    name = next(line for line in text.splitlines() if line.startswith("name = ") and "." not in line)
    text = text.replace(name, f"name = '{LINK}'", 1)
    title = next(line for line in text.splitlines() if line.startswith("title = "))
    study.write_text(text.replace(title, f"title = 'a,{LINK}'", 1), encoding="utf-8")
    calibrate_into(folder / "run", load_study(study), threads=1)
    fleet = small_fleet(folder)
    (fleet.parent / "=2+3.csv").write_text("no table", encoding="utf-8")
    edited(fleet.parent / "injectors.csv", "data/SN000002_160MPa.csv", "=2+3.csv")
    template = fleet.parent / "study.toml"
    told = template.read_text(encoding="utf-8").replace("simulated by", f"{LINK.replace(chr(34), chr(39))},\t=1, by")
    template.write_text(told, encoding="utf-8")
    run_fleet(load_fleet(fleet), folder / "fleet-run", workers=1)
    for path in [folder / "run" / "traces.csv", folder / "fleet-run" / "results.csv"]:
        computed = [cell for row in rows(path) for cell in row if cell.strip()[:1] in ("=", "@", "+")]
        if computed:
            return f"{path.name} holds {computed[0]}"
    found = set(WrittenTable(folder / "run" / "traces.csv").take([Column("data")]).texts["data"])
    return "" if found == {LINK} else f"read back as {found}"


@attack()
def wrong_counts(folder: Path, times: int) -> str:
    """A count of another kind is refused before a run or a fleet is touched."""
    run = small_run(folder)
    before = contents(run)
    for value in (1.5, "2", -1, float("nan"), [1], True):
        for name in ("generations", "threads"):
            said = refusal(lambda name=name, value=value: cr.resume(run, **{name: value}))  # type: ignore[misc]
            if not said or contents(run) != before:
                return f"{name}={value!r}: {said or 'accepted'}; the run has changed: {contents(run) != before}"
    fleet = load_fleet(small_fleet(folder, 1))
    for value in (1.5, "2", 0, float("nan"), True):
        said = refusal(lambda value=value: run_fleet(fleet, folder / "fleet-run", workers=value))  # type: ignore[misc]
        if not said or (folder / "fleet-run").exists():
            return f"a fleet with workers={value!r}: {said or 'accepted'}; its folder is made"
    return ""


@attack(few=0)
def modules_beside(folder: Path, times: int) -> str:
    """A module in the current folder is not run by a process that a command starts."""
    for name in ("json", "threading", "numba", "numpy", "signal"):
        (folder / f"{name}.py").write_text(f"open({str(folder / 'mark')!r}, 'a').close()\n", encoding="utf-8")
    program = (
        f"import os, sys; os.chdir({str(folder)!r}); sys.argv = ['commonrail', 'doctor']; "
        "from commonrail.cli.start import main; main()"
    )
    answer = python("-P", "-c", program, XDG_CACHE_HOME=str(folder / "cache"))
    return answer.fault or ("a module was run" if (folder / "mark").exists() else "")
