"""Models as the command line names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from commonrail.base.choices import Body, Boundary, Drive
from commonrail.base.errors import CommonrailError, ConfigurationError, InputError
from commonrail.cli.model_name import check_labels, read_model_name, read_model_names
from commonrail.readers.injector import load_injector
from tests.readers.conftest import Edit

NAME = "virtual-lino-2016"


def test_a_name_of_the_catalogue_is_its_own_label() -> None:
    model = read_model_name(NAME)
    assert (model.label, model.stated) == (NAME, False)
    assert model.injector == load_injector(NAME)


def test_label_and_variant_may_stand_around_it() -> None:
    model = read_model_name(f"stiff={NAME}@rigid,volume")
    assert (model.label, model.stated) == ("stiff", True)
    own = load_injector(NAME).variant
    assert model.injector.variant == own._replace(body=Body.RIGID, boundary=Boundary.VOLUME)
    assert load_injector(f"{NAME}@rigid,volume") == model.injector
    with pytest.raises(InputError):
        load_injector(f"{NAME}@hollow")


@pytest.mark.parametrize("word", ["current trace", "current-trace"])
def test_a_variant_of_two_words_may_have_a_hyphen(word: str) -> None:
    assert read_model_name(f"{NAME}@{word}").injector.variant.drive is Drive.CURRENT


def test_a_made_up_label_says_the_variant() -> None:
    assert read_model_name(f"{NAME}@rigid").label == f"{NAME}@rigid"


@pytest.mark.parametrize("name", ["mine.toml", "a=b.toml", "a@rigid.toml", "no-suffix"])
def test_a_file_is_taken_as_it_is_called(
    injector_file: Edit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    injector_file().rename(tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert read_model_name(name).label == name.removesuffix(".toml")
    model = read_model_name(f"L={name}@rigid")
    assert (model.label, model.injector.variant.body) == ("L", Body.RIGID)


@pytest.mark.parametrize("reader", [read_model_name, load_injector])
@pytest.mark.parametrize("number", ["0445110343", "0 445 110 343"])
def test_a_part_number_leads_to_the_injector_whose_file_states_it(reader: Callable[[str], object], number: str) -> None:
    with pytest.raises(InputError, match=r"\bcri2-0, "):
        reader(number)


def test_a_run_folder_gives_its_calibrated_injector(injector_file: Edit, tmp_path: Path) -> None:
    run = tmp_path / "run-1"
    run.mkdir()
    injector_file().rename(run / "calibrated.toml")
    for source in (run, run / "calibrated.toml"):
        assert read_model_name(str(source)).label == "run-1"


def test_made_up_labels_are_made_distinct_and_stated_ones_stay() -> None:
    models = read_model_names([NAME, f"{NAME} (2)={NAME}", NAME])
    assert [m.label for m in models] == [NAME, f"{NAME} (2)", f"{NAME} (3)"]


def test_a_stated_label_wins_over_one_made_up_before_it() -> None:
    assert [m.label for m in read_model_names([NAME, f"{NAME}=cri2-16"])] == [f"{NAME} (2)", NAME]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{NAME}@rigit", r'"rigit" .*"rigid"\?\); .*flexible, rigid, ideal'),
        (f"{NAME}@rigid,flexible", '"rigid" and "flexible"'),
        (f"{NAME}@", '"" .*variant'),
        (f"={NAME}", "no label"),
        ("virtual-lino-2061", r'mean "virtual-lino-2016"'),
        ("a=nowhere.toml", r"nowhere\.toml: .*no such"),
        ("a\0b", "or injector"),
        ("x" * 5000, "or injector"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_model_name(text)


def test_a_folder_without_a_calibrated_injector_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"calibrated\.toml .*run folder"):
        read_model_name(str(tmp_path))
    (tmp_path / "injector.toml").touch()
    with pytest.raises(InputError, match=r"mean .*injector\.toml"):
        read_model_name(str(tmp_path))


@pytest.mark.parametrize(
    ("texts", "kind", "words"),
    [
        ([f"a={NAME}", "a=cri2-16"], InputError, 'label "a"'),
        ([f"measured={NAME}"], ConfigurationError, '"measured" .*label'),
        ([NAME] * 9, ConfigurationError, "1 and 8 models"),
    ],
)
def test_labels_that_cannot_stand_beside_each_other_are_refused(
    texts: list[str], kind: type[CommonrailError], words: str
) -> None:
    with pytest.raises(kind, match=words):
        read_model_names(texts)


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ([], "not 0"),
        ([str(i) for i in range(9)], "1 and 8 models .* 9"),
        (["measured"], '"measured" .*label'),
        (["rail_pressure"], '"rail_pressure" .*label'),
        ([" "], "the label"),
        (["a\nb"], "the label"),
    ],
)
def test_labels_that_cannot_be_carried_are_refused(labels: list[str], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        check_labels(labels)


def test_a_flexible_body_of_a_direct_acting_injector_is_refused() -> None:
    with pytest.raises(InputError, match=r'rigid body.*"flexible"'):
        read_model_name("direct-acting-kr@flexible")


@pytest.mark.parametrize("drive", list(Drive))
def test_every_drive_is_a_word_of_a_variant(drive: Drive) -> None:
    word = drive.value.replace(" ", "-")
    assert read_model_name(f"{NAME}@{word}").injector.variant.drive is drive
