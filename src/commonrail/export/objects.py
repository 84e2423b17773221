"""Object files of the compiled physics for the processors and systems that libraries and FMUs are made for."""

from __future__ import annotations

from typing import Any, NamedTuple

from commonrail.errors import ConfigurationError, nearest
from commonrail.export.texts import entry_texts, refuse_foreign
from commonrail.injector.variants import Variant

__all__ = ["TARGETS", "Target", "emit", "target_named"]


class Target(NamedTuple):
    """Processor and system of a binary.

    Attributes
    ----------
    name : str
        Name on the command line.
    triple : str
        Name that LLVM has for it.
    processor, features : str
        LLVM's processor, and instruction sets beyond it.
    zig : str
        Name that zig has for it, with the oldest C library that the binary may meet.
    fmi2, fmi3 : str
        Folder of its binary in an FMU; "" where that version of the standard knows none.
    suffix : str
        Ending of a shared library.
    """

    name: str
    triple: str
    processor: str
    features: str
    zig: str
    fmi2: str
    fmi3: str
    suffix: str


_WASM = "+simd128,+bulk-memory,+nontrapping-fptoint,+sign-ext,+mutable-globals,+multivalue"
_LINUX = "x86_64-unknown-linux-gnu"
_ALL = (
    Target("linux64", _LINUX, "x86-64", "", "x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    Target("linux64-avx2", _LINUX, "x86-64-v3", "", "x86_64-linux-gnu.2.17", "linux64", "x86_64-linux", ".so"),
    Target("win64", "x86_64-pc-windows-gnu", "x86-64", "", "x86_64-windows-gnu", "win64", "x86_64-windows", ".dll"),
    Target(
        "linux-arm64", "aarch64-unknown-linux-gnu", "generic", "", "aarch64-linux-gnu.2.17", "", "aarch64-linux", ".so"
    ),
    Target("darwin-arm64", "arm64-apple-macosx11.0.0", "apple-m1", "", "aarch64-macos", "", "aarch64-darwin", ".dylib"),
    Target("wasm32", "wasm32-unknown-unknown", "generic", _WASM, "wasm32-wasi", "", "", ".wasm"),
)
TARGETS = {target.name: target for target in _ALL}


def target_named(name: str) -> Target:
    """Target by its name.

    Raises
    ------
    ConfigurationError
        If there is none of that name.
    """
    if name not in TARGETS:
        raise ConfigurationError(f'There is no platform "{name}"{nearest(name, TARGETS)}; known: {", ".join(TARGETS)}.')
    return TARGETS[name]


def emit(variant: Variant, target: Target | str, prefix: str = "cr") -> bytes:
    """Object file with the entries of `export.entries`, each named ``PREFIX_ENTRY`` and hidden.

    The entries follow Numba's calling convention: ``int32_t f(void *result, void **exception, arguments …)`` returns 0;
    `result` receives a pointer, and `exception` is not written.

    Parameters
    ----------
    variant : Variant
        Wiring to compile; a Numba compilation of some ten seconds where its text is in no cache.
    target : Target or str
    prefix : str
        Begins the names of the entries, so that the objects of two models can be linked into one program.

    Raises
    ------
    ConfigurationError
        If there is no such target, or the compiler fails.
    """
    import llvmlite.binding as llvm

    for_machine = target if isinstance(target, Target) else target_named(target)
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(for_machine.triple).create_target_machine(
        cpu=for_machine.processor, features=for_machine.features, opt=3, reloc="pic", codemodel="default"
    )
    module = _linked(entry_texts(variant), prefix, machine, llvm)
    refuse_foreign(str(module))
    module.verify()
    return bytes(machine.emit_object(module))


def _linked(texts: dict[str, str], prefix: str, machine: Any, llvm: Any) -> Any:
    """One module of all entries for a machine, without what none of them uses."""
    whole = None
    for name, text in texts.items():
        module = llvm.parse_assembly(text)
        module.triple, module.data_layout = machine.triple, str(machine.target_data)
        entry = module.get_function(name)
        entry.name, entry.visibility = f"{prefix}_{name}", "hidden"
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0))
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, builder)
    return whole
