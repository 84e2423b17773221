"""Pages of the app: data, injector, calibration and result; a page for workshops is in `workshop`."""

from __future__ import annotations

import asyncio
import inspect
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import app, ui

from commonrail.base.errors import CommonrailError
from commonrail.base.input import LARGEST_FILE
from commonrail.plugins.app import charts
from commonrail.plugins.app.project import COMMANDS, EFFORTS, Outcome, Project

STEPS = ("Data", "Injector", "Calibrate", "Result")
ROLES = {"fit": "fit", "validation": "held out", "unused": "not used"}
MARKS = {"M": "measured", "E": "estimated", "C": "control unit", "F": "fitted"}
PERIOD = 1.5  # between looks at the runs [s]
MAPS = {"DCM": "dcm", "CDFX": "cdfx", "TunerStudio": "table"}
STEP = 200  # of a slider between usual limits


def register(project: Project) -> None:
    """Declare the pages of a project."""
    from commonrail.plugins.app import workshop

    style = (Path(__file__).parent / "style.css").read_text("utf-8")

    @ui.page("/")
    async def home(step: str = "Data") -> None:
        ui.add_css(style)
        await Home(project, step if step in STEPS else STEPS[0]).build()

    @ui.page("/workshop")
    async def bench(language: str = "en") -> None:
        ui.add_css(style)
        await workshop.Workshop(project, "de" if language == "de" else "en").build()

    app.on_exception(lambda error: None)


async def finish(result: Any) -> Any:
    """Result of a function that may be asynchronous."""
    return await result if inspect.isawaitable(result) else result


def say(sentence: str, *, bad: bool = False) -> None:
    """Show a sentence for some seconds; an error until it is closed."""
    if bad:
        ui.notify(sentence, type="negative", timeout=0, close_button="Close", multi_line=True)
    else:
        ui.notify(sentence, type="positive")


def heading(words: str, level: int = 2) -> None:
    """Heading of a step or of a box."""
    ui.label(words).classes("head" if level == 2 else "sub").props(f'role="heading" aria-level="{level}"')


def soft(words: str) -> None:
    """Explaining sentence."""
    ui.label(words).classes("soft")


def trouble(sentence: str) -> None:
    """Reason why something is not shown."""
    ui.label(sentence).classes("bad").props('role="alert"')


def field(label: str, value: Any, save: Callable[[str], Any], hint: str = "", classes: str = "") -> ui.input:
    """Field of a text, saved when it is left or Enter is pressed."""
    box = ui.input(label, value=str(value or ""), placeholder=hint).props("dense outlined stack-label").classes(classes)
    last = [box.value]

    async def done() -> None:
        if box.value != last[0]:
            last[0] = box.value
            try:
                await finish(save(box.value.strip()))
            except CommonrailError as error:
                say(str(error), bad=True)

    box.on("blur", done)
    box.on("keydown.enter", done)
    return box


def upload(label: str, take: Callable[[str, Any], Any], *, many: bool = True, kinds: str = "") -> ui.upload:
    """Place to drop files; each goes to `take` with its name and content."""

    async def handle(event: Any) -> None:
        try:
            await finish(take(event.file.name, event.file.iterate()))
        except CommonrailError as error:
            say(str(error), bad=True)
        box.reset()

    box = ui.upload(
        label=label,
        multiple=many,
        auto_upload=True,
        max_file_size=LARGEST_FILE,
        on_upload=handle,
        on_rejected=lambda: say(f"A file may have {LARGEST_FILE // 1_000_000} MB.", bad=True),
    )
    box.props(f'flat bordered accept="{kinds}" aria-label="{label}"').classes("drop")
    box.on("failed", lambda: say("The file could not be taken: it may be too large.", bad=True), args=[])
    return box


async def waiting(button: Any, work: Any, words: str) -> Any:
    """Result of a work, during which its button turns and cannot be pressed."""
    button.props("loading")
    note = ui.notification(words, spinner=True, timeout=None, type="ongoing")
    try:
        return await work
    finally:
        note.dismiss()
        button.props(remove="loading")


def header(title: str, links: dict[str, str]) -> None:
    """Bar with title, links and the switch of the dark mode."""
    dark = ui.dark_mode(None)
    with ui.header().classes("bar"):
        ui.label(title).classes("title").props('role="heading" aria-level="1"')
        ui.space()
        for words, target in links.items():
            ui.link(words, target)
        turn = ui.button(icon="contrast", on_click=lambda: setattr(dark, "value", not dark.value))
        turn.props('flat round dense color=white aria-label="Light or dark"').classes("no-print")


class Home:
    """The four steps of one window on a project."""

    def __init__(self, project: Project, step: str) -> None:
        self.project, self.step, self.seen = project, step, project.version
        self.panels: dict[str, Any] = {}
        self.charts: dict[str, list[tuple[Any, Callable[[Any], Any]]]] = {}
        self.values: dict[str, float] = {}
        self.shifts: dict[str, float] = {}
        self.shown, self.live = "", dict[str, Any]()

    async def build(self) -> None:
        """Build the page."""
        header(f"commonrail · {self.project.folder.name}", {"Workshop": "/workshop"})
        await ui.context.client.connected()
        with ui.tabs().props("align=justify dense").classes("steps") as tabs:
            for number, name in enumerate(STEPS, start=1):
                ui.tab(name, label=f"{number} {name}")
        with ui.tab_panels(tabs, value=self.step, animated=False).classes("page") as panels:
            for name in STEPS:
                with ui.tab_panel(name) as panel:
                    self.panels[name] = panel
        self.tabs = tabs
        tabs.on_value_change(lambda event: self.turn(event.value))
        ui.skip_link("Skip to content", target=panels)
        await self.turn(self.step)
        ui.timer(PERIOD, self.follow)

    def own(self) -> None:
        """This window shows the latest change already."""
        self.seen = self.project.version

    async def turn(self, step: str) -> None:
        """Show a step by the present files."""
        self.step = step
        self.own()
        for panel in self.panels.values():
            panel.clear()
        with self.panels[step]:
            await finish(getattr(self, step.lower())())

    async def follow(self) -> None:
        """Show changes of other windows and the course of a run."""
        if self.seen != self.project.version:
            await self.turn(self.step)
        elif self.step == "Calibrate":
            await self.look()

    # Data

    def data(self) -> None:
        """Place to drop files, the files, and the pressures of the bench."""
        heading("Bring data")
        soft("Injection curves and quantity maps as the bench wrote them: CSV, Excel, MDF, TDMS, MAT, DCM …")
        upload("Drop data files here, or press +", self.take)
        self.files()
        with ui.card().classes("box"):
            heading("The bench", 3)
            with ui.element("div").classes("fields"):
                for key, words, hint in (
                    ("cylinder-pressure", "Back pressure behind the nozzle", "0.5 MPa, where no file tells it"),
                    ("return-pressure", "Pressure at the end of the return line", "0.1 MPa, where no file tells it"),
                ):
                    field(words, self.project.state["bench"].get(key), partial(self.bench, key), hint)
        ui.button("Next: the injector", on_click=lambda: self.tabs.set_value("Injector")).props("no-caps")

    @ui.refreshable_method
    def files(self) -> None:
        """Files with what they are taken for."""
        for name, entry in self.project.state["files"].items():
            self.file(name, entry)

    async def take(self, name: str, chunks: Any) -> None:
        """Take a dropped file."""
        await self.project.take_data(name, chunks)
        self.own()
        self.files.refresh()

    def bench(self, key: str, value: str) -> None:
        """State a pressure of the bench."""
        self.project.state["bench"][key] = value
        self.project.save()
        self.own()

    def file(self, name: str, entry: dict[str, Any]) -> None:
        """One file: what it is taken for, and what can be stated about it."""
        facts, taken = entry.get("facts") or {}, str((entry.get("facts") or {}).get("taken for", ""))
        is_map = "quantity" in taken or not taken

        def state(key: str, value: str, *, look: bool = False) -> Any:
            entry[key] = value
            self.project.save()
            self.own()
            return self.again(name) if look else None

        with ui.card().classes("box file").props(f'role="group" aria-label="{name}"'):
            with ui.row().classes("line"):
                ui.icon(
                    "error" if entry.get("reason") else "check_circle",
                    color="negative" if entry.get("reason") else "positive",
                )
                ui.label(name).classes("sub")
                ui.label(taken.partition(":")[0] if not entry.get("reason") else "not understood").classes("soft")
                ui.space()
                remove = ui.button(icon="delete", on_click=partial(self.remove, name))
                remove.props(f'flat dense round aria-label="Remove {name}"')
            if entry.get("reason"):
                trouble(entry["reason"])
            with ui.element("table").classes("facts"):
                for key, value in facts.items():
                    with ui.element("tr"):
                        with ui.element("th").props('scope="row"'):
                            ui.label(key)
                        with ui.element("td"):
                            ui.label(value if isinstance(value, str) else ", ".join(map(str, value)))
            with ui.element("div").classes("fields"):
                ui.select(ROLES, label="Role", value=entry["role"], on_change=lambda e: state("role", e.value)).props(
                    "dense outlined"
                )
                if is_map:
                    for key, words, hint in (
                        ("quantity-unit", "Quantity unit", "as in the file"),
                        ("pressure-unit", "Pressure unit", "as in the file"),
                        ("time-unit", "Time unit", "as in the file"),
                    ):
                        field(words, entry.get(key), partial(state, key, look=True), hint)
                if not is_map or entry.get("reason"):
                    for key, words, hint in (
                        ("rail_pressure", "Rail pressure", "by its name"),
                        ("energising_time", "Energising time", "by its name"),
                        ("time_zero", "Time zero", "0 us"),
                    ):
                        field(words, entry.get(key), partial(state, key), hint)
                    meters = {"": "as detected", "bench": "bench", "bench_2": "second meter", "none": "none"}
                    meter = entry.get("meter", "")
                    ui.select(meters, label="Meter", value=meter, on_change=lambda e: state("meter", e.value)).props(
                        "dense outlined"
                    )
                for key, words in (("cylinder_pressure", "Back pressure"), ("return_pressure", "Return pressure")):
                    field(words, entry.get(key), partial(state, key), facts.get(words.lower()) or "of the bench")
            with ui.expansion("How it is read").props("dense"), ui.element("div").classes("fields"):
                for key, words, hint in (
                    ("sheet", "Sheet", "first with cells"),
                    ("encoding", "Encoding", "detected"),
                    ("decimal", "Decimal sign", "detected"),
                ):
                    field(words, entry.get(key), partial(state, key, look=True), hint)

    def remove(self, name: str) -> None:
        """Remove a file."""
        self.project.remove(name)
        self.own()
        self.files.refresh()

    async def again(self, name: str) -> None:
        """Inspect a file again."""
        await self.project.inspect(name)
        self.own()
        self.files.refresh()

    # Injector

    async def injector(self) -> None:
        """Type, dimensions beside the section, and the data beside the model before any fit."""
        heading("Describe the injector")
        if not self.project.types:
            types = await self.project.run("catalogue", "injectors", "--json", logged=False)
            self.project.types = {
                row["name"]: f"{row['name']}: {row['title']}" for row in types.record.get("injectors", ())
            }
        base = self.project.state["injector"]
        with ui.element("div").classes("fields"):
            options = self.project.types | ({base: base} if base and base not in self.project.types else {})
            ui.select(
                options, label="Type", value=base or None, with_input=True, on_change=lambda e: self.choose(e.value)
            ).props("dense outlined")
            field("Part number", "", self.find, "0 445 110 191")
            ui.button("Pictures of all types", icon="photo_library", on_click=self.gallery).props("outline no-caps")
            upload("Or drop an injector file", self.take_injector, many=False, kinds=".toml")
        if not base:
            return
        answer = await self.ask(do="section", injector=str(self.project.folder / "injector.toml"))
        if "error" in answer:
            trouble(answer["error"])
            return
        with ui.element("div").classes("two"):
            with ui.card().classes("box picture"):
                ui.label(answer["title"]).classes("sub")
                ui.html(answer["picture"], sanitize=False)
            with ui.card().classes("box"):
                heading("Dimensions", 3)
                soft("State what you know, with its unit. What is measured stays; what is estimated may be fitted.")
                for words, rows in answer["groups"]:
                    with ui.expansion(words, value=any(r["mark"] == "M" for r in rows)).props("dense").classes("group"):
                        for row in rows:
                            self.dimension(row)
        with ui.row().classes("line"):
            words = "Prepare the study again" if self.project.study else "Prepare the study"
            ui.button(words, icon="playlist_add_check", on_click=self.prepare).props("no-caps")
            if self.project.study:
                ui.button("Next: calibrate", on_click=lambda: self.tabs.set_value("Calibrate")).props("no-caps")
        if self.project.study and self.project.state.get("open"):
            soft("No file tells these; state them:")
            with ui.element("div").classes("fields"):
                for key in self.project.state["open"]:
                    field(key.replace("_", " "), "", partial(self.answer, key), "with its unit, as 0.1 MPa")
        elif self.project.study:
            await self.before()

    def dimension(self, row: dict[str, Any]) -> None:
        """Value and mark of a dimension."""

        def save(value: str, mark: str) -> None:
            self.project.set_dimension(row["name"], value, mark)
            row.update(text=value, mark=mark)
            self.own()
            self.later()

        with ui.element("div").classes("dimension"):
            box = field(row["meaning"], row["text"], lambda v: save(v, "M"))
            box.props(f'aria-label="{row["meaning"]}"').tooltip(f"{row['name']}: {row['source']}")
            mark = ui.select(MARKS, value=row["mark"], label="Mark", on_change=lambda e: save(box.value, e.value))
            mark.props("dense outlined")

    def later(self) -> None:
        """Simulate again after a change, without building the page again."""
        ui.timer(0.01, self.move, once=True)

    async def choose(self, base: str) -> None:
        """Begin with a type of the catalogue."""
        if base and base != self.project.state["injector"]:
            self.project.edit_injector(lambda document: None, base)
            self.own()
            await self.turn("Injector")

    async def find(self, number: str) -> None:
        """Choose the type that names a part number."""
        outcome = await self.project.run("catalogue", "--search", number, "--json", logged=False)
        parts = outcome.record.get("parts", [])
        if not parts:
            say(outcome.message or f"The catalogue has no type for {number}.", bad=True)
            return
        say(parts[0]["reason"])
        await self.choose(parts[0]["injector"])

    async def gallery(self, event: Any) -> None:
        """Show all types of the catalogue with curves and figures."""
        outcome = await waiting(
            event.sender,
            self.project.run("catalogue", "injectors", "--report", "out/types.html", "--json", logged=False),
            "Drawing all types …",
        )
        if outcome.failed:
            say(outcome.message, bad=True)
            return
        with ui.dialog(value=True).props("full-width full-height"), ui.card():
            frame("out/types.html", "Types of the catalogue")

    async def take_injector(self, name: str, chunks: Any) -> None:
        """Take an injector file instead of a type."""
        written = await self.project.add_file(name, chunks, "out")
        place = self.project.folder / "out" / written
        answer = await self.ask(do="section", injector=str(place))
        if "error" in answer:
            say(answer["error"], bad=True)
            return
        shutil.copyfile(place, self.project.folder / "injector.toml")
        self.project.state["injector"] = written
        self.project.edit_injector(lambda document: None)
        self.own()
        await self.turn("Injector")

    async def prepare(self, event: Any) -> None:
        """Write the study."""
        outcome = await waiting(event.sender, self.project.new_study(), "Screening the parameters …")
        self.own()
        say(outcome.message or "The study is written.", bad=outcome.failed)
        self.values, self.shifts = {}, {}
        if not outcome.failed:
            await self.turn("Injector")

    async def answer(self, key: str, value: str) -> None:
        """State a value that no file tells."""
        self.project.state_open(key, value)
        await self.turn("Injector")

    async def before(self) -> None:
        """Measured beside simulated values before any fit, with sliders of delay and time zeros."""
        heading("Before any fit")
        answer = await self.ask_study()
        if "error" in answer:
            trouble(answer["error"])
            return
        soft("Set the delay of the meter and the time zeros so that the curves begin together.")
        for meter, delay in answer["meters"].items():
            self.slider(
                f"Delay of {meter}",
                delay * 1e6,
                (-200, 1000),
                partial(self.try_delay, meter),
                partial(self.set_delay, meter),
            )
        self.charts = {}
        with ui.element("div").classes("tiles"):
            for data in answer["data"]:
                with ui.element("div"):
                    self.tile(data, charts.START, self.charts)
                    if data["kind"] == "rate":
                        name = data["name"]
                        steps = partial(self.try_zero, name), partial(self.set_zero, name)
                        self.slider("Time zero, from the study's", 0.0, (-500, 500), *steps)

    async def ask(self, **request: Any) -> dict[str, Any]:
        """Answer of the process that simulates."""
        return await self.project.preview.ask(self.project.folder, **request)

    async def ask_study(self) -> dict[str, Any]:
        """Data of the latest study by the values of the sliders."""
        return await self.ask(do="study", path=str(self.project.study), values=self.values, shifts=self.shifts)

    def slider(
        self,
        words: str,
        value: float,
        ends: tuple[int, int],
        move: Callable[[float], Any],
        save: Callable[[float], Any],
    ) -> None:
        """Slider that simulates while it is moved and writes the study when it is released."""
        with ui.row().classes("line slider"):
            ui.label(f"{words}, µs")
            bar = ui.slider(min=ends[0], max=ends[1], step=5, value=round(value)).props(f'label aria-label="{words}"')

            async def moved() -> None:
                move(bar.value)
                await self.move()

            bar.on("update:model-value", moved, args=[], throttle=0.25, leading_events=False)
            bar.on("change", lambda: save(bar.value), args=[])
            ui.label().bind_text_from(bar, "value", lambda v: f"{v:.0f}").classes("number")

    async def move(self) -> None:
        """Simulate again and move the charts."""
        if not self.project.study:
            return
        answer = await self.ask_study()
        if "error" in answer:
            say(answer["error"], bad=True)
            return
        redraw(self.charts, answer["data"])

    def try_delay(self, meter: str, value: float) -> None:
        """Simulate with another delay of a meter."""
        self.values[f"meter.{meter}.delay"] = value * 1e-6

    def try_zero(self, name: str, value: float) -> None:
        """Simulate with another time zero of a curve."""
        self.shifts[name] = value * 1e-6

    def set_delay(self, meter: str, value: float) -> None:
        """Write the delay of a meter into the study, its bounds about it."""

        def change(document: Any) -> None:
            table = document["meters"][meter]
            if "lower" in (table.get("delay") if hasattr(table.get("delay"), "get") else {}):
                table["delay"].update(lower=f"{value - 200:g} us", upper=f"{value + 200:g} us", start=f"{value:g} us")
            else:
                table["delay"] = f"{value:g} us"

        self.project.edit_study(change)
        self.own()

    async def set_zero(self, name: str, value: float) -> None:
        """Shift the time zero of a curve in the study."""
        from commonrail.base.units import parse

        def change(document: Any) -> None:
            block = next(b for b in document["data"] if b["name"] == name or name.startswith(f"{b['name']}, "))
            block["time_zero"] = f"{parse(str(block.get('time_zero', '0 us')), 's', 'time_zero') * 1e6 + value:g} us"

        self.project.edit_study(change)
        self.shifts.pop(name, None)
        self.own()
        await self.turn("Injector")

    def tile(self, data: dict[str, Any], colour: str, charts_by_name: dict[str, Any]) -> None:
        """Chart of a data set, under its name and error."""
        with ui.card().classes("box tile"):
            with ui.row().classes("line"):
                ui.label(data["name"]).classes("sub")
                ui.space()
                words = ui.label(charts.summary(data)).classes("soft")
            drawn: list[Any] = [(words, charts.summary)]
            if data["kind"] == "rate":
                drawn.append((chart(charts.curve(data, colour)), lambda d: charts.curve(d, colour)))
            elif data["rows"]:
                drawn.append((chart(charts.errors(data)), charts.errors))
                drawn.append((chart(charts.quantities(data)), charts.quantities))
            charts_by_name[data["name"]] = drawn

    # Calibrate

    async def calibrate(self) -> None:
        """Parameters with ticks, bounds and priors; the search, its course, and the fit before and after."""
        heading("Calibrate")
        self.live = {}
        if not self.project.study:
            soft("First bring data, choose an injector and prepare the study.")
            return
        answer = await self.ask(do="parameters", path=str(self.project.study))
        with ui.row().classes("line"):
            document = self.project.read_study()
            effort = next(
                (k for k, v in EFFORTS.items() if v["members"] == document.get("optimiser", {}).get("members")), None
            )
            ui.toggle({k: k for k in EFFORTS}, value=effort, on_change=lambda e: self.set_effort(e.value)).props(
                'no-caps aria-label="Effort of the search"'
            )
            self.start = ui.button("Start", icon="play_arrow", on_click=self.begin).props("no-caps")
            self.halt = ui.button("Stop", icon="stop", on_click=self.end).props("no-caps outline")
            self.resume = ui.button("Continue", icon="replay", on_click=self.go_on).props("no-caps outline")
            undo = ui.button("Undo", icon="undo", on_click=self.undo).props("no-caps outline")
            undo.tooltip("Take back the latest change of the study")
        if "error" in answer:
            trouble(answer["error"])
            return
        self.status = ui.label("").classes("sub").props('role="status" aria-live="polite"')
        self.note = ui.label("").classes("soft")
        self.area = ui.element("div")
        title = f"Parameters: {len(answer['rows'])} free, best seen first"
        with ui.expansion(title, value=not self.project.runs).classes("box").props("dense"):
            counts = {n: f"the best {n}" for n in (2, 4, 6, 8) if n < len(document["parameter"])}
            if counts:
                best = ui.select(counts, label="Free only", on_change=lambda e: self.keep(e.value))
                best.props("dense outlined").classes("few")
            for row in answer["rows"]:
                self.parameter(row, document)
            for name, table in self.project.state["unticked"].items():
                with ui.row().classes("line"):
                    ui.checkbox(name, value=False, on_change=partial(self.tick, name, table, True))
                    ui.label(answer["meaning"].get(name, "")).classes("soft")
            free = {row["name"] for row in answer["rows"]} | set(self.project.state["unticked"])
            others = {n: f"{n}: {answer['meaning'][n]}" for n in answer["usual"] if n not in free}
            ui.select(
                others,
                label="Free another parameter",
                with_input=True,
                on_change=lambda e: self.tick(
                    e.value, dict(zip(("lower", "upper"), answer["usual"][e.value], strict=True)), True
                ),
            ).props("dense outlined").classes("wide")
        await self.look()

    def parameter(self, row: dict[str, Any], document: Any) -> None:
        """A free parameter: tick, bounds and prior."""
        name, table = row["name"], _table(document, row["name"])
        with ui.element("div").classes("parameter").props(f'role="group" aria-label="{name}"'):
            tick = ui.checkbox(name, value=True, on_change=partial(self.tick, name, _plain(table), False))
            tick.tooltip(row["meaning"])
            if name.startswith("meter."):
                tick.disable()
            width = row["most"] - row["least"]
            at = [round(STEP * (row[k] - row["least"]) / width) if width else 0 for k in ("lower", "upper")]
            bar = ui.range(min=0, max=STEP, value={"min": at[0], "max": at[1]}).props(
                f'dense aria-label="Bounds of {name}"'
            )
            low = field("lower", table.get("lower", ""), lambda v: self.set_key(name, "lower", v))
            high = field("upper", table.get("upper", ""), lambda v: self.set_key(name, "upper", v))

            async def dragged() -> None:
                ends = [row["least"] + width * bar.value[k] / STEP for k in ("min", "max")]
                texts = (await self.ask(do="text", values=ends, unit=row["unit"]))["texts"]
                low.value, high.value = texts
                self.set_key(name, "lower", texts[0], upper=texts[1])

            bar.on("change", dragged, args=[])
            prior = table.get("prior", {})
            if not name.startswith("meter."):
                field("prior", prior.get("value", ""), lambda v: self.set_prior(name, "value", v), "none")
                field("its sigma", prior.get("sigma", ""), lambda v: self.set_prior(name, "sigma", v), "none")

    def set_key(self, name: str, key: str, value: str, **more: str) -> None:
        """Write a bound of a parameter."""
        self.project.edit_study(lambda document: _table(document, name).update({key: value, **more}))
        self.own()

    def set_prior(self, name: str, key: str, value: str) -> None:
        """Write a prior, or remove it with an empty text; it is written once both of its values are stated."""
        state = self.project.state.setdefault("priors", {}).setdefault(name, {})

        def change(document: Any) -> None:
            import tomlkit

            table = _table(document, name)
            prior = (
                {k: str(v) for k, v in table.pop("prior", {}).items()}
                | state
                | {key: value, "source": "stated in commonrail app"}
            )
            state.update({key: value})
            if prior.get("value") and prior.get("sigma"):
                table["prior"] = tomlkit.inline_table()
                table["prior"].update(prior)

        self.project.edit_study(change)
        self.own()

    async def tick(self, name: str, table: dict[str, Any], on: bool) -> None:
        """Free a parameter, or hold it at its value."""
        unticked = self.project.state["unticked"]

        def change(document: Any) -> None:
            if on:
                document["parameter"].append({"name": name, **{k: v for k, v in table.items() if k != "name"}})
            else:
                document["parameter"].remove(_table(document, name))

        self.project.edit_study(change)
        unticked.pop(name, None) if on else unticked.update({name: table})
        self.project.save()
        self.own()
        await self.turn("Calibrate")

    async def keep(self, count: int) -> None:
        """Hold all parameters but those that the data see best."""
        tables = [_plain(table) for table in self.project.read_study()["parameter"][count:]]
        self.project.edit_study(lambda document: document["parameter"].__delitem__(slice(count, None)))
        self.project.state["unticked"].update({table["name"]: table for table in tables})
        await self.turn("Calibrate")

    def set_effort(self, effort: str) -> None:
        """Write how large the search is."""
        table = {"method": "staged least squares", **EFFORTS[effort]}
        self.project.edit_study(lambda document: document.__setitem__("optimiser", table))
        self.own()

    async def undo(self) -> None:
        """Take back the latest change of the study."""
        if self.project.undo():
            self.own()
            await self.turn("Calibrate")
        else:
            say("There is nothing to take back.")

    async def begin(self) -> None:
        """Start a calibration."""
        if self.live.get("state") == "running":
            say("A calibration is running; stop it first.", bad=True)
            return
        self.shown = self.project.start_fit()
        self.own()

    def end(self) -> None:
        """Stop the calibration."""
        if self.live.get("process"):
            self.project.stop(self.live["process"])
            say("The search stops; the best values so far are written.")

    def go_on(self) -> None:
        """Continue the latest run."""
        if self.project.runs:
            self.project.start_fit(self.project.runs[0])
            self.own()

    async def look(self) -> None:
        """Show the state of the latest run."""
        if not self.project.study or not hasattr(self, "status") or self.status.is_deleted:
            return
        latest = self.project.latest_log()[0] or next((run.name for run in self.project.runs), "")
        answer = await self.ask(do="runs", place=str(self.project.folder / "runs"))
        run = next((run for run in answer.get("runs", ()) if run["name"] == latest), None)
        said = self.project.said(latest)
        self.note.text = said
        if run is None:
            self.status.text = f"{latest}: starting …" if latest else "No calibration yet."
            self.live = {}
        else:
            steps = f"step {run['generation']} of {run['generations']}" if run["generations"] else ""
            best = f"J {run['best']:.5g}" if run["best"] is not None else ""
            self.status.text = " · ".join(filter(None, (latest, run["state"], steps, best)))
            done = (run["generation"], run["refinements"], run["state"], latest)
            if self.live.get("done") != done:
                more = await self.ask(do="run", place=str(self.project.folder / "runs" / latest))
                self.live = {
                    "state": run["state"],
                    "done": done,
                    "process": more.get("process"),
                    "drawn": self.live.get("drawn"),
                }
                self.draw(more)
        running = self.live.get("state") == "running"
        self.start.set_enabled(not running)
        self.halt.set_enabled(running)
        self.resume.set_enabled(self.live.get("state") in ("stopped", "interrupted", "failed"))

    def draw(self, answer: dict[str, Any]) -> None:
        """Draw the course of a run, and the fit before and after."""
        if "error" in answer:
            self.note.text = answer["error"]
            return
        drawn = self.live["drawn"]
        key = [data["name"] for data in answer["after"]]
        if drawn is None or drawn["key"] != key:
            self.area.clear()
            drawn = self.live["drawn"] = {"key": key, "after": {}}
            with self.area:
                drawn["course"] = chart(charts.course(answer["course"]))
                with ui.element("div").classes("two"):
                    ui.label("Before").classes("sub")
                    ui.label("After").classes("sub wide-only")
                    for start, best in zip(answer["before"], answer["after"], strict=True):
                        self.tile(start, charts.START, {})
                        self.tile(best, charts.BEST, drawn["after"])
        else:
            update(drawn["course"], charts.course(answer["course"]))
            redraw(drawn["after"], answer["after"])

    # Result

    async def result(self) -> None:
        """Report of a run, new data, and files to take away."""
        heading("Judge and take away")
        names = [run.name for run in self.project.runs if (run / "report.html").is_file()]
        if not names:
            soft("No calibration has ended yet.")
            return
        if self.shown not in names:
            self.shown = names[0]
        run = self.shown
        with ui.row().classes("line"):
            ui.select(names, label="Run", value=run, on_change=lambda e: self.show(e.value)).props("dense outlined")
            ui.link("Open the report", f"/file/runs/{run}/report.html", new_tab=True)
        frame(f"runs/{run}/report.html", f"Report of {run}")
        with ui.element("div").classes("two"):
            with ui.card().classes("box"):
                heading("Take away", 3)
                with ui.element("div").classes("buttons"):
                    for words, ending in MAPS.items():
                        self.button(words, partial(self.export_map, run, ending))
                    self.button("FMU", lambda: self.export(run, "fmu", f"out/{run}.fmu"))
                    self.button("C", lambda: self.export(run, "library", f"out/{run}-c"))
                    self.button("Report", lambda: f"runs/{run}/report.html")
                    self.button("Study", lambda: f"runs/{run}/study.toml")
                    self.button("Injector", lambda: f"runs/{run}/calibrated.toml")
                    self.button("Commands", lambda: COMMANDS)
                with ui.expansion("The same by the command line").props("dense"):
                    place = self.project.folder / COMMANDS
                    ui.code(place.read_text("utf-8") if place.is_file() else "", language="bash").classes("wide")
            with ui.card().classes("box"):
                heading("Update with new data", 3)
                soft("The new data are judged by the bands of this run first; then all data are fitted together.")
                upload("Drop new data here", lambda n, c: self.update(run, n, c), many=False)

    async def show(self, run: str) -> None:
        """Show another run."""
        self.shown = run
        await self.turn("Result")

    def button(self, words: str, make: Callable[[], Any]) -> None:
        """Button that makes a file and downloads it."""

        async def press() -> None:
            path = await waiting(button, finish_later(make), f"Writing {words} …")
            if isinstance(path, Outcome):
                say(path.message, bad=True)
            else:
                ui.download.from_url(f"/file/{path}?save=1", Path(path).name)

        button = ui.button(words, icon="download", on_click=press).props("no-caps outline")

    async def export_map(self, run: str, ending: str) -> str | Outcome:
        """Map of a run in the formats of control units."""
        files = [f"out/{run}.{ending}" for ending in MAPS.values()]
        if not self.is_fresh(run, files[0]):
            named = [text for file in files for text in ("--out", file)]
            outcome = await self.project.run("map", f"runs/{run}", *named, "--json")
            if outcome.failed:
                return outcome
        return f"out/{run}.{ending}"

    async def export(self, run: str, form: str, path: str) -> str | Outcome:
        """FMU, or C library as an archive."""
        archive = f"{path}.zip" if form == "library" else path
        if not self.is_fresh(run, archive):
            shutil.rmtree(self.project.folder / path, ignore_errors=True)
            outcome = await self.project.run("export", form, f"runs/{run}", "--out", path, "--json")
            if outcome.failed:
                return outcome
            if form == "library":
                place = str(self.project.folder / path)
                await asyncio.to_thread(shutil.make_archive, place, "zip", place)
        return archive

    def is_fresh(self, run: str, path: str) -> bool:
        """Return whether a file was made after the result of a run."""
        place, record = self.project.folder / path, self.project.folder / "runs" / run / "result.json"
        return place.is_file() and place.stat().st_mtime > record.stat().st_mtime

    async def update(self, run: str, name: str, chunks: Any) -> None:
        """Judge new data by a run and fit all data together."""
        written = await self.project.take_data(name, chunks)
        if self.project.state["files"][written]["reason"]:
            say(self.project.state["files"][written]["reason"], bad=True)
            return
        self.shown = self.project.start_update(run, written)
        self.own()
        self.tabs.set_value("Calibrate")


async def finish_later(make: Callable[[], Any]) -> Any:
    """Result of a function that may be asynchronous, called here."""
    return await finish(make())


def frame(path: str, words: str) -> None:
    """A report within the page; its scripts run apart from it."""
    ui.element("iframe").props(f'src="/file/{path}" title="{words}" sandbox="allow-scripts"').classes("report")


def chart(options: dict[str, Any]) -> ui.echart:
    """Chart that says in words what it shows."""
    element = ui.echart(options, renderer="svg").classes("chart")
    return element.props(f'role="img" aria-label="{options["aria"]["label"]["description"]}"')


def update(element: Any, options: dict[str, Any]) -> None:
    """Give a chart other options."""
    element.options.clear()
    element.options.update(options)
    element.update()


def redraw(drawn: dict[str, Any], sets: list[dict[str, Any]]) -> None:
    """Give charts and captions of data sets their new values."""
    for data in sets:
        for element, make in drawn.get(data["name"], ()):
            if isinstance(element, ui.label):
                element.text = make(data)
            else:
                update(element, make(data))


def _table(document: Any, name: str) -> Any:
    """Table of a free parameter in a study, of a meter's too."""
    if name.startswith("meter."):
        _, meter, key = name.split(".")
        return document["meters"][meter][key]
    return next(table for table in document["parameter"] if table["name"] == name)


def _plain(table: Any) -> dict[str, Any]:
    return dict(table.unwrap() if hasattr(table, "unwrap") else table)
