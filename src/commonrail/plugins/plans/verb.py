"""commonrail plan: judge an injector, and a part on the bench, by a test plan. Options shared by such verbs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from commonrail.base.arguments import amount
from commonrail.base.errors import InputError
from commonrail.base.hooks import note
from commonrail.base.output import write_text
from commonrail.base.registry import part_digits
from commonrail.base.units import parse, to_text
from commonrail.cli.console import SIMULATING, print_result, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import (
    DecimalSign,
    Json,
    Settings,
    Threads,
    check_report,
    command_again,
    read_form,
    read_pressures,
    refuse_return_pressure,
    with_overrides,
)

if TYPE_CHECKING:
    from commonrail.cli.model_name import NamedModel
    from commonrail.physics.injector import Injector
    from commonrail.plugins.plans.study import TestPlan

StrokeRate = Annotated[
    str | None, Option(help="Stroke rate of tests that do not state it, e.g. 1000/min; for returns. [default: none]")
]
Page = Callable[[Any, str], str]  # from a result and the command that repeats it
Report = Annotated[Path | None, Option(metavar="FILE.html", help="Report on one page.")]


@dataclass(frozen=True)
class BenchOptions:
    """Command-line options for part, tests and bench, shared by all verbs that use a test plan."""

    model: Annotated[str, Argument(metavar="PART", help="Catalogue name, part number, injector file or run folder.")]
    tests: Annotated[Path, Argument(metavar="TESTS.csv", help="Test plan; a column bench holds the results of a part.")]
    cylinder_pressure: Annotated[
        str | None, Option(help="Pressure behind the nozzle. [default: as in the run's first data, else 0.5MPa]")
    ] = None
    return_pressure: Annotated[
        str | None,
        Option(help="Pressure at the end of the return line. [default: as in the run's first data, else 0.1MPa]"),
    ] = None
    decimal: DecimalSign = None
    time_step: Annotated[str, Option(help="Time step, e.g. 1us.")] = "1us"
    set_: Settings = ()
    threads: Threads = None
    json: Json = False

    def read(
        self, report: Path | None = None, stroke_rate: str | None = None
    ) -> tuple[Injector, TestPlan, dict[str, Any]]:
        """Injector, test plan and further arguments, all checked; first, that the report can be written."""
        from commonrail.engine.time_step import check_step
        from commonrail.plugins.plans.study import BENCH_PRESSURES, STROKE_RATES, load_plan

        check_report(report)
        tests = load_plan(self.tests, read_form(None, self.decimal, None, [self.tests]))
        model = _read_part(self.model)
        injector = with_overrides(model.injector, self.set_)
        refuse_return_pressure(injector)
        cylinder, back = read_pressures(self.cylinder_pressure, self.return_pressure, model.folder, BENCH_PRESSURES)
        step = check_step(parse(self.time_step, "s", "--time-step"))
        settings = {"cylinder_pressure": cylinder, "return_pressure": back, "time_step": step, "threads": self.threads}
        if stroke_rate is not None:
            settings["stroke_rate"] = amount(stroke_rate, "1/s", "--stroke-rate", STROKE_RATES)
        say(SIMULATING)
        return injector, tests, settings

    def show(
        self, result: Any, settings: Mapping[str, Any], report: Path | None, page: Page, *files: Path | None
    ) -> None:
        """Print a result, write its page, and name this and other files."""
        from commonrail.report.presenter import presenter_of

        content, record = presenter_of(result), result.record()
        if report is not None:
            pressures = {name: to_text(settings[name], "Pa") for name in ("cylinder_pressure", "return_pressure")}
            write_text(report, page(result, command_again(**pressures)))

        def shown() -> None:
            print_synthetic(record["synthetic"])
            lines = [line for line in content.lines(result) if line != record["synthetic"]]
            print_text(lines, content.tables(result), reserved=0)

        print_result(self.json, lambda: record, shown, [*files, report])


def _read_part(text: str) -> NamedModel:
    """Model of a name, file or run; for a part number, the type that lists it."""
    from commonrail.cli.model_name import read_model_name
    from commonrail.readers.part_number import LENGTH, find_part

    if (
        len(part_digits(text)) == LENGTH
        and not Path(text).suffix
        and Path(text).name == text
        and not Path(text).exists()
    ):
        matches = find_part(text)
        if not any(match.kind == "exact" for match in matches):
            reason = " ".join(match.reason for match in matches) or "The catalogue has no type for this kind of part."
            raise InputError(f"{text}: {reason}")
        note(matches[0].reason)
        text = matches[0].injector
    return read_model_name(text)


@table_verb
def plan(bench: BenchOptions, *, stroke_rate: StrokeRate = None, report: Report = None) -> None:
    """Judge a model, and a part on the bench, by a test plan.

    Every test is simulated. Its quantity is inside or outside the band; its distance from the nominal quantity is given
    in half bands. Results in the column bench are judged in the same way: the part passes or fails. Default pressures
    are those of an injector bench, 0.5 MPa behind the nozzle and 0.1 MPa in the return.

    \b
    Examples:
      commonrail plan cri2-16 examples/test-plan/plan.csv --cylinder-pressure 0.5MPa --return-pressure 0.1MPa
      commonrail plan runs/first plan.csv --stroke-rate 1000/min --report plan.html
    """
    from commonrail.plugins.plans.page import plan_html
    from commonrail.plugins.plans.run import plan as run_plan

    injector, tests, settings = bench.read(report, stroke_rate)
    bench.show(run_plan(injector, tests, **settings), settings, report, plan_html)
