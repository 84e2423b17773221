"""The local server: a socket on the loopback interface, the guard, the project's files, and the pages."""

from __future__ import annotations

import contextlib
import secrets
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

from commonrail.base.errors import InputError
from commonrail.base.input import LARGEST_FILE
from commonrail.plugins.app.guard import Guard
from commonrail.plugins.app.project import Project

MARGIN = 100_000  # of a request's size over its file [bytes]
_SEALED = {"content-security-policy": "sandbox allow-scripts"}  # a report's scripts do not reach the app


def listen(port: int) -> socket.socket:
    """Socket on the loopback interface; `InputError` if the port is taken."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind(("127.0.0.1", port))
        listener.listen()  # connections wait until the pages are ready
    except OSError as error:
        listener.close()
        raise InputError(f"--port: {port} cannot be used ({error.strerror}); name another, or none.") from error
    return listener


def serve(folder: Path, listener: socket.socket, port: int, announce: Callable[[str], None], opens: bool) -> None:
    """Serve the pages of a project until Ctrl-C.

    `announce` is called with the address, token included, once the server answers; `opens`: open a browser too.
    """
    import uvicorn
    from fastapi import FastAPI
    from fastapi.responses import FileResponse, PlainTextResponse, Response
    from nicegui import ui

    def window() -> str:
        try:
            return ui.context.client.id
        except RuntimeError:  # outside the context of a page
            return ""

    project, token = Project(folder, window), secrets.token_urlsafe(32)
    address = f"http://127.0.0.1:{port}/?token={token}"

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> Any:
        announce(address)
        if opens:
            webbrowser.open(address)
        yield
        project.preview.close()

    application = FastAPI(lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None)

    @application.get("/file/{path:path}")
    async def file(path: str, save: bool = False) -> Response:
        place = project.inside(path)
        if place is None:
            return PlainTextResponse("There is no such file.", 404)
        return FileResponse(
            place, filename=place.name, content_disposition_type="attachment" if save else "inline", headers=_SEALED
        )

    _declare_pages(project)
    ui.run_with(
        application,
        title="commonrail",
        dark=None,
        favicon="⛽",
        show_welcome_message=False,
        tailwind=False,
        reconnect_timeout=60.0,
    )
    config = uvicorn.Config(
        Guard(application, token, port, LARGEST_FILE + MARGIN),
        log_level="error",
        server_header=False,
        ws_max_size=4_000_000,
        timeout_graceful_shutdown=1,
        loop="asyncio",
    )
    uvicorn.Server(config).run(sockets=[listener])


def _declare_pages(project: Project) -> None:
    from nicegui import ui

    from commonrail.plugins.app.pages import STEPS, Home
    from commonrail.plugins.app.workshop import Workshop

    style = (Path(__file__).parent / "style.css").read_text("utf-8")

    @ui.page("/")
    async def home(step: str = "") -> None:
        ui.add_css(style)
        await Home(project, step if step in STEPS else STEPS[0]).build()

    @ui.page("/workshop")
    async def workshop(language: str = "en") -> None:
        ui.add_css(style)
        await Workshop(project, "de" if language == "de" else "en").build()
