"""commonrail virtual-bench: make the synthetic curves of the paper's case."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commonrail.cli.console import print_json, say
from commonrail.cli.options import Json
from commonrail.cli.output import check_folder

__all__ = ["virtual_bench"]


def virtual_bench(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of the case.")],
    *,
    seed: Annotated[int, typer.Option(min=0, help="Of the rate meter's noise.")] = 1,
    json: Json = False,
) -> None:
    """Make the synthetic curves of the paper's case.

    The paper's measurements are not published. Curves of a hidden, richer injector, seen through a
    rate meter, stand in for them in DIR/data.

    \b
    Example:
      commonrail virtual-bench cases/paper --seed 1
    """
    from commonrail.files.bench_data import write_bench_data

    check_folder(folder)
    say("simulating the test bench with the reference engine; this takes minutes ...")
    written = write_bench_data(folder, seed)
    if json:
        print_json({"kind": "virtual-bench", "seed": seed, "files": [str(p) for p in written]})
        return
    for path in written:
        typer.echo(str(path))
