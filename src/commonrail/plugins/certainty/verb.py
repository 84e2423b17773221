"""commonrail certainty: intervals, profiles and verdicts for the parameters of a finished run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from commonrail.base.errors import InputError
from commonrail.base.stages import telling
from commonrail.cli.console import Bar, print_json, print_lines, print_table, say, shown_by
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import Json, Threads, check_folder, refuse_unused

if TYPE_CHECKING:
    from commonrail.plugins.certainty.file import Certainty
    from commonrail.plugins.certainty.posterior import Posterior

STARTS, LIMIT = 8, 10.0  # of the search; half width [%] up to which a parameter is pinned


@verb
def certainty(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate.")],
    *,
    starts: Annotated[int, Option(min=1, max=1000, help="Starts of the search.")] = STARTS,
    profile: Annotated[
        tuple[str, ...], Option(metavar="NAME", help="Profile this parameter; repeat it. [default: all]")
    ] = (),
    local: Annotated[bool, Option("--local", help="Omit the profiles.")] = False,
    combination: Annotated[
        tuple[str, ...], Option(metavar="SUM", help='Interval of a sum of parameters, e.g. "a + 2*b".')
    ] = (),
    limit: Annotated[
        float, Option(min=0.1, max=99.0, help="Half width of an interval up to which a parameter is pinned [%].")
    ] = LIMIT,
    posterior: Annotated[
        bool, Option("--posterior", help="Draw from the posterior too, into RUN/posterior.npz.")
    ] = False,
    adopt: Annotated[
        bool, Option("--adopt", help="Take the most likely values as the calibrated ones, of an earlier search if any.")
    ] = False,
    most: Annotated[int, Option(min=1000, help="Largest number of draws of the posterior.")] = 100_000,
    seed: Annotated[int, Option(min=0, help="Seed of the draws of the posterior.")] = 0,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Compute intervals and verdicts of parameters.

    The likelihood takes each data set with its own noise model, the key `noise` of its block in the study. The result
    is written to RUN/result.json under "certainty", and to its report; RUN/most-likely.toml is the injector with the
    most likely values. With --adopt they take the place of the calibrated ones, in calibrated.toml and all that is
    made of the run; without other options the search is not repeated. No interval is taken from a posterior whose
    chains do not agree.

    \b
    Example:
      commonrail certainty runs/first
      commonrail certainty runs/first --adopt
      commonrail certainty runs/first --posterior
      commonrail certainty runs/first --profile plunger_needle.k7 --combination "plunger_needle.k2 + plunger_needle.k3"
    """
    from commonrail.base.output import summed
    from commonrail.plugins.certainty.file import write_certainty, write_likely
    from commonrail.plugins.certainty.posterior_file import posterior_record, write_posterior
    from commonrail.plugins.certainty.run import certify
    from commonrail.report.fit.certainty import certainty_lines, certainty_tables
    from commonrail.report.page import write_report
    from commonrail.runs.fit import Listener, adopt_likely
    from commonrail.runs.folder import CALIBRATED, LIKELY, earlier_certainty, read_fit, read_result
    from commonrail.runs.journal import held_run

    refuse_unused({name: (posterior, "--posterior") for name in ("most", "seed")})
    if local and profile:
        raise InputError("--local omits the profiles, and --profile asks for one; omit either.")
    asked = starts != STARTS or profile or local or combination or limit != LIMIT or posterior
    read_result(run)
    check_folder(run)
    with held_run(run) as lock:  # until the result is written, nobody else changes the fit that it is about
        study, best = read_fit(run)
        if asked or not adopt or earlier_certainty(run) is None:
            with (
                Bar(f"{run}: time left is that of the present search or profiles, at most") as bar,
                telling(shown_by(bar)),
            ):
                found = certify(
                    study,
                    best,
                    threads=threads,
                    starts=starts,
                    profiles=() if local else profile or None,
                    combinations=combination,
                    limit=0.01 * limit,
                    note=bar.note,
                )
            kept = found.record()
            values = dict(zip(found.estimate.likelihood.names, found.estimate.point, strict=True))
            drawn = _draw(found, seed, most) if posterior else None
            lock.check_place()
            with summed(run):
                write_likely(run, study, values)
                if drawn is not None:
                    write_posterior(run, drawn)
                    kept["posterior"] = posterior_record(drawn, found.level)
                write_certainty(run, kept)
    if adopt:
        adopt_likely(run, threads=threads, listener=Listener(note=say))
    record = read_result(run)
    report = write_report(run)
    if json:
        print_json({"kind": "certainty", "run": str(run), "report": str(report), "certainty": record["certainty"]})
        return
    for table in certainty_tables(record):
        print_table(table)
    print_lines(certainty_lines(record))
    click.echo(f"most likely values: {run / (CALIBRATED if adopt else LIKELY)}")
    click.echo(f"report: {report}")


def _draw(found: Certainty, seed: int, most: int) -> Posterior:
    """Draws of the posterior, of the parameters of the study."""
    from commonrail.plugins.certainty.posterior import sample_posterior

    return sample_posterior(found.within.whole, seed=seed, most=most, note=say).of_first(found.estimate)
