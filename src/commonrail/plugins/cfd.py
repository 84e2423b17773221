"""Rate of injection of one hole over time, as programs of computational fluid dynamics (CFD) read it.

A table is linear between its points. The means over the samples are interpolated to the bounds between samples and set
to zero at both ends. The rate is then scaled so that the table gives the simulated mass.

``.foam``: a list of pairs, which Function1 `table` of OpenFOAM reads from a file (`format foam` and `file`; Foundation:
class `Foam::TableReaders::Foam`, "a list of Tuples"; ESI: `tableFile`). ``.dat``: two columns under lines of #.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats
from commonrail.base.errors import CommonrailError, InputError
from commonrail.base.output import line_text, write_text
from commonrail.cli.console import say
from commonrail.cli.options import check_file
from commonrail.cli.verbs.simulate import Run, heading
from commonrail.engine.status import Status

LEVEL = 0.9  # of the band
SIDES = ("lower", "upper")
HOLES = "nozzle.holes"


class Course(NamedTuple):
    """Mass flow of one hole [kg/s] at times (n,) [s], linear between them, with a description."""

    time: Floats
    rate: Floats
    what: str

    @property
    def mass(self) -> float:
        """Mass [kg] that flows."""
        return float(np.trapezoid(self.rate, self.time))


def write_foam(path: Path, run: Run, fitted: Path | None) -> list[Path]:
    """Write tables for OpenFOAM; see `write_dat`."""
    return _write(path, run, fitted, _foam_lines)


def write_dat(path: Path, run: Run, fitted: Path | None) -> list[Path]:
    """Write the rate of one hole, and both edges of its band if the run folder of a fit gives one.

    Parameters
    ----------
    path : Path
        The edges are in files of this name that end with ``_lower`` and ``_upper``.
    run : Run
        A simulation.
    fitted : Path or None
        Run folder of the simulated injector, if its calibrated values were not changed.

    Returns
    -------
    list of Path
        Files that were written.

    Raises
    ------
    InputError
        If nothing is injected, or the injection has not ended.
    OutputError
        If a file cannot be written.
    """
    return _write(path, run, fitted, _dat_lines)


_Lines = Callable[[Sequence[str], Course], Iterator[str]]


def _write(path: Path, run: Run, fitted: Path | None, lines: _Lines) -> list[Path]:
    courses = {path: course_of(run)}
    if fitted is not None:
        beside = [path.with_stem(f"{path.stem}_{side}") for side in SIDES]
        for file in beside:
            check_file(file, "--out")
        try:
            courses |= zip(beside, band_of(run, fitted), strict=True)
        except CommonrailError as error:
            say(f"no band: {error}")
    for file, course in courses.items():
        write_text(file, "\n".join(lines(_notes(run, course), course)) + "\n")
    return list(courses)


def course_of(run: Run) -> Course:
    """Mass flow of one hole, exact in mass; errors as in `write_dat`."""
    s = run.solution
    if s.status is Status.STILL_INJECTING:
        raise InputError(f"--out: {s.sentence} A file of CFD needs the whole injection; give a longer --horizon.")
    holes, time = run.injector.values[HOLES], s.time
    mass = float(s.injected[-1] - s.injected[0]) / holes
    rate = np.maximum(_at_bounds(time, s.mass_rate / holes), 0.0)  # no flow back into the nozzle
    course = Course(time, rate, f"{mass:.12g} kg flow, the injected mass over the number of holes")
    if not mass > 0.0:
        raise InputError(f"--out: {run.injector.name} injects nothing at this operating point, so there is no rate.")
    return course._replace(rate=rate * (mass / course.mass))


def band_of(run: Run, fitted: Path) -> tuple[Course, Course]:
    """Edges of the band of one hole's rate, from the parameter uncertainty of the fit.

    Raises `ConfigurationError` or `SimulationError` if there is no band, for instance without a fitted injection curve.
    """
    from commonrail.plugins.prediction.run import predict_rate
    from commonrail.runs.folder import read_fit

    s = run.solution
    say("predicting the band of the rate ...")
    band = predict_rate(*read_fit(fitted), run.point, s.time, level=LEVEL)
    factor = s.reference_density / run.injector.values[HOLES]
    what = f"edge of the {100.0 * LEVEL:g} % band at each time, from parameter uncertainty only; not a single injection"
    lower, upper = (np.maximum(_at_bounds(s.time, factor * edge), 0.0) for edge in band.alone[LEVEL])
    return Course(s.time, lower, f"lower {what}"), Course(s.time, upper, f"upper {what}")


def _at_bounds(time: Floats, means: Floats) -> Floats:
    """Values (n + 1,) at the bounds of samples, linear between the middles of their means (n,), zero at both ends."""
    middle = 0.5 * (time[1:] + time[:-1])
    return np.concatenate([[0.0], np.interp(time[1:-1], middle, means), [0.0]])


def _notes(run: Run, course: Course) -> list[str]:
    injector = run.injector
    return [
        f"simulated by commonrail {version('commonrail')}, not measured: {heading(run)}",
        *([f"synthetic: {injector.synthetic}"] if injector.synthetic else []),
        f"fuel {injector.fuel.name}, {run.solution.reference_density:.6g} kg/m3 at cylinder pressure",
        f"mass flow [kg/s] of one of {injector.values[HOLES]:g} holes over time [s] from the start of the simulation",
        course.what,
    ]


def _rows(course: Course) -> Iterator[tuple[str, str]]:
    """Points as texts, without the inner points of an interval without flow."""
    flows = course.rate > 0.0
    rows_to_write = flows | np.append(flows[1:], True) | np.insert(flows[:-1], 0, True)
    for time, rate in zip(course.time[rows_to_write].tolist(), course.rate[rows_to_write].tolist(), strict=True):
        yield f"{time:.12g}", f"{rate:.15g}"


def _foam_lines(notes: Sequence[str], course: Course) -> Iterator[str]:
    yield from (f"// {line_text(note)}" for note in notes)
    yield "("
    yield from (f"    ({time} {rate})" for time, rate in _rows(course))
    yield ")"


def _dat_lines(notes: Sequence[str], course: Course) -> Iterator[str]:
    yield from (f"# {line_text(note)}" for note in notes)
    yield "# time [s]  mass flow [kg/s]"
    yield from (f"{time} {rate}" for time, rate in _rows(course))
