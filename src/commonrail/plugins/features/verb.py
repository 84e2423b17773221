"""commonrail features: delays, ramps, rates and quantities of measured traces or of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from commonrail.base.errors import InputError
from commonrail.cli import options
from commonrail.cli.console import print_result, print_table, print_text
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.plugins.features.settings import FeatureSettings

if TYPE_CHECKING:
    from commonrail.engine.operating_point import Energising

OF_FILES = ("time", "rate", "time_unit", "rate_unit", "centred", "window", "energising_time", "energising", "separate")
OF_RUNS = ("model",)


@table_verb
def features(
    source: Annotated[
        Path, Argument(metavar="FILE|RUN", help="File with a time and one or more rates, or a run folder.")
    ],
    *,
    time: Annotated[str, Option(help="Column of the time.")] = "time",
    rate: Annotated[
        tuple[str, ...],
        Option(help="Column of a rate, a shot each; repeatable. [default: all with a unit of a rate]"),
    ] = (),
    time_unit: Annotated[str | None, Option(help="Unit of the time, if the file has none.")] = None,
    rate_unit: Annotated[str | None, Option(help="Unit of the rates, if the file has none.")] = None,
    centred: Annotated[bool, Option("--centred", help="Each sample is a mean around its time, not before it.")] = False,
    window: Annotated[str | None, Option(metavar="BEGIN:END", help="Time range to evaluate. [default: all]")] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising time from time 0, e.g. 700us; delays need it.")
    ] = None,
    energising: Annotated[
        tuple[str, ...], Option(metavar="START:DURATION", help="One of several energisings; repeatable.")
    ] = (),
    settings: FeatureSettings,
    separate: Annotated[
        bool, Option("--separate", help="The rates are of different operating points, not repeated shots.")
    ] = False,
    encoding: options.Encoding = None,
    decimal: options.DecimalSign = None,
    sheet: options.SheetName = None,
    model: Annotated[str, Option(help="Simulation of a run: best, start or rigid.")] = "best",
    out: Annotated[Path | None, Option(metavar="FILE.csv", help="Table of all features.")] = None,
    json: options.Json = False,
) -> None:
    """Find delays, ramps, rates and quantities in traces.

    Several rates of a file count as repeated shots: mean and scatter are shown with intervals, and outliers are
    listed. For a run folder, measured and simulated features are compared.

    \b
    Examples:
      commonrail features data/evi.csv --energising-time 700us
      commonrail features train.csv --energising 0us:200us --energising 900us:600us --out features.csv
      commonrail features bench.txt --encoding cp1252 --decimal , --energising-time 700us
      commonrail features runs/first --threshold 2mm3/ms
    """
    from commonrail.engine.operating_point import OperatingPoint
    from commonrail.plugins.features import file, page
    from commonrail.plugins.features.run import find_features
    from commonrail.plugins.features.shot_statistics import shot_statistics

    options.check_file(out, "--out")
    kind, other, idle = ("run", "file", OF_FILES) if source.is_dir() else ("file", "run", OF_RUNS)
    for name in filter(options.is_given, idle):
        option = f"--{name.replace('_', '-')}"
        raise InputError(f"{source}: {option} is for a {other} and does nothing for a {kind}; omit {option}.")
    pulses: tuple[Energising, ...] = ()
    if energising_time is not None or energising:
        pulses = OperatingPoint(100e6, options.read_energisings(energising_time, energising)).pulses
    form = options.read_form(encoding, decimal, sheet, [source])
    if source.is_dir():
        compared = file.run_features(source, model, settings)
        if out is not None:
            file.write_comparison(out, compared)

        def show_compared() -> None:
            for pair in compared:
                print_table(page.comparison_table(pair))
                print_text(page.feature_sentences(pair.name, pair.measured))
                print_text([*page.feature_sentences("simulated", pair.simulated), ""])

        print_result(json, lambda: file.comparison_record(compared), show_compared, [out])
        return
    between = None
    if window is not None:
        between = options.read_pair(window, "s", f"--window {window}", "BEGIN:END, such as 0us:3000us")
    columns = file.RateColumns(time, rate, time_unit, rate_unit, centred, between, form)
    by_name = {
        name: find_features(trace, settings=settings)
        for name, trace in file.read_rates(source, columns, pulses).items()
    }
    repeated = len(by_name) > 1 and not separate and file.are_repeated(list(by_name))
    shots = shot_statistics(list(by_name.values())) if repeated else ()
    if out is not None:
        file.write_features(out, by_name)

    def show() -> None:
        sentences = [text for name, traits in by_name.items() for text in page.feature_sentences(name, traits)]
        tables = [page.feature_table(name, traits) for name, traits in by_name.items() if traits.injections]
        print_text(sentences, [page.shot_table(shots, len(by_name))] if shots else tables)

    print_result(json, lambda: file.features_record(by_name, shots), show, [out])
