"""commonrail certainty: most likely values, intervals and verdicts of a finished run, from more starts."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import click

from commonrail.base.stages import telling
from commonrail.cli.console import Bar, print_json, print_text, show_stages_on
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import Json, Threads, check_folder

STARTS = 8  # of the search


@table_verb
def certainty(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate.")],
    *,
    starts: Annotated[int, Option(min=1, max=1000, help="Starts of the search for the most likely values.")] = STARTS,
    combination: Annotated[
        tuple[str, ...], Option(metavar="SUM", help='Interval of a sum of parameters, e.g. "a + 2*b".')
    ] = (),
    limit: Annotated[
        float | None,
        Option(
            min=0.1, max=99.0, help="Half width of an interval up to which a parameter is determined [%]. [default: 10]"
        ),
    ] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Estimate a run once more, from more starts.

    The likelihood takes each data set with its own noise model, the key `noise` of its block in the study. The run
    folder is updated: values, intervals, bands, draws.npz and report. With --combination or --limit nothing is written.

    \b
    Examples:
      commonrail certainty runs/first
      commonrail certainty runs/first --combination "plunger_needle.k2 + plunger_needle.k3"
    """
    from commonrail.calibration.record import CalibrationRecord, read_as
    from commonrail.plugins.certainty.run import certainty as certify
    from commonrail.plugins.certainty.run import read_combination
    from commonrail.report.fit.certainty import certainty_lines, certainty_tables, verdict_sentence
    from commonrail.report.page import write_report
    from commonrail.runs.fit import Listener, estimate_again
    from commonrail.runs.folder import RESULT, read_fit, read_result

    read_as(CalibrationRecord, read_result(run), run / RESULT)
    check_folder(run)
    report = None
    with Bar(f"{run}: time left is that of the present search, at most") as bar, telling(show_stages_on(bar)):
        if combination or limit is not None:
            study, best = read_fit(run)
            for text in combination:
                read_combination(text, study.space.names, "--combination")
            asked = {"combinations": combination, "starts": starts}
            asked |= {} if limit is None else {"limit": 0.01 * limit}
            certified = certify(study, best, threads=threads, note=bar.note, **asked)  # type: ignore[arg-type]
            record = read_result(run)
            record["certainty"] = certified.record()
            verdicts = {p["name"]: {"verdict": p["verdict"]} for p in record["certainty"]["parameters"]}
            record["parameters"] = [p | verdicts[p["name"]] for p in record["parameters"]]
        else:
            estimate_again(run, starts=starts, threads=threads, listener=Listener(note=bar.note))
            record = read_result(run)
            report = write_report(run)
    if json:
        result = {"kind": "certainty", "run": str(run), "report": report and str(report)}
        print_json(result | {"certainty": record["certainty"]})
        return
    fit = read_as(CalibrationRecord, record, run / RESULT)
    lines = [verdict_sentence(fit.parameters), *certainty_lines(fit.certainty)]
    print_text(lines, certainty_tables(fit.certainty, fit.parameters))
    if report is not None:
        click.echo(f"report: {report}")
