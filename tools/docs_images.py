"""Pictures of README and site, by the present code: ``python -m tools.docs_images docs/images``.

A headless Chromium opens the files that the commands of the README write, and a page whose slider is moved.
"""

from __future__ import annotations

import io
import subprocess
import sys
import tempfile
from pathlib import Path

from tools.browser import Browser, browsing

CARD = 480  # width of a card's picture [px]; cards stand side by side
WINDOW = (1280, 860)
MOVING = (1040, 800)  # window of the moving picture [px]
WIDE = 760  # its width as written [px]
FRAMES, PERIOD = 28, 90  # frames of the moving picture, and the time of each [ms]
LARGEST = 600_000  # bytes of the moving picture; a README should load at once

_CASE = """
commonrail simulate virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us --report rate.html
commonrail new my-injector
commonrail calibrate my-injector/study.toml --out runs/first
commonrail certainty runs/first
commonrail page virtual-lino-2016 --rail-pressure 160MPa --out live.html
"""
# Pictures of docs/gallery.md: the command, and the page that it writes.
_GALLERY = {
    "map": ("commonrail map cri2-16 --cylinder-pressure 0.5MPa --report map.html", "map.html"),
    "dwell": (
        "commonrail sweep cri2-16 --vary dwell=0:3000:50us --vary rail_pressure=40,80,160MPa "
        "--first-energising-time 350us --energising-time 500us --report dwell.html",
        "dwell.html",
    ),
    "compare": (
        "commonrail compare virtual-lino-2016 rigid=virtual-lino-2016@rigid --data cases/paper/study.toml "
        "--out runs/compare",
        "runs/compare/report.html",
    ),
    "sensitivity": (
        "commonrail sensitivity virtual-lino-2016 --rail-pressure 160MPa --energising-time 700us --design morris "
        "--out runs/sensitivity",
        "runs/sensitivity/report.html",
    ),
    "tolerance": (
        "commonrail tolerance cases/tolerance/tolerances.toml --parts 20000 --out runs/tolerance",
        "runs/tolerance/report.html",
    ),
    "fleet": ("commonrail fleet cases/fleet/fleet.toml --workers 2 --out runs/fleet", "runs/fleet/report.html"),
    "cri2-16": (
        "commonrail calibrate cases/cri2-16/study.toml --out runs/cri2-16",
        "runs/cri2-16/report.html",
    ),
    "catalogue": ("commonrail catalogue injectors --report injectors.html", "injectors.html"),
}
# One wave of a slider about its middle, and back: the picture repeats without a jump.
_MOVE = """(() => {{ const range = document.getElementById({slider!r});
    range.value = +range.min + (range.max - range.min) * {place};
    range.dispatchEvent(new Event("input")); }})()"""
_SLIDERS = "[...document.querySelectorAll('#point-sliders input[type=range]')].map((r) => r.id)"


def make_files(folder: Path) -> None:
    """Run the commands that write the pictured files."""
    (folder / "cases").symlink_to(Path(__file__).resolve().parents[1] / "cases")
    for line in [*_CASE.strip().splitlines(), *(command for command, _ in _GALLERY.values())]:
        print(line, flush=True)
        words = [sys.executable, "-m", *line.split()]
        subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)


def picture(page: Browser, file: Path, size: tuple[int, int] = WINDOW, place: str = "") -> bytes:
    """PNG of the window with a file, scrolled to an element if one is selected."""
    page.resize(*size)
    page.call("Emulation.setScrollbarsHidden", hidden=True)
    page.open(file.as_uri())
    if place:
        page.evaluate(f"document.querySelectorAll('details').forEach((d) => d.open = true), {place}.scrollIntoView()")
    return screenshot(page)


def screenshot(page: Browser) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "shot.png"
        page.picture(path, full_page=False)
        return path.read_bytes()


def save_webp(shots: list[bytes], width: int, path: Path, quality: int = 75) -> None:
    """Write pictures as WebP of a width [px]; several become an animation."""
    from PIL import Image

    images = [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]
    small = [
        image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS) for image in images
    ]
    rest = {"save_all": True, "append_images": small[1:], "duration": PERIOD, "loop": 0} if len(small) > 1 else {}
    small[0].save(path, "WEBP", quality=quality, method=6, **rest)
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB", flush=True)


def record_live_page(page: Browser, file: Path) -> list[bytes]:
    """Pictures of the live page while its first slider, the rail pressure, goes down and up again."""
    page.resize(*MOVING)
    page.call("Emulation.setScrollbarsHidden", hidden=True)
    page.open(file.as_uri())
    page.until("commonrail.settled()")
    slider = page.evaluate(_SLIDERS)[0]
    shots = []
    for i in range(FRAMES):
        place = abs(1.0 - 2.0 * i / FRAMES)
        page.evaluate(_MOVE.format(slider=slider, place=0.2 + 0.6 * place))
        page.until("commonrail.settled()")
        shots.append(screenshot(page))
    return shots


def main() -> None:
    """Write the pictures into the folder that the command line names."""
    out = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name, browsing() as page:
        folder = Path(name)
        make_files(folder)
        report = folder / "runs" / "first" / "report.html"
        save_webp([picture(page, folder / "rate.html")], CARD, out / "card-simulate.webp")
        save_webp([picture(page, report)], CARD, out / "card-calibrate.webp")
        trust = "[...document.querySelectorAll('h2,h3')].find((h) => /profile|Trust/i.test(h.textContent))"
        save_webp([picture(page, report, place=trust)], CARD, out / "card-trust.webp")
        save_webp(record_live_page(page, folder / "live.html"), WIDE, out / "live.webp", quality=60)
        for label, (_, file) in _GALLERY.items():
            save_webp([picture(page, folder / file)], WIDE, out / f"gallery-{label}.webp", quality=60)
    size = (out / "live.webp").stat().st_size
    if size > LARGEST:
        raise SystemExit(f"live.webp has {size} bytes, more than {LARGEST}: take fewer frames or a lower quality")


if __name__ == "__main__":
    main()
