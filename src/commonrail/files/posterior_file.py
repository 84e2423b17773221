"""Draws of a posterior in a run folder: posterior.npz, arrays with names, and where they come from."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from commonrail.analysis.posterior.sample import Posterior
from commonrail.arguments import file_path, instance
from commonrail.arrays import Floats
from commonrail.display.text import listed
from commonrail.errors import InputError
from commonrail.files.atomic import replacing
from commonrail.files.sums import check_sum
from commonrail.reading.guarded_file import opened, read_plain, sha256

__all__ = ["POSTERIOR", "RefusedDrawsError", "read_draws", "read_posterior", "write_posterior"]

POSTERIOR = "posterior.npz"


class RefusedDrawsError(InputError):
    """Draws whose chains did not agree, or that no model is simulated with."""


MOST_DRAWS = 400  # of a posterior that are simulated


def write_posterior(folder: str | Path, found: Posterior) -> Path:
    """Write posterior.npz of a run folder, and return its path.

    Arrays: ``points`` (chains, steps, d) [SI] in the order of ``names`` with ``units``, ``log_density`` (chains, steps)
    without its constant, ``r_hat`` and ``effective`` (d,), ``refused`` (text, empty if the draws may be used),
    ``beside`` (names of what was drawn too and is no parameter), ``seed``, ``version`` of the program,
    ``study_sha256`` of study.toml.

    Parameters
    ----------
    folder : str or Path
    found : Posterior

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    folder = file_path(folder, "folder")
    instance(found, Posterior, "posterior")
    own = found.estimate.likelihood
    study = folder / "study.toml"
    arrays = {
        "points": own.space.from_unit(found.unit),
        "log_density": found.log_density,
        "names": np.array(own.names),
        "units": np.array(own.units),
        "r_hat": found.r_hat,
        "effective": found.effective,
        "refused": np.array(found.refusal),
        "beside": np.array(found.beside, str),
        "seed": np.array(found.seed),
        "version": np.array(version("commonrail")),
        "study_sha256": np.array(sha256(read_plain(study)) if study.is_file() else ""),
    }
    with replacing(folder / POSTERIOR, "wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return folder / POSTERIOR


def read_posterior(folder: str | Path, names: Sequence[str]) -> Floats:
    """Draws (n, d) [SI] of a run folder, for parameters of these names.

    Parameters
    ----------
    folder : str or Path
    names : sequence of str

    Raises
    ------
    InputError
        If there are none, or they are of other parameters.
    RefusedDrawsError
        If their chains did not agree, or other quantities were drawn beside them, such as friction that the study
        states as uncertain: the model that predicts has the stated value, for which the draws are too low or too high.
    """
    path = file_path(folder, "folder") / POSTERIOR
    if not path.is_file():
        raise InputError(f"{path}: there are no draws; run commonrail certainty RUN --posterior first.")
    check_sum(path)
    try:
        with opened(path) as stream, np.load(stream, allow_pickle=False) as kept:
            found, own, refused = kept["points"], [str(name) for name in kept["names"]], str(kept["refused"])
            beside = [str(name) for name in kept["beside"]] if "beside" in kept else []
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise InputError(f"{path}: this is no file of draws ({error}); run commonrail certainty again.") from error
    if own != list(names):
        raise InputError(
            f"{path}: the draws are of other parameters than the study has; run commonrail certainty again."
        )
    if refused:
        raise RefusedDrawsError(
            f"{path}: the draws cannot be used: {refused}; allow more draws in commonrail certainty."
        )
    if beside:
        raise RefusedDrawsError(
            f"{path}: the draws belong to models with {listed(beside)} drawn too, as the study states; the model that "
            "predicts has the stated value alone, so that they are no draws of it. Use the linear bands instead."
        )
    return np.asarray(found.reshape(-1, len(own)), float)


def read_draws(folder: str | Path, names: Sequence[str]) -> Floats:
    """Draws as `read_posterior`, some hundreds at even distances: as many as predictions are simulated with."""
    kept = read_posterior(folder, names)
    return kept[:: max(len(kept) // MOST_DRAWS, 1)]
