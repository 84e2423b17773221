"""C sources of a model: hand-written ones with the model's names, and generated tables."""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.polynomial import chebyshev

from commonrail.base.arrays import Floats
from commonrail.base.choices import Actuation, Boundary
from commonrail.engine import plan
from commonrail.engine.job import Outcome, make_rows
from commonrail.engine.plan import BACKFLOW
from commonrail.engine.status import Status
from commonrail.engine.time_step import TIME_STEPS, Medium, is_stable, limiting, room_left
from commonrail.physics.fuel import Fuel
from commonrail.physics.fuel_polynomials import fuel_coefficients
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector, parameter_paths
from commonrail.physics.law import Domain
from commonrail.physics.variants import COMMAND, DRIVE, RAIL, RETURN, Variant, unread_inputs
from commonrail.plugins.export.c_source import kernel_source
from commonrail.plugins.export.entry_points import channels, sizes
from commonrail.plugins.export.object_files import link_llvm_text

# The condition on the time step as C, from its Python source.
#
# `engine.time_step.is_stable` is arithmetic on named numbers. Called with symbols it records its operations,
# one C statement each. The formulas exist only once.

_CHAMBER = "control_chamber.volume"


def step_condition(variant: Variant) -> str:
    """C function ``cr_bears(p, lift, medium, dt)``: 1 if a step is stable.

    `p` are the parameters in order, `lift` the greatest lift of the needle [m], `medium` the fields of `Medium`.
    """
    lines: list[str] = []
    paths = parameter_paths(variant.actuation)
    symbols = {path: _Symbol(f"p[{i}]", lines) for i, path in enumerate(paths)}
    if variant.actuation is not Actuation.DIRECT:
        symbols[_CHAMBER] = room_left(symbols, _Symbol("lift", lines))
    medium = Medium(*(_Symbol(f"medium[{i}]", lines) for i in range(len(Medium._fields))))  # type: ignore[arg-type]
    verdict = is_stable(variant, symbols, medium, _Symbol("dt", lines))  # type: ignore[arg-type]
    used = sorted({name for group in limiting(variant.actuation) for name in group})
    statements = "".join(f"    {line}\n" for line in select_used_statements(lines, verdict.text))
    return (
        f"/* Depends on {', '.join(used)}. */\n"
        "static int cr_bears(const double *p, double lift, const double *medium, double dt) {\n    (void)lift;\n"
        f"{statements}    return {verdict.text};\n}}\n"
    )


def select_used_statements(lines: list[str], result: str) -> list[str]:
    """Statements on which the result depends, in order."""
    names, needed = {result}, []
    for line in reversed(lines):
        name, _, expression = line.partition(" = ")
        if name.split()[-1] in names:
            names.update(re.findall(r"\bt\d+", expression))
            needed.append(line)
    return needed[::-1]


class _Symbol(NDArrayOperatorsMixin):
    """Number or condition computed in C: each NumPy operation on it appends a statement to `lines`."""

    def __init__(self, text: str, lines: list[str]) -> None:
        self.text, self.lines = text, lines

    def __array_ufunc__(self, function: Any, method: str, *inputs: Any, **_: Any) -> Any:
        if function is np.power and inputs[1] == 0.5:
            return self._statement("double", f"sqrt({_text(inputs[0])})")
        kind, expression = _IN_C.get(function, ("", ""))
        return self._statement(kind, expression.format(*map(_text, inputs))) if kind else NotImplemented

    def clip(self, low: Any, high: Any, out: None = None) -> _Symbol:
        """Value within limits, called by `numpy.clip`."""
        return self._statement("double", f"fmin(fmax({self.text}, {_text(low)}), {_text(high)})")

    def _statement(self, kind: str, expression: str) -> _Symbol:
        name = f"t{len(self.lines)}"
        self.lines.append(f"const {kind} {name} = {expression};")
        return _Symbol(name, self.lines)


# Type and C text of each operation.
_IN_C: dict[Any, tuple[str, str]] = {
    np.add: ("double", "{} + {}"),
    np.subtract: ("double", "{} - {}"),
    np.multiply: ("double", "{} * {}"),
    np.divide: ("double", "{} / {}"),
    np.absolute: ("double", "fabs({})"),
    np.maximum: ("double", "fmax({}, {})"),
    np.minimum: ("double", "fmin({}, {})"),
    np.greater: ("int", "{} > {}"),
    np.greater_equal: ("int", "{} >= {}"),
    np.less: ("int", "{} < {}"),
    np.less_equal: ("int", "{} <= {}"),
    np.equal: ("int", "{} == {}"),
    np.bitwise_and: ("int", "{} & {}"),
    np.bitwise_or: ("int", "{} | {}"),
}


def _text(value: Any) -> str:
    """Number as C: symbols by name, Python numbers with all digits."""
    if isinstance(value, _Symbol):
        return value.text
    if isinstance(value, bool):
        return str(int(value))
    number = float(value)
    return f"({number!r})" if number < 0.0 else repr(number)


# Coefficients of a fuel as Chebyshev series over its range of temperature, for callers without Python.

# The laws are polynomials and exponentials in temperature. With 24 terms the series of the catalogue are exact to
# rounding (4e-10 in the channels of tests/plugins/export/test_all_wirings.py).
DEGREE = 24


class FuelTable(NamedTuple):
    """Series of `FuelCoefficients` over a range of temperature, from `coldest` to `hottest` [K].

    `series` (coefficients, degree + 1) are in T_k((2 T − coldest − hottest)/(hottest − coldest)). `exact`
    (coefficients,) holds the coefficients at the model's own temperature, to the last bit.
    """

    coldest: float
    hottest: float
    series: Floats
    exact: Floats

    def at(self, temperature: float) -> Floats:
        """Coefficients at a temperature [K]."""
        x = (2.0 * temperature - self.coldest - self.hottest) / (self.hottest - self.coldest)
        return np.asarray(chebyshev.chebval(x, self.series.T))


def fuel_table(fuel: Fuel, exact_at: float) -> FuelTable:
    """Table of a fuel, with the exact values of `fuel_coefficients` at the temperature `exact_at` [K].

    The fit leaves rounding of about 1e-11 in single coefficients, which cancels in the polynomials; a shift makes them
    exact at that temperature. `ConfigurationError` if polynomials cannot represent the fuel's laws over its whole
    temperature range.
    """
    low, high = fuel.temperature_range

    def values(nodes: Floats) -> Floats:
        return np.array([fuel_coefficients(fuel, float(t)) for t in low + 0.5 * (nodes + 1.0) * (high - low)])

    exact = np.array(fuel_coefficients(fuel, exact_at))
    series = np.asarray(chebyshev.chebinterpolate(values, DEGREE), float).T  # type: ignore[type-var]
    table = FuelTable(low, max(high, float(np.nextafter(low, np.inf))), series, exact)
    table.series[:, 0] += exact - table.at(exact_at)
    return table


ENERGISINGS = 16  # planned at once
HEAD = 2048  # bytes before the working rows of a state; the C compiler checks that they suffice
MOST_SLOTS = 1 << 24  # of a ring buffer: a wave travel time of 16 s at 1 us
_TOLERANCE = 1e-6  # on the range of temperature, as in `Fuel.is_defined_at` [K]

_BOUNDS = {  # smallest and largest value, and which of them are themselves excluded
    Domain.POSITIVE: (0.0, math.inf, 1, 0),
    Domain.NON_NEGATIVE: (0.0, math.inf, 0, 0),
    Domain.UNIT: (0.0, 1.0, 0, 0),
    Domain.COEFFICIENT: (0.0, 1.0, 1, 0),
    Domain.CHANGE: (-1.0, math.inf, 1, 0),
    Domain.CONE: (0.0, math.pi, 1, 1),
    Domain.ANY: (-math.inf, math.inf, 0, 0),
}
_CHANNEL = "typedef struct { const char *name, *unit; } cr_channel"
_SENTENCE = "typedef struct { int status; const char *text; } cr_words"
_PARAMETER = (
    "typedef struct { const char *name, *unit; double value, low, high; int low_open, high_open; } cr_parameter"
)
_OWN_SENTENCES = {
    16: "A boundary pressure lies outside the fuel's range, or cylinder or return pressure reach the rail pressure; "
    "correct the pressures or their units.",
    17: "The energisings overlap, begin before the present time or are too many; give them in order.",
    18: "The memory is too small, or holds no state of this model; allocate what cr_state_size says and begin.",
}


class Model(NamedTuple):
    """Sources of an injector's library.

    `name` is a C identifier that begins the names of its functions, `stamp` a hexadecimal digest of everything that
    affects its numbers, `header` the text of ``NAME.h``, `sources` are the texts of the other files by name.
    """

    injector: Injector
    name: str
    stamp: str
    header: str
    sources: dict[str, str]


def make_model(injector: Injector, temperatures: Sequence[float] = ()) -> Model:
    """Sources of an injector's library.

    `temperatures` [K]: further temperatures with exact coefficients of the fuel, next to the injector's own.
    `ConfigurationError` if the physics cannot be compiled, or the fuel has no polynomials over its temperature range.
    """
    wired = injector.wired()
    size, name = sizes(wired), re.sub(r"\W+", "_", injector.name, flags=re.ASCII).strip("_").lower()
    if not name or name[0].isdigit():
        name = f"injector_{name}".rstrip("_")
    tables, defines = _tables(injector, temperatures), _defines(injector)
    kernel = kernel_source(link_llvm_text(wired, name))
    digest = hashlib.sha256((tables + defines + kernel).encode()).hexdigest()
    public_sizes = (
        ("PARAMETERS", size.parameters + 1, "the last one is the temperature of the fuel"),
        ("CHANNELS", size.channels, ", ".join(c.name for c in channels(wired.actuation))),
        ("ENERGISINGS", ENERGISINGS, "planned at once"),
        *define_inputs_read(wired),
    )
    public = "".join(f"#define CR_{key} {value} /* {meaning} */\n" for key, value, meaning in public_sizes)
    core = f"#define CR_STAMP UINT64_C(0x{digest[:16]})\n{defines}"
    return Model(
        injector,
        name,
        digest,
        insert_model_name(template("commonrail.h").replace("/*SIZES*/\n", public), name),
        {
            f"{name}.c": insert_model_name(template("core.c"), name),
            f"{name}_core.h": insert_model_name(template("core.h").replace("/*DEFINES*/\n", core), name),
            f"{name}_model.h": insert_model_name(tables, name),
            f"{name}_kernel.c": kernel,
        },
    )


def define_inputs_read(variant: Variant) -> list[tuple[str, int, str]]:
    """Definitions that state which inputs of `cr_boundary` the model reads during a simulation."""
    unread = unread_inputs(variant)
    words = {
        RAIL: "0: the rail is a volume; only its initial pressure is read",
        RETURN: "0: there is no return",
        DRIVE: "0: the drive is computed from the energisings; a measured voltage or current is not read",
        COMMAND: "0: boundary.drive drives the coil; energisings only say where an injection begins",
    }
    return [(f"READS_{name.upper()}", int(name not in unread), text) for name, text in words.items()]


def source_file(name: str) -> Traversable:
    """Hand-written source, or another file delivered with a model."""
    return resources.files("commonrail.plugins.export").joinpath("c", name)


def template(name: str) -> str:
    """Text of a hand-written source."""
    return source_file(name).read_text(encoding="utf-8")


def insert_model_name(text: str, name: str) -> str:
    """Insert the model's name in place of ``cr``: two models can be linked into one program."""
    text = text.replace('"cr_commonrail.h"', f'"{name}.h"')
    return re.sub(r"\bCR_", f"{name.upper()}_", re.sub(r"\bcr_", f"{name}_", text))


# Rows of the working memory that the C sources read: instants and flag of the needle, delays of the waves.
_ROWS = ("opening", "last_closing", "first_closing", "is_open", "delay_steps")


def _defines(injector: Injector) -> str:
    """Sizes, rows and limits of a model for the preprocessor."""
    wired, size = injector.wired(), sizes(injector.wired())
    rows = make_rows(wired, 1)
    low, high = injector.fuel.pressure_range
    defines = {
        "HEAD": HEAD,
        "WORK": size.work,
        "FUEL": size.fuel,
        "COLUMNS": size.parameters + size.fuel,
        "KERNEL_FIGURES": size.figures,
        **{f"F_{name.upper()}": i for i, name in enumerate(Outcome._fields)},
        **{f"ROW_{name.upper()}": getattr(rows, name) for name in _ROWS},
        "LOWEST_PRESSURE": repr(float(low)),
        "HIGHEST_PRESSURE": repr(float(high)),
        "SHORTEST_STEP": repr(TIME_STEPS.low),
        "LONGEST_STEP": repr(TIME_STEPS.high),
        "SLOWEST_WAVE": repr(plan.SLOWEST_WAVE),
        "MOST_SLOTS": MOST_SLOTS,
        "BACKFLOW": repr(BACKFLOW),
    }
    if wired.boundary is Boundary.IDEAL and wired.actuation is Actuation.SERVO:
        defines["IDEAL_RAIL"] = [c.name for c in channels(wired.actuation)].index("rail_pressure")
    return _directives(defines)


def _directives(defines: Mapping[str, object]) -> str:
    return "".join(f"#define CR_{key} {value}\n" for key, value in defines.items())


def _tables(injector: Injector, temperatures: Sequence[float]) -> str:
    """Text of the private header: parameters, channels, fuel, sentences, stability condition."""
    wired = injector.wired()
    fuel = fuel_table(injector.fuel, injector.values[FUEL_TEMPERATURE])
    exact = {injector.values[FUEL_TEMPERATURE]: fuel.exact}
    exact |= {float(t): np.array(fuel_coefficients(injector.fuel, t)) for t in temperatures if t not in exact}
    observed = [[_quote(c.name), _quote(c.unit)] for c in channels(wired.actuation)]
    ends = {int(status): status.sentence for status in Status if status is not Status.CONDITION_NOT_MET}
    sentences = [[str(status), _quote(text)] for status, text in (ends | _OWN_SENTENCES).items()]
    sizes_of_tables = {
        "DEGREE": fuel.series.shape[1] - 1,
        "COLDEST": repr(fuel.coldest),
        "HOTTEST": repr(fuel.hottest),
        "SENTENCES": len(sentences),
        "KNOWN": len(exact),
    }
    parts = (
        "/* Generated: tables of one model. */\n#ifndef CR_MODEL\n#define CR_MODEL",
        "#include <math.h>\n#include <stdint.h>",
        _directives(sizes_of_tables),
        _parameters(injector),
        _rows(_CHANNEL, "cr_channel cr_channels[]", observed),
        _rows(_SENTENCE, "cr_words cr_sentences[]", sentences),
        _fuel(fuel, exact),
        _longest_way(wired.actuation),
        step_condition(wired),
        "#endif\n",
    )
    return "\n".join(parts)


def _rows(kind: str, name: str, rows: Iterable[Iterable[str]]) -> str:
    body = ",\n".join(f"    {{{', '.join(row)}}}" for row in rows)
    return f"{kind};\nstatic const {name} = {{\n{body}\n}};"


def find_bounds(injector: Injector, path: str) -> tuple[float, float, int, int]:
    """Smallest and largest value of a parameter [SI], and 1 for each that is itself excluded."""
    if path == FUEL_TEMPERATURE:
        coldest, hottest = injector.fuel.temperature_range
        return coldest - _TOLERANCE, hottest + _TOLERANCE, 0, 0
    return _BOUNDS[injector.quantities[path].domain]


def _parameters(injector: Injector) -> str:
    rows = []
    for path in (*parameter_paths(injector.variant.actuation), FUEL_TEMPERATURE):
        quantity = injector.quantities[path]
        low, high, low_open, high_open = find_bounds(injector, path)
        numbers = [repr(float(value)).replace("inf", "HUGE_VAL") for value in (injector.values[path], low, high)]
        rows.append([_quote(path), _quote(quantity.unit), *numbers, str(low_open), str(high_open)])
    return _rows(_PARAMETER, "cr_parameter cr_parameters[]", rows)


def _quote(text: str) -> str:
    return json.dumps(text, ensure_ascii=True)


def _fuel(table: FuelTable, exact: Mapping[float, Floats]) -> str:
    rows = ",\n".join("    {" + ", ".join(map(repr, row.tolist())) + "}" for row in table.series)
    exact_rows = ",\n".join(f"    {{{', '.join(map(repr, [t, *row.tolist()]))}}}" for t, row in exact.items())
    return (
        f"static const double cr_fuel[CR_FUEL][CR_DEGREE + 1] = {{\n{rows}\n}};\n"
        "/* Temperature, and the coefficients at it. */\n"
        f"static const double cr_known_fuel[CR_KNOWN][CR_FUEL + 1] = {{\n{exact_rows}\n}};"
    )


def _longest_way(actuation: Actuation) -> str:
    paths = parameter_paths(actuation)
    ways = [f"{share!r} * p[{paths.index(name)}]" for name, share in plan._WAYS.items() if name in paths]
    longest = ways[0] if len(ways) == 1 else f"fmax({', '.join(ways)})"
    law = f"static double cr_longest_way(const double *p) {{ return {longest}; }}"
    return f"/* Longest distance of a wave [m]. */\n{law}"
