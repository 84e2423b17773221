"""Values with units from options."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.cli.options import open_workers, read_energisings, with_overrides
from commonrail.engine.operating_point import Energising
from commonrail.readers.injector import load_injector
from tests.cli.conftest import Command


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["nozzle.holes=2.5"], "whole number, not 2.5"),
        (["solenoid.air_gaps=1.5"], "whole number, not 1.5"),
        (["nozzle.holes=7", "valve.mass=5g", "nozzle.holes=8"], "--set nozzle.holes: it is set twice"),
    ],
)
def test_a_setting_that_makes_no_sense_is_refused(settings: list[str], words: str) -> None:
    injector = load_injector("virtual-lino-2016")
    with pytest.raises(InputError) as error:
        with_overrides(injector, settings)
    assert words in str(error.value)
    assert with_overrides(injector, ["nozzle.holes=8.0", "solenoid.turns=30.5"]).values["nozzle.holes"] == 8.0


def test_one_energising_is_a_duration() -> None:
    assert read_energisings("700us", []) == 700e-6


def test_several_energisings_have_starts() -> None:
    found = read_energisings(None, ["0us:200us", "0.9ms : 700us"])
    assert found == (Energising(0.0, 200e-6), Energising(900e-6, 700e-6))


@pytest.mark.parametrize(
    ("duration", "pulses", "words"),
    [
        (None, [], "--energising-time .*--energising "),
        ("700us", ["0us:1us"], "--energising-time .*--energising "),
        ("700", [], '--energising-time: "700" .*unit'),
        ("700MPa", [], "--energising-time: .*pressure"),
        (None, ["700us"], "--energising 700us: .*START:DURATION"),
        (None, ["0:700us"], '--energising 0:700us: "0" .*unit'),
        (None, ["0us:"], "--energising 0us:: "),
    ],
)
def test_energisings_that_cannot_be_read_say_why(duration: str | None, pulses: list[str], words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_energisings(duration, pulses)


@pytest.mark.parametrize("text", ["303N/um", "3.03e8", " 303 N/um "])
def test_a_value_is_set_with_its_unit_or_in_si(text: str) -> None:
    injector = with_overrides(load_injector("virtual-lino-2016"), [f"plunger_needle.k1={text}"])
    assert injector.values["plunger_needle.k1"] == 3.03e8


def test_an_offset_unit_is_a_point_on_its_scale() -> None:
    injector = with_overrides(load_injector("virtual-lino-2016"), ["fuel.temperature=40 degC"])
    assert injector.values["fuel.temperature"] == pytest.approx(313.15, abs=1e-9)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("plunger_needle.k1", "expected PATH=VALUE"),
        ("=3", "expected PATH=VALUE"),
        ("plunger_needle.k1=", "expected PATH=VALUE"),
        ("plunger_needle.kk1=3", 'mean "plunger_needle.k1"'),
        ("plunger_needle.k1=3m", "length; a stiffness"),
        ("plunger_needle.k1=soft", '"soft"'),
    ],
)
def test_settings_that_cannot_be_read_say_why(setting: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        with_overrides(load_injector("virtual-lino-2016"), [setting])


@pytest.mark.parametrize("value", ["-1", "nan", "inf"])
def test_a_value_outside_its_domain_is_refused(value: str) -> None:
    with pytest.raises(ConfigurationError, match=r"plunger_needle\.k1 .*zero"):
        with_overrides(load_injector("virtual-lino-2016"), [f"plunger_needle.k1={value}"])


def test_workers_do_not_go_with_a_cluster_elsewhere() -> None:
    with pytest.raises(InputError, match=r"--workers: .*--cluster"):
        open_workers(2, "tcp://somewhere:8786")


def test_pressures_are_those_of_the_run_and_are_said(
    command: Command, study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run is fitted at 8 MPa; what it injects there is not what it injects into the usual 5 MPa."""
    monkeypatch.chdir(tmp_path)
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace('"5 MPa"', '"8 MPa"').replace('"0.5 MPa"', '"0.1 MPa"'), encoding="utf-8")
    assert command("calibrate", study, "--out", "run", "--threads", "1").status == 0
    point = ("--rail-pressure", "160MPa", "--energising-time", "400us", "--json")
    stated = command("simulate", "run", *point, "--cylinder-pressure", "8MPa", "--return-pressure", "0.1MPa")
    found = command("simulate", "run", *point)
    assert re.search(r"8 MPa .*100 kPa: .*first data of run", found.err)
    assert found.record["injected_volume"] == stated.record["injected_volume"]
    assert "first data" not in stated.err
    usual = command("simulate", "run/calibrated.toml", *point)
    assert re.search(r"5 MPa .*500 kPa: .*usual", usual.err)
    assert usual.record["operating_point"]["cylinder_pressure"] == 5e6
    lines = ("--quantity", "5mm3", "--energising-time", "300,500us", "--json", "--threads", "1", "--bands", "none")
    record = command("map", "run", "--rail-pressure", "160MPa", *lines).record
    assert record["maps"][0]["conditions"]["cylinder_pressure"] == 8e6
    swept = command("sweep", "run", "--vary", "rail_pressure=160MPa", "--energising-time", "400us", "--json").record
    assert swept["injected_volume"] == [pytest.approx(stated.record["injected_volume"], rel=1e-12)]


@pytest.mark.parametrize(
    "words",
    [
        ("compare", "virtual-lino-2016", "--data", "study.toml"),
        ("export", "library", "virtual-lino-2016"),
        ("page", "virtual-lino-2016"),
        ("sensitivity", "virtual-lino-2016", "--rail-pressure", "160MPa", "--energising-time", "700us"),
    ],
)
def test_every_verb_that_simulates_a_model_takes_its_values(
    command: Command, study: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(study.parent)
    done = command(*words, "--set", "nozzle.hole=7")
    assert done.status == 2
    assert 'mean "nozzle.holes"' in done.sentence


def test_a_model_is_compared_with_other_values(command: Command, study: Path) -> None:
    own, more = (
        command("compare", "virtual-lino-2016", "--data", study, "--json", *options).record["data"][0]["volume"]
        for options in ((), ("--set", "nozzle.holes=9"))
    )
    assert more["virtual-lino-2016"] > 1.05 * own["virtual-lino-2016"]


def test_a_value_that_a_study_varies_is_no_setting_of_it(command: Command, study: Path) -> None:
    done = command("sensitivity", study, "--set", "nozzle.discharge_maximum=0.8")
    assert done.status == 2
    assert "frees it" in done.sentence


@pytest.mark.parametrize("end", ["stop", "seat"])
def test_a_film_without_a_disc_is_told_of(end: str, capsys: pytest.CaptureFixture[str]) -> None:
    injector = load_injector("virtual-lino-2016")
    with_overrides(injector, [f"valve.{end}_film=5um"])
    assert f"no effect while valve.{end}_disc is 0" in capsys.readouterr().err
    with_overrides(injector, [f"valve.{end}_film=5um", f"valve.{end}_disc=2mm"])
    assert capsys.readouterr().err == ""


def test_a_film_without_a_disc_in_a_file_is_told_of(tmp_path: Path, recwarn: pytest.WarningsRecorder) -> None:
    file = tmp_path / "own.toml"
    head = 'format = "commonrail-injector/1"\nbase = "virtual-lino-2016"\n[valve]\nstop_film = {}\nstop_disc = {}\n'
    for film, disc, told in (("5 um", "0 m", 1), ("5 um", "2 mm", 0), ("10 um", "0 m", 0)):
        recwarn.clear()
        file.write_text(head.format(f'"{film}"', f'"{disc}"'), encoding="utf-8")
        load_injector(file)
        assert len(recwarn) == told


POINT = ("--rail-pressure", "160MPa", "--energising-time", "700us")


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("sensitivity virtual-lino-2016 --parameter valve.lift --parameter valve.lift=50um:60um", "--parameter"),
        ("sensitivity virtual-lino-2016 --feature quantity --feature quantity", "--feature"),
        ("simulate virtual-lino-2016 --rail-pressure ١٦٠MPa", "--rail-pressure"),
        ("calibrate STUDY --threads 1 --workers 2", "--threads"),
        ("certainty RUN --local --profile valve.lift", "--local"),
        ("certainty RUN --most 5000", "--most"),
        ("certainty RUN --seed 1", "--seed"),
        ("next RUN --parameter valve.lift", "--parameter"),
        ("next RUN --first-energising-time 300us", "--first-energising-time"),
    ],
)
def test_an_option_without_effect_or_meaning_is_refused(
    command: Command, study: Path, tmp_path: Path, words: str, option: str
) -> None:
    point = POINT if words.startswith("sensitivity") else POINT[2:] if words.startswith("simulate") else ()
    done = command(*(word.replace("STUDY", str(study)) for word in words.split()), *point)
    assert done.status == 2
    assert option in done.err
    assert sorted(tmp_path.iterdir()) == [study.parent]
