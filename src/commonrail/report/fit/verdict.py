"""First page of a calibration's report: may the result be used, why, and what to do next."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from commonrail.base.table import Column, Table, table_from_columns
from commonrail.base.text import MISSING, count_noun, in_print, join_words, number, percent, significant, to_fixed
from commonrail.calibration.identifiability import ParameterVerdict
from commonrail.calibration.optimisers.base import ALIKE
from commonrail.calibration.record import (
    CalibrationRecord,
    LackOfFitRecord,
    LeftOutRecord,
    SearchVerdict,
    SeedRecord,
)
from commonrail.calibration.search import ONE_POINT
from commonrail.calibration.usual import BENCH, UNNAMED, USUAL_OF_METER
from commonrail.data.records import JUDGED, LABELS, MEAN, MICROSECOND, MM3, Record
from commonrail.data.registry import get_kind
from commonrail.physics.injector import parameter_quantities
from commonrail.physics.meters import is_of_meter, parameter_name, parts_of
from commonrail.report.data.bands import band_sentence, too_few_inside
from commonrail.report.data.view import Merit, view_of
from commonrail.report.fit.record import MORE, Advice, by_kind, map_line, meter_lines, of_role
from commonrail.report.fit.rules import BAD, CARE, GOOD, TITLES, Kind, Point, Step, Tile, judge, worst_level
from commonrail.runs.study_edits import can_widen

# Result of a calibration in sentences.

_ENDINGS = {
    None: "the search ran to its end",
    True: "the search has converged",
    False: "the search ran to its end and has not converged",
}
NAMED = 6  # data sets that a sentence names
DETERMINED = ParameterVerdict.DETERMINED.value


def headline(record: CalibrationRecord) -> list[str]:
    """Sentences on the task, the fall of the objective, the search, trivial models and meters."""
    return [
        _task(record),
        _objective(record),
        *convergence_lines(record),
        *baseline_lines(record.data),
        *meter_lines(record),
    ]


def baseline_lines(data: Sequence[Record]) -> list[str]:
    """One sentence for each trivial model of the validation data: whether the calibrated model beats it."""
    return [str(baseline["sentence"]) for d in data for baseline in d.get("baselines", ())]


def convergence_lines(record: CalibrationRecord) -> list[str]:
    """Sentence on whether the search has converged, with the rule; none of a record that does not say."""
    return [f"Search {record.convergence.sentence}."] if record.convergence else []


def search_words(search: SearchVerdict) -> str:
    """State of a search in a few words; figures and rule are in its sentence."""
    if search.spread is not None:
        if search.converged:
            return "the population has contracted and gains no more"
        return "the population is still spread" if search.spread > ALIKE else "the best still falls"
    if search.agreeing is not None:
        return f"{search.agreeing} of {search.starts} starts converged to the same optimum"
    words = search.sentence.removeprefix("not converged: ").partition(";")[0]
    return "a single search, which no other has confirmed" if ONE_POINT.startswith(words) else words


def synthetic_notes(synthetic: str, data: Sequence[Record]) -> list[str]:
    """Notes on synthetic data: the note of the result, notes that only a data set has, then their names."""
    texts = [synthetic]
    synthetic_sets = [d for d in data if d.get("synthetic")]
    texts += [d["synthetic"] for d in synthetic_sets if d["synthetic"] not in texts[0]]
    if synthetic_sets:
        texts.append(f"Synthetic data: {join_words([d['name'] for d in synthetic_sets])}.")
    return [text for text in texts if text]


def _task(record: CalibrationRecord) -> str:
    injector = record.injector
    fit = [d["name"] for d in of_role(record.data, "fit")]
    sets = count_noun(len(fit), "data set") + (f" ({join_words(fit)})" if 0 < len(fit) <= NAMED else "")
    parameters = count_noun(len(record.parameters), "parameter")
    task = f"{parameters} of “{injector.title or injector.name}” ({injector.variant})"
    ending = _ENDINGS[None if record.convergence is None else record.convergence.converged]
    if record.is_interrupted:
        ending = "the search was stopped early and these are the best values up to then"
    return f"{task} fitted to {sets}; {ending}."


def _objective(record: CalibrationRecord) -> str:
    start, best = record.objective.start, record.objective.best
    if best is None:
        return "No candidate could be simulated."
    if start is None:
        return f"The objective ended at {significant(best)}; the start values fail to simulate."
    share = f" ({to_fixed(100.0 * (best / start - 1.0), 0)} %)".replace("-", "−") if start else ""
    if best < start:
        return f"The objective fell from {significant(start)} to {significant(best)}{share}."
    return f"The objective did not fall: {significant(start)} at the start and still at the end."


# Judgement of a fit: bands, effective parameters, combinations, other seeds, rows that were held out.

_WORDS = {"rail_pressure": "rail pressure", "energising_time": "energising time"}


def judgement_lines(record: CalibrationRecord) -> list[str]:
    """Sentences on bands, effective parameters, spread of seeds and predictions of held-out rows."""
    lines = [band_sentence(d) for d in record.data if "band" in d]
    parameters = record.certainty.parameters if record.certainty else ()
    if parameters and not lines and all(None in (p.lower, p.upper) for p in parameters):
        lines.append("There are no bands: no parameter has an interval, so nothing bounds what the model predicts.")
    if influence := record.identifiability:
        lines.append(
            f"{influence.residuals} residuals determine {to_fixed(influence.effective_parameters, 1)} effective "
            f"parameters of {len(record.parameters)}; their scatter about the fit is "
            f"{significant(influence.scatter, 3)} {in_print(scatter_unit(record))}."
        )
    lines += _seed_lines(record.refits.seeds)
    lines += [line for left_out in record.refits.left_out for line in _left_out_lines(left_out)]
    if record.refits.interrupted:
        lines.append("The user stopped the further searches: those that are missing were not run.")
    return lines


def judgement_tables(record: CalibrationRecord) -> list[Table]:
    """Tables of other seeds and of rows that were held out, where there are any."""
    seeds, left_out = record.refits.seeds, record.refits.left_out
    tables = [_seed_table(seeds)] if seeds else []
    return tables + ([_left_out_table(left_out)] if left_out else [])


def scatter_unit(record: CalibrationRecord) -> str:
    """Unit of the scatter of the fitted residuals, which are weighted where data of several units are fitted."""
    units = {get_kind(d["kind"]).residual_unit for d in of_role(record.data, "fit")}
    return units.pop() if len(units) == 1 else "of their weighted units"


def _seed_lines(seeds: Sequence[SeedRecord]) -> list[str]:
    done = [seed for seed in seeds if not seed.failed]
    if len(done) < 2:
        return []
    ends = {name: [seed.positions[name] for seed in done] for name in done[0].positions}
    spread = {name: max(values) - min(values) for name, values in ends.items()}
    widest = max(spread, key=spread.__getitem__)
    if spread[widest] < 1e-3:
        return [f"{len(done)} seeds end at the same values, within 0.1 % of the bounds."]
    objectives = join_words([significant(seed.objective, 4) for seed in done])
    return [
        f"{len(done)} seeds end at objectives of {objectives}; the parameter that differs most between them is "
        f"{widest}, by {to_fixed(100.0 * spread[widest], 0)} % of its bounds."
    ]


def _seed_table(seeds: Sequence[SeedRecord]) -> Table:
    columns: list[Column] = [
        ("seed", lambda seed: str(seed.seed)),
        ("objective", lambda seed: significant(seed.objective)),
        *(
            (f"{name}: {seeds[0].error_heads[name]}", lambda seed, name=name: significant(seed.errors.get(name), 3))
            for name in seeds[0].errors
        ),
    ]
    note = "The first seed is that of the result. The spread is that of the search, not that of the parameters."
    return table_from_columns("Other seeds", seeds, columns, note)


def _left_out_lines(left_out: LeftOutRecord) -> list[str]:
    values = f"Each {_WORDS.get(left_out.by, left_out.by)} of {left_out.name}"
    searches = f"held out in turn, {left_out.searches} searches, and predicted"
    lines = [f"{values} {searches}: {_metrics(left_out.figures)}."]
    if left_out.mean is not None:
        lines.append(f"The mean of the members of each search gives {_metrics(left_out.mean)}.")
    if left_out.failed:
        lines.append(f"The search without {join_words(left_out.failed)} could simulate no candidate.")
    for baseline in left_out.baselines:
        beyond = baseline.extrapolated
        said = f", {beyond} of its {left_out.values} values extrapolated" if beyond else ""
        beats = "beats" if baseline.beaten else "does not beat"
        lines.append(f"There the model {beats} {baseline.text}, which gives {_metrics(baseline.figures)}{said}.")
    return lines


def _metrics(figures: Record) -> str:
    limit = significant(figures["limit_quantity"], 3, MM3)
    parts = [
        f"{to_fixed(figures[key], decimals, scale)} {unit} rms {words}"
        for key, decimals, scale, unit, words in (
            ("rms_large_percent", 2, 1.0, "%", f"above {limit} mm³"),
            ("rms_small", 3, MM3, "mm³", f"up to {limit} mm³"),
        )
        if number(figures.get(key)) is not None
    ]
    return " and ".join(parts) or MISSING


def _left_out_table(records: Sequence[LeftOutRecord]) -> Table:
    rows: list[tuple[LeftOutRecord, str, Record]] = []
    for left_out in records:
        rows.append((left_out, "model", left_out.figures))
        if left_out.mean is not None:
            rows.append((left_out, LABELS[MEAN], left_out.mean))
        rows += [(left_out, baseline.text, baseline.figures) for baseline in left_out.baselines]
    limit = significant(records[0].figures["limit_quantity"], 3, MM3)
    columns: list[Column] = [
        ("data set", lambda row: row[0].name),
        ("held out in turn", lambda row: _WORDS.get(row[0].by, row[0].by)),
        ("predicted by", lambda row: row[1]),
        ("searches", lambda row: str(row[0].searches)),
        ("quantities", lambda row: str(row[0].values)),
        (f"above {limit} mm³, % rms", lambda row: to_fixed(row[2].get("rms_large_percent"), 2)),
        (f"up to {limit} mm³, mm³ rms", lambda row: to_fixed(row[2].get("rms_small"), 3, MM3)),
        ("dead time, µs rms", lambda row: to_fixed(row[2].get("dead_time_rms"), 1, MICROSECOND)),
    ]
    note = "Every row is predicted by a fit that did not see the rows at its value; outermost values are extrapolated."
    return table_from_columns("Predictions of what was held out", rows, columns, note, 3)


MOST_TILES = 5  # on the first page
LEVELS = ("", GOOD, CARE, BAD)
SHOWN = 4  # parameters that a sentence names
MANY_STARTS = 16  # from which further ones are not advised: ends then differ because the data do not separate them
WEIGHTS = "share"  # finding about the weights of the data, which no data contradict
QUANTITY = "quantity"  # finding about single quantities too, as where an injector just opens


# Turns of the steps: a bound that is hit falsifies the search, which the values to adopt come from, which a map shows.
WIDEN, FREE, ON, OTHER, USE = range(-3, 2)  # bounds first: at a bound, a test may only see the bound


class ReportVerdict(NamedTuple):
    """Verdict on a calibration: level, title, what speaks against it, notes, what to do next, most urgent on top."""

    level: str
    title: str
    reasons: list[str]
    notes: list[str]
    steps: list[Step]

    @property
    def headline(self) -> str:
        """Title with its main reason."""
        return " ".join([f"{self.title}.", *self.reasons[:1]])

    def record(self) -> dict[str, Any]:
        """JSON-able form."""
        return {**self._asdict(), "steps": [{"text": step.text, "command": step.command} for step in self.steps]}


def verdict(record: CalibrationRecord, run: str) -> ReportVerdict:
    """Verdict on a calibration by its record; `run` is the folder's name for the command lines."""
    advice = Advice.of(run)
    parts = (_ending, _plausibility, _tests, _errors, _prediction, _parameters)
    points = [point for rule in parts for point in rule(record, advice)]
    level, against = judge(points)
    notes = [point for point in points if point.kind is Kind.NOTE]
    urgent = {point.step for point in against if point.level == BAD}
    after = [Step(*map_line(record, run), USE)] if level != BAD else []
    # what a note advises, such as further measurements, is of no use before the model fits
    steps = dict.fromkeys([*(point.step for point in (against if level == BAD else [*against, *notes])), *after])
    order = sorted(steps, key=lambda step: (step not in urgent, not step.command, step.turn))
    return ReportVerdict(level, TITLES[level], [p.reason for p in against], [p.reason for p in notes], order)


def merits(data: Sequence[Record], before: str = "") -> list[Tile]:
    """Errors of each kind of data, fitted and not fitted; `before` opens their heads."""
    return [
        _tile(f"{before}{head}", view.merit(records), worst_level(filter(None, map(view.fit_error, records))))
        for role, head in (("fit", "fit"), ("validation", "unseen"))
        for view, records in by_kind(of_role(data, role))
    ]


def _tile(head: str, merit: Merit, level: str = "") -> Tile:
    return Tile(head, merit.figure, merit.words, level, merit.others)


def tiles(record: CalibrationRecord) -> list[Tile]:
    """Answers of the first page: fit, unseen data, quantity, parameters, search, each with the level of its figure."""
    answers = merits(record.data)
    if not of_role(record.data, "validation"):
        answers.append(Tile("unseen", "not known", "no data were held back"))
    for view, records in by_kind(record.data):
        if merit := view.quantity_merit(records):
            answers.append(_tile("quantity", merit))
    parameters = record.parameters
    if any(p.verdict for p in parameters):
        determined = sum(p.verdict == DETERMINED for p in parameters)
        level = GOOD if determined == len(parameters) and not any(p.at_bound for p in parameters) else CARE
        answers.append(Tile("parameters", f"{determined} of {len(parameters)}", "determined by the data", level))
    return _limit_tiles([*answers, *_search_tile(record)])


def _limit_tiles(answers: Sequence[Tile]) -> list[Tile]:
    """The answers, or where they are many the worst of each head, which names the others."""
    if len(answers) <= MOST_TILES:
        return list(answers)
    worst: dict[str, Tile] = {}
    for tile in answers:
        first = worst.setdefault(tile.head, tile)
        if first is not tile:
            shown, other = sorted((first, tile), key=lambda t: LEVELS.index(t.level), reverse=True)
            more = "; ".join(filter(None, (shown.others, f"{other.figure} {other.words}")))
            worst[tile.head] = shown._replace(others=more)
    return list(worst.values())


def _search_tile(record: CalibrationRecord) -> list[Tile]:
    generations = count_noun(record.generations[-1].generation, "step") if record.generations else "no step"
    if record.is_interrupted:
        return [Tile("search", "stopped", f"after {generations}", BAD)]
    search = record.convergence
    if search is None:
        return []
    figure = "converged" if search.converged else "not converged"
    level = CARE if _is_unfinished(record) else GOOD if search.converged else ""
    return [Tile("search", figure, f"{search_words(search)} after {generations}", level)]


def _tests(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    """Statistical tests that found something."""
    text = f"State in {advice.study} what the data look like, or a discrepancy of theirs, and calibrate again."
    for test in record.certainty.tests if record.certainty else ():
        if test.detected:
            chances = [chance for chance in (test.probability, test.score, test.size, 1.0) if chance is not None]
            step = Step(text, advice.calibrate(), FREE)
            if _is_of_quantity(test):
                words = "Check the calibration of the meter, the unit and density of the data, and the nozzle's holes."
                step = Step(words, turn=FREE)
            elif (free := _suspect(record, test)) and _is_worth_a_fit(record, test.relief):
                words = f"Free {free}, which the data look like, unless you can measure and state it."
                step = Step(words, advice.calibrate(free=free), FREE)
            elif free and _is_lacking(record):
                step = LACKING
            reason = f"{test.sentence[:1].upper()}{test.sentence[1:]}."
            yield Point(Kind.TEST, reason, step, probability=min(chances))


LEAST_RELIEF = 0.1  # share of the error that a change of the study must promise, chosen: 10 % become 9 %
LACKING = Step(
    "Check units, time zero and operating points of the data, then the type and the drawing of the injector: no change "
    "of the study that the tests suggest would lower the errors much."
)


def _is_worth_a_fit(record: CalibrationRecord, relief: float | None) -> bool:
    """Return whether a change of a study promises to lower its errors, unless they are good already.

    Without a relief, in a record of an older version, it does.
    """
    errors = (view_of(d["kind"]).fit_error(d) for d in of_role(record.data, "fit"))
    return relief is None or relief >= LEAST_RELIEF or worst_level(filter(None, errors)) in ("", GOOD)


def _is_lacking(record: CalibrationRecord) -> bool:
    """Return whether wider bounds or free suspects were examined, and none is worth a fit."""
    if not record.certainty:
        return False
    reliefs = [
        test.relief
        for test in record.certainty.tests
        if test.detected and not _is_of_quantity(test) and _suspect(record, test)
    ]
    reliefs += [record.certainty.widening] if _movable(record) else []
    return bool(reliefs) and not any(_is_worth_a_fit(record, relief) for relief in reliefs)


def _movable(record: CalibrationRecord) -> list[str]:
    """Parameters that have met a bound that can be moved."""
    return [p.name for p in record.parameters if p.at_bound and can_widen(p)]


def _is_of_quantity(test: LackOfFitRecord) -> bool:
    """Return whether the data look like a gain or an offset of their meter.

    A meter whose gain is free makes every quantity of the model uncertain by it: freeing it is no cure.
    """
    key = parts_of(test.name)[1] if is_of_meter(test.name) else test.suspect
    return key in ("gain", "offset", "quantity_offset")


_OF_METER = {"delay": "delay", "bandwidth": "cutoff"}  # suspects of a data set


def _suspect(record: CalibrationRecord, test: LackOfFitRecord) -> str:
    """Dotted name of the suspect of a test that a study can free; empty without one."""
    free, suspect = {p.name for p in record.parameters}, test.suspect or ""
    stated = {data.get("meter") for data in record.data}
    names = itertools.chain([BENCH], (f"{BENCH}{i}" for i in itertools.count(2)))
    added = next(name for name in names if name not in stated)
    name = suspect if suspect in parameter_quantities() else test.name
    for data in record.data:
        if data["name"] == name and suspect in _OF_METER and data["kind"] == "rate":
            name = parameter_name(data.get("meter") or added, _OF_METER[suspect])
    if is_of_meter(name) and parts_of(name)[0] == UNNAMED:
        name = parameter_name(added, parts_of(name)[1])
    can_be = name in parameter_quantities() or (is_of_meter(name) and parts_of(name)[1] in USUAL_OF_METER)
    return name if can_be and name not in free else ""


def _errors(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    """Errors on each data set, fitted or not."""
    step = Step("Check units, time zero and operating points of the data, then the bounds of the parameters.")
    step = LACKING if _is_lacking(record) else step
    for data in record.data:
        if (error := view_of(data["kind"]).fit_error(data)) is not None:
            name = f"{data['name']}{'' if data['role'] == 'fit' else ', which was not fitted,'}"
            size = f"{significant(error.size, 2)} tolerances" if error.in_tolerances else f"{percent(error.size)} %"
            yield Point(Kind.ERROR, f"The model misses {name} by {size}.", step, error)


def _full(advice: Advice, record: CalibrationRecord) -> Step:
    starts = record.certainty.starts if record.certainty else 1
    if starts > MANY_STARTS:
        return Step(f"Free fewer parameters, or give them priors: {starts} starts have confirmed no best fit.")
    if starts > 1:
        text = "Search for the most likely values from more starts; a shorter time_step in the study helps too."
        return Step(text, advice.of_run("certainty", f"--starts {4 * starts}"), ON)
    return Step("Search for the most likely values from several starts.", advice.of_run("certainty"), ON)


def _ending(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    """Search that failed, was stopped or is unfinished, and values that fit better than the calibrated ones."""
    best, start = record.objective.best, record.objective.start
    if best is None:
        step = Step("Correct the injector or the operating points until the start values can be simulated.")
        yield Point(Kind.FAULT, "No candidate could be simulated.", step)
        return
    if record.is_interrupted:
        step = Step("Run the search to its end.", advice.of_run("resume"), ON)
        yield Point(Kind.FAULT, "The search was stopped before its end.", step)
    elif record.convergence and record.has_not_converged and not (record.certainty and record.certainty.confirms):
        step = Step("Continue the search.", advice.of_run("resume", MORE), ON)
        step = step if record.convergence.cut_short else _full(advice, record)
        kind = Kind.SEARCH if _is_unfinished(record) else Kind.NOTE
        words = search_words(record.convergence)
        reason = f"The search has not converged: {words}."
        if kind is Kind.NOTE:
            reason = f"The most likely values are found, although the search by itself has not converged: {words}."
        yield Point(kind, reason, step)
    errors = (view_of(d["kind"]).fit_error(d) for d in of_role(record.data, "fit"))
    if start is not None and not best < start and worst_level(filter(None, errors)) != GOOD:
        step = Step("Check bounds and data: the start values fit as well as anything that was tried.")
        yield Point(Kind.FAULT, "The objective did not fall below that of the start values.", step)


def _is_unfinished(record: CalibrationRecord) -> bool:
    """Return whether the search is unfinished in a way that matters for the values.

    The most likely values must be found; they are the calibrated ones, or lie in one interval with them.
    """
    return record.has_not_converged and not (record.certainty and record.certainty.settled)


def _plausibility(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    errors = {d["name"]: view_of(d["kind"]).fit_error(d) for d in record.data}
    usable = [(QUANTITY, name) for name, error in errors.items() if error and worst_level([error]) != BAD]
    mild = [w for w in record.warnings if w.code == WEIGHTS or (w.code, w.subject) in usable]
    if odd := [w for w in record.warnings if w not in mild] or mild:
        more = f" {count_noun(len(odd) - 1, 'more finding')} at the top of the report." if len(odd) > 1 else ""
        text = "Check the findings at the top of the report against the test bench, correct the study, calibrate again."
        step = Step(text, advice.calibrate())
        yield Point(Kind.NOTE if odd[0] in mild else Kind.FAULT, f"{odd[0].sentence}{more}", step)
    if synthetic := [d["name"] for d in record.data if d.get("synthetic")]:
        reason = f"{_some(synthetic)} {'are' if len(synthetic) > 1 else 'is'} synthetic, not measured."
        step = Step("Replace synthetic data by measured ones before the result is used on an engine.")
        yield Point(Kind.NOTE, reason, step)


def _prediction(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    """Data that the fit has not seen: none, or met worse than a trivial model meets them."""
    validation, held_out = of_role(record.data, "validation"), record.refits.left_out
    if not validation and not held_out:
        step = Step(f'Set role = "validation" for one data set of {advice.study}, or measure another one.')
        yield Point(Kind.NOTE, "No data were held back: errors on unseen points are not known.", step)
    if lost := [d["name"] for d in validation if _is_lost(d)]:
        cure = Step("Correct these operating points, or narrow the bounds until the calibrated model runs there.")
        yield Point(Kind.FAULT, f"The calibrated model does not run at all points of {_some(lost)}.", cure)
    step = Step("Free fewer parameters or add data between the fitted ones; see “Figures of merit”.")
    if narrow := [d["name"] for d in record.data if "band" in d and too_few_inside(d)]:
        cure = Step("State a discrepancy of these data, or free what the model lacks; do not rely on its bands before.")
        yield Point(Kind.NOTE, f"The bands hold too few measured values of {_some(narrow)}: they are too narrow.", cure)
    for data in validation:
        for baseline in data.get("baselines", ()):
            if baseline.get("beaten") is False:
                yield Point(Kind.NOTE, baseline["sentence"], step)
    beaten_rows = dict.fromkeys(
        left_out.name for left_out in held_out if any(b.beaten is False for b in left_out.baselines)
    )
    if beaten_rows:
        reason = f"On held out rows of {_some(list(beaten_rows))} a trivial model is as good or better."
        yield Point(Kind.NOTE, reason, step)


def _is_lost(data: Record) -> bool:
    """True if the calibrated model has no number for the data, or for a row that is not a dead time."""
    if "rows" not in data:
        return "J" in data and number(data["J"].get(JUDGED)) is None
    return any(number(row.get(JUDGED)) is None for row in data["rows"] if not row.get("dead_time"))


def _parameters(record: CalibrationRecord, advice: Advice) -> Iterator[Point]:
    parameters = record.parameters
    if bounded := [p.name for p in parameters if p.at_bound]:
        text = f"Check the drawing: {_some(bounded)} ended at the limits of what is possible or built."
        step = Step(text, turn=WIDEN)
        if movable := _movable(record):
            is_worth = _is_worth_a_fit(record, record.certainty.widening if record.certainty else None)
            wider = Step(
                f"Widen the bounds of {_some(movable)} if the parts allow it.", advice.calibrate(widen=True), WIDEN
            )
            step = (
                wider
                if is_worth
                else Step("Check the drawing: wider bounds would not lower the errors much.", turn=WIDEN)
            )
        yield Point(Kind.BOUND, f"At a bound: {_some(bounded)}.", step)
    loose = [p.name for p in parameters if p.verdict and p.verdict != DETERMINED]
    if loose:
        reason = f"The data do not determine {len(loose)} of {len(parameters)} parameters: {_some(loose)}."
        yield Point(Kind.NOTE, reason, _plan(record, advice))


def _plan(record: CalibrationRecord, advice: Advice) -> Step:
    """Measurements to plan; of data at one operating point `next` needs the range of the bench."""
    text = "Plan the measurements that would determine them"
    points = [p for d in of_role(record.data, "fit") for p in view_of(d["kind"]).operating_points(d)]
    if len({(p.get("rail_pressure"), p.get("energising_time")) for p in points}) == 1:
        return Step(
            f"{text} with commonrail next. The fitted data are of one operating point: state what the bench can run by "
            "--rail-pressure and --energising-time."
        )
    return Step(f"{text}.", advice.of_run("next", "--points 3 --out plan.csv"))


def _some(names: list[str]) -> str:
    """Names, the first few of many."""
    if len(names) <= SHOWN + 1:
        return join_words(names)
    return f"{', '.join(names[:SHOWN])} and {len(names) - SHOWN} more"
