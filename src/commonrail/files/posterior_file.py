"""Draws of a posterior in a run folder: posterior.npz, arrays with names, and where they come from."""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path

import numpy as np

from commonrail.analysis.posterior.sample import Posterior
from commonrail.arguments import file_path, instance
from commonrail.files.atomic import replacing

__all__ = ["POSTERIOR", "write_posterior"]

POSTERIOR = "posterior.npz"


def write_posterior(folder: str | Path, found: Posterior) -> Path:
    """Write posterior.npz of a run folder, and return its path.

    Arrays: ``points`` (chains, steps, d) [SI] in the order of ``names`` with ``units``, ``log_density`` (chains, steps)
    without its constant, ``r_hat`` and ``effective`` (d,), ``refused`` (text, empty if the draws may be used),
    ``seed``, ``version`` of the program, ``study_sha256`` of study.toml.

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
        "seed": np.array(found.seed),
        "version": np.array(version("commonrail")),
        "study_sha256": np.array(hashlib.sha256(study.read_bytes()).hexdigest() if study.is_file() else ""),
    }
    with replacing(folder / POSTERIOR, "wb") as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]
    return folder / POSTERIOR
