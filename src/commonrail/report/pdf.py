"""Reports as PDF, printed by a Chromium that is installed on this machine."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from commonrail.base.errors import InputError, OutputError

# Names that Chromium and browsers made of it have on Linux, macOS and Windows.
BROWSERS = (
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "microsoft-edge",
    "msedge",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
)
LONGEST = 120.0  # [s]


def browser() -> str:
    """Command of the first browser found; InputError without one."""
    command = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if command is None:
        raise InputError(
            "A PDF is printed by Chromium, Chrome or Edge, and none was found on this machine; install one, or open "
            "report.html in any browser and print it."
        )
    return command


def print_pdf(page: Path) -> Path:
    """Print a page to a PDF next to it, whose path is returned.

    InputError if no browser is found; OutputError if it fails.
    """
    command, target = browser(), page.with_suffix(".pdf")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        printed = Path(folder) / "page.pdf"
        options = ["--headless", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={folder}/profile"]
        if getattr(os, "geteuid", lambda: 1)() == 0:
            options.append("--no-sandbox")  # Chromium refuses to start as root otherwise
        try:
            subprocess.run(
                [command, *options, f"--print-to-pdf={printed}", page.resolve().as_uri()],
                capture_output=True,
                timeout=LONGEST,
                check=False,
            )
            shutil.copyfile(printed, target)
        except (OSError, subprocess.TimeoutExpired) as error:
            reason = getattr(error, "strerror", None) or "it took too long"
            raise OutputError(f"{target}: {command} printed no PDF ({reason}); open {page} and print it.") from error
    return target
