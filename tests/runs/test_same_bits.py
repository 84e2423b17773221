"""A study with `same_bits`: one search, byte for byte, whatever processor the libraries take this one for.

Other processors are other child processes: NumPy, OpenBLAS and the C library each have a variable of their own that
hides features of this one, and Numba has one that names another, so that kernels are other machine code.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest

from commonrail.base.errors import StudyError
from commonrail.calibration.study_file import load_study
from commonrail.compiler import target
from commonrail.runs.fingerprint import hash_study
from commonrail.runs.fit import calibrate_into, resume
from tests.runs.conftest import Whole, stopped_run, write_small

ROOT = Path(__file__).resolve().parents[2]
CASES = ROOT / "cases"
pytestmark = pytest.mark.skipif(not target.is_x86(), reason="this machine is no x86-64")


class Machine(NamedTuple):
    """Variables that make libraries take this processor for another one, and options of the run."""

    variables: dict[str, str]
    options: tuple[str, ...]


# NumPy names its kernels by level (2.4 and later) or by feature (before); it ignores names that it does not know.
_WIDE = "X86_V4 AVX512_ICL AVX512_SPR AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL"
_NARROW = f"{_WIDE} X86_V3 AVX2 FMA3"
HASWELL = Machine(
    {
        "NPY_DISABLE_CPU_FEATURES": _WIDE,
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+avx2,+fma",
    },
    ("--threads", "2"),
)
OLD = Machine(  # before AVX
    {
        "NPY_DISABLE_CPU_FEATURES": _NARROW,
        "OPENBLAS_CORETYPE": "Prescott",
        "NUMBA_CPU_NAME": "x86-64-v2",
        "NUMBA_CPU_FEATURES": "",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA",
    },
    ("--threads", "2"),
)
LEVEL_3 = Machine(  # with kernels that other tests compile too, and libraries of an older processor
    {name: text for name, text in OLD.variables.items() if "NUMBA" not in name} | {"COMMONRAIL_KERNELS": "v3"},
    ("--workers", "2"),
)
# Of the cases: a short evolution. Least squares solve linear systems by LAPACK, whose bits depend on the processor.
OPTIMISER = "[optimiser]\nmembers = 24\ngenerations = 4\n"
OUTPUTS = ("calibrated.toml", "traces.csv")
# Judged by least squares: sections of result.json, and keys of its parameters and data.
JUDGED = ("identifiability", "certainty", "target", "clock")
JUDGED_OF_ONE = ("effect", "pinned", "standard_error", "verdict", "band")


def run_elsewhere(study: Path, run: Path, machine: Machine) -> None:
    """Calibrate in a child process that takes this processor for another one."""
    environment = os.environ | machine.variables | {"PYTHONPATH": os.pathsep.join(sys.path), "PYTHONWARNINGS": "ignore"}
    command = [sys.executable, "-m", "commonrail", "calibrate", str(study), "--out", str(run), *machine.options]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def of_the_search(run: Path) -> str:
    """result.json without time and machine, and without what is judged of the fit."""
    record = json.loads((run / "result.json").read_text(encoding="utf-8"))
    assert all(record[key] for key in JUDGED)
    kept = {key: value for key, value in record.items() if key not in JUDGED}
    for section in ("parameters", "data"):
        kept[section] = [{k: v for k, v in one.items() if k not in JUDGED_OF_ONE} for one in record[section]]
    return json.dumps(kept)


def with_same_bits(study: Path) -> None:
    """Set the key in a study file."""
    text = study.read_text(encoding="utf-8")
    assert text.count("\nseed = ") == 1
    study.write_text(text.replace("\nseed = ", "\nsame_bits = true\nseed = "), encoding="utf-8")


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """The small study with a rigid body and PWM, so that one kernel is compiled, and its run on this machine."""
    folder = tmp_path_factory.mktemp("exact")
    study = write_small(folder / "small")
    with_same_bits(study)
    text = study.read_text(encoding="utf-8")
    polish = re.search("polish = .*\\n", text)
    assert polish is not None
    text = text.replace(polish[0], "polish = 0\n")
    parameter = '[[parameter]]\nname = "nozzle.discharge_maximum"\n'
    assert parameter in text
    bent = parameter + 'scale = "log"\n'
    order = '[constraints]\norder = ["control_chamber.z_hole_diameter < control_chamber.a_hole_diameter"]\n'
    study.write_text(text.replace(parameter, bent).replace("[optimiser]", order + "\n[optimiser]"), encoding="utf-8")
    injector = study.with_name("injector.toml")
    text = injector.read_text(encoding="utf-8")
    for old, new in (('variant = "flexible"', 'variant = "rigid"'), ('drive_kind = "regulated"', 'drive_kind = "pwm"')):
        assert old in text
        text = text.replace(old, new)
    injector.write_text(text, encoding="utf-8")
    calibrate_into(folder / "run", load_study(study), threads=1)
    return Whole(study, folder / "run")


@pytest.mark.parametrize(
    "machine",
    [*(pytest.param(one, marks=pytest.mark.slow) for one in (HASWELL, OLD)), LEVEL_3],
    ids=["haswell", "old", "level-3"],
)
def test_another_processor_gives_the_same_bytes(exact: Whole, tmp_path: Path, machine: Machine) -> None:
    """Search with constraints and a logarithmic scale, and scores."""
    run_elsewhere(exact.study, tmp_path / "run", machine)
    assert of_the_search(tmp_path / "run") == of_the_search(exact.run)
    for name in OUTPUTS:
        assert (tmp_path / "run" / name).read_bytes() == (exact.run / name).read_bytes()


def test_the_result_says_so(exact: Whole) -> None:
    assert json.loads((exact.run / "result.json").read_text(encoding="utf-8"))["same_bits"] is True


def test_it_is_another_study_than_without(exact: Whole, tmp_path: Path) -> None:
    """A run is not resumed in the other mode: its bits would be of both."""
    study = load_study(exact.study)
    fast = replace(study, same_bits=False)
    assert hash_study(study) != hash_study(fast)
    run = stopped_run(tmp_path / "run", fast, 2)  # its file says otherwise
    with pytest.raises(StudyError, match="reads differently"):
        resume(run, study=study)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["paper", "cri2-16"])
def test_the_cases_give_the_same_bytes(case: str, tmp_path: Path) -> None:
    """Both cases with short evolutions."""
    study = tmp_path / "study.toml"
    text = (CASES / case / "study.toml").read_text(encoding="utf-8")
    shutil.copytree(CASES / case / "data", tmp_path / "data")
    study.write_text(text[: text.index("[optimiser]")] + OPTIMISER, encoding="utf-8")
    with_same_bits(study)
    calibrate_into(tmp_path / "run", load_study(study), threads=1)
    for name, machine in (("haswell", HASWELL), ("old", OLD)):
        run_elsewhere(study, tmp_path / name, machine)
        assert of_the_search(tmp_path / name) == of_the_search(tmp_path / "run")
