"""commonrail adapt: model of one part from a type of injector and a few reference quantities."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from commonrail.base.errors import InputError, StudyError
from commonrail.base.text import number, quantity
from commonrail.base.units import to_text
from commonrail.cli.console import print_json, print_lines, print_pairs, print_rows, print_synthetic, print_text, say
from commonrail.cli.grammar import Argument, Option, table_verb
from commonrail.cli.options import CylinderPressure, Json, ReturnPressure, Threads, check_file, read_pressures

if TYPE_CHECKING:
    from commonrail.physics.injector import Injector
    from commonrail.plugins.family.adapt import Adapted, Advice

SHOWN = 10  # reference points in the printed table


@table_verb
def adapt(
    injector_type: Annotated[Path, Argument(metavar="TYPE.toml", help="Type file, as `type` writes it.")],
    *,
    points: Annotated[
        Path | None,
        Option(
            "--from",
            metavar="POINTS.csv",
            help="Reference quantities of the part: columns rail_pressure, energising_time and quantity. With "
            "--advise candidates without quantity. [default with --advise: 40 to 160 MPa, 300 to 1400 us]",
        ),
    ] = None,
    out: Annotated[Path | None, Option(metavar="MODEL.toml", help="Injector file to be written.")] = None,
    advise: Annotated[
        bool,
        Option("--advise", help="Before the measurement: rank reference points by the errors expected with each."),
    ] = False,
    injector: Annotated[
        str | None,
        Option(
            metavar="MODEL",
            help="Injector of the part, for its nozzle and measured values: a file, catalogue name or run folder; "
            "@VARIANT selects another variant. [default: the type's]",
        ),
    ] = None,
    cylinder_pressure: CylinderPressure = None,
    return_pressure: ReturnPressure = None,
    tolerance: Annotated[str, Option(help="Relative tolerance of the quantities, besides 0.05 mm3.")] = "1.5%",
    flow_spread: Annotated[str, Option(help="Standard deviation of the nozzles' flow about their drawing.")] = "3%",
    strict: Annotated[
        bool, Option("--strict", help="Exit with status 2 if the part is doubted; the model is still written.")
    ] = False,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Make a part's model from its type and few quantities.

    One quantity determines the flow factor. With two or more, the type's parameters are fitted too; priors are their
    spreads. A warning names references that the model misses beyond their tolerance, and points where it injects
    nothing. --advise draws parts from the type and ranks reference points by how well they predict all others.

    \b
    Examples:
      commonrail adapt types/cri2.toml --advise --injector part.toml
      commonrail adapt types/cri2.toml --from points.csv --injector part.toml --out model.toml
    """
    from commonrail.base.arguments import fraction
    from commonrail.cli.model_name import read_model_name
    from commonrail.plugins.family.adapt import adapt as run
    from commonrail.readers.injector_writer import dump_injector

    model = None if injector is None else read_model_name(injector)
    part_injector = None if model is None else model.injector
    pressures = read_pressures(cylinder_pressure, return_pressure, None if model is None else model.folder)
    share, allowed = fraction(flow_spread, "--flow-spread"), fraction(tolerance, "--tolerance")
    if advise:
        _advise(injector_type, points, (injector, part_injector), pressures, share, threads, json)
        return
    if points is None or out is None:
        missing = "--from POINTS.csv" if points is None else "--out MODEL.toml"
        raise InputError(f"{missing} is missing: give the reference quantities and the file of the model.")
    check_file(out, "--out")
    adapted = run(
        injector_type,
        points,
        injector=part_injector,
        cylinder_pressure=pressures[0],
        return_pressure=pressures[1],
        tolerance=allowed,
        flow_spread=share,
        threads=threads,
    )
    header = (
        f"Made by commonrail adapt from {injector_type.name} and {points.name}; flow factor {adapted.flow_factor:.5g}."
    )
    dump_injector(adapted.injector, out, header=header)
    if json:
        print_json(_record(adapted, out))
    else:
        print_synthetic(adapted.injector.synthetic)
        free = len(adapted.calibration.best)
        pairs = [("flow factor", f"{adapted.flow_factor:.4f}"), ("parameters fitted", f"{free}")]
        if adapted.doubts.pulls:
            pulls = [f"{name} {pull:+.1f}" for name, pull in adapted.doubts.pulls.items()]
            pairs += [("chi-squared (expected)", f"{adapted.doubts.chi2:.3g} ({adapted.doubts.freedom})")]
            pairs += [("pulls [spreads]", ", ".join(pulls))]
        print_pairs(pairs, adapted.calibration.study.title)
        head = ["rail pressure", "energising time", "measured", "adapted", "type", "90 % of its parts"]
        print_rows(head, _rows(adapted), texts=0)
    doubt = _doubt(adapted)
    if doubt:
        say(f"warning: {doubt}")
    say(f"wrote {out}")
    if strict and doubt:
        raise StudyError(f"{out} is written, but --strict makes the warning an error: {doubt}")


def _advise(
    injector_type: Path,
    points: Path | None,
    injector: tuple[str | None, Injector | None],
    pressures: tuple[float, float],
    flow_spread: float,
    threads: int | None,
    json: bool,
) -> None:
    """Print the ranking of reference points, and the next steps."""
    from commonrail.plugins.family.adapt import advise, grid, read_candidates

    candidates = grid(*pressures) if points is None else read_candidates(points, *pressures)
    advice = advise(injector_type, candidates, injector=injector[1], flow_spread=flow_spread, threads=threads)
    if json:
        print_json(_advice_record(advice))
        return
    print_rows(
        ["rail pressure", "energising time", "expected rms", "90 % of parts below", "parts served"],
        [_advice_row(advice, i) for i in advice.order[:SHOWN]],
        f"reference points of {injector_type.name}, best first",
        texts=0,
    )
    drawn = (
        f"Without a reference: {advice.without * 1e9:.2f} mm³ rms. {advice.draws} parts were drawn from the spreads of "
        "the type, independently for each parameter; no measurement of the part was used."
    )
    injector_option = [] if injector[0] is None else ["--injector", injector[0]]
    cylinder, back = (to_text(pressure, "Pa").replace(" ", "") for pressure in pressures)
    options = [*injector_option, "--cylinder-pressure", cylinder, "--return-pressure", back]
    again = shlex.join(["commonrail", "adapt", str(injector_type), *options, "--from", "points.csv"])
    step = (
        'Next: measure at the first point, write it into points.csv below "rail_pressure [MPa],energising_time [us],'
        'quantity [mm3]", then'
    )
    print_text((), notes=[drawn])
    print_lines([step])
    click.echo(f"  {again} --out model.toml")


def _advice_row(advice: Advice, i: int) -> list[str]:
    point = advice.points[i]
    return [
        quantity(point.initial_pressures()[0], "Pa"),
        quantity(point.pulses[0].duration, "s"),
        f"{advice.expected[i] * 1e9:.2f} mm³",
        f"{advice.upper[i] * 1e9:.2f} mm³",
        f"{100 * advice.usable[i]:.0f} %",
    ]


def _advice_record(advice: Advice) -> dict[str, Any]:
    points = [
        {
            "rail_pressure": point.initial_pressures()[0],
            "energising_time": point.pulses[0].duration,
            "expected_rms": number(float(advice.expected[i])),
            "upper_rms": number(float(advice.upper[i])),
            "usable": float(advice.usable[i]),
        }
        for i, point in enumerate(advice.points)
    ]
    order = list(advice.order)
    head = {"schema": 1, "kind": "advice", "draws": advice.draws, "without_reference": advice.without}
    return {**head, "points": points, "order": order}


def _doubt(adapted: Adapted) -> str:
    """Reasons to doubt that the part is sound, as a sentence; empty without any."""
    doubts = adapted.doubts
    if not doubts.sentences:
        return ""
    change = f" A single change of the type explains it best: {doubts.change}." if doubts.change else ""
    return f"{adapted.points.name}: probably not a sound part of the type: {'; '.join(doubts.sentences)}.{change}"


def _rows(adapted: Adapted) -> list[list[str]]:
    def row(i: int) -> list[str]:
        point, band = adapted.points.points[i], (adapted.doubts.low[i], adapted.doubts.high[i])
        measured, before, after = (
            f"{volumes[i] * 1e9:.3f} mm³" for volumes in (adapted.points.quantity, adapted.before, adapted.after)
        )
        between = " to ".join(f"{end * 1e9:.3f}" for end in band) + " mm³"
        at = quantity(point.initial_pressures()[0], "Pa"), quantity(point.pulses[0].duration, "s")
        return [*at, measured, after, before, between]

    return [row(i) for i in range(len(adapted.before))]


def _record(adapted: Adapted, out: Path) -> dict[str, Any]:
    return {
        "schema": 1,
        "kind": "adaptation",
        "model": str(out),
        "synthetic": adapted.injector.synthetic,
        "flow_factor": adapted.flow_factor,
        "parameters": adapted.calibration.best,
        "measured": adapted.points.quantity.tolist(),
        "type": adapted.before.tolist(),
        "adapted": adapted.after.tolist(),
        "type_low": adapted.doubts.low.tolist(),
        "type_high": adapted.doubts.high.tolist(),
        "chi2": adapted.doubts.chi2,
        "freedom": adapted.doubts.freedom,
        "pulls": adapted.doubts.pulls,
        "doubt": _doubt(adapted),
        "limits": list(adapted.limits),
    }
