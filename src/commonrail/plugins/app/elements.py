"""Elements that the pages share: headings, fields, places to drop files, charts and frames."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

from nicegui import ui

from commonrail.base.errors import CommonrailError
from commonrail.base.input import LARGEST_FILE


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


def field(label: str, value: Any, save: Callable[[str], Any], hint: str = "") -> ui.input:
    """Field of a text, saved when it is left or Enter is pressed."""
    box = ui.input(label, value=str(value or ""), placeholder=hint).props("dense outlined stack-label")
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


def select(label: str, options: Any, value: Any, save: Callable[[Any], Any], *, search: bool = False) -> ui.select:
    """Choice that is saved at once."""

    async def done(event: Any) -> None:
        try:
            await finish(save(event.value))
        except CommonrailError as error:
            say(str(error), bad=True)

    box = ui.select(options, label=label, value=value, with_input=search, on_change=done)
    return box.props("dense outlined")


def upload(label: str, take: Callable[[str, Any], Any], *, many: bool = True, kinds: str = "") -> ui.upload:
    """Place to drop files; each goes to `take` with its name and content."""

    async def handle(event: Any) -> None:
        try:
            await finish(take(event.file.name, event.file.iterate()))
        except CommonrailError as error:
            say(str(error), bad=True)
        if not box.is_deleted:  # the page may have been built again
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


async def waiting(button: Any, work: Callable[[], Any], words: str) -> Any:
    """Result of `work`, while the button shows a spinner; None after a failure, which is reported."""
    button.props("loading")
    note = ui.notification(words, spinner=True, timeout=None, type="ongoing")
    try:
        return await finish(work())
    except CommonrailError as error:
        say(str(error), bad=True)
        return None
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


def frame(path: str, words: str) -> None:
    """A report within the page; its scripts run in a frame of their own."""
    ui.element("iframe").props(f'src="/file/{path}" title="{words}" sandbox="allow-scripts"').classes("report")


def chart(options: dict[str, Any]) -> ui.echart:
    """Chart with its content in words."""
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
