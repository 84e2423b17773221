"""Translate the compiled physics to C, one LLVM instruction at a time, for targets that accept only sources.

The text of a wiring has about thirty kinds of instructions on doubles, 64-bit integers and pointers. Each value
becomes a local variable and each block a label. Unknown instructions are refused.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import starmap
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
_BLOCK = r'%"[^"]+"|%[\w.$-]+'
VALUE = r'(?:%"[^"]+"|%[\w.$-]+|-?[\w.+-]+)'
FLAGS = r"(?:(?:reassoc|nsz|arcp|contract|nnan|ninf|afn|fast|nuw|nsw|exact|disjoint|nneg|samesign|tail|noundef) )*"


def expression(text: str, c: Value) -> tuple[str, str]:
    """Translate the right side `text` of an instruction to type and C text; `c` translates its operands.

    `ConfigurationError` if there is no translation.
    """
    for pattern, rule in _EXPRESSIONS:
        if match := pattern.match(text):
            return rule(c, *match.groups())
    raise unknown(text)


def constant(value: str, kind: str) -> str:
    """C constant for an LLVM constant of a type."""
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


def _signed_operation(c: Value, operation: str, left: str, right: str) -> tuple[str, str]:
    sign = {"ashr": ">>", "sdiv": "/", "srem": "%"}[operation]
    return "i64", f"(uint64_t)((int64_t){c(left, 'i64')} {sign} (int64_t){c(right, 'i64')})"


def _real_comparison(c: Value, word: str, kind: str, left: str, right: str) -> tuple[str, str]:
    a, b = c(left, kind), c(right, kind)
    expressions = {
        "ord": f"{a} == {a} && {b} == {b}",
        "uno": f"{a} != {a} || {b} != {b}",
        "one": f"{a} < {b} || {a} > {b}",
        "une": f"{a} != {b}",
        "ueq": f"!({a} < {b} || {a} > {b})",
    }
    if word in expressions:
        return "i1", expressions[word]
    return "i1", f"{a} {_ORDERED[word[1:]]} {b}" if word[0] == "o" else f"!({a} {_NEGATED[word[1:]]} {b})"


def _integer_comparison(c: Value, word: str, kind: str, left: str, right: str) -> tuple[str, str]:
    cast = "(int64_t)" if word[0] == "s" else ""
    sign = _ORDERED[word if word in ("eq", "ne") else word[1:]]
    return "i1", f"{cast}{c(left, kind)} {sign} {cast}{c(right, kind)}"


def _conversion(c: Value, operation: str, origin: str, value: str, kind: str) -> tuple[str, str]:
    operand = c(value, origin)
    if operation == "bitcast":
        if origin != kind:
            raise unknown(f"bitcast {origin} to {kind}")
        return kind, operand
    casts = {
        "sitofp": "(double)(int64_t)",
        "uitofp": "(double)",
        "fptosi": "(uint64_t)(int64_t)",
        "zext": "(uint64_t)",
        "sext": "(uint64_t)-(int64_t)" if origin == "i1" else "(uint64_t)(int64_t)(int32_t)",
        "ptrtoint": "(uint64_t)(uintptr_t)",
        "trunc": f"({TYPES.get(kind, kind)})",
    }
    if operation == "trunc" and kind == "i1":
        return kind, f"(int)({operand} & 1)"
    return kind, casts[operation] + operand


def _call(c: Value, kind: str, name: str, arguments: str) -> tuple[str, str]:
    operands = [argument.split()[-1] for argument in arguments.split(", ")]
    return kind, f"{_CALLS[name]}({', '.join(c(operand, kind) for operand in operands)})"


def _double(value: str) -> str:
    """A constant, which LLVM writes as decimal digits or as the bits of the number."""
    number = struct.unpack(">d", bytes.fromhex(value[2:]))[0] if value.startswith("0x") else float(value)
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "HUGE_VAL" if number > 0.0 else "(-HUGE_VAL)"
    return f"({number.hex()})" if number < 0.0 else number.hex()


def unknown(what: str) -> ConfigurationError:
    """Error for an unknown instruction."""
    return ConfigurationError(
        f"The compiled physics cannot be written as C: there is no translation of `{what.strip()[:120]}`; export "
        "only to platforms with binaries, or install the version of Numba that constraints.txt names."
    )


def _any(words: Iterable[str]) -> str:
    return f"({'|'.join(map(re.escape, words))})"


# Right side of an instruction, and the function that makes type and C text of its groups.
_EXPRESSIONS: list[tuple[re.Pattern[str], Callable[..., tuple[str, str]]]] = [
    (re.compile(pattern), rule)
    for pattern, rule in (
        (
            rf"{_any(_INFIX)} {FLAGS}(\w+) ({VALUE}), ({VALUE})$",
            lambda c, sign, kind, a, b: (kind, f"{c(a, kind)} {_INFIX[sign]} {c(b, kind)}"),
        ),
        (
            rf"(fneg|freeze) {FLAGS}(\w+) ({VALUE})$",
            lambda c, word, kind, a: (kind, ("-" if word == "fneg" else "") + c(a, kind)),
        ),
        (rf"load (double|i64), ptr ({VALUE})", lambda c, kind, address: (kind, f"load_{kind}({c(address, 'ptr')})")),
        (
            rf"getelementptr (?:inbounds |nuw |nusw )*{_any(_SIZES)}, ptr ({VALUE}), i64 ({VALUE})$",
            lambda c, kind, base, index: ("ptr", f"{c(base, 'ptr')} + (int64_t){c(index, 'i64')} * {_SIZES[kind]}"),
        ),
        (rf"fcmp {FLAGS}(\w+) (\w+) ({VALUE}), ({VALUE})$", _real_comparison),
        (rf"icmp {FLAGS}(\w+) (\w+) ({VALUE}), ({VALUE})$", _integer_comparison),
        (
            rf"select {FLAGS}i1 ({VALUE}), (\w+) ({VALUE}), \w+ ({VALUE})$",
            lambda c, condition, kind, yes, no: (kind, f"{c(condition, 'i1')} ? {c(yes, kind)} : {c(no, kind)}"),
        ),
        (rf"(?:tail |notail )?call {FLAGS}(\w+) @{_any(_CALLS)}\((.*)\)", _call),
        (rf"(sitofp|uitofp|fptosi|zext|sext|ptrtoint|trunc|bitcast) {FLAGS}(\w+) ({VALUE}) to (\w+)$", _conversion),
        (rf"(ashr|sdiv|srem) {FLAGS}i64 ({VALUE}), ({VALUE})$", _signed_operation),
    )
]


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
    """C source of a module from its LLVM text; `ConfigurationError` if an instruction has no translation."""
    functions = re.findall(r"^define [^\n]*\n.*?^}", text, re.M | re.S)
    return "\n".join([_HEAD, *(_Function(function).source() for function in functions)])


class _Phi(NamedTuple):
    variable: str
    kind: str
    sources: dict[str, str]


class _Function:
    """Translation of one function: its values, blocks and phis by LLVM name."""

    def __init__(self, text: str) -> None:
        head, *lines = text.splitlines()
        self.head, self.lines = head, drop_unread_values(_join_lines(lines[:-1]))
        self.names: dict[str, str] = {}
        self.kinds: dict[str, str] = {}
        self.labels: dict[str, str] = {}
        self.phis: dict[str, list[_Phi]] = {}

    def source(self) -> str:
        """C text."""
        self._read_phis()
        body = self._body()
        variables = {**self.kinds, **{f"{phi.variable}_in": phi.kind for phis in self.phis.values() for phi in phis}}
        declared = "".join(f"    {_declare(name, kind)} = 0;\n" for name, kind in variables.items())
        signature, parameters = self._signature()
        unused = "".join(f"    (void){name};\n" for name in parameters)
        return f"{signature} {{\n{declared}{unused}{body}}}\n"

    def _signature(self) -> tuple[str, list[str]]:
        match = re.search(r"@([\w.$]+)\((.*)\) (?:local_unnamed_addr )?(?:#\d+ )?{", self.head)
        if match is None or " i32 @" not in self.head:
            raise unknown(self.head)
        parts = [parameter.split() for parameter in re.split(r", (?=(?:ptr|i64|i32|double) )", match.group(2))]
        parameters = {self.value(words[-1], words[0]): words[0] for words in parts}
        return f"int32_t {match.group(1)}({', '.join(starmap(_declare, parameters.items()))})", list(parameters)

    def label(self, name: str) -> str:
        """C label of a block."""
        return self.labels.setdefault(name.strip('%"'), f"b{len(self.labels)}")

    def value(self, value: str, kind: str) -> str:
        """C text of a value of a type."""
        return self.names.setdefault(value, f"v{len(self.names)}") if value[0] == "%" else constant(value, kind)

    def define(self, value: str, kind: str) -> str:
        """C name of a computed value; its type is declared."""
        if kind not in TYPES:
            raise unknown(kind)
        name = self.value(value, kind)
        self.kinds[name] = kind
        return name

    def goto(self, origin: str, label: str) -> str:
        """C text of a jump from one block to another, with the values of its phis."""
        target = label.strip('%"')
        moves = "".join(
            f"{phi.variable}_in = {self.value(phi.sources[origin], phi.kind)}; " for phi in self.phis.get(target, ())
        )
        return f"{moves}goto {self.label(target)};"

    def _read_phis(self) -> None:
        """Read the phis of each block: their values are assigned on the way to it."""
        block = ""
        for line in self.lines:
            if (label := _read_label(line)) is not None:
                block = label
            elif match := re.match(rf"({VALUE}) = phi {FLAGS}(\w+) (.*)", line):
                value, kind, sources = match.groups()
                pairs = re.findall(rf"\[ ({VALUE}), ({_BLOCK}) \]", sources)
                phi = _Phi(self.define(value, kind), kind, {origin.strip('%"'): source for source, origin in pairs})
                self.phis.setdefault(block, []).append(phi)

    def _body(self) -> str:
        out: list[str] = []
        block = ""
        targets = {name.strip('%"') for line in self.lines for name in re.findall(rf"label ({_BLOCK})", line)}
        for line in self.lines:
            if (label := _read_label(line)) is not None:
                block = label
                if label in targets:
                    out.append(f"{self.label(label)}:;")
                out.extend(f"    {phi.variable} = {phi.variable}_in;" for phi in self.phis.get(label, ()))
            elif " = phi " not in line:
                out.extend(f"    {statement}" for statement in _statements(self, block, line))
        return "\n".join(out) + "\n"


def _declare(name: str, kind: str) -> str:
    return f"{TYPES[kind]}{'' if kind == 'ptr' else ' '}{name}"


def _statements(f: _Function, block: str, line: str) -> list[str]:
    """C statements for an instruction in a block."""
    for pattern, rule in _STATEMENTS:
        if match := pattern.match(line):
            return rule(f, block, *match.groups())
    raise unknown(line)


def _branch(f: _Function, block: str, condition: str, yes: str, no: str) -> list[str]:
    return [f"if ({f.value(condition, 'i1')}) {{ {f.goto(block, yes)} }}", f.goto(block, no)]


def _switch(f: _Function, block: str, kind: str, value: str, other: str, cases: str) -> list[str]:
    tests = [
        f"if ({f.value(value, kind)} == {f.value(case, kind)}) {{ {f.goto(block, label)} }}"
        for case, label in re.findall(rf"\w+ ({VALUE}), label ({VALUE})", cases)
    ]
    return [*tests, f.goto(block, other)]


def _store(f: _Function, _block: str, kind: str, value: str, address: str) -> list[str]:
    return [f"store_{kind}({f.value(address, 'ptr')}, {f.value(value, kind)});"]


def _assignment(f: _Function, _block: str, value: str, text: str) -> list[str]:
    kind, c = expression(text, f.value)
    return [f"{f.define(value, kind)} = {c};"]


def _memory(f: _Function, _block: str, function: str, arguments: str) -> list[str]:
    values = [argument.split()[-1] for argument in arguments.split(", ")]
    kinds = ("ptr", "i8" if function == "memset" else "ptr", "i64")
    to, source, count = (f.value(value, kind) for value, kind in zip(values, kinds, strict=False))
    return [f"{'memset' if function == 'memset' else 'memmove'}({to}, {source}, (size_t){count});"]


_STATEMENTS: list[tuple[re.Pattern[str], Callable[..., list[str]]]] = [
    (re.compile(pattern), rule)
    for pattern, rule in (
        (rf"br i1 ({VALUE}), label ({VALUE}), label ({VALUE})", _branch),
        (rf"br label ({VALUE})", lambda f, block, label: [f.goto(block, label)]),
        (rf"switch (\w+) ({VALUE}), label ({VALUE}) \[(.*)\]", _switch),
        (rf"ret i32 ({VALUE})", lambda f, _, value: [f"return (int32_t){f.value(value, 'i32')};"]),
        (rf"store (\w+) ({VALUE}), ptr ({VALUE})", _store),
        (r"unreachable", lambda *_: ["return -1;"]),
        (r"(?:tail |notail )?call void @llvm\.(memset|memcpy|memmove)[\w.]*\((.*)\)", _memory),
        (rf"({VALUE}) = (.*)", _assignment),
    )
]


def _join_lines(lines: list[str]) -> list[str]:
    """Instructions and labels without comments and metadata, each switch in one line."""
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


def drop_unread_values(lines: list[str]) -> list[str]:
    """Remove lines of unread values, and assumptions, which are not translated."""
    remaining = [line for line in lines if not re.match(rf"(?:tail |notail )?call void @(?:{_UNTRANSLATED})", line)]
    while True:
        read = Counter(name for line in remaining for name in set(re.findall(VALUE, line)))
        left = [
            line for line in remaining if not (match := re.match(rf"({VALUE}) = ", line)) or read[match.group(1)] > 1
        ]
        if len(left) == len(remaining):
            return remaining
        remaining = left


def _read_label(line: str) -> str | None:
    match = re.fullmatch(r'("[^"]+"|[\w.$-]+):', line)
    return match.group(1).strip('"') if match else None
