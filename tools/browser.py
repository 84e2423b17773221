"""Headless Chromium by its own protocol: a page opened from its file, evaluated, typed into, looked at."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["CHROMIUM", "Browser", "browsing"]

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
LONGEST = 60.0  # for an answer of the browser [s]; it only limits the wait for a hung browser
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--remote-allow-origins=*",
    "--remote-debugging-port=0",
)


class Browser:
    """One page of a browser at the address of its own socket; `complaints` are errors that it has thrown or logged."""

    def __init__(self, address: str) -> None:
        from websocket import create_connection

        self._socket = create_connection(address, timeout=LONGEST, suppress_origin=True)
        self._numbers = itertools.count(1)
        self._loaded = 0
        self.complaints: list[str] = []
        self.process = 0
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Answer of a method of the protocol."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = self._receive()
            if message.get("id") == number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return dict(message["result"])

    def _receive(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self._socket.recv())
        about = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(about["exceptionDetails"].get("exception", about["exceptionDetails"])))
        elif message.get("method") == "Log.entryAdded" and about["entry"]["level"] == "error":
            self.complaints.append(str(about["entry"]["text"]))
        elif message.get("method") == "Runtime.consoleAPICalled" and about["type"] in ("error", "assert"):
            self.complaints.append(str(about["args"]))
        elif message.get("method") == "Page.loadEventFired":
            self._loaded += 1
        return message

    def open(self, address: str) -> None:
        """Open an address, and wait until it is loaded."""
        before = self._loaded
        self.call("Page.navigate", url="about:blank")
        while self._loaded == before:
            self._receive()
        before = self._loaded
        self.call("Page.navigate", url=address)
        while self._loaded == before:
            self._receive()

    def evaluate(self, expression: str) -> Any:
        """Value of an expression of JavaScript; a promise is waited for."""
        response = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in response:
            raise RuntimeError(str(response["exceptionDetails"].get("exception", response["exceptionDetails"])))
        return response["result"].get("value")

    def until(self, condition: str) -> None:
        """Wait until an expression is true."""
        self.evaluate(
            f"new Promise((done) => {{ const look = () => ({condition}) ? done(true) : setTimeout(look, 5); look(); }})"
        )

    def press(self, key: str, code: str = "", number: int = 0) -> None:
        """Press and release a key as in events of JavaScript; `number`: Windows' code, which sliders need."""
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            extra = text if kind == "keyDown" else {}
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=code or key, windowsVirtualKeyCode=number, **extra
            )

    def resize(self, width: int, height: int, phone: bool = False) -> None:
        """Set the size of the window [px]."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=phone)

    def picture(self, path: Path, full_page: bool = True) -> None:
        """Write a picture of the page as PNG."""
        response = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=full_page)
        path.write_bytes(base64.b64decode(response["data"]))


@contextmanager
def browsing() -> Iterator[Browser]:
    """A browser that ends with the block."""
    assert CHROMIUM is not None
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [CHROMIUM, *_FLAGS, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            browser = Browser(_address(Path(profile), process))
            browser.process = process.pid
            yield browser
        finally:
            process.terminate()
            try:
                process.wait(LONGEST)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _address(profile: Path, process: subprocess.Popen[bytes]) -> str:
    """Address of the first page's socket, once the browser has written its port."""
    file, end = profile / "DevToolsActivePort", time.monotonic() + LONGEST
    while not (file.is_file() and file.read_text().strip()):
        if process.poll() is not None or time.monotonic() > end:
            raise RuntimeError("the browser did not start")
        time.sleep(0.02)
    port = file.read_text().split()[0]
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list") as answer:
        pages = [target for target in json.load(answer) if target["type"] == "page"]
    return str(pages[0]["webSocketDebuggerUrl"])
