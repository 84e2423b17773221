"""The compiled physics as C: its LLVM text, instruction by instruction, for targets that take sources alone.

The text of a wiring consists of some thirty kinds of instructions on doubles, 64-bit integers and pointers. Each value
becomes a local variable and each block a label; what is not known here is refused.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import NamedTuple

from commonrail.export.kernel_expressions import FLAGS, TYPES, VALUE, constant, expression, unknown

__all__ = ["kernel_source"]

_UNTRANSLATED = r"llvm\.(?:assume|lifetime|experimental\.noalias|dbg)"
_HEAD = """/* Generated: the compiled physics of one wiring, written from LLVM's text. Not meant to be read. */
#include <math.h>
#include <stdint.h>
#include <string.h>

static inline double load_double(const char *p) { double v; memcpy(&v, p, sizeof v); return v; }
static inline uint64_t load_i64(const char *p) { uint64_t v; memcpy(&v, p, sizeof v); return v; }
static inline void store_double(char *p, double v) { memcpy(p, &v, sizeof v); }
static inline void store_i64(char *p, uint64_t v) { memcpy(p, &v, sizeof v); }
static inline void store_ptr(char *p, char *v) { memcpy(p, &v, sizeof v); }
static inline uint64_t smax(uint64_t a, uint64_t b) { return (int64_t)a > (int64_t)b ? a : b; }
static inline uint64_t smin(uint64_t a, uint64_t b) { return (int64_t)a < (int64_t)b ? a : b; }
static inline uint64_t umax(uint64_t a, uint64_t b) { return a > b ? a : b; }
static inline uint64_t umin(uint64_t a, uint64_t b) { return a < b ? a : b; }
"""


def kernel_source(text: str) -> str:
    """C source of a module.

    Parameters
    ----------
    text : str
        LLVM text, of `objects.linked_text`.

    Raises
    ------
    ConfigurationError
        If it contains an instruction that is not translated.
    """
    functions = re.findall(r"^define [^\n]*\n.*?^}", text, re.M | re.S)
    return "\n".join([_HEAD, *(_Function(one).source() for one in functions)])


class _Phi(NamedTuple):
    variable: str
    kind: str
    sources: dict[str, str]


class _Function:
    """Translation of one function."""

    def __init__(self, text: str) -> None:
        head, *lines = text.splitlines()
        self.head, self.lines = head, _used(_joined(lines[:-1]))
        self.names: dict[str, str] = {}
        self.kinds: dict[str, str] = {}
        self.labels: dict[str, str] = {}
        self.phis: dict[str, list[_Phi]] = {}

    def source(self) -> str:
        """C text."""
        self._read_phis()
        body = self._body()
        declared = "".join(
            f"    {TYPES[kind]}{'' if kind == 'ptr' else ' '}{name} = 0;\n" for name, kind in self.kinds.items()
        )
        incoming = "".join(
            f"    {TYPES[phi.kind]}{'' if phi.kind == 'ptr' else ' '}{phi.variable}_in = 0;\n"
            for phis in self.phis.values()
            for phi in phis
        )
        signature, parameters = self._signature()
        unused = "".join(f"    (void){name};\n" for name in parameters)
        return f"{signature} {{\n{declared}{incoming}{unused}{body}}}\n"

    def _signature(self) -> tuple[str, list[str]]:
        match = re.search(r"@([\w.$]+)\((.*)\) (?:local_unnamed_addr )?(?:#\d+ )?{", self.head)
        if match is None or " i32 @" not in self.head:
            raise unknown(self.head)
        parameters, names = [], []
        for part in re.split(r", (?=(?:ptr|i64|i32|double) )", match.group(2)):
            kind, value = part.split()[0], part.split()[-1]
            name = self._name(value)
            names.append(name)
            parameters.append(f"{TYPES[kind]}{'' if kind == 'ptr' else ' '}{name}")
        return f"int32_t {match.group(1)}({', '.join(parameters)})", names

    def _name(self, value: str) -> str:
        return self.names.setdefault(value, f"v{len(self.names)}")

    def _label(self, name: str) -> str:
        return self.labels.setdefault(name.strip('%"'), f"b{len(self.labels)}")

    def _define(self, value: str, kind: str) -> str:
        name = self._name(value)
        if kind not in TYPES:
            raise unknown(kind)
        self.kinds[name] = kind
        return name

    def _read_phis(self) -> None:
        """Phis of each block: their values are assigned on the way to it."""
        block = ""
        for line in self.lines:
            if (label := _label_of(line)) is not None:
                block = label
            elif match := re.match(rf"({VALUE}) = phi {FLAGS}(\w+) (.*)", line):
                value, kind, sources = match.groups()
                found = re.findall(rf'\[ ({VALUE}), (%"[^"]+"|%[\w.$-]+) \]', sources)
                one = _Phi(self._define(value, kind), kind, {origin.strip('%"'): given for given, origin in found})
                self.phis.setdefault(block, []).append(one)

    def _body(self) -> str:
        out: list[str] = []
        block, targeted = "", self._targets()
        for line in self.lines:
            if (label := _label_of(line)) is not None:
                block = label
                if label in targeted:
                    out.append(f"{self._label(label)}:;")
                out.extend(f"    {phi.variable} = {phi.variable}_in;" for phi in self.phis.get(label, ()))
            elif " = phi " not in line:
                out.extend(f"    {statement}" for statement in self._statements(line, block))
        return "\n".join(out) + "\n"

    def _targets(self) -> set[str]:
        return {name.strip('%"') for line in self.lines for name in re.findall(r'label (%"[^"]+"|%[\w.$-]+)', line)}

    def _goto(self, origin: str, label: str) -> str:
        target = label.strip('%"')
        given = "".join(
            f"{phi.variable}_in = {self._value(phi.sources[origin], phi.kind)}; " for phi in self.phis.get(target, ())
        )
        return f"{given}goto {self._label(target)};"

    def _value(self, value: str, kind: str) -> str:
        return self._name(value) if value.startswith("%") else constant(value, kind)

    def _statements(self, line: str, block: str) -> list[str]:
        if match := re.match(rf"br i1 ({VALUE}), label ({VALUE}), label ({VALUE})", line):
            condition, yes, no = match.groups()
            return [f"if ({self._value(condition, 'i1')}) {{ {self._goto(block, yes)} }}", self._goto(block, no)]
        if match := re.match(rf"br label ({VALUE})", line):
            return [self._goto(block, match.group(1))]
        if match := re.match(rf"switch (\w+) ({VALUE}), label ({VALUE}) \[(.*)\]", line):
            kind, value, other, cases = match.groups()
            found = re.findall(rf"\w+ ({VALUE}), label ({VALUE})", cases)
            tests = [
                f"if ({self._value(value, kind)} == {self._value(case, kind)}) {{ {self._goto(block, label)} }}"
                for case, label in found
            ]
            return [*tests, self._goto(block, other)]
        if match := re.match(rf"ret i32 ({VALUE})", line):
            return [f"return (int32_t){self._value(match.group(1), 'i32')};"]
        if match := re.match(rf"store (\w+) ({VALUE}), ptr ({VALUE})", line):
            kind, value, place = match.groups()
            return [f"store_{kind}({self._value(place, 'ptr')}, {self._value(value, kind)});"]
        if line.startswith("unreachable"):
            return ["return -1;"]
        if match := re.match(r"(?:tail |notail )?call void @([\w.]+)\((.*)\)", line):
            return self._effect(*match.groups())
        if match := re.match(rf"({VALUE}) = (.*)", line):
            value, given = match.groups()
            kind, text = expression(given, self._value)
            return [f"{self._define(value, kind)} = {text};"]
        raise unknown(line)

    def _effect(self, name: str, arguments: str) -> list[str]:
        given = [part.split()[-1] for part in arguments.split(", ")]
        if name.startswith("llvm.memset"):
            value, count = self._value(given[1], "i8"), self._value(given[2], "i64")
            return [f"memset({self._value(given[0], 'ptr')}, {value}, (size_t){count});"]
        if name.startswith(("llvm.memcpy", "llvm.memmove")):
            to, origin, count = (
                self._value(one, kind) for one, kind in zip(given, ("ptr", "ptr", "i64"), strict=False)
            )
            return [f"memmove({to}, {origin}, (size_t){count});"]
        raise unknown(name)


def _joined(lines: list[str]) -> list[str]:
    """Instructions and labels without comments and metadata, a switch in one line."""
    out: list[str] = []
    inside = False
    for line in lines:
        bare = re.sub(r"(?:, ![\w.]+ !\d+)+$", "", line.split(" ;")[0].strip())
        bare = re.sub(r",? #\d+$", "", bare)
        if not bare or bare.startswith(";"):
            continue
        if inside:
            out[-1] += " " + bare
        else:
            out.append(bare)
        inside = (inside or bare.startswith("switch ")) and not bare.endswith("]")
    return out


def _used(lines: list[str]) -> list[str]:
    """Lines but those of values that nothing reads: what was assumed of them is not translated."""
    kept = [line for line in lines if not re.match(rf"(?:tail |notail )?call void @(?:{_UNTRANSLATED})", line)]
    while True:
        read = Counter(name for line in kept for name in set(re.findall(VALUE, line)))
        left = [line for line in kept if not (match := re.match(rf"({VALUE}) = ", line)) or read[match.group(1)] > 1]
        if len(left) == len(kept):
            return kept
        kept = left


def _label_of(line: str) -> str | None:
    match = re.fullmatch(r'("[^"]+"|[\w.$-]+):', line)
    return match.group(1).strip('"') if match else None
