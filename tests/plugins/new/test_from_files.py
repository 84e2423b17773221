"""From a bench's files to a calibrated report, as the page on data walks through it: its commands and its edits."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import commonrail as cr
from commonrail.plugins.new.study import _best_seen, usual_space
from commonrail.readers.overview import propose_time_zero, survey
from tests.cli.conftest import Done, run_command
from tools.bench_files import INTERVAL, SHOT_POINTS, TRUTH, quantities, rate, true_injector, write_bench_files

PAGE = Path(__file__).resolve().parents[3] / "docs" / "howto" / "data-files.md"
WALK = PAGE.read_text(encoding="utf-8").partition("## Walk through it")[2].partition("## Rules of a file")[0]

pytest.importorskip("asammdf", reason="the extra mdf is not installed")
pytest.importorskip("openpyxl", reason="the extra excel is not installed")


def commands() -> list[list[str]]:
    """Words of the commands of the walk."""
    blocks = re.findall(r"```sh\n(.*?)```", WALK, re.S)
    lines = [shlex.split(line) for block in blocks for line in block.splitlines()]
    return [words for words in lines if words[0] == "commonrail"]


def edit(study: Path) -> int:
    """Make the edits of the page; returns how many lines they change."""
    (block,) = re.findall(r"```diff\n(.*?)```", WALK, re.S)
    text, edited = study.read_text(encoding="utf-8"), 0
    for hunk in block.strip("\n").split("\n\n"):
        lines = hunk.splitlines()
        old = "\n".join(line[1:] for line in lines if line[0] in " -") + "\n"
        new = "\n".join(line[1:] for line in lines if line[0] in " +") + "\n"
        found = text.count(old)
        assert found, f"the study has no lines {old!r}"
        edited += found * sum(line.startswith("+") for line in lines)
        text = text.replace(old, new)
    study.write_text(text, encoding="utf-8")
    return edited


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the raw files."""
    folder = tmp_path_factory.mktemp("bench")
    write_bench_files(folder / "raw")
    return folder


@pytest.fixture
def walked(bench: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Done]:
    """The commands of the page up to the edits, done in a folder of their own."""
    (tmp_path / "raw").symlink_to(bench / "raw")
    monkeypatch.chdir(tmp_path)
    return [run_command(*words[1:]) for words in commands()[:-1]]


def test_the_study_that_is_written_reads_all_files_after_a_few_edits(walked: list[Done]) -> None:
    assert [done.status for done in walked] == [0, 0], [done.err for done in walked]
    (shown,) = re.findall(r"```text\n(.*?)```", WALK, re.S)
    assert [line for line in shown.splitlines() if line not in walked[0].out] == []
    assert len(commands()) <= 4
    assert edit(Path("fit/study.toml")) <= 10
    data = cr.load_study("fit/study.toml").data
    rates = [d for d in data if d.name.startswith("rates")]
    shots = [d for d in data if d.name.startswith("shots")]
    assert len(rates) == 12
    assert [d.points[0].pulses[0].duration for d in shots] == pytest.approx([1e-6 * t for _, t in SHOT_POINTS])
    assert all("25 shots" in d.source and d.noise.sigma is not None for d in shots)
    january, march = (d for d in data if d.kind == "quantities")
    assert [january.role, march.role] == [cr.data.Role.FIT, cr.data.Role.VALIDATION]
    assert january.weight > max(d.weight for d in rates)  # 20 points beside 2400 samples
    # The same injector on both days, a noise of 0.1 mm³: six standard deviations of the difference are allowed.
    assert sorted(march.measured) == pytest.approx(sorted(january.measured), abs=6.0 * 0.1e-9 * 2.0**0.5)


@pytest.mark.slow
def test_the_calibration_finds_what_the_files_were_made_with(walked: list[Done]) -> None:
    edit(Path("fit/study.toml"))
    done = run_command(*commands()[-1][1:], "--threads", "1")
    assert done.status == 0, done.err
    assert Path("fit/run/report.html").is_file()
    best = cr.load_injector("fit/run/calibrated.toml").values
    true = cr.load_injector("virtual-lino-2016").with_values(TRUTH).values
    # The page promises 0.1 %.
    assert {name: best[name] for name in TRUTH} == pytest.approx({name: true[name] for name in TRUTH}, rel=1e-3)


def test_the_search_of_the_written_study_can_be_found_converged(walked: list[Done]) -> None:
    edit(Path("fit/study.toml"))
    assert cr.load_study("fit/study.toml").method.polish >= 3  # refinements that a verdict asks for


def test_what_no_file_tells_is_named_and_not_invented(bench: Path, tmp_path: Path) -> None:
    done = run_command("new", tmp_path / "s", "--injector", "cri2-16", "--from", bench / "raw" / "map_january.csv")
    assert done.status == 0, done.err
    assert "state in" in done.out
    assert "study.toml: cylinder_pressure, return_pressure\n" in done.out  # once, whatever the number of files
    with pytest.raises(cr.errors.InputError, match=r'study\.toml, cylinder_pressure: "\?"'):
        cr.load_study(tmp_path / "s" / "study.toml")


def test_the_offset_of_a_trigger_is_to_be_stated(bench: Path, tmp_path: Path) -> None:
    """Zero would be a guess: a trigger 35 us ahead would make every injection 35 us late."""
    words = ("--from", bench / "raw" / "shots.mf4", "--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa")
    done = run_command("new", tmp_path / "s", "--injector", "virtual-lino-2016", *words)
    assert done.status == 0, done.err
    assert f"state in {tmp_path / 's' / 'study.toml'}: data[1].shots.offset" in done.out.splitlines()
    assert "# STATE IT: offset" in (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    with pytest.raises(cr.errors.InputError, match=r'data\[1\]\.shots\.offset: "\?"'):
        cr.load_study(tmp_path / "s" / "study.toml")


def write_shots_with_current(path: Path, lags: Sequence[float], currents: Sequence[str] = ("I_inj",)) -> None:
    """Record whose current is there `lags` [s] after each of as many trigger edges, for 500 us."""
    from asammdf import MDF, Signal

    time, slow = 5e-6 * np.arange(16_000), 1e-5 * np.arange(8_000)
    edges = 0.01 * np.arange(1, len(lags) + 1)
    trigger = sum(np.where((time >= t) & (time < t + 1e-3), 5.0, 0.0) for t in edges)
    rises = zip(edges, lags, strict=True)
    current = sum(np.where(np.abs(slow - t - lag - 2.5e-4) < 2.55e-4, 1.0, 0.0) for t, lag in rises)
    record = MDF()
    record.append([Signal(np.sin(time), time, "mm³/ms", "ROI"), Signal(trigger, time, "V", "TRIG")])
    record.append([Signal(12.0 * current, slow, "A", name) for name in currents])
    for name, unit, value in (("p_set", "bar", 900.0), ("ti_set", "us", 500.0)):
        record.append([Signal(np.full(len(edges), value), edges - 1e-3, unit, name)])
    record.save(path, overwrite=True)
    record.close()


@pytest.mark.parametrize(
    ("lags", "currents", "offset"),
    [
        ([1.7e-3] * 6, ("I_inj",), "1.7 ms"),
        ([0.0] * 6, ("I_inj",), "0 s"),
        ([1.7e-3] * 6, ("I_inj", "I_pump"), "?"),  # which of them opens the injector?
        ([1.5e-3, 1.9e-3] * 3, ("I_inj",), "?"),  # no fixed offset
        ([7e-3] * 6, ("I_inj",), "?"),  # nearer to the next trigger
    ],
)
def test_the_only_current_proposes_the_offset_of_the_trigger(
    lags: list[float], currents: tuple[str, ...], offset: str, tmp_path: Path
) -> None:
    write_shots_with_current(tmp_path / "shots.mf4", lags, currents)
    words = ("--injector", "virtual-lino-2016", "--from", tmp_path / "shots.mf4", "--free", "valve.lift")
    done = run_command("new", tmp_path / "s", *words)
    assert done.status == 0, done.err
    text = (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    assert f'offset = "{offset}"' in text
    assert ("only current" in text) is (offset != "?")
    (line,) = [line for line in done.out.splitlines() if "data[1].shots.offset" in line]
    assert line.startswith("state in" if offset == "?" else "assumed, check")


def test_what_a_file_says_is_synthetic_is_no_measured_data_of_the_study(bench: Path, tmp_path: Path) -> None:
    names = ("map_january.csv", "rates.csv", "shots.mf4", "map_march.xlsx")  # the third has no text to say so
    words = [word for name in names for word in ("--from", bench / "raw" / name)]
    words += ["--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa", "--free", "valve.lift"]
    done = run_command("new", tmp_path / "s", "--injector", "virtual-lino-2016", *words)
    assert done.status == 0, done.err
    text = (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    (tmp_path / "s" / "study.toml").write_text(text.replace('offset = "?"', 'offset = "35 us"'), encoding="utf-8")
    data = cr.load_study(tmp_path / "s" / "study.toml").data
    marks = {next(name for name in names if d.name.startswith(Path(name).stem)): d.synthetic for d in data}
    assert [marks[name].lower()[:8] for name in names] == ["syntheti", "syntheti", "", "syntheti"]


@pytest.mark.parametrize(
    ("first", "last", "zero"),
    [(0.0, 2e-3, "0 us"), (1e-5, 2e-3, "0 us"), (-5e-4, 2e-3, "0 us"), (1.2e-4, 2e-3, "?"), (-5e-4, -1e-5, "?")],
)
def test_time_zero_is_taken_for_the_start_of_energising_where_the_times_hold_it(
    first: float, last: float, zero: str
) -> None:
    """A first sample may stand at the end of its interval."""
    assert propose_time_zero((first, last), 200) == {"time_zero": zero}


@pytest.mark.parametrize(
    ("head", "columns"),
    [("", ",rate [mm3/ms]"), ("", ",800bar_300us [mm3/ms]"), ("p [bar];800\nET [us];300\n", ";rate [mm3/ms]")],
    ids=["a trace", "named columns", "header rows"],
)
def test_time_zero_of_traces_is_not_taken_in_silence(head: str, columns: str, tmp_path: Path) -> None:
    comma = columns[0]
    for name, first in (("begins", 0), ("later", 500)):
        rows = "".join(f"{first + 10 * i}{comma}{i}\n" for i in range(9))
        (tmp_path / f"{name}.csv").write_text(f"{head}time [us]{columns}\n{rows}", encoding="utf-8")
    words = [word for name in ("begins", "later") for word in ("--from", tmp_path / f"{name}.csv")]
    done = run_command("new", tmp_path / "s", "--injector", "virtual-lino-2016", *words)
    assert done.status == 0, done.err
    text = (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    for line in ('time_zero = "0 us" # CHECK IT: time of the', 'time_zero = "?" # STATE IT: time of the'):
        assert text.count(line) == 1
    said = [line for line in done.out.splitlines() if line.startswith(("state in", "assumed"))]
    assert "data[2].time_zero" in said[0]
    assert "data[1].time_zero" not in said[0]
    assert said[1].startswith("assumed, check: data[1].time_zero")
    assert "data[2].time_zero" not in said[1]


def traces(path: Path) -> Path:
    """MAT structure of rates and currents, whose names alone have units and rail pressures; MATLAB knows neither.

    The current sensor reads 0.3 A before the energising.
    """
    time = np.arange(-10, 200) / 100.0
    columns = {f"mdot_mg_ms_{p}bar": p * (time > 0.45) for p in (100, 200)}
    columns |= {f"I_A_{p}bar": 0.3 + p * (time > -0.005) for p in (100, 200)}
    savemat(path, {"run": {"t_ms": time, **columns}})
    return path


def test_units_and_points_of_names_are_proposed_to_be_checked_and_each_rate_has_its_current(tmp_path: Path) -> None:
    file = traces(tmp_path / "shots_ET700us.mat")
    words = ("--from", file, "--cylinder-pressure", "0.1MPa", "--return-pressure", "0.2MPa", "--free", "armature.mass")
    done = run_command("new", tmp_path / "s", "--injector", "direct-acting-kr", *words)
    keys = ("time_unit", "rate_unit", "time_zero", "energising_time")
    assert f"assumed, check: {', '.join(f'data[1].{key}' for key in keys)}" in done.out, done.err
    text = (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")
    assert text.count("# CHECK IT: ") == len(keys)
    study = cr.load_study(tmp_path / "s" / "study.toml")
    assert study.space.names == ("armature.mass",)
    for data, rail in zip(study.data, (10e6, 20e6), strict=True):
        assert isinstance(data, cr.RateData)
        assert (data.point.rail_pressure, data.point.pulses[0].duration) == (rail, pytest.approx(700e-6))
        assert isinstance(data.point.drive, cr.Trace)
        # the current of this pressure, 1 A for each bar, from the zero that the sensor shows at rest
        assert data.point.drive.value[0] == pytest.approx(0.0, abs=1e-9)
        assert data.point.drive.value[-1] == pytest.approx(rail / 1e5)
        assert (data.point.cylinder_pressure, data.point.return_pressure) == (1e5, 2e5)


def test_what_the_file_of_a_driven_injector_does_not_tell_is_asked_for(tmp_path: Path) -> None:
    rows = "".join(f"{10 * i},{i}\n" for i in range(9))
    (tmp_path / "a.csv").write_text(f"time [us],rate [mg/ms]\n{rows}", encoding="utf-8")
    done = run_command("new", tmp_path / "s", "--injector", "direct-acting-kr", "--from", tmp_path / "a.csv")
    asked = "cylinder_pressure return_pressure data[1].rail_pressure data[1].energising_time data[1].drive.column"
    assert ", ".join(asked.split()) in done.out, done.err


def test_pressures_of_the_bench_are_those_of_the_data_that_state_none(bench: Path, tmp_path: Path) -> None:
    raw = bench / "raw"
    words = ("--from", raw / "rates.csv", "--from", raw / "map_january.csv", "--free", "valve.lift")
    words += ("--cylinder-pressure", "6MPa", "--return-pressure", "0.3MPa")
    assert run_command("new", tmp_path / "s", "--injector", "virtual-lino-2016", *words).status == 0
    study = tmp_path / "s" / "study.toml"
    text = study.read_text(encoding="utf-8")
    study.write_text(
        text.replace('layout = "matrix"', 'layout = "matrix"\ncylinder_pressure = "7 MPa"'), encoding="utf-8"
    )
    rate, *_, quantity = cr.load_study(study).data
    assert [rate.points[0].cylinder_pressure, rate.points[0].return_pressure] == pytest.approx([6e6, 0.3e6])
    assert [quantity.points[0].cylinder_pressure, quantity.points[0].return_pressure] == pytest.approx([7e6, 0.3e6])


def test_a_screening_proposes_what_nobody_measured_and_the_data_can_tell_apart(bench: Path, tmp_path: Path) -> None:
    words = ("--from", bench / "raw" / "map_january.csv", "--cylinder-pressure", "5MPa", "--return-pressure", "0.5MPa")
    done = run_command("new", tmp_path / "s", "--injector", "cri2-16", *words, "--json")
    free = done.record["free"]
    injector = cr.load_injector("cri2-16")
    assert free
    assert all(injector.sources[name].mark in ("E", "F") for name in free)
    space = cr.load_study(tmp_path / "s" / "study.toml").space
    assert list(space.names) == free
    assert ((space.lower < space.reference) & (space.reference < space.upper)).all()


@pytest.mark.parametrize("other", ["crin", "virtual-lino-2016"])
def test_the_range_of_a_length_that_the_user_frees_holds_the_values_of_other_types(other: str) -> None:
    """Nobody who frees a diameter knows that it is that of this type within a twentieth."""
    own, others = cr.load_injector("cri2-16"), cr.load_injector(other)
    names = ("control_chamber.a_hole_diameter", "control_chamber.z_hole_diameter", "needle_seat.diameter")
    for parameter in usual_space(own, names).parameters:
        assert parameter.lower < others.values[parameter.name] < parameter.upper
    screened, named = usual_space(own), usual_space(own, names)
    for parameter in named.parameters:
        (of_screening,) = (one for one in screened.parameters if one.name == parameter.name)
        assert of_screening.upper < parameter.upper  # a screening frees many: their space is searched more coarsely


def test_of_columns_that_do_the_same_one_is_chosen_and_small_ones_are_left() -> None:
    changes = np.array([[0.5, 0.49, 0.0, 0.0], [0.0, 0.01, 0.2, 0.04], [0.0, 0.0, 0.0, 0.0]])
    assert _best_seen(changes) == [0, 2]


def test_why_a_file_is_no_data_of_a_study_is_said_and_a_unit_can_be_stated(bench: Path, tmp_path: Path) -> None:
    text = (bench / "raw" / "map_january.csv").read_text(encoding="cp1252").replace("[mm³]", "[mm³/Huub]")
    (tmp_path / "map.csv").write_text(text, encoding="utf-8")
    words = ("new", tmp_path / "s", "--injector", "cri2-16", "--from", tmp_path / "map.csv", "--free", "valve.mass")
    assert re.search(r'unit of the quantity .*"mm³/Huub"', run_command(*words).sentence)
    assert run_command(*words, "--quantity-unit", "mm3").status == 0
    assert 'quantity_unit = "mm3"' in (tmp_path / "s" / "study.toml").read_text(encoding="utf-8")


def test_a_variant_becomes_an_injector_file(bench: Path, tmp_path: Path) -> None:
    words = ("--from", bench / "raw" / "rates.csv", "--free", "valve.lift", "--cylinder-pressure", "5MPa")
    done = run_command("new", tmp_path / "s", "--injector", "cri2-16@rigid", *words, "--return-pressure", "0.5MPa")
    assert done.status == 0, done.err
    assert cr.load_injector(tmp_path / "s" / "injector.toml").variant == cr.load_injector("cri2-16@rigid").variant


def test_a_test_plan_is_named(tmp_path: Path) -> None:
    (tmp_path / "plan.csv").write_text(
        "# SYNTHETIC\ntest,rail_pressure [MPa],energising_time [us],upper_limit [mm3]\nVL,160,700,60\nEM,80,500,20\n"
    )
    done = run_command("new", tmp_path / "study", "--injector", "cri2-16", "--from", tmp_path / "plan.csv")
    assert done.status == 2
    assert "test plan" in done.sentence
    assert "not read" not in survey(tmp_path / "plan.csv").facts["test"]  # it is the names of the tests


def test_new_refuses_what_it_cannot_do(bench: Path, tmp_path: Path) -> None:
    raw = bench / "raw" / "rates.csv"
    assert "--injector" in run_command("new", tmp_path / "s", "--from", raw).sentence
    assert "--from" in run_command("new", tmp_path / "s", "--cylinder-pressure", "5MPa").sentence
    twice = run_command(
        "new", tmp_path / "s", "--injector", "cri2-16", "--from", raw, "--from", raw.parent / ".." / "raw" / raw.name
    )
    assert "rates.csv" in twice.sentence
    for pressure, words in (("5GPa", "--cylinder-pressure must"), ("-3MPa", "-3 MPa")):
        beyond = ("--injector", "cri2-16", "--from", raw, "--cylinder-pressure", pressure)
        assert words in run_command("new", tmp_path / "s", *beyond).sentence
    unread = ("--injector", "cri2-16", "--from", raw, "--free", "drive.peak_band")
    assert "read drive.peak_band" in run_command("new", tmp_path / "s", *unread).sentence
    assert not (tmp_path / "s").exists()


def test_a_pressure_of_no_bench_is_warned_of(bench: Path, tmp_path: Path) -> None:
    words = ("--from", bench / "raw" / "map_january.csv", "--cylinder-pressure", "500MPa", "--free", "valve.lift")
    with pytest.warns(RuntimeWarning, match="--cylinder-pressure: 500MPa .*50 kPa .*30 MPa"):
        run_command("new", tmp_path / "s", "--injector", "cri2-16", *words)


def test_the_rates_of_the_files_inject_what_the_map_does_and_are_not_early() -> None:
    """A rate taken at the middles of its samples would be half a microsecond early, which tests of a fit find."""
    injector = true_injector()
    made = rate(injector, 1400, 350)
    assert made.sum() * 1e3 * INTERVAL == pytest.approx(float(quantities(injector, (1400,), (350,))[0, 0]), rel=1e-6)
    whole = cr.simulate(injector, cr.OperatingPoint(140e6, 350e-6, "5 MPa", "0.5 MPa", horizon=3e-3))
    middles = INTERVAL * (np.arange(len(made)) + 0.5)
    centre = float(np.sum(whole.rate_mm3_per_ms * whole.rate_time) / np.sum(whole.rate_mm3_per_ms))
    # Means over 10 us move the centre of a course by less than a hundredth of that.
    assert float(np.sum(made * middles) / np.sum(made)) == pytest.approx(centre, abs=0.1e-6)
