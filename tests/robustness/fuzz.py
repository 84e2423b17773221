"""Feed spoilt files to every reader: python -m tests.robustness.fuzz 100000 [--seed 1] [--first 0] [--keep DIR].

Each input must be read or refused with one sentence that names a file, within 5 s and 1 GB. Inputs after which
something else happened are kept in a folder, with a note beside them. Exit status 1 if there is any. Before them come
the files of `tests/fuzz/bombs.py`, small ones that are built to take memory or time without end; what they took is
printed. A child that reads a foreign format has the same memory, and its time besides that of its start.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path
from random import Random

LONGEST = 5.0  # processor time for one input [s]
HUNG = 600.0  # wall time, long for a busy machine, after which a process that does not hear its clock is given up [s]
MEMORY = 1_000_000_000  # of a process in addition to what the program itself takes [bytes]
PROCESSES = 2


class TooLong(BaseException):
    """The watchdog; no reader catches it."""


def main() -> int:
    """Run the inputs in processes and add up."""
    options = _options()
    options.keep.mkdir(parents=True, exist_ok=True)
    if options.bombs:
        return _run_bombs(options.keep)
    if options.part is not None:
        return _run_part(options)
    command = [sys.executable, "-m", "tests.robustness.fuzz", str(options.inputs), "--seed", str(options.seed)]
    command += ["--first", str(options.first), "--keep", str(options.keep)]
    bombs = subprocess.run([*command, "--bombs"], check=False).returncode
    parts = [
        subprocess.Popen([*command, "--part", str(i)], stdout=subprocess.PIPE, text=True) for i in range(PROCESSES)
    ]
    results = [_result(part) for part in parts]
    done, failed, refused = (sum(int(r[i]) for r in results) for i in range(3))
    slowest, peak = (max(r[i] for r in results) for i in (3, 4))
    crashed = sum(part.returncode not in (0, 1) for part in parts)
    print(
        f"{done} of {options.inputs}, {failed} tracebacks, slowest {slowest:.2f} s, peak memory {peak:.0f} MB "
        f"({refused} refused, {done - refused - failed} read; seed {options.seed})"
    )
    if crashed:
        print(f"{crashed} of {PROCESSES} processes died; their last inputs are in {options.keep}")
    return int(failed > 0 or crashed > 0 or done != options.inputs or bombs != 0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("inputs", type=int)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first input: to continue an earlier trial")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-findings"), help="folder for inputs that fail")
    parser.add_argument("--bombs", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--part", type=int, help=argparse.SUPPRESS)
    return parser.parse_args()


def _result(part: subprocess.Popen[str]) -> list[float]:
    """Done, failed, refused, slowest, peak: the last line that the process has left."""
    lines = part.communicate()[0].splitlines()
    for line in lines[:-1]:
        print(line)
    return [float(word) for word in lines[-1].split()] if lines else [0.0] * 5


def _run_bombs(keep: Path) -> int:
    """Read each bomb in a process of its own, whose peak memory and time, with its children's, are printed."""
    from tests.fuzz.bombs import BOMBS, read
    from tests.fuzz.targets import Broken, check_reader

    failed = 0
    for name, build in BOMBS.items():
        with tempfile.TemporaryDirectory() as place:
            (Path(place) / name).write_bytes(build())
            child = os.fork()
            if child == 0:
                _limit_memory()
                signal.signal(signal.SIGPROF, _ring)
                signal.setitimer(signal.ITIMER_PROF, LONGEST)
                try:
                    end = check_reader(read, Path(place)) or "read"
                    status = 0
                except (Broken, TooLong) as error:
                    end, status = f"FAILED: {error}", 1
                own, inner = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
                print(
                    f"{name}: {own.ru_maxrss / 1e3:.0f} + {inner.ru_maxrss / 1e3:.0f} MB, "
                    f"{own.ru_utime + own.ru_stime:.1f} + {inner.ru_utime + inner.ru_stime:.1f} s, "
                    f"{end.replace(place, '')[:150]}",
                    flush=True,
                )
                os._exit(status)
            if os.waitpid(child, 0)[1]:
                failed += 1
                _keep(Path(place), keep / name, Broken(name))
    return int(failed > 0)


def _run_part(options: argparse.Namespace) -> int:
    from commonrail.base.hooks import tell_notes
    from tests.fuzz.targets import TARGETS, Broken, check, write_input

    tell_notes(lambda _: None)  # they are no faults, and warnings of the same kind unless somebody listens
    warnings.simplefilter("error", RuntimeWarning)  # NumPy's would stand on the user's terminal
    signal.signal(signal.SIGPROF, _ring)
    with tempfile.TemporaryDirectory() as place:
        _warm_up(Path(place))
        _limit_memory()
        names, weights = zip(*((name, target.weight) for name, target in TARGETS.items()), strict=True)
        done = failed = refused = 0
        slowest = 0.0
        for number in range(options.first + options.part, options.first + options.inputs, PROCESSES):
            random = Random(f"{options.seed} {number}")
            (name,) = random.choices(names, weights)
            # of the names of the folders alone the sentence must hold this one
            folder = Path(place) / f"input-{number}"
            folder.mkdir()
            write_input(random, name, folder)
            faulthandler.dump_traceback_later(HUNG, exit=True)
            begin = time.process_time()
            try:
                signal.setitimer(signal.ITIMER_PROF, LONGEST)
                refused += bool(check(name, folder))
            except (Broken, TooLong) as error:
                failed += 1
                _keep(folder, options.keep / f"{name}-{options.seed}-{number}", error)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
            slowest = max(slowest, time.process_time() - begin)
            faulthandler.cancel_dump_traceback_later()
            shutil.rmtree(folder)
            done += 1
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(done, failed, refused, slowest, peak)
    return int(failed > 0)


def _ring(*_: object) -> None:
    raise TooLong(f"took longer than {LONGEST} s")


def _warm_up(place: Path) -> None:
    """Read good files once: what is compiled or built at the first use counts for no input."""
    from tests.fuzz.targets import TARGETS

    for name, target in TARGETS.items():
        for i, files in enumerate(target.files()):
            folder = place / f"good-{name}-{i}"
            for file, data in files.items():
                (folder / file).parent.mkdir(parents=True, exist_ok=True)
                (folder / file).write_bytes(data)
            target.read(folder)


def _limit_memory() -> None:
    """Bound what the process may still take; what it has are pages of its own and heaps that libraries reserve."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    own = 1024 * next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmData"))
    resource.setrlimit(resource.RLIMIT_DATA, (own + MEMORY, own + MEMORY))


def _keep(folder: Path, target: Path, error: BaseException) -> None:
    shutil.copytree(folder, target, dirs_exist_ok=True)
    (target / "note.txt").write_text("".join(traceback.format_exception(error)), encoding="utf-8", errors="replace")
    print(f"{target}: {' '.join(str(error).split())[:200]}", flush=True)


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    sys.exit(main())
