"""One meter of a file that describes meters: a study, or the calibrated injector of a run."""

from __future__ import annotations

from pathlib import Path

from commonrail.arguments import file_path
from commonrail.errors import nearest
from commonrail.files.injector_file import load_meters
from commonrail.files.meter_models import meters_of_tables
from commonrail.files.study_models import StudyModel
from commonrail.observation.meter import Meter
from commonrail.reading.faults import read_model
from commonrail.reading.place import Place
from commonrail.reading.toml_file import read_toml

__all__ = ["load_meter"]


def load_meter(path: str | Path, name: str) -> Meter:
    """Read one meter of a study, with its start values, or of ``calibrated.toml``, with its calibrated ones.

    Parameters
    ----------
    path : str or Path
        TOML file with a table ``[meters.NAME]``; the data of a study are not read.
    name : str

    Raises
    ------
    InputError
        If the file cannot be read, something in it is unknown or of the wrong kind, or there is no such meter.
    ConfigurationError
        If `path` is no path, or the quantities make no meter.
    """
    file = file_path(path, "path of a file with meters")
    at = Place(str(file))
    document = read_toml(file)[0]
    if str(document.get("format", "")).startswith("commonrail-study/"):
        meters = meters_of_tables(read_model(StudyModel, document, at).meters, at / "meters")
    else:
        meters = {meter.name: meter for meter in load_meters(file)}
    if name not in meters:
        known = f"it has {', '.join(meters)}" if meters else "it has none"
        raise (at / "meters").error(f'there is no meter "{name}"{nearest(name, meters)}; {known}')
    return meters[name]
