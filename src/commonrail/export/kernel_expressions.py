"""Values and expressions of LLVM's text as C."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable

from commonrail.errors import ConfigurationError

__all__ = ["FLAGS", "TYPES", "VALUE", "constant", "expression", "unknown"]

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
    """Type and C text of the value of an instruction.

    Parameters
    ----------
    text : str
        Right side of the instruction.
    c : function (value, type) -> str
        C text of its operands.

    Raises
    ------
    ConfigurationError
        If there is no translation of it.
    """
    for read in _READERS:
        found = read(text, c)
        if found is not None:
            return found
    raise unknown(text)


def constant(value: str, kind: str) -> str:
    """C constant of an LLVM one.

    Parameters
    ----------
    value, kind : str
        Its text and type.
    """
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
