"""commonrail diagnose and trim: which fault explains what a bench measured, and what corrects a sound part."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from commonrail.base.output import write_text
from commonrail.base.units import parse, to_text
from commonrail.cli.console import SIMULATING, print_result, print_text, say
from commonrail.cli.grammar import Argument, Option, verb
from commonrail.cli.options import (
    DecimalSign,
    Json,
    Settings,
    Threads,
    check_file,
    check_report,
    read_axis,
    read_form,
    read_pressures,
    refuse_return_pressure,
    with_overrides,
)
from commonrail.plugins.plans.verb import BenchCylinderPressure, BenchReturnPressure

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
    noise: Noise = "1%",
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
    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.diagnose.page import diagnosis_html, diagnosis_lines, diagnosis_tables
    from commonrail.plugins.diagnose.run import diagnose as run
    from commonrail.plugins.plans.study import BENCH_PRESSURES, load_plan

    check_report(report)
    tests = load_plan(file, read_form(None, decimal, None, [file]))
    named = read_model_name(model)
    injector = with_overrides(named.injector, set_)
    refuse_return_pressure(injector)
    cylinder, back = read_pressures(cylinder_pressure, return_pressure, named.folder, BENCH_PRESSURES)
    say(SIMULATING)
    record = run(
        injector,
        tests,
        faults=faults,
        noise=parse(noise, "1", "--noise"),
        sound=parse(sound, "1", "--sound"),
        nominal=nominal,
        stroke_rate=None if stroke_rate is None else parse(stroke_rate, "1/s", "--stroke-rate"),
        cylinder_pressure=cylinder,
        return_pressure=back,
        time_step=parse(time_step, "s", "--time-step"),
        threads=threads,
    ).record()
    if report is not None:
        stated = {"noise": noise, "sound": sound, "faults": faults}
        stated |= {"stroke-rate": stroke_rate, "decimal": decimal}
        stated |= {"cylinder-pressure": to_text(cylinder, "Pa"), "return-pressure": to_text(back, "Pa")}
        again = ["commonrail", "diagnose", model, str(file), *(part for text in set_ for part in ("--set", text))]
        again += ["--nominal"] if nominal else []
        again += [f"--{name}={value}" for name, value in stated.items() if value is not None]
        write_text(report, diagnosis_html(record, shlex.join([*again, f"--report={report}"])))
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
    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.diagnose.page import corrections_text, trim_lines, trim_table
    from commonrail.plugins.diagnose.trim import trim as run
    from commonrail.plugins.plans.study import BENCH_PRESSURES, load_plan

    check_file(out, "--out")
    tests = load_plan(file, read_form(None, decimal, None, [file]))
    named = read_model_name(model)
    injector = with_overrides(named.injector, set_)
    refuse_return_pressure(injector)
    cylinder, back = read_pressures(cylinder_pressure, return_pressure, named.folder, BENCH_PRESSURES)
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
        cylinder_pressure=cylinder,
        return_pressure=back,
        time_step=parse(time_step, "s", "--time-step"),
        threads=threads,
    )
    record = found.record()
    if out is not None:
        write_text(out, corrections_text(record))
    print_result(json, lambda: record, lambda: print_text(trim_lines(record), [trim_table(record)]), [out])
