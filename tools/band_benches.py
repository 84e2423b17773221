"""Share of unseen quantities that bands hold, on virtual benches of a case's own linear model.

    commonrail calibrate cases/cri2-16/study.toml --out runs/cri2
    python -m tools.band_benches runs/cri2                  # 300 benches of each kind

A bench draws the parameters about the middle of their priors, a discrepancy that the model lacks, and noise. It is
fitted and predicted as the linear model of the run has it: derivatives, priors, operating points and the rule of
`commonrail.plugins.prediction.scatter`. The measured values of the validation maps are not used.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from commonrail.calibration.influence import around
from commonrail.data.base import DataSet, Role
from commonrail.data.quantities.data import QuantityData
from commonrail.data.registry import of_role
from commonrail.data.simulator import Simulator
from commonrail.plugins.certainty.covariance import student
from commonrail.plugins.certainty.estimate import estimate
from commonrail.plugins.certainty.likelihood import Likelihood, prior_slopes_at
from commonrail.runs.folder import read_fit

Floats = NDArray[np.float64]

LEVELS = (0.5, 0.9)
ROUNDS = 40  # of the noise given the residuals
LENGTHS = np.array([60e6, 250e-6])  # over which a discrepancy is correlated [Pa], [s]
# variation of the parameters over that of the priors, noise and discrepancy in tolerances
KINDS = ((1.0, 1.0, 0.0), (0.3, 1.0, 0.0), (1.0, 0.7, 1.5), (0.3, 0.7, 1.5))


class Linear(NamedTuple):
    """Linear model of a run, in tolerances and standard deviations of the priors.

    `fitted` (n, d) and `unseen` (m, d) are derivatives of the fitted residuals and of the quantities to be predicted;
    `judged` (n,) are the residuals that are quantities; `places` (n + m, 2) are rail pressures [Pa] and energising
    times [s].
    """

    fitted: Floats
    judged: NDArray[np.bool_]
    unseen: Floats
    places: Floats

    @classmethod
    def of(cls, folder: str) -> Linear:
        """Model of a run folder whose study has priors on all parameters and fits quantities alone."""
        study, best = read_fit(folder)
        own, point = Likelihood.of(study, 1), np.array([best[name] for name in study.space.names])
        found = estimate(own, own.space.to_unit(point)[None])
        widths = 1.0 / np.diag(prior_slopes_at(own, found.unit))
        fitted = of_role(study.data, Role.FIT)
        new = [data for data in of_role(study.data, Role.VALIDATION) if isinstance(data, QuantityData)]
        place = around(own.space, point)
        simulator = Simulator(study.injector, study.space.names, study.time_step, 1)
        slopes = []
        for data in new:
            values = data.simulated(simulator, place.values)
            slopes.append((place.slopes(values) / np.asarray(data.discrepancy(values[0]))[:, None])[data.judged])
        judged = np.concatenate([data.judged for data in fitted])
        places = np.vstack([_places(data) for data in fitted] + [_places(data)[data.judged] for data in new])
        return cls((found.slopes * widths[:, None]).T, judged, np.vstack(slopes) * widths, places)

    def half_widths(self, errors: Floats) -> tuple[Floats, list[Floats]]:
        """Fitted parameters (d,) and half widths (m,) of the bands of each level."""
        d, scale = self.fitted.shape[1], 1.0
        for _ in range(ROUNDS):
            inverse = np.linalg.inv(self.fitted.T @ self.fitted / scale**2 + np.eye(d))
            best = -inverse @ self.fitted.T @ errors / scale**2
            influence = self.fitted @ inverse @ self.fitted.T / scale**2
            rest = errors + self.fitted @ best
            scale = max(float(np.sqrt(rest @ rest / max(len(rest) - np.trace(influence), 1.0))), 0.05)
        left = (np.eye(len(rest)) - influence)[np.ix_(self.judged, self.judged)]
        root = np.sqrt(np.diag(left))
        freedom = len(root) ** 2 / np.sum((left / np.outer(root, root)) ** 2)
        calibration = np.mean((rest[self.judged] / scale / root) ** 2)
        variance = calibration * (np.einsum("ni,ij,nj->n", self.unseen, inverse, self.unseen) + scale**2)
        quantiles = [float(student(np.array([freedom]), level)[0]) for level in LEVELS]
        return best, [quantile * np.sqrt(variance) for quantile in quantiles]


def _places(data: DataSet) -> Floats:
    return np.array([(p.initial_pressures()[0], p.pulses[0].duration if p.pulses else 0.0) for p in data.points])


def inside(model: Linear, kind: tuple[float, float, float], many: int) -> NDArray[np.intp]:
    """Number of unseen quantities inside the bands of each bench and level, (many, levels), for a kind of `KINDS`."""
    width, noise, discrepancy = kind
    rng = np.random.default_rng(2)
    apart = (model.places[:, None] - model.places[None]) / LENGTHS
    covariance = np.exp(-0.5 * np.sum(apart**2, axis=-1)) + 1e-9 * np.eye(len(model.places))
    root, n = discrepancy * np.linalg.cholesky(covariance), len(model.fitted)
    found = []
    for _ in range(many):
        truth = width * rng.standard_normal(model.fitted.shape[1])
        off = root @ rng.standard_normal(len(root)) + noise * rng.standard_normal(len(root))
        best, halves = model.half_widths(-(model.fitted @ truth + off[:n]))
        error = np.abs(model.unseen @ (best - truth) - off[n:])
        found.append([np.count_nonzero(error <= half) for half in halves])
    return np.array(found, np.intp)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the shares."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", help="run folder of a study with a validation map")
    parser.add_argument("-n", type=int, default=300, help="benches of each kind [default: 300]")
    own = parser.parse_args(arguments)
    model = Linear.of(own.run)
    many = len(model.unseen)
    print(
        f"| variation, noise, discrepancy | in the 50 % band, % | in the 90 % band, % | all {many} in the latter, % |"
    )
    print("|---|---|---|---|")
    for kind in KINDS:
        held = inside(model, kind, own.n)
        half, wide = 100.0 * held.mean(axis=0) / many
        print(f"| {kind} | {half:.0f} | {wide:.0f} | {100.0 * np.mean(held[:, 1] == many):.0f} |", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
