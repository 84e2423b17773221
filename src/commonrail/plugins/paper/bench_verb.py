"""commonrail lab virtual-bench: synthetic injection curves of the paper's case, and their truth."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Any

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, check_folder
from commonrail.plugins.paper import TRUTH


@table_verb
def virtual_bench(
    folder: Annotated[Path | None, Argument(metavar="DIR", help="Folder for the case.")] = None,
    *,
    truth: Annotated[
        str, Option(metavar="TRUTH", help="Truth of the virtual test bench: a listed name, or a TOML file.")
    ] = TRUTH,
    seed: Annotated[int, Option(min=0, help="Seed of scatter and noise.")] = 1,
    list_: Annotated[bool, Option("--list", help="List the truths that ship with commonrail.")] = False,
    show: Annotated[bool, Option("--show", help="Print the file of the truth, to be copied and changed.")] = False,
    json: Json = False,
) -> None:
    """Make the synthetic curves of the paper's case.

    The paper's measurements are not published. They are replaced by curves of a hidden, richer injector,
    measured by modelled sensors and written to DIR/data. The hidden injector, its scatter and the sensors
    are the declared truth of the bench.

    \b
    Examples:
      commonrail lab virtual-bench cases/paper --seed 1
      commonrail lab virtual-bench --show > my-truth.toml
      commonrail lab virtual-bench my-case --truth my-truth.toml
    """
    from commonrail.plugins.paper.bench_file import load_truth, truth_catalogue
    from commonrail.plugins.paper.bench_file import virtual_bench as make_bench

    if list_ + show + (folder is not None) != 1:
        raise InputError("Give one of DIR, --list and --show.")
    record: dict[str, Any]
    if list_:
        head = ["name", "title", "injector"]
        rows = [[t.name, t.title, t.injector] for t in map(load_truth, truth_catalogue())]
        record = {"kind": "truths", "truths": [dict(zip(head, row, strict=True)) for row in rows]}
        tell = partial(print_rows, head, rows, "truths", texts=3)
    elif folder is None:
        declared = load_truth(truth)
        facts = [{"name": name, "text": text} for name, text in declared.facts()]
        heading = {"kind": "truth", "name": declared.name, "title": declared.title}
        record, tell = heading | {"facts": facts, "text": declared.text}, partial(click.echo, declared.text, nl=False)
    else:
        check_folder(folder)
        declared = load_truth(truth)
        say("simulating the test bench with the reference engine; the first time its loop is compiled ...")
        files = [str(path) for path in make_bench(folder, seed, declared)]
        record = {"kind": "virtual-bench", "truth": declared.name, "seed": seed, "files": files}
        tell = partial(click.echo, "\n".join(files))
    if json:
        print_json(record)
    else:
        tell()
