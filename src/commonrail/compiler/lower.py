"""From laws to LLVM's text, and from that to object files.

Numba types and lowers laws in a child process, for no processor in particular.

There it may be told to leave the text unoptimised and unvectorised, which nobody else's Numba is; and laws that were
typed for one kernel are known to the next one. The child ends with its parent, or when it has waited for a while.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from commonrail.base.child import python, same_modules
from commonrail.base.errors import ConfigurationError
from commonrail.compiler.cache import Source, kept_or_made
from commonrail.compiler.target import System, may_compile

# Level 1 without vectors: at 0 the text is fourteen times as long and takes a quarter more time, at 3 it is that of a
# processor.
_NUMBA = {
    "NUMBA_OPT": "1",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_DISABLE_JIT": "0",
    "PYTHONHASHSEED": "0",  # flags of operations are written in the order of a set
}
# Counts of an array's owners: those of a kernel are views, which have none.
_COUNTS = re.compile(r"^ *(?:tail )?call void @NRT_(?:in|de)cref\(.*\n", re.MULTILINE)
_IDLE = 300.0  # after which a child, of some 300 MB, ends [s]: another would have to type all laws anew


def texts(source: Source) -> dict[str, str]:
    """LLVM's text of each function by its name, which it has in the text too; from the cache where it is kept.

    Raises ConfigurationError if the compiler fails, or ``NUMBA_DISABLE_JIT`` forbids to compile.
    """
    found: dict[str, str] = json.loads(kept_or_made(f"{source.digest}.text", lambda: _lowered(source)))
    return found


def _lowered(source: Source) -> bytes:
    if not may_compile():
        raise ConfigurationError(
            "The fast engine needs its compiler, which NUMBA_DISABLE_JIT switches off; unset it, or use the engine "
            '"reference".'
        )
    with _TURN:
        # one that has waited for too long may end as it is asked
        answer = _child(source.kind).ask(source) or _child(source.kind).ask(source) or {"fault": "it has ended"}
    if "fault" in answer:
        raise ConfigurationError(f"Compiling the simulation failed: {answer['fault']}.")
    return json.dumps(answer["texts"]).encode()


_TURN = threading.Lock()
_CHILDREN: dict[tuple[int, str], _Child] = {}


def _child(kind: str) -> _Child:
    """Child of this process for a kind of kernel; a forked process has its own."""
    key = os.getpid(), kind
    child = _CHILDREN.get(key)
    if child is None or child.process.poll() is not None:
        child = _CHILDREN[key] = _Child(kind)
        atexit.register(child.end)
    return child


class _Child:
    """Process that lowers one kind of kernel."""

    def __init__(self, kind: str) -> None:
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as the process
        self.process = subprocess.Popen(
            python("-m", __name__, kind),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,  # a Ctrl-C is for this process, which may have to finish what it does
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # the same on Windows, 0 elsewhere
            env=same_modules() | _NUMBA,
        )

    def ask(self, source: Source) -> dict[str, Any] | None:
        """Texts of a source, or a fault; nothing if the process has ended as it does after a while."""
        line = b""
        try:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.write(json.dumps(source).encode() + b"\n")  # type: ignore[union-attr]
                self.process.stdin.flush()  # type: ignore[union-attr]
                line = self.process.stdout.readline()  # type: ignore[union-attr]
        finally:
            if not line:
                self.end()
        if line:
            answer: dict[str, Any] = json.loads(line)
            return answer
        if self.process.returncode == 0:
            return None
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip().splitlines()[-1:] or ["it ended without a message"]
        return {"fault": said[0].rstrip(".")}

    def end(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()


def _serve(kind: str) -> None:
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="ascii")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what an import prints is no answer
    from commonrail.compiler.laws import declare_laws

    declare_laws(kind)
    while True:
        idle = threading.Timer(_IDLE, os._exit, (0,))
        idle.daemon = True
        idle.start()
        line = sys.stdin.readline()
        idle.cancel()
        if not line:
            return
        answers.write(json.dumps(_answer(Source(*json.loads(line)))) + "\n")
        answers.flush()


def _answer(source: Source) -> dict[str, Any]:
    try:
        module, _, maker = source.maker.partition(":")
        made = getattr(import_module(module), maker)(*source.words)
        return {"texts": {name: _text(name, *of, kind=source.kind) for name, of in made.items()}}
    except Exception as error:  # a law of another package may raise anything
        return {"fault": " ".join(f"{type(error).__name__}: {error}".split())[:600]}


def _text(name: str, function: Callable[..., Any], signature: Any, *, kind: str) -> str:
    """Text of a function under a name, with all that it calls and nothing else."""
    import llvmlite.binding as llvm
    import numba

    from commonrail.compiler.laws import options

    compiled = numba.cfunc(signature, **options(kind))(function)
    module = llvm.parse_assembly(_COUNTS.sub("", compiled.inspect_llvm()))
    entry = module.get_function(compiled.native_name.removeprefix("cfunc."))
    for other in (*module.functions, *module.global_variables):
        if not other.is_declaration:
            other.linkage = "internal"
    entry.name, entry.linkage = name, "external"
    machine = llvm.Target.from_triple(module.triple).create_target_machine()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    text = str(module)
    if "@NRT_" in text:
        raise TypeError(f"{name} allocates memory, for which there is no owner")
    return text


# From the text to an object file, for any processor and system: in the process that asks for it.


def emit(texts: Mapping[str, str], names: Mapping[str, str], system: System, visibility: str = "default") -> bytes:
    """Object file of functions.

    `texts`: by the name of the function in its text; `names`: by the same, its name in the object.
    """
    machine, whole = optimised(texts, names, system, visibility)
    return bytes(machine.emit_object(ordered(machine, whole)))


def ordered(machine: Any, module: Any) -> Any:
    """An optimised module whose instructions the machine orders so that few of them wait for operands.

    A step is one long piece of code, of which a processor sees a fourth at once. LLVM trusts that it reorders that by
    itself, but for the one model of an x86-64 processor that takes instructions as they come: Intel's first Atom.
    """
    import llvmlite.binding as llvm

    if not machine.triple.startswith("x86_64"):
        return module
    return llvm.parse_assembly(re.sub(r"^(attributes #\d+ = \{)", r'\1 "tune-cpu"="atom"', str(module), flags=re.M))


def optimised(
    texts: Mapping[str, str],
    names: Mapping[str, str],
    system: System,
    visibility: str = "default",
    *,
    vectors: bool = True,
) -> tuple[Any, Any]:
    """LLVM's machine of a system, and one optimised module of functions; arguments as of `emit`.

    `vectors`: may loops and statements be put into vectors.
    """
    import llvmlite.binding as llvm

    machine = _machine(system)
    whole: Any = None
    for name, text in texts.items():
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        entry = module.get_function(name)
        entry.name, entry.visibility = names[name], visibility
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    whole.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = vectors
    tuning.loop_unrolling = True
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(whole, builder)
    return machine, whole


@functools.cache
def _machine(system: System) -> Any:
    """LLVM's machine of a system."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    triple = system.triple or llvm.get_process_triple()
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=system.name, features=system.features, opt=3, reloc="pic", codemodel="default"
    )


if __name__ == "__main__":
    _serve(sys.argv[1])
