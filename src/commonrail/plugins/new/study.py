"""Write a study from an injector and data files, with free parameters screened at the points of the data."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from commonrail.base.arguments import COUNTS, file_path
from commonrail.base.arrays import Floats
from commonrail.base.errors import CommonrailError, ConfigurationError, InputError, nearest, one_line
from commonrail.base.hooks import note, quiet
from commonrail.base.input import read_plain
from commonrail.base.output import replacing, write_text, writing
from commonrail.base.text import join_words
from commonrail.base.units import fits, parse, to_text
from commonrail.calibration.influence import around
from commonrail.calibration.parameter import Parameter
from commonrail.calibration.plausibility import Delay, common_delays, unit_findings
from commonrail.calibration.space import Space
from commonrail.calibration.study import step_for_all
from commonrail.calibration.usual import BENCH, usual_parameter, with_usual_prior
from commonrail.data.base import DataSet
from commonrail.data.quantities.data import QuantityData, chosen_rows
from commonrail.data.registry import get_kind
from commonrail.data.simulator import Simulator
from commonrail.data.study_block import Context, drive_unit
from commonrail.physics.injector import FUEL_TEMPERATURE, Injector
from commonrail.physics.variants import unread_parameters
from commonrail.readers.columns import PLAIN, TIME, Column, FileForm, Sheet
from commonrail.readers.formats import find_format
from commonrail.readers.injector import load_injector
from commonrail.readers.injector_writer import dump_injector
from commonrail.readers.location import Place, Reach
from commonrail.readers.operating_points import find_pattern
from commonrail.readers.overview import RATES, UNKNOWN, ZERO, Survey, survey
from commonrail.readers.quantity_matrix import GivenUnits
from commonrail.readers.tables import open_sheet
from commonrail.readers.toml import read_model, read_toml, value_text
from commonrail.runs.folder import final_text, new_folder

# A folder to start from: a commented injector, a study and an example curve, which the user replaces.

# Files of the folder `template`, in reading order.
TEMPLATES = ("README.md", "injector.toml", "study.toml", "data/evi.csv")


def write_new(folder: Path) -> list[Path]:
    """Write an injector, a study, an example curve and a README into a new or empty folder.

    Returns the written files. Raises `InputError` if the folder is not empty, and `OutputError` if it cannot be
    written.
    """
    templates = resources.files(__package__) / "template"
    return write_into(folder, {name: (templates / name).read_bytes() for name in TEMPLATES})


def write_into(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write files into a new or empty folder.

    `files`: content by path relative to the folder. Raises `InputError`, `OutputError` as `write_new`.
    """
    with new_folder(folder) as place, writing(folder):
        for name, content in files.items():
            path = place / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    return [folder / name for name in files]


# Free parameters without a screening: those with the largest effect and the least known from drawings.
_FREE = ("control_chamber.z_hole_diameter", "control_chamber.a_hole_diameter", "nozzle.discharge_maximum")
_FREE_OF_DIRECT = ("nozzle.discharge_maximum", "needle_seat.diameter")

_BENCH = ("cylinder_pressure", "return_pressure")
_OF_NOTES = "by a note above the map"
_MEANINGS = {
    "cylinder_pressure": "pressure behind the nozzle",
    "return_pressure": "pressure at the end of the return line",
    "rail_pressure": "not stated by the file",
    "energising_time": "not stated by the file",
    "time": "column of the times",
    "rate": "column of the rate of injection",
    "drive": "column of the measured current or voltage, which drives this injector",
    "time_zero": "time of the file at which energising starts",
    "shots": "offset, from the trigger's edge to the start of energising",
}
# Keys of a rate whose value may be assumed, since the content of the file does not state it.
_CHECKED = {
    "time_zero": "time of the file at which energising starts; files do not state it",
    "time_unit": "unit by the name of the column",
    "rate_unit": "unit by the names of the columns",
    "rail_pressure": "by the name of the file or its column",
    "energising_time": "by the name of the file or its column",
    "shots": "the only current starts to rise at the offset after the trigger's edge, within one sample",
}
# Weight of a map next to rates. On two benches of 50 points and 120 shots (`studies/walk_bench.py`, seeds 1 and 2) it
# lowers the rms of the quantities above 3 mm³ from 0.9 and 2.7 % to 0.7 and 0.9 %, and raises the largest error of a
# curve from 6.0 and 4.8 % to 6.3 and 5.6 %.
WEIGHT = 100
# Substitutes for open keys in the screening, whose result hardly depends on them.
_SUBSTITUTES = {"cylinder_pressure": "5 MPa", "return_pressure": "0.5 MPa", "time_zero": ZERO, "offset": ZERO}


class StatedByUser(NamedTuple):
    """Values stated by the user for all files, as texts with units; empty if they are to be stated later.

    `pressures` of the bench and `points` of rates: texts by the keys of a study; `form` and `units`: for files that
    lack them; `free`: parameters to fit, screened if empty.
    """

    pressures: Mapping[str, str]
    points: Mapping[str, str] = {}
    form: FileForm = PLAIN
    units: GivenUnits = GivenUnits()
    free: tuple[str, ...] = ()


class Started(NamedTuple):
    """Written study.

    `files`: all written files; `surveys`: how each data file was understood; `open`: keys to state; `assumed`: keys
    with assumed values, to check; `free`: parameters proposed by a screening at the points of the data, most
    influential first; empty without a screening.
    """

    study: Path
    files: tuple[Path, ...]
    surveys: tuple[Survey, ...]
    open: tuple[str, ...]
    assumed: tuple[str, ...]
    free: tuple[str, ...]


def new(
    folder: str | Path,
    injector: str | Path | None = None,
    files: Sequence[str | Path] = (),
    stated: StatedByUser | None = None,
) -> Started:
    """Write a small study to start from, into a new or empty folder.

    Parameters
    ----------
    folder : str or path
    injector : str or path, optional
        Name of the catalogue or file, for a study of data files.
    files : list of path
        Data files of the study: maps, traces, records of shots. Default: a synthetic example curve.
    stated : StatedByUser, optional
        Facts missing from the files, such as the cylinder pressure of the bench.

    Returns
    -------
    Started
        Written files; keys to state or check.

    Raises
    ------
    InputError
        If the folder is not empty, or a file cannot be read or holds no data for a study.
    ConfigurationError
        If files come without an injector, or an injector or a statement without files.
    """
    path = file_path(folder, "folder")
    if files and injector is not None:
        return write_study_from(path, str(injector), [Path(file) for file in files], stated or StatedByUser({}))
    if files or injector is not None or stated is not None:
        raise ConfigurationError("A study of data files needs both files and an injector; give both, or neither.")
    written = write_new(path)
    return Started(study=path / "study.toml", files=tuple(written), surveys=(), open=(), assumed=(), free=())


def write_study_from(folder: Path, injector: str, sources: Sequence[Path], stated: StatedByUser) -> Started:
    """Write a study into a new or empty folder, with copies of the data files.

    `injector`: as in `load_injector`; a file is copied, completed if it names other files; `sources`: data files, see
    `survey`. Raises `InputError` if the folder is not empty, a file cannot be read or holds no data for a study, or two
    files have one name. Raises `OutputError` if the folder cannot be written.
    """
    model = load_injector(injector)
    surveys = tuple(survey_file(path, stated) for path in sources)
    free_by_name = list(usual_space(model, stated.free).parameters) if stated.free else []
    names = [path.name for path in sources]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"Two of the data files have the name {twice}; rename one.")
    _check_points(surveys, stated.points)
    blocks = [block_of_file(surveyed, surveys, model, stated) for surveyed in surveys]
    with new_folder(folder) as place, writing(folder):
        (place / "data").mkdir()
        copies = [_copy(path, place / "data" / path.name) for path in sources]
        if injector.endswith(".toml") or "@" in injector:  # a study takes no variant
            copies.append(_copy_injector(injector, model, place / "injector.toml"))
            injector = "injector.toml"
        study = place / "study.toml"
        maps = [survey.quantity_map for survey in surveys if survey.quantity_map]
        noted = {key: text for quantity_map in maps for key, text in quantity_map.notes.items()}
        bench = {key: stated.pressures.get(key) or noted.get(key, UNKNOWN) for key in _BENCH}
        read = [key for key in _BENCH if key in noted and not stated.pressures.get(key)]
        trial = _Trial(model, [bench | block for block in blocks], study)
        if trial.error:  # the copies of the files go with the folder
            sentence = trial.error
            for path in sources:
                sentence = sentence.replace(str(folder / "data" / path.name), str(path))
            raise InputError(sentence)
        free = free_by_name or trial.screen_parameters()
        delay, doubts = trial.delay(), trial.doubt_units(surveys)
        for curve in delay.curves if delay else ():
            blocks[trial.find_block(curve.name)]["meter"] = BENCH
        warmth = _temperature_lines(model, noted.get("fuel_temperature", ""))
        lines = [
            *_head(injector, bench, [survey.path.name for survey in surveys], read),
            *_meter_lines(delay),
            *warmth,
            *data_lines(surveys, blocks, stated, doubts),
            *_parameter_lines(model, free, bool(free_by_name)),
            *_optimiser_lines(blocks),
        ]
        write_text(study, "\n".join(lines))
    missing = [
        *open_keys(bench),
        *(f"data[{i}].{key}" for i, block in enumerate(blocks, 1) for key in open_keys(block)),
    ]
    assumed = (
        read
        + [f"meters.{BENCH}.delay"] * (delay is not None)
        + ["fixed[1].value"] * bool(warmth)
        + [f"data[{i + 1}].rate_unit" for i in doubts]
        + [
            f"data[{i}].{'shots.offset' if key == 'shots' else key}"
            for i, block in enumerate(blocks, 1)
            for key in block
            if is_to_check(key, block, stated)
        ]
    )
    screened = () if free_by_name else tuple(parameter.name for parameter in free)
    files = tuple(folder / path.relative_to(place) for path in (study, *copies))
    return Started(
        study=files[0], files=files, surveys=surveys, open=tuple(missing), assumed=tuple(assumed), free=screened
    )


def survey_file(path: Path, stated: StatedByUser) -> Survey:
    """Survey a file; units stated by the user apply only if the file lacks them.

    `InputError` if it cannot be read, or holds no data for a study.
    """
    is_book = find_format(path) == "xlsx"
    form = stated.form._replace(encoding="") if is_book else stated.form._replace(sheet="")
    result = survey(path, form)
    if not result.block and any(stated.units.by_kind().values()):
        result = survey(path, form, stated.units)
    if not result.block:
        raise InputError(f"{result.path}: {result.reason()}; correct the file, or write its block by hand.")
    return result


def _check_points(surveys: Sequence[Survey], points: Mapping[str, str]) -> None:
    """Refuse an operating point of the command line that contradicts the name of a file, or that all files state."""
    rates = [survey for survey in surveys if survey.block["kind"] == "rate"]
    for key, text in points.items():
        option, unit = f"--{key.replace('_', '-')} {text}", "Pa" if key == "rail_pressure" else "s"
        values = {survey.path.name: survey.block[key] for survey in rates if key in survey.block}
        if text and not values:
            raise InputError(f"{option}: every file states its operating points, or has no rates; omit the option.")
        for name, value in values.items() if text else ():
            if value != UNKNOWN and not math.isclose(parse(value, unit), parse(text, unit)):
                raise InputError(f"{option}: {name} states {value} by a name; omit the option, or rename it.")


def block_of_file(survey: Survey, surveys: Sequence[Survey], model: Injector, stated: StatedByUser) -> dict[str, Any]:
    """Keys of the block of a file, `UNKNOWN` if they must be stated; `surveys`: of all files."""
    names = [s.path.stem for s in surveys]
    name = survey.path.name if names.count(survey.path.stem) > 1 else survey.path.stem
    block: dict[str, Any] = {"kind": survey.block["kind"], "name": name, "role": "fit"}
    block |= survey.block | {"file": f"data/{survey.path.name}"}
    block |= {key: text for key, text in stated.points.items() if text and key in block and block["kind"] == "rate"}
    if (unit := drive_unit(model)) and block["kind"] == "rate" and "shots" not in block and "layout" not in block:
        block["drive"] = _drive(survey, unit)
    if "shots" in block:
        block["shots"] |= {"offset": _offset(survey, block["shots"]["trigger"])}
    return block | {"source": f"{survey.path.name}, as it came", "synthetic": survey.synthetic}


def _drive(survey: Survey, unit: str) -> dict[str, Any]:
    """Key with the only possible channel of the measured drive, or with a name pattern for several channels.

    Energising starts at time 0, so a record that begins earlier shows the zero of the sensor.
    """
    channels = [channel for channel in survey.channels if channel.kind == unit]
    names = [channel.name for channel in channels]
    column = find_pattern(names) if "columns" in survey.block else names[0] if len(names) == 1 else None
    stated = {"unit": channels[0].unit} if column and channels[0].unit_by_name else {}
    starts = [any_channel.low for any_channel in survey.channels if any_channel.kind == "s"] + [
        any_channel.times[0] for any_channel in channels if any_channel.times
    ]
    rest = {"zero_at_rest": True} if unit == "A" and min(starts, default=0.0) < 0.0 else {}
    return {"column": column or UNKNOWN, **stated, **rest}


BEGUN = 0.1  # share of a current's range at which it begins to rise; chosen, above the noise of a clamp
EARLY = 0.5  # share of the time between two triggers within which a rise belongs to the earlier one; chosen


def _offset(survey: Survey, trigger: str) -> str:
    """Time from the trigger's edge to the start of energising, by the rise of the only current.

    `UNKNOWN` without such a current, or if its rises scatter about the edges by more than two samples.
    """
    currents = [channel for channel in survey.channels if channel.kind == "A" and channel.name != trigger]
    if len(currents) != 1 or not (step := currents[0].step):
        return UNKNOWN
    sheet = open_sheet(survey.path)
    edges, rises = _rises(sheet, trigger, 0.5), _rises(sheet, currents[0].name, BEGUN)
    if not len(edges) or not len(rises):
        return UNKNOWN
    following = rises[np.clip(np.searchsorted(rises, edges - 2.0 * step), 0, len(rises) - 1)] - edges
    middle = float(np.median(following))
    most = EARLY * float(np.median(np.diff(edges))) if len(edges) > 1 else np.inf
    if not -2.0 * step <= middle <= most or (np.abs(following - middle) > 2.0 * step).mean() > BEGUN:
        return UNKNOWN
    return to_text(step * round(middle / step), "s", 4)


def _rises(sheet: Sheet, name: str, share: float) -> Floats:
    """Times [s] midway between the samples where a channel rises through a share of its range."""
    table = sheet.take([Column(TIME, "s", increasing=True), Column(name, "1")])
    time, value = table.columns[TIME], table.columns[name]
    level = value.min() + share * (value.max() - value.min())
    rising = np.flatnonzero((value[:-1] < level) & (value[1:] >= level))
    return np.asarray(0.5 * (time[rising] + time[rising + 1]))


def _copy_injector(source: str, model: Injector, target: Path) -> Path:
    """Copy an injector's file; a variant, or a file that refers to others, is written with all values."""
    document = read_toml(Path(source))[0] if source.endswith(".toml") else {}
    if not document or str(document.get("base", "")).endswith(".toml") or "file" in document.get("fuel", {}):
        dump_injector(model, target)
        return target
    return _copy(Path(source), target)


class _Trial:
    """Data sets of blocks, read before the study is written, with substitutes for open keys.

    `blocks`: keys of each, with the keys of the bench; `study`: path of the file.
    """

    def __init__(self, model: Injector, blocks: Sequence[Mapping[str, Any]], study: Path) -> None:
        self.model, self.blocks = model, blocks
        self.study = study
        self.space, self.error = usual_space(model), ""
        self.step = step_for_all(model, self.space)
        self.sets: list[tuple[int, DataSet]] = []
        for i in range(len(blocks)):
            try:
                self.sets += [(i, data) for data in self._read_block(i)]
            except CommonrailError as error:
                self.error = final_text(str(error), study.parent)

    def _read_block(self, i: int) -> list[DataSet]:
        """Data sets of a block; empty without operating points."""
        assumed = _assume_open_values(self.blocks[i])
        if open_keys(assumed):
            return []
        kind = get_kind(self.blocks[i]["kind"])
        context = Context(self.model, self.step, Reach(self.study, False), (Place(str(self.study)) / "data")[i])
        with quiet():  # reading the study gives the same notes
            return list(kind.read_all(read_model(kind.model, assumed, context.at), context))

    def screen_parameters(self) -> list[Parameter]:
        """Screen the parameters to free at the operating points of the data; empty without operating points.

        A large map is screened on some of its pressures and times.
        """
        left, data = MOST_SIMULATIONS // len(around(self.space, self.space.reference).values), list[DataSet]()
        sets = sorted((data_set for _, data_set in self.sets), key=lambda data_set: len(data_set.simulated_points))
        for rank, data_set in enumerate(sets):
            data.append(_thin(data_set, left // (len(sets) - rank)))
            left -= len(data[-1].simulated_points)
        free = screen(self.model, self.space, data, self.step)
        if not free:
            reason = "the data do not depend on them, or state no operating points."
            note(f"Usual parameters are free within 10 %, because the screening failed: {reason}")
        return free

    def delay(self) -> Delay | None:
        """Common delay of all curves with a stated time zero and operating point."""
        simulator = Simulator(self.model, (), self.step)
        curves = [
            curve for i, curve in self.sets if curve.bounds is not None and not {*open_keys(self.blocks[i])} & _TIMES
        ]
        return next(iter(common_delays((curve, curve.score(simulator)) for curve in curves)), None)

    def find_block(self, name: str) -> int:
        """Index of the block with a data set of this name."""
        return next(i for i, data in self.sets if data.name == name)

    def doubt_units(self, surveys: Sequence[Survey]) -> dict[int, str]:
        """Reasons to doubt that rates are volumes, by index of their blocks."""
        doubts = {}
        for i, surveyed in enumerate(surveys):
            units = [channel.unit for channel in surveyed.channels if channel.kind in RATES]
            texts = [
                surveyed.path.stem,
                *(text for channel in surveyed.channels for text in (channel.name, channel.unit)),
            ]
            masses = [text for text in texts if _MASS.search(text)]
            if masses and units and all(fits(unit, "m3/s") for unit in units):
                doubts[i] = one_line(
                    f'{surveyed.path.name}: its rate is read in {units[0]}, and "{masses[0]}" names a mass'
                )
        for finding in unit_findings([surveyed for _, surveyed in self.sets], self.model):
            doubts[self.find_block(finding.subject)] = finding.sentence
        return doubts


_TIMES = {"time_zero", "shots.offset"}  # keys that an onset needs
_MASS = re.compile(r"(?<![a-z])mg(?![a-z])", re.I)


def _thin(data: DataSet, most: int) -> DataSet:
    """Thin a map of more than `most` points to evenly spaced pressures and times."""
    if not isinstance(data, QuantityData) or len(data.points) <= most:
        return data
    rails = np.array([point.initial_pressures()[0] for point in data.points])
    times = np.array([sum(pulse.duration for pulse in point.pulses) for point in data.points])
    for stride in range(2, len(rails) + 1):
        rows = np.isin(rails, np.unique(rails)[::stride]) & np.isin(times, np.unique(times)[::stride])
        if 0 < np.count_nonzero(rows) <= most:
            note(f"The parameters to free are screened at {np.count_nonzero(rows)} of {len(rails)} points of the map.")
            return chosen_rows(data, rows)
    return data


def _assume_open_values(keys: Mapping[str, Any]) -> dict[str, Any]:
    """Replace open keys by the substitutes of the screening."""
    return {
        key: _assume_open_values(value)
        if isinstance(value, Mapping)
        else _SUBSTITUTES.get(key, value)
        if value == UNKNOWN
        else value
        for key, value in keys.items()
    }


def _copy(source: Path, target: Path) -> Path:
    with replacing(target, "wb") as stream:
        stream.write(read_plain(source))
    return target


def _temperature_lines(model: Injector, text: str) -> list[str]:
    """Lines that fix the fuel temperature noted by the bench."""
    if not text:
        return []
    value, (low, high) = parse(text, "K"), model.fuel.temperature_range
    if not low <= value <= high:
        note(f"The fuel temperature of the bench, {text}, is outside the range of {model.fuel.name} and is not used.")
        return []
    lines = ["[[fixed]]", f"name = {_toml(FUEL_TEMPERATURE)}", f"value = {_toml(text)} # CHECK IT: {_OF_NOTES}"]
    return [*lines, 'mark = "M"', f"source = {_toml(_OF_NOTES)}", ""]


def _head(injector: str, bench: Mapping[str, str], files: Sequence[str], noted: Sequence[str]) -> list[str]:
    data = join_words(files) if len(files) < 4 else f"{len(files)} files"
    return [
        "# A calibration: which data, which parameters are free, within which bounds. Paths start at this folder.",
        "",
        'format = "commonrail-study/1"',
        f"title = {_toml(f'Calibration of {injector} by {data}')}",
        f"injector = {_toml(injector)}",
        "seed = 1 # the same seed gives the same result",
        *(_line(key, value) + f" # CHECK IT: {_OF_NOTES}" * (key in noted) for key, value in bench.items()),
        "",
    ]


def _meter_lines(delay: Delay | None) -> list[str]:
    """Lines of a meter with a free delay, suggested by the onsets of the curves."""
    if delay is None:
        return []
    note(f"{delay.sentence()}: the delay of their meter is free, as [meters.{BENCH}].delay; check it.")
    lines = [f"[meters.{BENCH}]", f"delay = {delay.text()} # CHECK IT: {delay.sentence()}, or their time_zero is wrong"]
    return [*lines, 'mark = "E"', f"source = {_toml(delay.sentence())}", ""]


def data_lines(
    surveys: Sequence[Survey],
    blocks: Sequence[dict[str, Any]],
    stated: StatedByUser,
    doubts: Mapping[int, str] = MappingProxyType({}),
) -> list[str]:
    """Lines of the blocks of files, with comments on keys to state or check; `doubts` by block."""
    lines: list[str] = []
    for i, (surveyed, block) in enumerate(zip(surveys, blocks, strict=True)):
        lines.append(f"# {surveyed.taken_for}{'; ' + surveyed.said if surveyed.said else ''}")
        if i in doubts:
            note(doubts[i])
            lines.append(f"# CHECK IT: {doubts[i]}")
        lines.append("[[data]]")
        lines += [_line(key, value, is_to_check(key, block, stated)) for key, value in block.items()]
        if block["kind"] == "quantities" and "weight" not in block and any(other["kind"] == "rate" for other in blocks):
            lines.append(
                f"weight = {WEIGHT} # gives few quantities more influence in the search next to many samples of rates; "
                "the most likely values and intervals use the noise of each set instead"
            )
        lines.append("")
    return lines


def _parameter_lines(model: Injector, free: Sequence[Parameter], is_named: bool) -> list[str]:
    heading = (
        "# Free: unmeasured parameters that affect these data, most influential first; usual errors are their priors."
    )
    lines = [heading] if free and not is_named else []
    for parameter in free:
        low, high = (to_text(bound, parameter.unit, 4) for bound in (parameter.lower, parameter.upper))
        lines += [
            "[[parameter]]",
            f"name = {_toml(parameter.name)}",
            f"lower = {_toml(low)}",
            f"upper = {_toml(high)}",
            *_prior_line(parameter),
            "",
        ]
    for name in () if free else _FREE if _FREE[0] in model.values else _FREE_OF_DIRECT:
        lines += ["[[parameter]]", f"name = {_toml(name)}", 'below = "10 %"', 'above = "10 %"', ""]
    return lines


def _prior_line(parameter: Parameter) -> list[str]:
    """Line of the prior of a parameter, if it has one."""
    if parameter.prior is None:
        return []
    value, sigma = (to_text(size, parameter.unit, 4) for size in (parameter.prior.value, parameter.prior.sigma))
    source = _toml(parameter.prior.source)
    return [f"prior = {{ value = {_toml(value)}, sigma = {_toml(sigma)}, source = {source} }}"]


def _optimiser_lines(blocks: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines of the optimiser for such data.

    On benches of a map and 120 shots the staged search reached two thirds of the J of the evolution in the same time
    (`studies/walk_bench.py`): a map has cliffs where quantities become zero.
    """
    if any(block["kind"] == "quantities" for block in blocks):
        head = "[optimiser] # `members` are screened, ensembles contract, least squares follow, `polish` refines"
        search = [
            'method = "staged least squares"',
            "members = 400",
            "inversions = 12",
            "generations = 64",
            "polish = 3",
        ]
    else:
        head = "[optimiser] # differential evolution, then `polish` refinements by least squares"
        search = ["members = 24", "generations = 30", "polish = 3"]
    return [head, *search, ""]


def is_to_check(key: str, block: Mapping[str, Any], stated: StatedByUser) -> bool:
    """Return whether a key has an assumed value: neither the content of the file nor the user states it."""
    return (
        key in _CHECKED
        and block["kind"] == "rate"
        and block[key] not in (UNKNOWN, stated.points.get(key))
        and (key != "shots" or block[key]["offset"] != UNKNOWN)
        and (key != "time_zero" or block[key] == ZERO)
    )


def open_keys(keys: Mapping[str, Any]) -> list[str]:
    """Keys with unknown values; keys of an inline table are prefixed by its name."""
    unknown_keys = [key for key, value in keys.items() if value == UNKNOWN]
    for key, value in keys.items():
        unknown_keys += [f"{key}.{inner}" for inner in open_keys(value)] if isinstance(value, Mapping) else []
    return unknown_keys


def _line(key: str, value: Any, is_checked: bool = False) -> str:
    comments = {
        "role": '"fit", or "validation": compared, not fitted',
        "window": 'samples that count, from the start of energising; for a meter: meter = "NAME", [meters.NAME]',
        "synthetic": "part of the data that is not measured",
    }
    if is_checked:
        comments[key] = f"CHECK IT: {_CHECKED[key]}"
    if open_keys({key: value}) and key in _MEANINGS:
        comments[key] = f"STATE IT: {_MEANINGS[key]}"
    return f"{key} = {_toml(value)}" + (f" # {comments[key]}" if key in comments else "")


def _toml(value: Any) -> str:
    """Value as TOML: text, boolean, list or inline table."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {value_text(item)}" for key, item in value.items()) + " }"
    return value_text(value)


# Screening of an injector's parameters at the points of measured data, for a first fit.

# Factor on the ranges of parameters named by the user: wide enough for other injector types.
NAMED = 2.0
# Smallest rms change of the data, relative to their rms, from which a parameter is freed: about the noise of a bench.
# If the model is far from the part, slopes are a weak guide; a prior then holds what the data do not determine.
SEEN = 0.01
MOST = 12  # freed parameters
MOST_SIMULATIONS = 40_000  # about 10 s


def usual_space(injector: Injector, names: Sequence[str] = ()) -> Space:
    """Parameters of an injector within usual ranges about their values; default: all unmeasured parameters.

    The default excludes counts, zeros and the temperature of the fuel. Raises `InputError` for an unknown name, and
    `ConfigurationError` for a parameter that the variant does not read or that has no range.
    """
    for name in names:
        if name not in injector.values:
            raise InputError(f"{injector.name} has no parameter {name}{nearest(name, injector.values)}.")
    injector.check_read(names)
    widening = NAMED if names else 1.0
    return Space([usual_parameter(injector, name, widening) for name in names or _names(injector)])


def screen(injector: Injector, space: Space, data: Sequence[DataSet], time_step: float) -> list[Parameter]:
    """Screen the parameters of a space for those to free, most influential first; empty if the data are too large.

    From the local slopes of the simulated data, each step takes the parameter whose range changes the data most beyond
    the effects of the parameters before it, while the change is at least `SEEN` (pivoted Gram-Schmidt; Yao et al. 2003,
    Polym. React. Eng. 11, 563). `time_step` in [s].
    """
    place = around(space, space.reference)
    left = MOST_SIMULATIONS // len(place.values)
    simulator = Simulator(injector, space.names, time_step)
    slopes = []
    for data_set in sorted(data, key=lambda data_set: len(data_set.simulated_points)):
        left -= len(data_set.simulated_points)
        size = float(np.linalg.norm(data_set.measured))
        if left >= 0 and size > 0.0:
            slopes.append(place.slopes(data_set.simulated(simulator, place.values)) / size)
    if not slopes:
        return []
    changes = np.concatenate(slopes) / np.sqrt(len(slopes))
    seen = _best_seen(np.where(np.isfinite(changes).all(axis=0), changes, 0.0))
    return [with_usual_prior(injector, space.parameters[i]) for i in seen]


def _best_seen(changes: Floats) -> list[int]:
    """Order columns of changes (n, parameters) by their effect on the data, up to `MOST`."""
    rest, order = changes.copy(), list[int]()
    while len(order) < MOST:
        further = np.linalg.norm(rest, axis=0)
        i = int(np.argmax(further))
        if not further[i] >= SEEN:
            break
        order.append(i)
        direction = rest[:, i] / further[i]
        rest -= np.outer(direction, direction @ rest)
    return order


def _names(injector: Injector) -> list[str]:
    of_the_model = (
        "solenoid.turns",
        "drive.regulator_gain",
        FUEL_TEMPERATURE,
    )  # fixed by design, by choice and by the bench
    fixed = {*COUNTS, *of_the_model, *unread_parameters(injector.variant)}
    return [
        name
        for name, value in injector.values.items()
        if value != 0.0 and name not in fixed and injector.sources[name].mark not in ("M", "C")
    ]
