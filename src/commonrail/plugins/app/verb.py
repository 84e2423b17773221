"""commonrail app: the steps from data files to an ECU map in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.cli.console import print_json, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json


@verb
def app(
    folder: Annotated[Path, Argument(metavar="[DIR]", help="Project folder: new, or from an earlier session.")] = Path(
        "injector-project"
    ),
    *,
    port: Annotated[int, Option(help="Port of this machine. [default: any free port]", min=0, max=65535)] = 0,
    no_open: Annotated[bool, Option("--no-open", help="Do not open a browser; the address is printed.")] = False,
    json: Json = False,
) -> None:
    """Calibrate and judge injectors in the browser.

    Serves pages to this machine alone, without a network: data files, injector, calibration, report and downloads, and
    a page for workshops. Everything is kept in DIR as the command line would leave it; a calibration continues when
    the browser or the server ends, and is shown again by the next start. Ctrl-C ends the server.

    \b
    Examples:
      commonrail app
      commonrail app my-injector --port 8000 --no-open
    """
    from commonrail.plugins.app.run import app as serve

    def announce(address: str) -> None:
        if json:
            print_json({"kind": "app", "address": address, "folder": str(folder)})
        else:
            say(f"{address}\nOpen this address in a browser of this machine. Ctrl-C ends the server.")

    serve(folder, port=port, opens=not no_open, announce=announce)
