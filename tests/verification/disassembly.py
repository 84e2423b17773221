"""Text of the machine code in an object file, by binutils' objdump."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

__all__ = ["MISSING", "disassembled"]

MISSING = "" if shutil.which("objdump") else "objdump, of binutils, is not on this machine"


def disassembled(content: bytes) -> str:
    """Return instructions as a compiler would write them: a label in front of each target of a jump."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kernel.o"
        path.write_bytes(content)
        command = ["objdump", "-d", "--no-show-raw-insn", str(path)]
        text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = re.findall(r"^ +([0-9a-f]+):\t(\S+)(.*)$", text, re.M)
    jump = re.compile(r"\s+([0-9a-f]+) <")
    targets = {jump.match(rest).group(1) for _, name, rest in found if name[0] == "j" and jump.match(rest)}  # type: ignore[union-attr]
    lines = []
    for address, name, rest in found:
        if address in targets:
            lines.append(f".L{address}:")
        to = jump.match(rest) if name[0] == "j" else None
        lines.append(f"\t{name}\t{'.L' + to.group(1) if to else rest.strip()}")
    return "\n".join(lines)
