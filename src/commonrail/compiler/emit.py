"""From LLVM's text to an object file, for any processor and system."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from commonrail.compiler.target import System


def emit(texts: Mapping[str, str], names: Mapping[str, str], system: System, visibility: str = "default") -> bytes:
    """Object file of functions.

    `texts`: by the name of the function in its text; `names`: by the same, its name in the object.
    """
    machine, whole = optimised(texts, names, system, visibility)
    return bytes(machine.emit_object(whole))


def assembly(texts: Mapping[str, str], names: Mapping[str, str], system: System) -> str:
    """Assembly text of what `emit` makes of the same arguments."""
    machine, whole = optimised(texts, names, system)
    return str(machine.emit_assembly(whole))


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
    whole = linked(texts, names, machine, visibility)
    tuning = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = vectors
    tuning.loop_unrolling = True
    builder = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(whole, builder)
    return machine, whole


def linked(texts: Mapping[str, str], names: Mapping[str, str], machine: Any, visibility: str = "default") -> Any:
    """One module of functions for LLVM's machine; arguments as of `emit`."""
    import llvmlite.binding as llvm

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
    return whole


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
