"""Feed the readers what a coverage-guided fuzzer finds.

    python tests/robustness/fuzz_atheris.py -max_total_time=300 CORPUS

Needs atheris (pip install atheris, outside the project's own environment), and the root of the project and `src` in
PYTHONPATH. The first byte of an input chooses the reader and the file, the rest is that file's content; the other files
of the folder are good. CORPUS is a folder, made and filled with the good files if it is empty.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(
    include=["commonrail.readers", "commonrail.calibration.study_file", "commonrail.base.units", "tomllib"]
):
    from tests.fuzz.targets import TARGETS, check

LONGEST = 20_000  # of an input [bytes]

# Reader, good files, and the one of them that gets the input. Reports are left out: a page takes a tenth of a second.
CHOICES = [
    (name, files, file)
    for name, target in TARGETS.items()
    if name != "report"
    for files in target.files()
    for file in files
    if file.endswith(target.spoilt)
]


def one_input(folder: Path, data: bytes) -> None:
    """Read the folder with one file replaced; what `check` raises is a finding."""
    if not data:
        return
    name, files, file = CHOICES[data[0] % len(CHOICES)]
    for other, content in files.items():
        (folder / other).parent.mkdir(parents=True, exist_ok=True)
        (folder / other).write_bytes(data[1:] if other == file else content)
    check(name, folder)


def fill(corpus: Path) -> None:
    """Write the good files as inputs."""
    corpus.mkdir(parents=True, exist_ok=True)
    if any(corpus.iterdir()):
        return
    for i, (name, files, file) in enumerate(CHOICES):
        (corpus / f"{name}-{i}").write_bytes(bytes([i]) + files[file])


def main() -> None:
    """Run until the fuzzer's own limits."""
    folders = [Path(argument) for argument in sys.argv[1:] if not argument.startswith("-")]
    for folder in folders[:1]:
        fill(folder)
    with tempfile.TemporaryDirectory() as place:
        atheris.Setup([*sys.argv, f"-max_len={LONGEST}"], lambda data: one_input(Path(place), data))
        atheris.Fuzz()


if __name__ == "__main__":
    main()
