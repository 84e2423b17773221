"""commonrail diagnose, trim and judge: likely fault of a part, correction of a sound part, or both on one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from commonrail.base.arguments import amount, fraction
from commonrail.base.output import write_text
from commonrail.cli.grammar import Option, table_verb
from commonrail.cli.options import check_distinct, check_file, read_axis
from commonrail.plugins.plans.verb import BenchOptions, Report, StrokeRate

SoundShare = Annotated[str, Option(help="Prior probability that the part is sound.")]
Step = Annotated[str, Option(help="Step of the corrections, e.g. 2us.")]


@dataclass(frozen=True)
class SoundOptions:
    """Options on sound parts and the bench, shared by the verbs that compare with sound parts."""

    noise: Annotated[
        str | None,
        Option(
            help="Bench noise: workshop, maker, or a share of a quantity. [default: maker for a trim, else workshop]"
        ),
    ] = None
    nominal: Annotated[
        bool, Option(help="Use the plan's nominal quantities as sound part, and the model only for changes.")
    ] = False
    faults: Annotated[
        Path | None,
        Option(metavar="FAULTS.toml", help="Faults and scatter of sound parts. [default: the shipped table]"),
    ] = None

    def read(self) -> dict[str, Any]:
        """Arguments of `diagnose`, `trim` and `judge`, all checked; without the noise if it is not stated."""
        from commonrail.plugins.diagnose.run import read_noise, read_table

        stated = {} if self.noise is None else {"noise": read_noise(self.noise, "--noise")}
        return {"nominal": self.nominal, "faults": read_table(self.faults), **stated}


def _read_step(step: str) -> float:
    from commonrail.plugins.diagnose.trim import STEPS

    return amount(step, "s", "--step", STEPS)


@table_verb
def diagnose(
    bench: BenchOptions,
    sound_parts: SoundOptions,
    *,
    sound: SoundShare = "50%",
    stroke_rate: StrokeRate = None,
    report: Report = None,
) -> None:
    """Find the fault that explains the results of a bench.

    Sound parts within makers' tolerances, and parts with each fault at each size, are simulated at the tests of the
    plan. Bayes' theorem gives probabilities over the faults and "sound". If several remain, the test that separates
    them is named. The answer depends on the model: a model fitted to other data may name another fault.

    \b
    Examples:
      commonrail diagnose cri2-16 examples/test-plan/results.csv --nominal
      commonrail diagnose runs/first results.csv --noise 2% --report diagnosis.html
    """
    from commonrail.plugins.diagnose.page import diagnosis_html
    from commonrail.plugins.diagnose.run import diagnose as run

    stated = {"sound": fraction(sound, "--sound"), **sound_parts.read()}
    injector, tests, settings = bench.read(report, stroke_rate)
    result = run(injector, tests, **settings, **stated)
    bench.show(result, settings, report, diagnosis_html)


@table_verb
def trim(
    bench: BenchOptions,
    sound_parts: SoundOptions,
    *,
    step: Step = "2us",
    rail_pressure: Annotated[
        str | None, Option(help="Rail pressures of the map, e.g. 40:160:40MPa. [default: five between the tests']")
    ] = None,
    energising_time: Annotated[
        str | None, Option(help="Energising times of the map, e.g. 200,500,900us. [default: five between the tests']")
    ] = None,
    out: Annotated[Path | None, Option(metavar="FILE.csv", help="Corrections over the map.")] = None,
    report: Report = None,
) -> None:
    """Correct a part's energising time from a few tests.

    The corrections at the tests, in whole steps, are the part's code. The map is the most likely correction for a part
    with this code, within makers' tolerances; a linear model estimates the remaining spread. A warning appears if the
    results look faulty or mistyped.

    \b
    Examples:
      commonrail trim cri2-16 examples/test-plan/sound.csv --nominal --out corrections.csv
      commonrail trim runs/first results.csv --step 1us --rail-pressure 40:160:40MPa --energising-time 300,600,900us
    """
    from commonrail.plugins.diagnose.page import corrections_text, trim_html
    from commonrail.plugins.diagnose.trim import trim as run

    check_file(out, "--out")
    check_distinct(out, report)
    axes: dict[str, Any] = {
        f"{key}s": None if text is None else read_axis(text, unit, f"--{key.replace('_', '-')}").tolist()
        for key, text, unit in (("rail_pressure", rail_pressure, "Pa"), ("energising_time", energising_time, "s"))
    }
    stated = {"step": _read_step(step), **sound_parts.read()}
    injector, tests, settings = bench.read(report)
    result = run(injector, tests, **axes, **settings, **stated)
    if out is not None:
        write_text(out, corrections_text(result))
    bench.show(result, settings, report, trim_html, out)


@table_verb
def judge(
    bench: BenchOptions,
    sound_parts: SoundOptions,
    *,
    sound: SoundShare = "50%",
    step: Step = "2us",
    stroke_rate: StrokeRate = None,
    report: Report = None,
) -> None:
    """Judge a part: pass or fail, causes, next test and trim.

    Does what `plan`, `diagnose` and `trim` do, with their options. Exit status 0 whether the part passes or fails.

    \b
    Examples:
      commonrail judge cri2-16 examples/test-plan/results.csv --nominal --report judgement.html
      commonrail judge "0 445 110 191" results.csv --nominal --noise workshop
    """
    from commonrail.plugins.diagnose.judgement import judge as judge_part
    from commonrail.plugins.diagnose.page import judgement_html

    stated = {"sound": fraction(sound, "--sound"), "step": _read_step(step), **sound_parts.read()}
    injector, tests, settings = bench.read(report, stroke_rate)
    bench.show(judge_part(injector, tests, **settings, **stated), settings, report, judgement_html)
