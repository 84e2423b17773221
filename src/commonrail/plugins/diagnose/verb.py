"""commonrail diagnose and trim: which fault explains what a bench measured, and what corrects a sound part."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from commonrail.base.output import write_text
from commonrail.base.units import parse
from commonrail.cli.console import SIMULATING, print_result, print_text, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import DecimalSign, Json, Settings, Threads, check_file, check_report, read_axis
from commonrail.plugins.plans.verb import BenchCylinderPressure, BenchReturnPressure, command_again, read_bench

Model = Annotated[str, Argument(metavar="MODEL", help="Injector file, a name of the catalogue, or a run folder.")]
Results = Annotated[Path, Argument(metavar="RESULTS.csv", help="Test plan with a column bench, as measured on a part.")]
Noise = Annotated[str, Option(help="Standard deviation of bench and model, as a share of a quantity.")]
Nominal = Annotated[
    bool, Option(help="Take the plan's nominal quantities for a sound part's, and the model for changes alone.")
]
Faults = Annotated[
    Path | None,
    Option(metavar="FAULTS.toml", help="Table of faults and of the scatter of sound parts. [default: that shipped]"),
]


@verb
def diagnose(
    model: Model,
    file: Results,
    *,
    noise: Annotated[
        str | None,
        Option(
            help="Standard deviation of bench and model, as a share of a quantity. [default: a workshop's, by bands]"
        ),
    ] = None,
    sound: Annotated[str, Option(help="Probability before the measurement that the part is sound.")] = "50%",
    nominal: Nominal = False,
    faults: Faults = None,
    stroke_rate: Annotated[
        str | None, Option(help="Stroke rate where the plan states none, e.g. 1000/min. [default: none]")
    ] = None,
    cylinder_pressure: BenchCylinderPressure = None,
    return_pressure: BenchReturnPressure = None,
    decimal: DecimalSign = None,
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us",
    set_: Settings = (),
    report: Annotated[Path | None, Option(metavar="FILE.html", help="Report with probabilities and bands.")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Find the fault that explains what a bench measured.

    Sound parts within makers' tolerances, and parts with each fault at each size, are simulated at the tests of the
    plan. Probabilities over the faults and "sound" follow by Bayes' theorem. Where the results cannot tell, the next
    test that would is named. The answer depends on the model: one fitted to other data may name another fault.

    \b
    Examples:
      commonrail diagnose cri2-16 examples/test-plan/results.csv --nominal
      commonrail diagnose runs/first results.csv --noise 2% --report diagnosis.html
    """
    from commonrail.plugins.diagnose.page import diagnosis_html, diagnosis_lines, diagnosis_tables
    from commonrail.plugins.diagnose.run import diagnose as run

    check_report(report)
    injector, tests, pressures = read_bench(model, file, decimal, set_, (cylinder_pressure, return_pressure))
    say(SIMULATING)
    record = run(
        injector,
        tests,
        faults=faults,
        noise=None if noise is None else parse(noise, "1", "--noise"),
        sound=parse(sound, "1", "--sound"),
        nominal=nominal,
        stroke_rate=None if stroke_rate is None else parse(stroke_rate, "1/s", "--stroke-rate"),
        cylinder_pressure=pressures["cylinder_pressure"],
        return_pressure=pressures["return_pressure"],
        time_step=parse(time_step, "s", "--time-step"),
        threads=threads,
    ).record()
    if report is not None:
        stated = {"noise": noise, "sound": sound, "faults": faults, "stroke_rate": stroke_rate, "decimal": decimal}
        words = ["diagnose", model, str(file), *(["--nominal"] if nominal else [])]
        again = command_again(words, set_, pressures, stated | {"report": report})
        write_text(report, diagnosis_html(record, again))
    print_result(json, lambda: record, lambda: print_text(diagnosis_lines(record), diagnosis_tables(record)), [report])


@verb
def trim(
    model: Model,
    file: Results,
    *,
    step: Annotated[str, Option(help="Step of a class, e.g. 2us.")] = "2us",
    rail_pressure: Annotated[
        str | None, Option(help="Rail pressures of the map, e.g. 40:160:40MPa. [default: five between the tests']")
    ] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising times of the map, e.g. 200,500,900us. [default: five between the tests']")
    ] = None,
    noise: Noise = "1%",
    nominal: Nominal = False,
    faults: Faults = None,
    cylinder_pressure: BenchCylinderPressure = None,
    return_pressure: BenchReturnPressure = None,
    decimal: DecimalSign = None,
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us",
    set_: Settings = (),
    out: Annotated[Path | None, Option(metavar="FILE.csv", help="Corrections over the map.")] = None,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Correct a part's energising time from a few tests.

    The corrections at the tests, in whole steps, are the part's code. Over the map follows what the code makes most
    likely for parts within makers' tolerances; what it leaves of their spread is estimated by a linear model. A result
    far from sound parts is warned of, such as a fault's or a mistyped one.

    \b
    Examples:
      commonrail trim cri2-16 examples/test-plan/sound.csv --nominal --out corrections.csv
      commonrail trim runs/first results.csv --step 1us --rail-pressure 40:160:40MPa --energising-time 300,600,900us
    """
    from commonrail.plugins.diagnose.page import corrections_text, trim_lines, trim_table
    from commonrail.plugins.diagnose.trim import trim as run

    check_file(out, "--out")
    injector, tests, pressures = read_bench(model, file, decimal, set_, (cylinder_pressure, return_pressure))
    axes = {
        key: None if text is None else read_axis(text, unit, f"--{key.replace('_', '-')}").tolist()
        for key, text, unit in (("rail_pressure", rail_pressure, "Pa"), ("energising_time", energising_time, "s"))
    }
    say(SIMULATING)
    found = run(
        injector,
        tests,
        step=parse(step, "s", "--step"),
        rail_pressures=axes["rail_pressure"],
        energising_times=axes["energising_time"],
        faults=faults,
        noise=parse(noise, "1", "--noise"),
        nominal=nominal,
        **pressures,
        time_step=parse(time_step, "s", "--time-step"),
        threads=threads,
    )
    record = found.record()
    if out is not None:
        write_text(out, corrections_text(record))
    print_result(json, lambda: record, lambda: print_text(trim_lines(record), [trim_table(record)]), [out])
