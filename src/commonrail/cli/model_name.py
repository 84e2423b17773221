"""Models as the command line names them: [LABEL=]INJECTOR[@VARIANT,…]."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from commonrail.base.errors import ConfigurationError, InputError
from commonrail.base.hooks import note
from commonrail.physics.injector import Injector
from commonrail.physics.variants import apply_words
from commonrail.readers.injector import CATALOGUE, in_catalogue, injector_catalogue, load_injector, load_meters
from commonrail.readers.location import Place, locate_errors

if TYPE_CHECKING:
    from commonrail.physics.meters import Meter

CALIBRATED = "calibrated.toml"
MOST_MODELS = 8  # colours and markers that can be told apart
# Names that the results give to other things than models.
_RESERVED = frozenset(
    {"data", "dead_time", "measured", "quantity", "synthetic", "time_s"}
    | {"rail_pressure", "cylinder_pressure", "return_pressure", "energising_time"}
)


class NamedModel(NamedTuple):
    """Injector named on the command line, with its meters.

    `stated`: the label was given in the text. `folder`: run folder of the injector. `run`: this folder, if its
    calibrated injector is unchanged.
    """

    label: str
    injector: Injector
    text: str
    stated: bool
    meters: tuple[Meter, ...] = ()
    run: Path | None = None
    folder: Path | None = None


def read_model_names(texts: Iterable[str]) -> list[NamedModel]:
    """Models with distinct labels: stated labels are kept, generated labels are numbered if necessary.

    `InputError` if a text cannot be read, or two texts state one label.
    """
    models = [read_model_name(text) for text in texts]
    taken: set[str] = set()
    for model in models:
        if model.stated and model.label in taken:
            raise InputError(f'{model.text}: there are two models with the label "{model.label}"; rename one.')
        if model.stated:
            taken.add(model.label)
    labelled = []
    for model in models:
        label = model.label if model.stated else _free(model.label, taken)
        taken.add(label)
        labelled.append(model._replace(label=label))
    check_labels([model.label for model in labelled])
    return labelled


def check_labels(labels: Sequence[str]) -> None:
    """Raise `ConfigurationError` for a wrong number of models, or a label that tables and files cannot hold."""
    if not 1 <= len(labels) <= MOST_MODELS:
        raise ConfigurationError(f"Between 1 and {MOST_MODELS} models can be compared at a time, not {len(labels)}.")
    for label in labels:
        if label in _RESERVED:
            raise ConfigurationError(f'"{label}" cannot be the label of a model: results use it; choose another one.')
        if not label.strip() or not label.isprintable():
            raise ConfigurationError(f"{label!r} cannot be the label of a model; choose a short printable text.")


def read_model_name(text: str) -> NamedModel:
    """Model of a text [LABEL=]INJECTOR[@WORD,…], as in ``stiff=runs/a@rigid,regulated``.

    INJECTOR is an injector's file, a name of the catalogue or a run folder of ``commonrail calibrate``; the words state
    a variant. `InputError` if the injector cannot be read, or a word is unknown or contradicts another.
    """
    label, source, words = _split_label_and_words(text)
    if label is not None and not label.strip():
        raise InputError(f"{text}: there is no label before the equals sign; write LABEL=INJECTOR.")
    injector, meters = _injector(source), _meters(source)
    if words is not None:
        with locate_errors(Place(text)):
            injector = replace(injector, variant=apply_words(injector.variant, words))
    folder = None
    if not in_catalogue(source) and Path(source).is_dir():
        from commonrail.runs.folder import note_stopped

        folder = Path(source)
        note_stopped(folder)
        _note_unusable(folder)
    origin = meters, folder if words is None else None, folder
    if label is not None:
        return NamedModel(label.strip(), injector, text, True, *origin)
    return NamedModel(_stem(source) + (f"@{words}" if words else ""), injector, text, False, *origin)


def _note_unusable(folder: Path) -> None:
    """Note that a run is not usable by its verdict; a folder without an intact result is not judged."""
    from commonrail.calibration.record import CalibrationRecord, read_as  # all slow to import
    from commonrail.report.fit.rules import BAD
    from commonrail.report.fit.verdict import verdict
    from commonrail.runs.folder import read_result

    with suppress(InputError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):  # a broken record
        judged = verdict(read_as(CalibrationRecord, read_result(folder)), str(folder))
        if judged.level == BAD:
            note(f"{folder}: {judged.headline}", once=True)


def _split_label_and_words(text: str) -> tuple[str | None, str, str | None]:
    """Label, injector and words of the variant; a name that exists is never taken apart at its own = or @."""
    label, equals, rest = text.partition("=")
    readings: list[tuple[str | None, str]] = [(None, text)]
    if equals:
        readings.append((label, rest))
    for name, body in readings:
        if _exists(body):
            return name, body, None
    for name, body in readings:
        source, at, words = body.rpartition("@")
        if at and _exists(source):
            return name, source, words
    name, body = readings[-1]
    source, at, words = body.rpartition("@")
    return (name, source, words) if at else (name, body, None)


def _exists(source: str) -> bool:
    try:
        return in_catalogue(source) or Path(source).exists()
    except (OSError, ValueError):  # a name too long, or with a null character
        return False


def _injector(source: str) -> Injector:
    path = Path(source)
    if in_catalogue(source) or source.endswith(".toml"):
        return load_injector(source)
    if not _exists(source):
        raise InputError(
            f"{source}: there is no such file, run folder or injector of the catalogue{CATALOGUE.meant(source)}; "
            f"the catalogue has {', '.join(injector_catalogue())}."
        )
    if not path.is_dir():
        return load_injector(path)
    if not (path / CALIBRATED).is_file():
        from commonrail.runs.folder import without_result  # slow to import

        meant = f' (did you mean "{path / "injector.toml"}"?)' if (path / "injector.toml").is_file() else ""
        raise without_result(path) or InputError(
            f"{source}: no {CALIBRATED} there{meant}; name a run folder of commonrail calibrate, an injector's file or "
            "a name of the catalogue."
        )
    return load_injector(path / CALIBRATED)


def _meters(source: str) -> tuple[Meter, ...]:
    """Meters that a calibration has left in the injector's file."""
    if in_catalogue(source):
        return ()
    path = Path(source)
    return load_meters(path / CALIBRATED if path.is_dir() else path)


def _stem(source: str) -> str:
    path = Path(source).absolute()
    return path.parent.name if path.name == CALIBRATED else path.stem if path.suffix == ".toml" else path.name


def _free(label: str, taken: set[str]) -> str:
    number = 2
    free = label
    while free in taken:
        free, number = f"{label} ({number})", number + 1
    return free
