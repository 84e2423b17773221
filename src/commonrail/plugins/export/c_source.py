"""The compiled physics as C: its LLVM text, instruction by instruction, for targets that take sources alone.

The text of a wiring consists of some thirty kinds of instructions on doubles, 64-bit integers and pointers. Each value
becomes a local variable and each block a label; what is not known here is refused.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from commonrail.base.errors import ConfigurationError

# Values and expressions of LLVM's text as C.

Value = Callable[[str, str], str]  # C text of a value, from LLVM's text of it and its type

TYPES = {"double": "double", "i64": "uint64_t", "i32": "uint32_t", "i8": "uint8_t", "i1": "int", "ptr": "char *"}
_SIZES = {"double": 8, "i64": 8, "i32": 4, "i8": 1, "ptr": 8}
_INFIX = {
    **{"fadd": "+", "fsub": "-", "fmul": "*", "fdiv": "/", "add": "+", "sub": "-", "mul": "*"},
    **{"and": "&", "or": "|", "xor": "^", "shl": "<<", "lshr": ">>", "udiv": "/", "urem": "%"},
}
_ORDERED = {"eq": "==", "ne": "!=", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_NEGATED = {"eq": "!=", "ne": "==", "lt": ">=", "le": ">", "gt": "<=", "ge": "<"}
_CALLS = {
    **{name: name for name in ("sqrt", "sin", "cos", "exp", "log", "pow", "fabs", "floor")},
    **{f"llvm.{name}.f64": name for name in ("sqrt", "sin", "cos", "exp", "log", "pow", "fabs", "floor")},
    **{"llvm.maxnum.f64": "fmax", "llvm.minnum.f64": "fmin", "llvm.copysign.f64": "copysign", "llvm.fma.f64": "fma"},
    **{f"llvm.{name}.i64": name for name in ("smax", "smin", "umax", "umin", "abs")},
}
VALUE = r'(?:%"[^"]+"|%[\w.$-]+|-?[\w.+-]+)'
FLAGS = r"(?:(?:reassoc|nsz|arcp|contract|nnan|ninf|afn|fast|nuw|nsw|exact|disjoint|nneg|samesign|tail|noundef) )*"


def expression(text: str, c: Value) -> tuple[str, str]:
    """Type and C text of the value of an instruction, whose right side `text` is; `c` makes C texts of its operands."""
    for read in _READERS:
        found = read(text, c)
        if found is not None:
            return found
    raise unknown(text)


def constant(value: str, kind: str) -> str:
    """C constant of an LLVM one of a type."""
    if kind == "double":
        return _double(value)
    if value in ("true", "false"):
        return str(int(value == "true"))
    if value in ("null", "undef", "poison", "zeroinitializer"):
        return "0"
    number = int(value)
    if kind == "i64":
        return f"UINT64_C({number % 2**64})"
    return str(number % 2**32) + "u" if kind == "i32" else str(number)


def _infix(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"(\w+) {FLAGS}(\w+) ({VALUE}), ({VALUE})$", text)
    if match is None or match.group(1) not in _INFIX:
        return None
    operation, kind, left, right = match.groups()
    return kind, f"{c(left, kind)} {_INFIX[operation]} {c(right, kind)}"


def _negation(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"(fneg|freeze) {FLAGS}(\w+) ({VALUE})$", text)
    if match is None:
        return None
    operation, kind, value = match.groups()
    return kind, ("-" if operation == "fneg" else "") + c(value, kind)


def _shift(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"(ashr|sdiv|srem) {FLAGS}i64 ({VALUE}), ({VALUE})$", text)
    if match is None:
        return None
    operation, left, right = match.groups()
    sign = {"ashr": ">>", "sdiv": "/", "srem": "%"}[operation]
    return "i64", f"(uint64_t)((int64_t){c(left, 'i64')} {sign} (int64_t){c(right, 'i64')})"


def _comparison(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"([if])cmp {FLAGS}(\w+) (\w+) ({VALUE}), ({VALUE})$", text)
    if match is None:
        return None
    real, word, kind, left, right = match.groups()
    a, b = c(left, kind), c(right, kind)
    if real == "f":
        return "i1", _real_comparison(word, a, b)
    if word in ("eq", "ne"):
        return "i1", f"{a} {_ORDERED[word]} {b}"
    cast = "(int64_t)" if word[0] == "s" else ""
    return "i1", f"{cast}{a} {_ORDERED[word[1:]]} {cast}{b}"


def _choice(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"select {FLAGS}i1 ({VALUE}), (\w+) ({VALUE}), \w+ ({VALUE})$", text)
    if match is None:
        return None
    condition, kind, yes, no = match.groups()
    return kind, f"{c(condition, 'i1')} ? {c(yes, kind)} : {c(no, kind)}"


def _conversion(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"(\w+) {FLAGS}(\w+) ({VALUE}) to (\w+)$", text)
    if match is None:
        return None
    operation, origin, value, kind = match.groups()
    given = c(value, origin)
    known = {
        "sitofp": f"(double)(int64_t){given}",
        "uitofp": f"(double){given}",
        "fptosi": f"(uint64_t)(int64_t){given}",
        "zext": f"(uint64_t){given}",
        "sext": f"(uint64_t)-(int64_t){given}" if origin == "i1" else f"(uint64_t)(int64_t)(int32_t){given}",
        "ptrtoint": f"(uint64_t)(uintptr_t){given}",
        "trunc": f"({TYPES.get(kind, kind)}){given}" if kind != "i1" else f"(int)({given} & 1)",
    }
    if operation == "bitcast" and origin == kind:
        return kind, given
    return (kind, known[operation]) if operation in known else None


def _place(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"getelementptr (?:inbounds |nuw |nusw )*(\w+), ptr ({VALUE}), i64 ({VALUE})$", text)
    if match is None or match.group(1) not in _SIZES:
        return None
    kind, place, index = match.groups()
    return "ptr", f"{c(place, 'ptr')} + (int64_t){c(index, 'i64')} * {_SIZES[kind]}"


def _load(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"load (double|i64), ptr ({VALUE})", text)
    if match is None:
        return None
    return match.group(1), f"load_{match.group(1)}({c(match.group(2), 'ptr')})"


def _call(text: str, c: Value) -> tuple[str, str] | None:
    match = re.match(rf"(?:tail |notail )?call {FLAGS}(\w+) @([\w.]+)\((.*)\)", text)
    if match is None or match.group(2) not in _CALLS:
        return None
    kind, name, arguments = match.groups()
    given = [part.split()[-1] for part in arguments.split(", ")]
    return kind, f"{_CALLS[name]}({', '.join(c(one, kind) for one in given)})"


def _double(value: str) -> str:
    """A constant: LLVM writes it as decimal digits or as the bits of the number."""
    number = struct.unpack(">d", bytes.fromhex(value[2:]))[0] if value.startswith("0x") else float(value)
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "HUGE_VAL" if number > 0.0 else "(-HUGE_VAL)"
    return f"({number.hex()})" if number < 0.0 else number.hex()


def _real_comparison(word: str, a: str, b: str) -> str:
    if word in ("ord", "uno"):
        return f"{a} == {a} && {b} == {b}" if word == "ord" else f"{a} != {a} || {b} != {b}"
    if word == "one":
        return f"{a} < {b} || {a} > {b}"
    if word == "une":
        return f"{a} != {b}"
    if word == "ueq":
        return f"!({a} < {b} || {a} > {b})"
    if word[0] == "o":
        return f"{a} {_ORDERED[word[1:]]} {b}"
    return f"!({a} {_NEGATED[word[1:]]} {b})"


def unknown(what: str) -> ConfigurationError:
    """Refusal of an instruction."""
    return ConfigurationError(
        f"The compiled physics cannot be written as C: there is no translation of `{what.strip()[:120]}`; export it "
        "for platforms with binaries alone, or install the version of Numba that constraints.txt names."
    )


_READERS = (
    _infix,
    _negation,
    _load,
    _place,
    _comparison,
    _choice,
    _call,
    _conversion,
    _shift,
)


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
    """C source of a module from LLVM's text of it; ConfigurationError if an instruction has no translation."""
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
