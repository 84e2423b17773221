"""A server of the app in a process of its own, and made-up bench files as a foreign bench writes them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

import numpy as np


class Served(NamedTuple):
    """Address with its token, port and process of a server."""

    address: str
    port: int
    token: str
    process: subprocess.Popen[str]


@contextmanager
def serving(folder: Path) -> Iterator[Served]:
    """A server on a folder, killed without a farewell at the end of the block."""
    command = [sys.executable, "-m", "commonrail", "app", str(folder), "--no-open", "--json"]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        text = ""
        assert process.stdout is not None
        while not text.rstrip().endswith("}"):
            line = process.stdout.readline()
            assert line, "the server ended"
            text += line
        address = json.loads(text)["address"]
        parts = urlsplit(address)
        assert parts.hostname == "127.0.0.1"
        assert parts.port
        yield Served(address, parts.port, parse_qs(parts.query)["token"][0], process)
    finally:
        process.kill()
        process.wait()


def is_alive(process: int) -> bool:
    """Return whether a process runs."""
    try:
        os.kill(process, 0)
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


def end(process: int) -> None:
    """End a process that a server has left behind."""
    if is_alive(process):
        os.kill(process, signal.SIGKILL)


def write_bench(folder: Path) -> list[Path]:
    """Write a map and a rate curve of a made-up trapezoid model: German headings, decimal commas, times in ms."""
    folder.mkdir()

    def rate(pressure: float, energising: float) -> tuple[np.ndarray, np.ndarray]:
        time = np.arange(-0.3e-3, 3e-3, 5e-6)
        opening, closing = (270 + 2.2e9 / pressure) * 1e-6, energising + (150 + 1.2e-6 * pressure) * 1e-6
        speed = 0.28 + 1.1e-9 * pressure
        lift = np.clip(speed * (time - opening), 0.0, 0.22e-3)
        fall = np.interp(closing, time, lift) - (0.4 + 1.7e-9 * pressure) * (time - closing)
        lift = np.where(time > closing, np.clip(fall, 0.0, None), lift)
        flow = 0.82 * 8 * np.pi / 4 * 0.1306e-3**2 * np.sqrt(2 * (pressure - 0.5e6) / 812.0)
        return time, flow * np.tanh(lift / 0.055e-3) ** 1.3

    def german(value: float) -> str:
        return f"{value:.4f}".replace(".", ",")

    times = [220, 300, 400, 600, 900]
    rows = ["Einspritzmenge [mm³/Hub]", ";".join(["Raildruck [bar] \\ Ansteuerdauer [µs]", *map(str, times)])]
    for bar in (400, 800, 1200):
        cells = [rate(bar * 1e5, t * 1e-6)[1].sum() * 5e-6 * 1e9 for t in times]
        rows.append(";".join([str(bar), *map(german, cells)]))
    (folder / "Kennfeld.csv").write_text("\n".join(rows), encoding="utf-8")
    time, values = rate(8e7, 6e-4)
    lines = [f"{german(t * 1e3)};{german(v * 812e3)}" for t, v in zip(time, values, strict=True)]
    (folder / "Rate_800bar_600us.csv").write_text("Zeit [ms];Einspritzrate [mg/ms]\n" + "\n".join(lines), "utf-8")
    return [folder / "Kennfeld.csv", folder / "Rate_800bar_600us.csv"]
