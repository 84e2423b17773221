"""Time from a moved slider to its drawn curve in headless Chromium: ``python -m benchmarks.page_speed PAGE.html``.

The arrow key moves the slider in focus, as a person would move it. A time begins when the browser receives the key, and
ends when the page has drawn the rate; "to the screen" ends at the refresh that shows it, in the browser's own account,
which counts in steps of 8 ms and does not list what takes less than 16 ms.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from tools.browser import Browser, browsing

MOVES, WARMING = 300, 40
RIGHT, LEFT = ("ArrowRight", 39), ("ArrowLeft", 37)
PAUSE = 0.012  # between two keys [s]
SHORTEST = 16.0  # that the browser lists of times to the screen [ms]
_ACCOUNT = """window.account ??= [], window.accountant ??= new PerformanceObserver((list) => {
    account.push(...list.getEntries().filter((e) => e.name === "keydown").map((e) => e.duration)); }),
    accountant.observe({ type: "event", durationThreshold: 16 }), null"""


def measure(page: Browser, slider: str, fan: bool) -> dict[str, Any]:
    """Times [ms] from a key to the drawn curve, and to the screen, of the slider of an id on an open page."""
    page.evaluate(f"if (commonrail.state().fan !== {str(fan).lower()}) document.getElementById('fanned').click()")
    page.evaluate(f"document.getElementById({slider!r}).focus()")
    page.evaluate(_ACCOUNT)
    for count in (WARMING, MOVES):
        page.evaluate("commonrail.frames.length = account.length = 0")
        for i in range(count):
            key, number = RIGHT if i % 100 < 50 else LEFT
            page.press(key, key, number)
            time.sleep(PAUSE)
    page.until("commonrail.settled()")
    frames, listed = page.evaluate("commonrail.frames"), page.evaluate("account")
    times = np.array([frame["ms"] for frame in frames])
    seen = np.maximum([*listed, *[0.0] * (len(times) - len(listed))], SHORTEST)
    return {
        "curves": len(times),
        "median": np.median(times),
        "p95": np.percentile(times, 95),
        "worst": times.max(),
        "simulated in": np.median([frame["work"] for frame in frames]),
        "p95 to the screen": np.percentile(seen, 95),
    }


def drag(page: Browser, slider: str, seconds: float) -> tuple[float, float]:
    """Curves and fans per second while a slider is moved at every frame of the screen for so many seconds."""
    curves, fans = page.evaluate(f"""new Promise((done) => {{
            const range = document.getElementById({slider!r}), begun = performance.now();
            const low = +range.min, high = +range.max;
            commonrail.frames.length = commonrail.fans.length = 0;
            const move = () => {{
              const passed = performance.now() - begun;
              const drawn = [commonrail.frames.length, commonrail.fans.length];
              if (passed > {seconds * 1e3}) return done(drawn.map((n) => n / passed * 1e3));
              range.value = low + (high - low) * (0.5 + 0.3 * Math.sin(passed / 300));
              range.dispatchEvent(new Event("input"));
              requestAnimationFrame(move);
            }};
            move();
          }})""")
    return float(curves), float(fans)


def processor_times(process: int) -> dict[str, float]:
    """Processor time [ms] so far of the threads below a process, by kind of process and name of thread (Linux)."""
    parents = {
        int(p.name): int(_stat(p)[1]) for p in Path("/proc").iterdir() if p.name.isdigit() and (p / "stat").exists()
    }
    times: dict[str, float] = {}
    for number in parents:
        above = number
        while above in parents and above != process:
            above = parents[above]
        if above == process:
            command = Path(f"/proc/{number}/cmdline").read_text()
            kind = command.partition("--type=")[2].split(" ")[0].split("\0")[0] or "browser"
            for thread in Path(f"/proc/{number}/task").iterdir():
                name = f"{kind} {(thread / 'comm').read_text().strip()}"
                spent = int((thread / "schedstat").read_text().split()[0]) * 1e-6
                times[name] = times.get(name, 0.0) + spent
    return times


def _stat(process: Path) -> list[str]:
    """Fields of a process after its name; its parent is the second."""
    return (process / "stat").read_text().rpartition(")")[2].split()


def main() -> None:
    """Measure a page, with and without its fan; the load of the machine is printed too."""
    with browsing() as page:
        print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors, of the minute before")
        page.resize(1280, 900)
        page.open(Path(sys.argv[1]).absolute().as_uri())
        page.until("commonrail.shown() !== null")
        for fan in (False, True):
            measurement = measure(page, "rail", fan)
            before = processor_times(page.process)
            rate, fans = drag(page, "rail", 5.0)
            after, curves = processor_times(page.process), page.evaluate("commonrail.frames.length")
            spent = {name: (after[name] - before.get(name, 0.0)) / curves for name in after}
            most = sorted(spent, key=lambda name: -spent[name])[:5]
            print("processor time a curve:", ", ".join(f"{name} {spent[name]:.2f} ms" for name in most))
            times = ", ".join(f"{name} {value:.1f}" for name, value in measurement.items())
            dragged = f"{rate:.0f} curves" + (f" and {fans:.0f} fans" if fan else "")
            print(f"{'with fan' if fan else 'one curve'}: {times} ms; {dragged} per second while dragged")
        if page.complaints:
            sys.exit(f"the page complains: {page.complaints}")


if __name__ == "__main__":
    main()
