"""Certainty of a fit in its run folder: in result.json, with the injector of the most likely values beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from commonrail.arguments import file_path
from commonrail.calibration.result import CERTAINTY
from commonrail.calibration.study import Study
from commonrail.files.atomic import writing
from commonrail.files.injector_file import dump_injector
from commonrail.files.posterior_file import POSTERIOR
from commonrail.files.record_file import write_record
from commonrail.files.run_folder import CALIBRATED, LIKELY, RESULT, TRACES, members_of, read_result
from commonrail.files.sums import summed
from commonrail.injector.definition import Source
from commonrail.observation.quantities import is_of_meter


def write_likely(folder: Path, study: Study, values: Mapping[str, float]) -> Path:
    """Write the most likely values of a fit as an injector with its meters, most-likely.toml; return its path.

    `keep_certainty`, which follows, writes its checksum.

    Parameters
    ----------
    folder : Path
        Run folder.
    study : Study
        Of the run.
    values : mapping of str to float
        [SI], of all free parameters.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    source = Source("F", f'most likely values of "{study.title}"')
    fitted = {name: value for name, value in values.items() if not is_of_meter(name)}
    meters = tuple(meter.with_best(values, source) for meter in study.meters)
    path = folder / LIKELY
    dump_injector(study.injector.with_values(fitted), path, dict.fromkeys(fitted, source.text), meters=meters)
    return path


def keep_certainty(folder: str | Path, certainty: Mapping[str, Any]) -> dict[str, Any]:
    """Write the certainty of a fit into its result.json, and return the whole record.

    Parameters
    ----------
    folder : str or Path
        Run folder.
    certainty : mapping
        Of `Certainty.record`; with a key "posterior" if posterior.npz was written.

    Raises
    ------
    InputError
        If the folder is not a run folder.
    OutputError
        If the file cannot be written.
    """
    folder = file_path(folder, "folder")
    record = read_result(folder)
    record[CERTAINTY] = dict(certainty)
    known = {one["name"]: one for one in certainty["parameters"]}
    for parameter in record["parameters"]:
        parameter.update({key: known[parameter["name"]][key] for key in ("standard_error", "verdict")})
    if "posterior" not in certainty:  # that of a former certainty has other noise
        with writing(folder / POSTERIOR):
            (folder / POSTERIOR).unlink(missing_ok=True)
    with summed(folder, RESULT, CALIBRATED, TRACES, POSTERIOR, LIKELY, *members_of(folder)):
        write_record(folder / RESULT, record)
    return record
