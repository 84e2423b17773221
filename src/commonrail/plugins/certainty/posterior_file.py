"""Draws of a posterior in a run folder: posterior.npz, arrays with names, and where they come from."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.arguments import file_path, instance
from commonrail.base.arrays import Floats
from commonrail.base.errors import InputError
from commonrail.base.input import check_sum, read_arrays, read_plain, sha256
from commonrail.base.output import replacing
from commonrail.base.text import listed, number
from commonrail.plugins.certainty.posterior import Posterior
from commonrail.runs.folder import POSTERIOR

# Posterior as the JSON-able record that result.json keeps under "certainty", "posterior".


def posterior_record(found: Posterior, level: float = 0.95) -> dict[str, Any]:
    """Record of a posterior; no interval and no median if the chains do not agree.

    `level`: share of the draws within an interval.
    """
    size = len(found.names)
    low, high, middle = np.full((3, size), np.nan)
    if found.converged:
        low, high = found.interval(level)
        middle = np.median(found.points(), axis=0)
    chains, steps, _ = found.unit.shape
    return {
        "level": level,
        "refused": found.refusal,
        "chains": chains,
        "steps": steps,
        "accepted": found.accepted,
        "simulated": found.simulated,
        "failed": found.failed,
        "seed": found.seed,
        "parameters": [
            {
                "name": name,
                "median": number(float(middle[i])),
                "lower": number(float(low[i])),
                "upper": number(float(high[i])),
                "r_hat": number(float(found.r_hat[i])),
                "effective": number(float(found.effective[i])),
            }
            for i, name in enumerate(found.names)
        ],
    }


class RefusedDrawsError(InputError):
    """Draws whose chains did not agree, or that no model is simulated with."""


MOST_DRAWS = 400  # of a posterior that are simulated


def write_posterior(folder: str | Path, found: Posterior) -> Path:
    """Write posterior.npz of a run folder, and return its path.

    Arrays: ``points`` (chains, steps, d) [SI] in the order of ``names`` with ``units``, ``log_density`` (chains, steps)
    without its constant, ``r_hat`` and ``effective`` (d,), ``refused`` (text, empty if the draws may be used),
    ``beside`` (names of what was drawn too and is no parameter), ``seed``, ``version`` of the program,
    ``study_sha256`` of study.toml.

    Raises `OutputError` if the file cannot be written.
    """
    folder = file_path(folder, "folder")
    instance(found, Posterior, "posterior")
    likelihood = found.estimate.likelihood
    study = folder / "study.toml"
    arrays = {
        "points": likelihood.space.from_unit(found.unit),
        "log_density": found.log_density,
        "names": np.array(likelihood.names),
        "units": np.array(likelihood.units),
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

    Raises `InputError` if there are none, or they are of other parameters. Raises `RefusedDrawsError` if their chains
    did not agree, or other quantities were drawn beside them, such as friction that the study states as uncertain: the
    model that predicts has the stated value, for which the draws are too low or too high.
    """
    path = file_path(folder, "folder") / POSTERIOR
    if not path.is_file():
        raise InputError(f"{path}: there are no draws; run commonrail certainty RUN --posterior first.")
    check_sum(path)
    arrays = read_arrays(path, "points", "names", "refused")
    found, own, refused = arrays["points"], arrays["names"].tolist(), str(arrays["refused"])
    beside = arrays["beside"].tolist() if "beside" in arrays else []
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
