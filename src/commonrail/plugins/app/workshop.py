"""Page for workshops, in English and German: test values in, verdict, cause, next test and trim out."""

from __future__ import annotations

import csv
import io
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from commonrail.base.csv_output import write_csv
from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.input import read_plain
from commonrail.plugins.app.elements import field, header, say, select, soft, upload, waiting
from commonrail.plugins.app.project import Project

# Columns of a test plan as it is written: key, heading of the page, heading of the file.
COLUMNS = (
    ("test", "test", "test"),
    ("measure", "measure", "measure"),
    ("rail_pressure", "rail, MPa", "rail_pressure [MPa]"),
    ("energising_time", "energising, µs", "energising_time [us]"),
    ("stroke_rate", "strokes, 1/min", "stroke_rate [1/min]"),
    ("nominal", "nominal, mm³", "nominal [mm3]"),
    ("half_band", "half band, %", "half_band [%]"),
    ("bench", "measured, mm³", "bench [mm3]"),
)
_MEASURES = ("delivery", "return")
_EMPTY = {"test": "", "measure": "delivery", "stroke_rate": "1000", "half_band": "20"}
_START = ("VL", "135", "800"), ("EM", "80", "500"), ("LL", "30", "650"), ("VE", "80", "300")
MOST_TESTS = 60


def read_rows(text: str) -> list[dict[str, str]]:
    """Rows of a pasted or dropped sheet; its separator is detected, and its headings are those of a test plan.

    `InputError` if a column is missing, or a unit differs from the page's.
    """
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError("There are no rows; the first line has the headings, as in test,measure,rail_pressure [MPa].")
    separator = max("\t;,", key=lines[0].count)
    rows = list(csv.reader(io.StringIO("\n".join(lines)), delimiter=separator))
    heads = [head.strip() for head in rows[0]]
    places: dict[str, int] = {}
    for key, _, name in COLUMNS:
        bare, _, unit = name.partition(" [")
        for i, head in enumerate(heads):
            if head == bare or head.partition(" [")[0].strip() == bare:
                if unit and "[" in head and head.partition("[")[2].rstrip("] ") != unit.rstrip("]"):
                    raise InputError(f"{head}: this page takes {name}; convert the column, or use `commonrail judge`.")
                places[key] = i
    if missing := [
        name for key, _, name in COLUMNS if key in ("test", "rail_pressure", "energising_time") and key not in places
    ]:
        raise InputError(f"The heading has no column {missing[0]}; it has {', '.join(heads)[:200]}.")
    if unread := [h for h in heads if h.partition(" [")[0].strip() not in {k for k, _, _ in COLUMNS}]:
        raise InputError(f"The column {unread[0]} cannot be shown here; use `commonrail judge` for this plan.")
    comma = separator != ","
    cells = [
        [cell.strip().replace(",", ".") if comma else cell.strip() for cell in row] for row in rows[1 : MOST_TESTS + 1]
    ]
    return [{key: row[at] if at < len(row) else "" for key, at in places.items()} for row in cells]


def write_rows(path: Path, rows: list[dict[str, str]], notes: list[str]) -> None:
    """Write a test plan as CSV under its notes; rows without a rail pressure are left out."""
    cells = [[row.get(key, "").replace(",", ".") for key, _, _ in COLUMNS] for row in rows if row.get("rail_pressure")]
    write_csv(path, [note.lstrip("# ") for note in notes], [name for _, _, name in COLUMNS], cells)


LARGEST_PLAN = 1_000_000  # of a test plan of a few lines [bytes]


class Workshop:
    """The page of one window."""

    def __init__(self, project: Project, language: str) -> None:
        self.project, self.language = project, language
        words = (Path(__file__).parent / "german.toml").read_text("utf-8")
        self.words: dict[str, str] = tomllib.loads(words) if language == "de" else {}
        self.part, self.noise = str(project.state.get("part", "")), "workshop"
        self.rows = [{**_EMPTY, "test": t, "rail_pressure": p, "energising_time": e} for t, p, e in _START]
        self.notes: list[str] = []
        self.record: dict[str, Any] = {}

    def say(self, text: str) -> str:
        """Text in the language of the page."""
        return self.words.get(text, text)

    async def build(self) -> None:
        """Build the page."""
        ui.query("html").props(f'lang="{self.language}"')
        other = {"Deutsch": "/workshop?language=de"} if self.language == "en" else {"English": "/workshop?language=en"}
        header(self.say("Workshop"), {self.say("Calibration"): "/"} | other)
        with ui.element("main").classes("page").props('id="content"'), ui.column().classes("q-tab-panel"):
            self.verdict()
            with ui.card().classes("box"):
                with ui.element("div").classes("fields"):
                    field(self.say("Part number or type"), self.part, self.set_part, "0 445 110 191")
                    noises = {key: self.say(key) for key in ("workshop", "bench", "maker")}
                    choice = select(self.say("Accuracy of the bench"), noises, self.noise, lambda noise: None)
                    choice.bind_value(self, "noise")
                    upload(self.say("Drop a test plan"), self.take, many=False, kinds=".csv,.txt,.tsv")
                self.tests()
                if (place := self.project.folder / "tests.csv").is_file():
                    self.paste(read_plain(place).decode("utf-8", "replace"))
                with ui.row().classes("line no-print"):
                    ui.button(self.say("Judge"), icon="gavel", on_click=self.judge).props("no-caps")
                    turn = ui.button(self.say("Print"), icon="print").props("no-caps outline")
                    turn.on("click", js_handler="() => window.print()")
                words = self.say("Paste rows of a sheet, with their heading")
                with ui.expansion(words).props("dense").classes("no-print"):
                    box = ui.textarea().props(f'outlined aria-label="{words}"').classes("wide")
                    ui.button(self.say("Take"), on_click=lambda: self.paste(box.value)).props("no-caps outline")

    def set_part(self, number: str) -> None:
        """Take a part number or a type."""
        self.part = self.project.state["part"] = number
        self.project.save()

    async def take(self, name: str, chunks: Any) -> None:
        """Take a dropped test plan, with or without results."""
        written = await self.project.add_file(name, chunks, "out")
        text = read_plain(self.project.folder / "out" / written, LARGEST_PLAN)
        self.paste(text.decode("utf-8-sig", "replace"))

    def paste(self, text: str) -> None:
        """Take rows of a sheet."""
        try:
            self.rows = [_EMPTY | row for row in read_rows(text)]
            self.notes = [line for line in text.splitlines() if line.startswith("#")]
        except InputError as error:
            say(str(error), bad=True)
            return
        self.record = {}
        self.tests.refresh()
        self.verdict.refresh()

    @ui.refreshable_method
    def tests(self) -> None:
        """Table of tests, whose cells are typed into."""
        with ui.element("div").classes("scroll"), ui.element("table").classes("results"):
            with ui.element("tr"):
                for _, words, _ in COLUMNS:
                    with ui.element("th").props('scope="col"'):
                        ui.label(self.say(words))
            for number, row in enumerate(self.rows, start=1):
                with ui.element("tr"):
                    for key, words, _ in COLUMNS:
                        with ui.element("td"):
                            label = f'aria-label="{self.say(words)} {number}"'
                            if key == "measure":
                                options = {name: self.say(name) for name in _MEASURES}
                                value = row.get(key) if row.get(key) in _MEASURES else "delivery"
                                cell: Any = ui.select(options, value=value)
                            else:
                                cell = ui.input(value=row.get(key, ""))
                            cell.props(f"dense borderless {label}").on_value_change(
                                lambda e, r=row, k=key: r.update({k: str(e.value or "").strip()})
                            )
        ui.button(self.say("Add a test"), icon="add", on_click=self.add).props("flat dense no-caps").classes("no-print")

    def add(self) -> None:
        """Add an empty test."""
        self.rows.append(dict(_EMPTY))
        self.tests.refresh()

    async def judge(self, event: Any) -> None:
        """Judge the part by `commonrail judge`."""
        if not self.part or not any(row.get("bench") for row in self.rows):
            say(self.say("Enter a part and at least one measured quantity."), bad=True)
            return
        try:
            write_rows(self.project.folder / "tests.csv", self.rows, self.notes)
        except CommonrailError as error:
            say(str(error), bad=True)
            return
        command = "judge", self.part, "tests.csv", "--nominal", "--noise", self.noise, "--report", "out/judgement.html"
        work = partial(self.project.run, *command, "--json")
        self.record = await waiting(event.sender, work, self.say("Judging …")) or {}
        self.verdict.refresh()

    @ui.refreshable_method
    def verdict(self) -> None:
        """Verdict, tests in their bands, cause, next test and trim."""
        if not self.record:
            return
        kinds = {"pass": ("PASS", "pass"), "fail": ("FAIL", "fail")}
        words, look = kinds.get(self.record["verdict"], ("Not told", "open"))
        ui.label(self.say(words)).classes(f"verdict {look}").props('role="status"')
        ui.label(f"{self.part}: {self.record['injector']['title']}").classes("sub")
        soft(self.record["synthetic"])
        with ui.element("div").classes("scroll"), ui.element("table").classes("results"):
            with ui.element("tr"):
                for text in ("test", "rail, MPa", "energising, µs", "band, mm³", "measured, mm³", ""):
                    minor = "minor" if text in ("rail, MPa", "energising, µs") else ""
                    with ui.element("th").props('scope="col"').classes(minor):
                        ui.label(self.say(text) if text else "")
            for row in self.record["plan"]["data"]["rows"]:
                self.row(row)
        with ui.element("div").classes("two"):
            self.cause(self.record.get("diagnosis") or {})
            self.show_next_test_and_trim(self.record.get("diagnosis") or {}, self.record.get("trim") or {})

    def row(self, row: dict[str, Any]) -> None:
        """One test in its band."""
        bench = row.get("bench") or {}
        measure = "" if row["measure"] == "delivery" else f" ({self.say(row['measure'])})"
        state = bench.get("state", "not measured")
        texts = (
            f"{row['test']}{measure}",
            f"{row['rail_pressure'] / 1e6:g}",
            f"{row['energising_time'] * 1e6:.0f}",
            row["band"],
            f"{bench['value'] * 1e9:.2f}" if bench else "–",
        )
        with ui.element("tr"):
            for place, text in enumerate(texts):
                with ui.element("td").classes("minor" if place in (1, 2) else ""):
                    ui.label(self.number(text))
            with ui.element("td"):
                if bench.get("distance") is not None:
                    at = 50.0 + 25.0 * max(-2.0, min(2.0, bench["distance"]))
                    with ui.element("div").classes("bandbar").props('aria-hidden="true"'):
                        ui.element("i")
                        ui.element("b").style(f"left: {min(max(at, 1.0), 99.0):.1f}%")
                ui.label(("" if state == "inside" else "● ") + self.say(state)).classes(
                    "soft" if state == "inside" else "bad"
                )

    def number(self, text: str) -> str:
        """Text with the decimal sign of the language."""
        return text.replace(".", ",") if self.language == "de" and any(c.isdigit() for c in text) else text

    def cause(self, diagnosis: dict[str, Any]) -> None:
        """Causes with their probabilities."""
        if not diagnosis.get("diagnoses"):
            return
        with ui.card().classes("box"):
            ui.label(self.say("Likely cause")).classes("sub").props('role="heading" aria-level="2"')
            if diagnosis["verdict"] == "undecided":
                ui.label(self.say("The measurements do not single out a cause.")).classes("soft")
            for candidate in diagnosis["diagnoses"]:
                if candidate["probability"] >= 0.01:
                    with ui.row().classes("line"):
                        ui.label(self.say(candidate["name"])).style("flex: 1")
                        bar = ui.linear_progress(candidate["probability"], show_value=False, size="12px").style(
                            "width: 40%"
                        )
                        bar.props('aria-hidden="true"')
                        ui.label(f"{100 * candidate['probability']:.0f} %").classes("number")

    def show_next_test_and_trim(self, diagnosis: dict[str, Any], trim: dict[str, Any]) -> None:
        """The next test, and the trim."""
        with ui.card().classes("box"):
            if tests := diagnosis.get("next"):
                test = tests[0]
                head = "Decisive next test" if test["tells"] else "Best next test; it does not decide alone"
                ui.label(self.say(head)).classes("sub").props('role="heading" aria-level="2"')
                place = f"{test['rail_pressure'] / 1e6:g} MPa, {test['energising_time'] * 1e6:.0f} µs"
                ui.label(f"{self.say(test['measure'])} {self.say('at')} {self.number(place)}:")
                for name, value in zip(test["names"], test["expected"], strict=True):
                    ui.label(self.number(f"{value * 1e9:.1f} mm³ ") + f"{self.say('if')} {self.say(name)}")
            if trim.get("code"):
                ui.label(self.say("Trim")).classes("sub").props('role="heading" aria-level="2"')
                ui.label(f"{trim['code']} {self.say('in steps of')} {trim['step'] * 1e6:.0f} µs")
                if self.record["verdict"] == "fail":
                    ui.label(self.say("A trim is for sound parts: repair comes first.")).classes("soft")
