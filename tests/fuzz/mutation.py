"""Files spoilt in the ways in which files are spoilt: by hand, by other programs, by transfer, and on purpose."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from random import Random

__all__ = ["mutated", "noise"]

Change = Callable[[Random, str], str]

LARGEST = 300_000
UNITS = (
    "MPa bar Pa us ms s mm um m mm3 mm3/ms mg/ms m3/s kg N N/m N/um degC K A V % 1 rpm Hz furlong m^99 1000**9 / ° µm"
)
NUMBERS = (
    "0 -1 1 1e400 -1e400 1e308 -1e308 1e-400 1e-300 nan inf -inf 1_0 0x10 1e 1,5 9999999999999999999999 1e15 0.5 ٣ 1e-9"
)
TEXTS = (
    "<script>alert(1)</script>",
    '\\"',
    "\\u0000",
    "\\u001b[2J",
    "\\u202e",
    "\\n",
    "{{ 7 * 7 }}",
    "{% include 'x' %}",
    "../../../etc/passwd",
    "/dev/zero",
    "/",
    ".",
    "",
    " ",
    "NUL",
    "%s%n",
    "x" * 300,
    "é" * 50,
    "🙂",
    "\u2028",
    "=1+1",
    "virtual-lino-2016",
    "cri2-16",
    "iso4113",
    "n-dodecane",
    "injector.toml",
    "data/evi.csv",
    "study.toml",
    "rate",
    "quantities",
    "fit",
    "validation",
    "plunger_needle.k1 < plunger_needle.k2",
    "fuel.temperature",
)
VALUES = (
    "true",
    "[]",
    "{}",
    "[[]]",
    "[{}]",
    '[""]',
    "{ value = 1 }",
    '{ column = "time" }',
    '{ file = "data/evi.csv", column = "rate" }',
    "1979-05-27T07:32:00Z",
    "07:32:00",
    '"""\n"""',
    "'''x'''",
    "[1, 2]",
    '["0 us", "900 us"]',
    "[0.4, 1.0]",
    "9" * 5000,
    "0x" + "f" * 400,
    "[" * 3000,
    "",
)
KEYS = ("", "a.b.c", '""', '"a b"', "x" * 300, "format", "kind", "name", "file", "é", '"\\n"', "a" + ".a" * 50)
NASTY_BYTES = (
    b"\0",
    b"\xff",
    b"\xc3",
    b"\xed\xa0\x80",
    b"\r",
    b"\x1b[2J",
    b"\xef\xbb\xbf",
    b'"',
    b"\n",
    b"[",
    b"#",
    b",",
)
JSON_VALUES: tuple[object, ...] = (
    None,
    True,
    -1,
    10**400,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "<script>",
    [],
    {},
    [[]],
    [None],
    {"a": {}},
    "x" * 500,
    0,
)


def noise(random: Random) -> bytes:
    """Bytes of no file."""
    return random.randbytes(random.choice((0, 1, 7, 100, 3000)))


def mutated(random: Random, name: str, data: bytes) -> bytes:
    """The content of a file with some faults in it, of the kinds that fit its name."""
    if random.random() < 0.02:
        return noise(random)
    text = data.decode("utf-8")
    changes = {"toml": TOML, "json": JSON}.get(name.rpartition(".")[2], CSV)
    for _ in range(random.choice((1, 1, 1, 2, 3, 6))):
        if len(text) < LARGEST:  # a table repeated twenty times, twice, would fill the memory before anybody reads it
            text = random.choice(changes)(random, text)
    spoilt = text.encode("utf-8", "surrogatepass")
    return random.choice(BYTES)(random, spoilt) if random.random() < 0.15 else spoilt


def _value(random: Random) -> str:
    """Values for the right of an equals sign."""
    kind = random.random()
    if kind < 0.35:
        return f'"{random.choice(NUMBERS.split())} {random.choice(UNITS.split())}"'
    if kind < 0.55:
        return random.choice(NUMBERS.split())
    return f'"{random.choice(TEXTS)}"' if kind < 0.8 else random.choice(VALUES)


def _lines(change: Callable[[Random, list[str]], None]) -> Change:
    def run(random: Random, text: str) -> str:
        lines = text.split("\n")
        change(random, lines)
        return "\n".join(lines)

    return run


def _delete_line(random: Random, lines: list[str]) -> None:
    del lines[random.randrange(len(lines))]


def _delete_lines(random: Random, lines: list[str]) -> None:
    first = random.randrange(len(lines))
    del lines[first : first + random.choice((2, 5, 30, 1000))]


def _repeat_line(random: Random, lines: list[str]) -> None:
    lines.insert(random.randrange(len(lines) + 1), random.choice(lines) if lines else "")


def _swap_lines(random: Random, lines: list[str]) -> None:
    a, b = random.randrange(len(lines)), random.randrange(len(lines))
    lines[a], lines[b] = lines[b], lines[a]


def _repeat_block(random: Random, lines: list[str]) -> None:
    first = random.randrange(len(lines))
    block = lines[first : first + random.choice((1, 5, 20))]
    lines[first:first] = block * random.choice((1, 3, 20))


def _with_value(random: Random, lines: list[str], value: str) -> None:
    places = [i for i, line in enumerate(lines) if re.match(r"\s*[\w\"'.]+\s*=", line)]
    if places:
        i = random.choice(places)
        lines[i] = f"{lines[i].partition('=')[0]}= {value}"


def _change_value(random: Random, lines: list[str]) -> None:
    _with_value(random, lines, _value(random))


def _borrow_value(random: Random, lines: list[str]) -> None:
    """A value of another key: as a rule of another type or unit."""
    values = [line.partition("=")[2].strip() for line in lines if "=" in line]
    if values:
        _with_value(random, lines, random.choice(values))


def _wrap_value(random: Random, lines: list[str]) -> None:
    values = [line.partition("=")[2].partition(" #")[0].strip() for line in lines if "=" in line]
    if values:
        form = random.choice(("[{}]", "{{ value = {} }}", "[{0}, {0}]", '{{ value = {}, mark = "X" }}'))
        _with_value(random, lines, form.format(random.choice(values)))


def _change_key(random: Random, lines: list[str]) -> None:
    places = [i for i, line in enumerate(lines) if "=" in line]
    if places:
        i = random.choice(places)
        own, _, value = lines[i].partition("=")
        other = random.choice(places)
        key = random.choice((random.choice(KEYS), lines[other].partition("=")[0], own.strip()[:-1], own.upper()))
        lines[i] = f"{key} = {value}"


def _add_key(random: Random, lines: list[str]) -> None:
    key = random.choice(KEYS)
    lines.insert(random.randrange(len(lines) + 1), f"{key} = {_value(random)}")


def _change_header(random: Random, lines: list[str]) -> None:
    places = [i for i, line in enumerate(lines) if line.startswith("[")]
    if places:
        i = random.choice(places)
        name = lines[i].strip("[] ")
        other = lines[random.choice(places)].strip("[] ")
        forms = (f"[{name}]", f"[[{name}]]", f"[{name}.{other}]", f"[{other}]", f"[{random.choice(KEYS)}]", f"[{name}")
        lines[i] = random.choice(forms)


def _change_unit(random: Random, text: str) -> str:
    found = list(re.finditer(r'(?<=\d )[^"\s\d][^"\s]*(?=")|(?<=\[)[^\]\n]{1,12}(?=\])', text))
    if not found:
        return text
    place = random.choice(found)
    return text[: place.start()] + random.choice(UNITS.split()) + text[place.end() :]


def _change_number(random: Random, text: str) -> str:
    found = list(re.finditer(r"-?\d+\.?\d*(?:[eE][+-]?\d+)?", text))
    if not found:
        return text
    place = random.choice(found)
    scaled = float(place[0]) * random.choice((0.0, -1.0, 1e3, 1e-3, 1e12, 0.999, 1e300))
    new = random.choice((random.choice(NUMBERS.split()), repr(scaled), place[0] + "0" * 30, place[0] + place[0]))
    return text[: place.start()] + new + text[place.end() :]


def _change_text(random: Random, text: str) -> str:
    found = list(re.finditer(r'(?<=")[^"\n]*(?=")', text))
    if not found:
        return text
    place = random.choice(found)
    return text[: place.start()] + random.choice(TEXTS) + text[place.end() :]


def _insert(random: Random, text: str) -> str:
    at = random.randrange(len(text) + 1)
    return text[:at] + random.choice((*TEXTS, '"', "'", "=", "[", "]", "{", "\\", ",", ";", "\t", "#")) + text[at:]


def _cut(random: Random, text: str) -> str:
    return text[: random.randrange(len(text) + 1)]


def _line_ends(random: Random, text: str) -> str:
    return text.replace("\n", random.choice(("\r\n", "\r", "\n\n", "\u2028", "\x0b", " ")))


def _cells(change: Callable[[Random, list[list[str]]], None]) -> Change:
    def run(random: Random, text: str) -> str:
        rows = [line.split(",") for line in text.split("\n")]
        change(random, rows)
        return "\n".join(",".join(row) for row in rows)

    return run


def _change_cell(random: Random, rows: list[list[str]]) -> None:
    row = random.choice(rows)
    cell = random.choice((*NUMBERS.split(), *TEXTS, '"', '"x', "9" * 5000, "1e9", "[us]", "", "x" * 140_000))
    row[random.randrange(len(row))] = cell


def _change_column(random: Random, rows: list[list[str]]) -> None:
    column = random.randrange(max(map(len, rows)))
    new = random.choice((*NUMBERS.split(), "", None))
    for row in rows[random.choice((0, 1, 5)) :]:
        if column < len(row):
            if new is None:
                del row[column]
            else:
                row[column] = new


def _change_name(random: Random, rows: list[list[str]]) -> None:
    heads = [row for row in rows if row and not row[0].startswith("#")] or rows
    head = heads[0]
    names = (*TEXTS, *UNITS.split(), f"x [{random.choice(UNITS.split())}]", random.choice(head), "x" * 400, "time")
    head[random.randrange(len(head))] = random.choice(names)


def _widen(random: Random, rows: list[list[str]]) -> None:
    wide = random.choice((2, 50, 1200))
    if wide * sum(map(len, rows)) < 200_000:
        for row in rows:
            row.extend(row * wide)


def _shuffle(random: Random, rows: list[list[str]]) -> None:
    first = random.randrange(len(rows))
    part = rows[first:]
    random.shuffle(part)
    rows[first:] = part


def _units_row(random: Random, rows: list[list[str]]) -> None:
    rows.insert(random.choice((0, 1, 6)), [random.choice(UNITS.split()) for _ in rows[-2 if len(rows) > 1 else -1]])


def _delimiter(random: Random, text: str) -> str:
    return text.replace(",", random.choice((";", "\t", " ", ",,", "|", ", ")))


def _decimal_comma(random: Random, text: str) -> str:
    return text.replace(",", ";").replace(".", ",")


def _json_node(random: Random, text: str) -> str:
    """Replace, delete or add something anywhere in a tree."""
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return text
    nodes = [node for node in _containers(tree) if node]
    if not nodes:
        return text
    node = random.choice(nodes)
    key = random.choice(list(node) if isinstance(node, dict) else range(len(node)))
    action = random.random()
    if action < 0.3:
        del node[key]
    elif action < 0.8:
        node[key] = random.choice(JSON_VALUES)
    elif action < 0.9:
        node[key] = random.choice(nodes)
    elif isinstance(node, dict):
        node[random.choice((*TEXTS, key + "x"))] = node.pop(key)
    try:
        return json.dumps(tree, indent=1)
    except ValueError:  # a node now holds itself
        return text


def _containers(tree: object) -> list[dict[str, object] | list[object]]:
    found: list[dict[str, object] | list[object]] = []
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, dict | list):
            found.append(node)
            waiting += list(node.values()) if isinstance(node, dict) else node
    return found


def _json_deep(random: Random, text: str) -> str:
    return random.choice(("[" * 100_000, '{"a":' * 50_000, "9" * 10_000, '{"schema": 1e999}', "null", '"x"', "[]"))


def _flip(random: Random, data: bytes) -> bytes:
    changed = bytearray(data or b"x")
    for _ in range(random.choice((1, 1, 3, 20))):
        changed[random.randrange(len(changed))] ^= 1 << random.randrange(8)
    return bytes(changed)


def _insert_bytes(random: Random, data: bytes) -> bytes:
    at = random.randrange(len(data) + 1)
    return data[:at] + random.choice(NASTY_BYTES) * random.choice((1, 1, 2, 5000)) + data[at:]


def _cut_bytes(random: Random, data: bytes) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _encode(random: Random, data: bytes) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(random.choice(("utf-16", "utf-16-le", "utf-8-sig", "latin-1", "utf-7")), "replace")


def _splice(random: Random, data: bytes) -> bytes:
    a, b = sorted((random.randrange(len(data) + 1), random.randrange(len(data) + 1)))
    return data[:a] + data[b:] + data[a:b]


_LINES = [_lines(c) for c in (_delete_line, _delete_lines, _repeat_line, _swap_lines, _repeat_block)]
_ANY: list[Change] = [_change_number, _change_number, _change_unit, _insert, _cut, _line_ends]
TOML: list[Change] = [
    *_LINES,
    *_ANY,
    *[_lines(c) for c in (_change_value, _change_value, _change_value, _borrow_value, _borrow_value, _wrap_value)],
    *[_lines(c) for c in (_change_key, _add_key, _change_header)],
    _change_text,
    _change_text,
]
CSV: list[Change] = [
    *_LINES,
    *_ANY,
    *[_cells(c) for c in (_change_cell, _change_cell, _change_column, _change_name, _widen, _shuffle, _units_row)],
    _delimiter,
    _decimal_comma,
]
JSON: list[Change] = [
    _json_node,
    _json_node,
    _json_node,
    _json_node,
    _json_node,
    _json_deep,
    _change_text,
    _insert,
    _cut,
]
BYTES = [_flip, _insert_bytes, _cut_bytes, _encode, _splice]
