"""From laws to LLVM text, in a child process (`child`), and from there to object files."""

from __future__ import annotations

import functools
import json
import os
import re
import sys
import threading
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from commonrail.compiler.target import System

# Level 1 without vectorisation: level 0 gives fourteen times the text and takes 25 % longer; level 3 depends on the
# processor.
NUMBA = {
    "NUMBA_OPT": "1",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_DISABLE_JIT": "0",
    "PYTHONHASHSEED": "0",  # flags of operations are written in the order of a set
}
# Reference counts of arrays: kernels have only views, which need none.
_COUNTS = re.compile(r"^ *(?:tail )?call void @NRT_(?:in|de)cref\(.*\n", re.MULTILINE)
_IDLE = 300.0  # idle time after which a child process (300 MB) ends [s]; a new one must type all laws again


def _serve(kind: str) -> None:
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="ascii")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # output of an import must not mix with the answer
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
        answers.write(json.dumps(_answer(*json.loads(line))) + "\n")
        answers.flush()


def _answer(maker: str, words: list[str], kind: str, key: str) -> dict[str, Any]:
    """Texts of a `cache.Source` by name, or a fault."""
    try:
        module, _, function = maker.partition(":")
        entries = getattr(import_module(module), function)(*words)
        return {"texts": {name: _text(name, *of, kind=kind) for name, of in entries.items()}}
    except Exception as error:  # a law of another package may raise anything
        return {"fault": " ".join(f"{type(error).__name__}: {error}".split())[:600]}


def _text(name: str, function: Callable[..., Any], signature: Any, *, kind: str) -> str:
    """Text of a function under a name, with everything it calls and nothing else."""
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
        raise TypeError(f"{name} allocates memory, which would have no owner")
    return text


# From the text to an object file, for any processor and system, in the calling process.


def emit(texts: Mapping[str, str], names: Mapping[str, str], system: System, visibility: str = "default") -> bytes:
    """Object file of functions.

    `texts`: LLVM text of each function by its name there; `names`: name in the object file by name in the text.
    """
    machine, module = optimise(texts, names, system, visibility)
    return bytes(machine.emit_object(schedule_instructions(machine, module)))


def schedule_instructions(machine: Any, module: Any) -> Any:
    """Reschedule an optimised module so that few instructions wait for operands.

    A time step is one long block of code, and an out-of-order processor sees only a quarter of it at a time. LLVM
    reorders instructions only for its in-order x86-64 model, Intel's first Atom, which is used here.
    """
    import llvmlite.binding as llvm

    if not machine.triple.startswith("x86_64"):
        return module
    return llvm.parse_assembly(re.sub(r"^(attributes #\d+ = \{)", r'\1 "tune-cpu"="atom"', str(module), flags=re.M))


def optimise(
    texts: Mapping[str, str],
    names: Mapping[str, str],
    system: System,
    visibility: str = "default",
    *,
    vectors: bool = True,
) -> tuple[Any, Any]:
    """LLVM's machine of a system, and one optimised module of functions; arguments as in `emit`.

    `vectors`: whether loops and statements may be vectorised.
    """
    import llvmlite.binding as llvm

    machine = _machine(system)
    linked: Any = None
    for name, text in texts.items():
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        entry = module.get_function(name)
        entry.name, entry.visibility = names[name], visibility
        if linked is None:
            linked = module
        else:
            linked.link_in(module)
    linked.verify()
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = vectors
    tuning.loop_unrolling = True
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(linked, builder)
    return machine, linked


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
