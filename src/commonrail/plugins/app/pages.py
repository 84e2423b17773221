"""Page of the four steps: data, injector, calibration and result; the page for workshops is in `workshop`."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.input import read_plain
from commonrail.base.units import parse, to_text
from commonrail.plugins.app import charts
from commonrail.plugins.app.elements import (
    chart,
    field,
    finish,
    frame,
    header,
    heading,
    redraw,
    say,
    select,
    soft,
    trouble,
    update,
    upload,
    waiting,
)
from commonrail.plugins.app.project import COMMANDS, EFFORTS, Project

STEPS = ("Data", "Injector", "Calibrate", "Result")
ROLES = {"fit": "fit", "validation": "held out", "unused": "not used"}
MARKS = {"M": "measured", "E": "estimated", "C": "control unit", "F": "fitted"}
PERIOD = 1.5  # between looks at the runs [s]
MAPS = {"DCM": "dcm", "CDFX": "cdfx", "TunerStudio": "table"}
METERS = {"": "as detected", "bench": "bench", "bench_2": "second meter", "none": "none"}
# What can be stated about a file: key, words, hint, and the kind of file.
FIELDS = (
    ("rail_pressure", "Rail pressure", "by its name", "curve"),
    ("energising_time", "Energising time", "by its name", "curve"),
    ("time_zero", "Time zero", "0 us", "curve"),
    ("quantity-unit", "Quantity unit", "as in the file", "map"),
    ("pressure-unit", "Pressure unit", "as in the file", "map"),
    ("time-unit", "Time unit", "as in the file", "map"),
    ("cylinder_pressure", "Cylinder pressure", "of the bench", "both"),
    ("return_pressure", "Return pressure", "of the bench", "both"),
    ("sheet", "Sheet", "first with cells", "both"),
    ("encoding", "Encoding", "detected", "both"),
    ("decimal", "Decimal sign", "detected", "both"),
)
READING = ("quantity-unit", "pressure-unit", "time-unit", "sheet", "encoding", "decimal")  # inspect again
STEP = 200  # of a slider between usual limits


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

    async def turn(self, step: str) -> None:
        """Show a step with the present files."""
        self.step, self.seen = step, self.project.version
        for panel in self.panels.values():
            panel.clear()
        with self.panels[step]:
            try:
                await finish(getattr(self, step.lower())())
            except CommonrailError as error:
                trouble(str(error))

    async def follow(self) -> None:
        """Show changes of other windows and the course of a run."""
        changed, self.seen = self.seen != self.project.version, self.project.version
        if changed and self.project.author != ui.context.client.id:
            await self.turn(self.step)
        elif self.step == "Calibrate":
            await self.look()

    # Data

    def data(self) -> None:
        """Place to drop files, the files, and the pressures of the bench."""
        heading("Bring data")
        soft("Injection curves and quantity maps as the bench wrote them: CSV, Excel, MDF, TDMS, MAT, DCM …")
        upload("Drop data files here, or press +", self._take)
        self.files()
        with ui.card().classes("box"):
            heading("The bench", 3)
            with ui.element("div").classes("fields"):
                for key, words, hint in (
                    ("cylinder-pressure", "Back pressure behind the nozzle", "0.5 MPa, where no file tells it"),
                    ("return-pressure", "Pressure at the end of the return line", "0.1 MPa, where no file tells it"),
                ):
                    field(words, self.project.state["bench"].get(key), partial(self._bench, key), hint)
        ui.button("Next: the injector", on_click=lambda: self.tabs.set_value("Injector")).props("no-caps")

    @ui.refreshable_method
    def files(self) -> None:
        """Files with their roles and interpretation."""
        for name, entry in self.project.state["files"].items():
            self.file(name, entry)

    async def _take(self, name: str, chunks: Any) -> None:
        await self.project.take_data(name, chunks)
        self.files.refresh()

    def _bench(self, key: str, value: str) -> None:
        self.project.state["bench"][key] = value
        self.project.save()

    def file(self, name: str, entry: dict[str, Any]) -> None:
        """One file: how it was read, and the fields to complete."""
        facts, taken = entry.get("facts") or {}, str((entry.get("facts") or {}).get("taken for", ""))
        is_map = "quantity" in taken or not taken

        async def state(key: str, value: str) -> None:
            entry[key] = value
            self.project.save()
            if key in READING:
                await self.project.inspect(name)
                self.files.refresh()

        with ui.card().classes("box file").props(f'role="group" aria-label="{name}"'):
            with ui.row().classes("line"):
                ui.icon(
                    "error" if entry.get("reason") else "check_circle",
                    color="negative" if entry.get("reason") else "positive",
                )
                ui.label(name).classes("sub")
                ui.label(taken.partition(":")[0] if not entry.get("reason") else "not understood").classes("soft")
                ui.space()
                remove = ui.button(icon="delete", on_click=partial(self._remove, name))
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
                select("Role", ROLES, entry["role"], partial(state, "role"))
                if not is_map:
                    select("Meter", METERS, entry.get("meter", ""), partial(state, "meter"))
                for key, words, hint, kind in FIELDS:
                    if kind in ("both", "map" if is_map else "curve"):
                        field(words, entry.get(key), partial(state, key), facts.get(words.lower()) or hint)

    def _remove(self, name: str) -> None:
        self.project.remove(name)
        self.files.refresh()

    # Injector

    async def injector(self) -> None:
        """Show the type, the dimensions next to the section, and data with the unfitted model."""
        heading("Describe the injector")
        if not self.project.types:
            types = (await self.project.run("catalogue", "injectors", "--json", logged=False))["injectors"]
            self.project.types = {row["name"]: f"{row['name']}: {row['title']}" for row in types}
        base = self.project.state["injector"]
        with ui.element("div").classes("fields"):
            options = self.project.types | ({base: base} if base and base not in self.project.types else {})
            select("Type", options, base or None, self._choose, search=True)
            field("Part number", "", self.find, "0 445 110 191")
            ui.button("Pictures of all types", icon="photo_library", on_click=self.gallery).props("outline no-caps")
            upload("Or drop an injector file", self.take_injector, many=False, kinds=".toml")
        if not base:
            return
        answer = await self._ask(do="section", injector=str(self.project.folder / "injector.toml"))
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
            ui.button(words, icon="playlist_add_check", on_click=self._prepare).props("no-caps")
            if self.project.study:
                ui.button("Next: calibrate", on_click=lambda: self.tabs.set_value("Calibrate")).props("no-caps")
        if self.project.study and self.project.state.get("open"):
            soft("No file tells these; state them:")
            with ui.element("div").classes("fields"):
                for key in self.project.state["open"]:
                    field(key.replace("_", " "), "", partial(self._answer, key), "with its unit, as 0.1 MPa")
        elif self.project.study:
            await self.before()

    def dimension(self, row: dict[str, Any]) -> None:
        """Value and mark of a dimension."""

        async def save(value: str, mark: str) -> None:
            self.project.set_dimension(row["name"], value, mark)
            row.update(text=value, mark=mark)
            await self.move()

        with ui.element("div").classes("dimension"):
            box = field(row["meaning"], row["text"], lambda value: save(value, "M"))
            box.props(f'aria-label="{row["meaning"]}"').tooltip(f"{row['name']}: {row['source']}")
            select("Mark", MARKS, row["mark"], lambda mark: save(box.value, mark))

    async def _choose(self, base: str) -> None:
        if base and base != self.project.state["injector"]:
            self.project.edit_injector(lambda document: None, base)
            await self.turn("Injector")

    async def find(self, number: str) -> None:
        """Choose the type that names a part number."""
        parts = (await self.project.run("catalogue", "--search", number, "--json", logged=False))["parts"]
        if not parts:
            raise InputError(f"The catalogue has no type for {number}; choose one by its name.")
        say(parts[0]["reason"])
        await self._choose(parts[0]["injector"])

    async def gallery(self, event: Any) -> None:
        """Show all types of the catalogue with curves and figures."""
        command = "catalogue", "injectors", "--report", "out/types.html", "--json"
        work = partial(self.project.run, *command, logged=False)
        if await waiting(event.sender, work, "Drawing all types …"):
            with ui.dialog(value=True).props("full-width full-height"), ui.card():
                frame("out/types.html", "Types of the catalogue")

    async def take_injector(self, name: str, chunks: Any) -> None:
        """Take an injector file instead of a type."""
        written = await self.project.add_file(name, chunks, "out")
        place = self.project.folder / "out" / written
        await self._ask(do="section", injector=str(place))  # refuses what is not an injector
        shutil.copyfile(place, self.project.folder / "injector.toml")
        self.project.state["injector"] = written
        self.project.edit_injector(lambda document: None)
        await self.turn("Injector")

    async def _prepare(self, event: Any) -> None:
        before = self.project.study
        await waiting(event.sender, self.project.new_study, "Screening the parameters …")
        if self.project.study != before:
            self.values, self.shifts = {}, {}
            await self.turn("Injector")

    async def _answer(self, key: str, value: str) -> None:
        self.project.state_open(key, value)
        await self.turn("Injector")

    async def before(self) -> None:
        """Measured and simulated values before any fit, with sliders of delay and time zeros."""
        heading("Before any fit")
        answer = await self._ask_study()
        soft("Set the delay of the meter and the time zeros so that the curves begin together.")
        for meter, delay in answer["meters"].items():
            key = f"meter.{meter}.delay"
            self.slider(f"Delay of {meter}", delay * 1e6, self.values, key, partial(self.set_delay, meter))
        self.charts = {}
        with ui.element("div").classes("tiles"):
            for data in answer["data"]:
                with ui.element("div"):
                    self.tile(data, charts.START, self.charts)
                    if data["kind"] == "rate":
                        save = partial(self.set_zero, data["name"])
                        self.slider("Time zero, from the study's", 0.0, self.shifts, data["name"], save)

    async def _ask(self, **request: Any) -> dict[str, Any]:
        return await self.project.preview.ask(self.project.folder, **request)

    async def _ask_study(self) -> dict[str, Any]:
        return await self._ask(do="study", path=str(self.project.study), values=self.values, shifts=self.shifts)

    def slider(self, words: str, value: float, tried: dict[str, float], key: str, save: Callable[[float], Any]) -> None:
        """Slider that simulates while it is moved and writes the study when it is released."""
        with ui.row().classes("line slider"):
            ui.label(f"{words}, µs")
            bar = ui.slider(min=-500, max=1000, step=5, value=round(value)).props(f'label aria-label="{words}"')

            async def moved() -> None:
                tried[key] = bar.value * 1e-6
                await self.move()

            bar.on("update:model-value", moved, args=[], throttle=0.25, leading_events=False)
            bar.on("change", lambda: save(bar.value), args=[])
            ui.label().bind_text_from(bar, "value", lambda v: f"{v:.0f}").classes("number")

    async def move(self) -> None:
        """Simulate again and move the charts."""
        if self.project.study and self.charts:
            redraw(self.charts, (await self._ask_study())["data"])

    def set_delay(self, meter: str, value: float) -> None:
        """Write the delay of a meter into the study, with bounds around it."""

        def change(document: Any) -> None:
            table = document["meters"][meter]
            if isinstance(table.get("delay"), dict):
                table["delay"].update(lower=f"{value - 200:g} us", upper=f"{value + 200:g} us", start=f"{value:g} us")
            else:
                table["delay"] = f"{value:g} us"

        self.project.edit_study(change)

    async def set_zero(self, name: str, value: float) -> None:
        """Shift the time zero of a curve in the study."""

        def change(document: Any) -> None:
            block = next(b for b in document["data"] if b["name"] == name or name.startswith(f"{b['name']}, "))
            block["time_zero"] = f"{parse(str(block.get('time_zero', '0 us')), 's', 'time_zero') * 1e6 + value:g} us"

        self.project.edit_study(change)
        self.shifts.pop(name, None)
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
        answer = await self._ask(do="parameters", path=str(self.project.study))
        with ui.row().classes("line"):
            document = self.project.read_study()
            size = document.get("optimiser", {}).get("members")
            effort = next((name for name, table in EFFORTS.items() if table["members"] == size), None)
            turn = ui.toggle({k: k for k in EFFORTS}, value=effort, on_change=lambda e: self._set_effort(e.value))
            turn.props('no-caps aria-label="Effort of the search"')
            self.start = ui.button("Start", icon="play_arrow", on_click=self._begin).props("no-caps")
            self.halt = ui.button("Stop", icon="stop", on_click=self._end).props("no-caps outline")
            self.resume = ui.button("Continue", icon="replay", on_click=self._go_on).props("no-caps outline")
            undo = ui.button("Undo", icon="undo", on_click=self._undo).props("no-caps outline")
            undo.tooltip("Take back the latest change of the study")
        self.status = ui.label("").classes("sub").props('role="status" aria-live="polite"')
        self.note = ui.label("").classes("soft")
        self.area = ui.element("div")
        title = f"Parameters: {len(answer['rows'])} free, best seen first"
        with ui.expansion(title, value=not self.project.runs).classes("box").props("dense"):
            counts = {n: f"the best {n}" for n in (2, 4, 6, 8) if n < len(document["parameter"])}
            if counts:
                select("Free only", counts, None, self._keep).classes("few")
            for row in answer["rows"]:
                self.parameter(row, document)
            for name, table in self.project.state["unticked"].items():
                with ui.row().classes("line"):
                    ui.checkbox(name, value=False, on_change=partial(self.tick, name, table, True))
                    ui.label(answer["meaning"].get(name, "")).classes("soft")
            free = {row["name"] for row in answer["rows"]} | set(self.project.state["unticked"])
            others = {n: f"{n}: {answer['meaning'][n]}" for n in answer["usual"] if n not in free}
            select("Free another parameter", others, None, partial(self._free, answer["usual"]), search=True)
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
            low = field("lower", table.get("lower", ""), lambda v: self._set_key(name, "lower", v))
            high = field("upper", table.get("upper", ""), lambda v: self._set_key(name, "upper", v))

            def take_dragged_bounds() -> None:
                ends = [row["least"] + width * bar.value[k] / STEP for k in ("min", "max")]
                low.value, high.value = (to_text(end, row["unit"], 4) for end in ends)
                self._set_key(name, "lower", low.value, upper=high.value)

            bar.on("change", take_dragged_bounds, args=[])
            if not name.startswith("meter."):
                prior = table.get("prior", {})
                text = f"{prior['value']} ± {prior['sigma']}" if "value" in prior else ""
                field("prior", text, partial(self.set_prior, name), "4 mm ± 0.1 mm")

    def _set_key(self, name: str, key: str, value: str, **more: str) -> None:
        self.project.edit_study(lambda document: _table(document, name).update({key: value, **more}))

    def set_prior(self, name: str, text: str) -> None:
        """Write a prior, a value and its standard deviation; an empty text removes it."""
        import tomlkit

        value, sign, sigma = (piece.strip() for piece in text.replace("+-", "±").partition("±"))
        if text and not (value and sigma):
            raise InputError(f"A prior is a value and its standard deviation, as in 4 mm ± 0.1 mm, not {text}.")
        prior = tomlkit.inline_table()
        prior.update({"value": value, "sigma": sigma, "source": "stated in commonrail app"})

        def change(document: Any) -> None:
            table = _table(document, name)
            table.pop("prior", None)
            table.update({"prior": prior} if sign else {})

        self.project.edit_study(change)

    async def _free(self, usual: dict[str, list[str]], name: str) -> None:
        await self.tick(name, dict(zip(("lower", "upper"), usual[name], strict=True)), True)

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
        await self.turn("Calibrate")

    async def _keep(self, count: int) -> None:
        tables = [_plain(table) for table in self.project.read_study()["parameter"][count:]]
        self.project.edit_study(lambda document: document["parameter"].__delitem__(slice(count, None)))
        self.project.state["unticked"].update({table["name"]: table for table in tables})
        await self.turn("Calibrate")

    def _set_effort(self, effort: str) -> None:
        table = {"method": "staged least squares", **EFFORTS[effort]}
        self.project.edit_study(lambda document: document.__setitem__("optimiser", table))

    async def _undo(self) -> None:
        if self.project.undo():
            await self.turn("Calibrate")
        else:
            say("There is nothing to take back.")

    async def _begin(self) -> None:
        self.shown = self.project.start_fit()

    async def _end(self) -> None:
        place = str(self.project.folder / "runs" / self.project.latest())
        process = (await self._ask(do="run", place=place))["process"]  # that of the latest session
        if process:
            self.project.stop(process)
            say("The search stops; the best values so far are written.")

    def _go_on(self) -> None:
        if self.project.runs:
            self.project.start_fit(self.project.runs[0])

    async def look(self) -> None:
        """Show the state of the latest run."""
        if not self.project.study or not hasattr(self, "status") or self.status.is_deleted:
            return
        latest, drawn = self.project.latest(), self.live.get("drawn")
        self.note.text = self.project.said(latest)
        runs = (await self._ask(do="runs", place=str(self.project.folder / "runs")))["runs"]
        run = next((run for run in runs if run["name"] == latest), {"state": ""})
        if not run["state"]:
            self.status.text = f"{latest}: starting …" if latest else "No calibration yet."
        else:
            steps = f"step {run['generation']} of {run['generations']}" if run["generations"] else ""
            best = f"J {run['best']:.5g}" if run["best"] is not None else ""
            self.status.text = " · ".join(filter(None, (latest, run["state"], steps, best)))
            done = (run["generation"], run["refinements"], run["state"], latest)
            if self.live.get("done") != done:
                more = await self._ask(do="run", place=str(self.project.folder / "runs" / latest))
                self.live = {"done": done, "drawn": self.draw(more, drawn)}
        self.live["state"] = run["state"]
        self.start.set_enabled(run["state"] != "running")
        self.halt.set_enabled(run["state"] == "running")
        self.resume.set_enabled(run["state"] in ("stopped", "interrupted", "failed"))

    def draw(self, answer: dict[str, Any], drawn: Any) -> Any:
        """Draw the progress of a run and the fit before and after; charts of the same data are updated."""
        key = [data["name"] for data in answer["after"]]
        if drawn and drawn["key"] == key:
            update(drawn["course"], charts.course(answer["course"]))
            redraw(drawn["after"], answer["after"])
            return drawn
        self.area.clear()
        after: dict[str, Any] = {}
        with self.area:
            course = chart(charts.course(answer["course"]))
            with ui.element("div").classes("two"):
                ui.label("Before").classes("sub")
                ui.label("After").classes("sub wide-only")
                for start, best in zip(answer["before"], answer["after"], strict=True):
                    self.tile(start, charts.START, {})
                    self.tile(best, charts.BEST, after)
        return {"key": key, "course": course, "after": after}

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
            select("Run", names, run, self._show)
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
                    text = read_plain(place).decode() if place.is_file() else ""
                    ui.code(text, language="bash").classes("wide")
            with ui.card().classes("box"):
                heading("Update with new data", 3)
                soft("The new data are judged by the bands of this run first; then all data are fitted together.")
                upload("Drop new data here", lambda n, c: self.update(run, n, c), many=False)

    async def _show(self, run: str) -> None:
        self.shown = run
        await self.turn("Result")

    def button(self, words: str, make: Callable[[], Any]) -> None:
        """Button that makes a file and downloads it."""

        async def work() -> Any:
            async with self.project.busy:  # one after the other: they share files
                return await finish(make())

        async def press() -> None:
            path = await waiting(button, work, f"Writing {words} …")
            if path:
                ui.download.from_url(f"/file/{path}?save=1", Path(path).name)

        button = ui.button(words, icon="download", on_click=press).props("no-caps outline")

    async def export_map(self, run: str, ending: str) -> str:
        """Map of a run in the formats of control units."""
        files = [f"out/{run}.{ending}" for ending in MAPS.values()]
        if not self.is_fresh(run, files[0]):
            out_options = [text for file in files for text in ("--out", file)]
            await self.project.run("map", f"runs/{run}", "--bands", "none", *out_options, "--json")
        return f"out/{run}.{ending}"

    async def export(self, run: str, form: str, path: str) -> str:
        """FMU, or C library as an archive."""
        archive = f"{path}.zip" if form == "library" else path
        if not self.is_fresh(run, archive):
            shutil.rmtree(self.project.folder / path, ignore_errors=True)
            await self.project.run("export", form, f"runs/{run}", "--out", path, "--json")
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
        if reason := self.project.state["files"][written]["reason"]:
            raise InputError(reason)
        self.shown = self.project.start_update(run, written)
        self.tabs.set_value("Calibrate")


def _table(document: Any, name: str) -> Any:
    """Table of a free parameter in a study, of the injector or of a meter."""
    if name.startswith("meter."):
        _, meter, key = name.split(".")
        return document["meters"][meter][key]
    return next(table for table in document["parameter"] if table["name"] == name)


def _plain(table: Any) -> dict[str, Any]:
    return dict(table.unwrap() if hasattr(table, "unwrap") else table)
