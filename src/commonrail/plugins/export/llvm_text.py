"""LLVM text of the entries of a wiring: compiled once by Numba, the same for every target.

A child process compiles for the plainest processor of this machine's architecture, so that the text holds no wide
vectors and nothing of this machine. Nothing in it may be fused or reordered (`compiler.numba`), so that every target
gives the bits of the lanes with `same_bits`. `refuse_foreign` checks that no pointer's width, runtime or Python is left
in it: that is what allows the same text for 32-bit WebAssembly and 64-bit processors. The text is kept beside the
compiled kernels, under the same stamp of all physics sources.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

from commonrail.base.errors import ConfigurationError
from commonrail.compiler.cache import kept_or_made
from commonrail.compiler.target import Processor, compiler_settings
from commonrail.physics.variants import Variant, kernel_name

_SINGLE, _BLOCK = "single", "block"
_LONGEST = 900.0  # for the child process that compiles [s]
# Plainest processors: their instruction sets are in every processor of the architecture.
_PLAIN = {"x86_64": "x86-64", "AMD64": "x86-64"}
# Numbers as pointers, pointers in memory, what one processor or Python alone has.
_FOREIGN = re.compile(r"inttoptr|addrspacecast|asm |alloca .*ptr|@llvm\.(x86|aarch64|arm)\.|@NRT_|@Py|@numba_")


def entry_texts(variant: Variant) -> dict[str, str]:
    """LLVM text of each entry by name, from the cache where it is kept; ConfigurationError if the compiler fails."""
    return _kept(variant, _SINGLE)


def block_texts(variant: Variant) -> dict[str, str]:
    """LLVM text of the entries that march several injectors by name; its loop over lanes is not vectorised yet.

    ConfigurationError if the compiler fails.
    """
    return _kept(variant, _BLOCK)


def _kept(variant: Variant, which: str) -> dict[str, str]:
    found: dict[str, str] = json.loads(kept_or_made(_file_name(variant, which), lambda: _compile(variant, which)))
    return found


def _file_name(variant: Variant, which: str) -> str:
    key = repr((kernel_name(variant), which, _own_stamp(which), compiler_settings(), platform.machine()))
    return hashlib.sha256(key.encode()).hexdigest()[:24] + ".entries"


@functools.cache
def _own_stamp(which: str) -> str:
    """Digest of the sources of this package that decide over the text; those of the physics name the folder."""
    digest = hashlib.sha256()
    for name in ("entry_points.py", "llvm_text.py"):
        digest.update(Path(__file__).with_name(name).read_bytes())
    return digest.hexdigest()


def _compile(variant: Variant, which: str) -> bytes:
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        "NUMBA_DISABLE_JIT": "0",
        # plain numbers are the same everywhere; `objects` vectorises the lanes of a block for each processor
        "NUMBA_LOOP_VECTORIZE": "0",
        "NUMBA_SLP_VECTORIZE": "0",
    }
    words = [str(getattr(choice, "value", choice)) for choice in variant]
    command = [sys.executable, "-m", __name__, which, *words]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST, env=environment, check=False)
    except subprocess.TimeoutExpired:
        raise ConfigurationError(f"Compiling the export was not done within {_LONGEST:g} s; try again.") from None
    if done.returncode != 0:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        raise ConfigurationError(f"Compiling the export failed: {last[0]}.")
    return done.stdout


def refuse_foreign(text: str) -> None:
    """Refuse a text that only one machine could run (ConfigurationError that names what was found)."""
    found = sorted({match.group() for match in _FOREIGN.finditer(text)})
    if found:
        raise ConfigurationError(
            f"The compiled physics cannot be exported: it contains {', '.join(found)}, which only this machine has; "
            "install the version of Numba that constraints.txt names."
        )


def _optimised(variant: Variant, which: str) -> dict[str, str]:
    """Compile the entries in this process."""
    from commonrail.compiler.lower import module_text
    from commonrail.plugins.export.entry_points import make_block_entries, make_entries

    make = make_block_entries if which == _BLOCK else make_entries
    plain = Processor(_PLAIN.get(platform.machine(), "generic"), exact=True)
    return {
        name: module_text(function, name, signature, plain) for name, (function, signature) in make(variant).items()
    }


def _main(words: list[str]) -> None:
    which, *choices = words
    sys.stdout.write(json.dumps(_optimised(Variant(*choices), which)))


if __name__ == "__main__":
    _main(sys.argv[1:])
