"""commonrail predict: predictions of a calibrated model, with bands for measured values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.errors import InputError
from commonrail.base.output import write_text
from commonrail.cli.console import SIMULATING, print_json, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    CylinderPressure,
    Json,
    ReturnPressure,
    Threads,
    check_distinct,
    check_file,
    check_report,
    read_axis,
    read_pressures,
)

if TYPE_CHECKING:
    from commonrail.calibration.study import Study
    from commonrail.engine.operating_point import OperatingPoint


@table_verb
def predict(
    run: Annotated[Path, Argument(metavar="RUN", help="Folder of commonrail calibrate.")],
    *,
    rail_pressure: Annotated[
        str | None, Option(help="Rail pressures, e.g. 40:160:20MPa. [default: the data of the study]")
    ] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising times, e.g. 200,400,1000us; each with each rail pressure.")
    ] = None,
    from_: Annotated[
        Path | None,
        Option("--from", metavar="FILE.csv", help="Operating points: columns rail_pressure, energising_time."),
    ] = None,
    cylinder_pressure: CylinderPressure = None,
    return_pressure: ReturnPressure = None,
    out: Annotated[Path | None, Option(metavar="FILE.csv", help="File for predictions and bands.")] = None,
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with the bands.")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Predict quantities, with bands for measured values.

    At operating points, or at all data of the study; bands of 50 % and 90 %.

    A band combines parameter uncertainty and the scatter of measured values about the best prediction: the tolerance of
    a map, or the residual level of the fit if it is larger. Without operating points the measured values inside the
    bands are counted, separately for validation data.

    \b
    Examples:
      commonrail predict runs/first
      commonrail predict runs/first --rail-pressure 40:160:20MPa --energising-time 200:1400:100us --out bands.csv
    """
    from commonrail.plugins.prediction.file import write_bands
    from commonrail.plugins.prediction.page import coverage_table, points_table, prediction_html, prediction_lines
    from commonrail.plugins.prediction.run import predict as run_prediction
    from commonrail.runs.folder import DRAWS, read_draws, read_fit

    check_file(out, "--out")
    check_report(report)
    check_distinct(out, report)
    study, best = read_fit(run)
    points = _points(study, (rail_pressure, energising_time, from_), (cylinder_pressure, return_pressure))
    draws = read_draws(run, study.space.names) if (run / DRAWS).is_file() else None
    say(SIMULATING)
    prediction = run_prediction(study, best, points, draws=draws, threads=threads)
    if out is not None:
        write_bands(out, prediction)
    if report is not None:
        write_text(report, prediction_html(prediction, study))
    record = prediction.record()
    if json:
        print_json({"kind": "prediction", "run": str(run), "file": str(out) if out else None, **record})
        return
    verdict, *notes = prediction_lines(prediction)
    print_text([verdict], [points_table(record) if points else coverage_table(record)], notes)
    for path in filter(None, (out, report)):
        say(f"wrote {path}")


def _points(
    study: Study, options: tuple[str | None, str | None, Path | None], pressures: tuple[str | None, str | None]
) -> list[OperatingPoint]:
    """Requested operating points; empty for the data of the study."""
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.plugins.prediction.file import read_points

    rails, times, file = options
    if file is not None and (rails or times):
        raise InputError("--from: give either a file of operating points or --rail-pressure and --energising-time.")
    if (rails is None) is not (times is None):
        raise InputError("Give both --rail-pressure and --energising-time, or neither for the data of the study.")
    if file is not None:
        pairs = read_points(file)
    elif rails is not None and times is not None:
        axis = read_axis(times, "s", "--energising-time").tolist()
        pairs = [(p, t) for p in read_axis(rails, "Pa", "--rail-pressure").tolist() for t in axis]
    else:
        return []
    behind = read_pressures(*pressures, study)
    return [OperatingPoint(p, t, *behind) for p, t in pairs]
