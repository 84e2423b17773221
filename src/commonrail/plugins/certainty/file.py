"""Certainty of a fit, and the JSON-able record that result.json keeps of it under the key "certainty"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.base.arguments import file_path
from commonrail.base.arrays import Floats
from commonrail.base.display import Shown
from commonrail.base.output import summed
from commonrail.base.text import number
from commonrail.calibration.result import CERTAINTY
from commonrail.calibration.study import Study
from commonrail.physics.injector import Source
from commonrail.physics.meters import is_of_meter, known_quantity
from commonrail.plugins.certainty.estimate import Estimate
from commonrail.plugins.certainty.lack_of_fit import LackOfFit
from commonrail.plugins.certainty.one_sided import Within
from commonrail.plugins.certainty.profile import Profile, Ripple
from commonrail.plugins.certainty.verdict import Assessment, sensitivity_records
from commonrail.readers.injector_writer import dump_injector
from commonrail.runs.folder import LIKELY, POSTERIOR, RESULT, read_result, write_record


@dataclass(frozen=True, repr=False)
class Certainty(Shown):
    """Certainty of a fit.

    Attributes
    ----------
    estimate : Estimate
        Most likely values and their local intervals; `estimate.likelihood` is the likelihood with its fitted noise.
    level : float
        Share of intervals that hold the truth.
    low, high : (d,)
        Ends of the intervals [SI]: of the profile where there is a finished one, else local.
    estimators : list of str
        Estimator of each parameter's interval.
    profiles : mapping of str to Profile
    tests : list of LackOfFit
        For each data set, and for a delay that all curves share.
    visible : float
        Smallest delay of the meter [s] that the test of a delay finds in 9 of 10 benches like this one; NaN without
        that test.
    withdrawn : str
        Reason why no parameter is called pinned, empty if there is none.
    verdicts : list of Assessment
    adopted : int
        Times that a profile met a better optimum, which then took the place of the first.
    combinations : mapping of str to (float, float)
        Value and half width [SI] of each stated combination.
    simulated : int
        Points simulated.
    within : Within
        The same estimate with the quantities that were fitted as the study states them, see `one_sided`.
    gain : float
        2 ln L of the most likely values less that of the values that the search started from, under the same noise.
    ripple : Ripple or None
        Comparison of the curvature with the simulated likelihood; None where profiles were asked for, or quantities
        were fitted as stated.
    """

    presenter = "commonrail.plugins.certainty.notebook:CERTAINTY"

    estimate: Estimate
    level: float
    low: Floats
    high: Floats
    estimators: list[str]
    profiles: Mapping[str, Profile]
    tests: list[LackOfFit]
    visible: float
    withdrawn: str
    verdicts: list[Assessment]
    adopted: int
    combinations: Mapping[str, tuple[float, float]]
    simulated: int
    within: Within
    gain: float
    ripple: Ripple | None = None

    def record(self) -> dict[str, Any]:
        """JSON-able form, the key "certainty" of a result."""
        estimate = self.estimate
        return {
            "level": self.level,
            "starts": estimate.starts,
            "agreeing": estimate.agreeing,
            "settled": estimate.settled,
            "adopted": self.adopted,
            "gain": number(self.gain),
            "simulated": self.simulated,
            "withdrawn": self.withdrawn,
            "parameters": [_parameter(self, i) for i in range(len(estimate.likelihood.names))],
            "fitted_as_stated": [
                {"name": name, "value": value, "unit": known_quantity(name).unit}
                for name, value in self.within.fitted.items()
            ],
            "combinations": [
                {"sum": text, "value": value, "half_width": number(half)}
                for text, (value, half) in self.combinations.items()
            ],
            "noise": _noise(estimate),
            "tests": [test._asdict() for test in self.tests],
            "visible_delay": number(self.visible),
            "sensitivity": sensitivity_records(estimate),
            "profiles": [_profile(profile) for profile in self.profiles.values()],
        }


def _parameter(found: Certainty, i: int) -> dict[str, Any]:
    estimate = found.estimate
    likelihood, value = estimate.likelihood, float(estimate.point[i])
    low, high, judged = float(found.low[i]), float(found.high[i]), found.verdicts[i]
    error = float(np.sqrt(estimate.covariance.total[i, i]) * abs(likelihood.scaled(estimate.unit)[i]))
    return {
        "name": likelihood.names[i],
        "value": value,
        "lower": number(low),
        "upper": number(high),
        "percent": number(50.0 * (high - low) / abs(value)) if value else None,
        "standard_error": number(error),
        "estimator": found.estimators[i],
        "ripple": None if found.ripple is None else number(float(found.ripple.ratios[i])),
        "verdict": judged.verdict.value,
        "sentence": judged.sentence,
        "cure": judged.cure,
        "moved_by": _moved_by(estimate, i),
        "shares": _shares(estimate, i),
    }


def _moved_by(estimate: Estimate, i: int) -> list[dict[str, Any]]:
    """Percent of the value for one standard deviation of each uncertain quantity."""
    likelihood = estimate.likelihood
    scale, value = float(likelihood.scaled(estimate.unit)[i]), abs(float(estimate.point[i]))
    return [
        {
            "name": nuisance.name,
            "deviation": nuisance.deviation,
            "unit": nuisance.unit,
            "percent": float(100.0 * move[i] * scale / value) if value else None,
        }
        for nuisance, move in zip(likelihood.nuisances, estimate.covariance.nuisances, strict=True)
    ]


def _shares(estimate: Estimate, i: int) -> dict[str, float | None]:
    """Shares of the variance by noise that come from each data set, and from the priors."""
    likelihood = estimate.likelihood
    names = [block.name for block in likelihood.blocks] + (["priors"] if len(likelihood.priors) else [])
    return {name: number(float(s)) for name, s in zip(names, estimate.covariance.shares[:, i], strict=False)}


def _noise(estimate: Estimate) -> list[dict[str, Any]]:
    """Noise of each data set as it was fitted, and the share of the data set in −2 ln L."""
    likelihood = estimate.likelihood
    costs = likelihood.block_costs(likelihood.whiten(estimate.errors))
    whole = max(float(costs.sum()), 1e-300)
    return [
        {
            "name": block.name,
            "law": noise.law.value,
            "order": noise.autoregression.order,
            "sigma": noise.sigma,
            "relative": noise.relative,
            "innovation": noise.scale * noise.density.deviation,
            "unit": block.unit,
            "stated": noise.known,
            "values": block.size,
            "share": float(cost) / whole,
            "parameters": float(used),
            "discrepancy": block.noise.discrepancy,
        }
        for block, noise, cost, used in zip(
            likelihood.blocks, likelihood.noises, costs, estimate.covariance.used, strict=True
        )
    ]


def _profile(profile: Profile) -> dict[str, Any]:
    ends = ("low", profile.low), ("high", profile.high)
    return {
        "name": profile.name,
        **{side: {"value": end.value, "finished": end.finished, "wall": end.wall} for side, end in ends},
        "points": [[float(x), float(fall)] for x, fall in profile.points],
    }


# Certainty of a fit in its run folder: in result.json, with the injector of the most likely values beside it.


def write_likely(folder: Path, study: Study, values: Mapping[str, float]) -> Path:
    """Write the most likely values of a fit as an injector with its meters, most-likely.toml; return its path.

    `write_certainty`, which follows, writes its checksum.

    `folder`: run folder; `study`: of the run; `values`: [SI], of all free parameters. Raises `OutputError` if the file
    cannot be written.
    """
    source = Source("F", f'most likely values of "{study.title}"')
    fitted = {name: value for name, value in values.items() if not is_of_meter(name)}
    meters = tuple(meter.with_best(values, source) for meter in study.meters)
    path = folder / LIKELY
    dump_injector(study.injector.with_values(fitted), path, dict.fromkeys(fitted, source.text), meters=meters)
    return path


def write_certainty(folder: str | Path, certainty: Mapping[str, Any]) -> dict[str, Any]:
    """Write the certainty of a fit into its result.json, and return the whole record.

    `folder`: run folder; `certainty`: of `Certainty.record`; with a key "posterior" if posterior.npz was written.
    Raises `InputError` if the folder is not a run folder. Raises `OutputError` if the file cannot be written.
    """
    folder = file_path(folder, "folder")
    record = read_result(folder)
    adopted = {key: value for key, value in record.get(CERTAINTY, {}).items() if key in ("searched", "taken")}
    record[CERTAINTY] = {**certainty, **adopted}
    known = {one["name"]: one for one in certainty["parameters"]}
    for parameter in record["parameters"]:
        parameter.update({key: known[parameter["name"]][key] for key in ("standard_error", "verdict")})
    former = () if "posterior" in certainty else (POSTERIOR,)  # that of a former certainty has other noise
    with summed(folder, *former):
        write_record(folder / RESULT, record)
    return record
