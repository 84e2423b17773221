"""commonrail lab virtual-bench: synthetic injection curves of the paper's case, and their truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base.errors import InputError
from commonrail.cli.console import print_json, print_rows, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, check_folder
from commonrail.plugins.paper import TRUTH


@verb
def virtual_bench(
    folder: Annotated[Path | None, Argument(metavar="DIR", help="Folder for the case.")] = None,
    *,
    truth: Annotated[
        str, Option(metavar="TRUTH", help="Truth of the virtual test bench: a name of its list, or a TOML file.")
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
    if list_ + show + (folder is not None) != 1:
        raise InputError("Give one of DIR, --list and --show.")
    if list_:
        _list(json)
    elif show:
        _show(truth, json)
    else:
        assert folder is not None
        _write(folder, truth, seed, json)


def _list(json: bool) -> None:
    from commonrail.plugins.paper.bench_file import load_truth, truth_catalogue

    truths = [load_truth(name) for name in truth_catalogue()]
    if json:
        entries = [{"name": t.name, "title": t.title, "injector": t.injector} for t in truths]
        print_json({"kind": "truths", "truths": entries})
        return
    print_rows(["name", "title", "injector"], [[t.name, t.title, t.injector] for t in truths], "truths", texts=3)


def _show(source: str, json: bool) -> None:
    from commonrail.plugins.paper.bench_file import load_truth

    truth = load_truth(source)
    if json:
        facts = [{"name": name, "text": text} for name, text in truth.facts()]
        print_json({"kind": "truth", "name": truth.name, "title": truth.title, "facts": facts, "text": truth.text})
        return
    click.echo(truth.text, nl=False)


def _write(folder: Path, source: str, seed: int, json: bool) -> None:
    from commonrail.plugins.paper.bench_file import load_truth, virtual_bench

    check_folder(folder)
    truth = load_truth(source)
    say("simulating the test bench with the reference engine; the first time its loop is compiled ...")
    written = virtual_bench(folder, seed, truth)
    if json:
        print_json(
            {"kind": "virtual-bench", "truth": truth.name, "seed": seed, "files": [str(path) for path in written]}
        )
        return
    for path in written:
        click.echo(str(path))
