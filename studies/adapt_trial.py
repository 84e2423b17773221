"""Adapt a type to sound and to defective parts, and count the doubts. All of its data are SYNTHETIC.

    python -m studies.adapt_trial               # a hundred sound parts and five defective ones of a CRI2-16
    python -m studies.adapt_trial --sound 20
    python -m studies.adapt_trial --sound 0 --z-hole 10   # and twenty parts whose Z-hole is 4 % too small or too large
    python -m studies.adapt_trial --few 20      # twenty parts each of three types by 2, 3 and 4 quantities, alone

The type has the values of the catalogue and, as spreads, tolerances of makers: those that `cases/tolerance`
and `cases/family` assume, and estimates for the coil and the needle's seat. A part is drawn from them, simulated at
eight points at a finer step than the fit's, and measured with the scatter of a good bench, which `adapt` receives with
the spread of the flow. A defective part is a drawn one with one defect more. Exit status 1 if more than 5 % of the
sound parts are doubted, or a defect is not.

With --few a point is left out in turn, and 2, 3 or 4 others, drawn at random, are given: relative errors of its
quantity without noise, by `adapt`, by the flow factor that fits the given ones best, and by the type as it is. The
type's spreads are twice the tolerances here, as of a type that was itself fitted, and so are the parts'; a part that
does not inject 1 mm³ at each point is drawn again. Exit status 1 if `adapt` is not the best of the three.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

import commonrail as cr
from commonrail.base.arrays import Floats
from commonrail.plugins.family.drawn import FACTORS

INJECTOR, TYPES = "cri2-16", ("cri2-16", "cri2-1", "crin2")
Z_HOLE = "control_chamber.z_hole_diameter"
# Standard deviations between sound parts, as shares of the value.
TOLERANCES = {
    "nozzle.discharge_maximum": 0.005,
    "control_chamber.a_hole_diameter": 0.008,
    Z_HOLE: 0.008,
    "plunger_needle.plunger_diameter": 0.0005,
    "plunger_needle.spring_preload": 0.025,
    "needle_seat.diameter": 0.004,
    "valve.lift": 0.03,
    "valve.spring_preload": 0.015,
    "valve.mass": 0.01,
    "solenoid.eddy_lag": 0.05,
}
HOLE, HOLE_SPREAD = "nozzle.hole_diameter", 0.005  # of the part's own drawing: 1 % of flow
DEFECTS = {
    "flow -8 %": {HOLE: 0.92**0.5},
    "valve spring -30 %": {"valve.spring_preload": 0.7},
    "armature lift +25 %": {"valve.lift": 1.25},
    "worn seat and guides": {
        "needle_seat.diameter": 1.08,
        "plunger_needle.plunger_gap": 2.5,
        "plunger_needle.needle_gap": 2.5,
    },
    "armature lag x 2": {"solenoid.eddy_lag": 2.0},
}
# Rail pressure [MPa], energising time [us].
POINTS = ((40, 400), (40, 1000), (80, 300), (80, 700), (120, 500), (160, 250), (160, 500), (160, 1400))
FEW = ((30, 800), (60, 700), (80, 400), (120, 600), (160, 1350))  # as of a workshop's sheet
WIDER = 2.0  # spreads of the types that are given few quantities, in `TOLERANCES`
ABSOLUTE, RELATIVE, FINE = 0.05e-9, 0.006, 0.25e-6  # scatter of the bench [m³], [1]; step of the truth [s]


def type_of(injector: cr.Injector, scale: float = 1.0) -> cr.parts.InjectorType:
    """The type: values of the catalogue, spreads of the makers times a scale."""
    parameters = [
        cr.parts.TypeParameter(
            name, value, share * value, 0.5 * value, 2.0 * value, "E", "maker's tolerance", share * value
        )
        for name, share, value in ((name, scale * share, injector.values[name]) for name, share in TOLERANCES.items())
    ]
    return cr.parts.InjectorType(
        "trial", "made up", tuple(parameters), (cr.parts.TypePart("none", "made up", {}),), injector
    )


def operating_points(points: Sequence[tuple[float, float]]) -> tuple[cr.OperatingPoint, ...]:
    """Points of rail pressures [MPa] and energising times [us]."""
    return tuple(cr.OperatingPoint(p * 1e6, t * 1e-6, horizon=t * 1e-6 + 3e-3) for p, t in points)


def measure_part(injector: cr.Injector, random: np.random.Generator) -> cr.QuantityData:
    """Quantities of a part at the reference points, as a bench reads them."""
    at = operating_points(POINTS)
    return measure_points(at, cr.simulate_batch(injector, at, time_step=FINE, threads=1).injected_volume[0], random)


def measure_points(at: tuple[cr.OperatingPoint, ...], true: Floats, random: np.random.Generator) -> cr.QuantityData:
    """True quantities [m³] with the scatter of a bench."""
    deviation = np.hypot(ABSOLUTE, RELATIVE * true)
    read = np.maximum(true + deviation * random.standard_normal(len(at)), 0.0)
    text = "studies/adapt_trial.py"
    return cr.QuantityData(
        "points", cr.data.Role.FIT, at, read, ABSOLUTE, RELATIVE, np.zeros(len(at), bool), 1.0, text, text
    )


def verdict(injector_type: cr.parts.InjectorType, seed: int, defect: dict[str, float]) -> tuple[list[str], str]:
    """Doubts of a part drawn from the tolerances, with a defect, and the change that explains it."""
    random, nominal = np.random.default_rng(seed), injector_type.injector.values
    shares = TOLERANCES | {HOLE: HOLE_SPREAD}
    drawn = {name: nominal[name] * (1.0 + share * random.standard_normal()) for name, share in shares.items()}
    changed = {n: drawn.get(n, nominal[n]) * defect.get(n, 1.0) for n in {*drawn, *defect}}
    specimen = injector_type.injector.with_values(changed)
    try:
        doubts = cr.parts.adapt(injector_type, measure_part(specimen, random), flow_spread=2.0 * HOLE_SPREAD).doubts
    except cr.errors.InputError as error:
        return [str(error)], ""
    return list(doubts.sentences), doubts.change


def predict_by_flow(injector: cr.Injector, data: cr.QuantityData, at: cr.OperatingPoint) -> float:
    """Quantity [m³] at a point by the flow factor whose quantities are nearest to data, in their tolerances."""
    factors = np.linspace(*FACTORS, 201)
    values = injector.values[HOLE] * np.sqrt(factors)[:, None]
    volumes = cr.simulate_batch(injector, (*data.points, at), (HOLE,), values, threads=1).injected_volume
    costs = np.sum(((volumes[:, :-1] - data.quantity) / data.discrepancy(data.quantity)) ** 2, axis=1)
    return float(volumes[np.argmin(costs), -1])


def leave_points_out(injector: cr.Injector, count: int) -> bool:
    """Print the errors of a point that is left out, by 2, 3 and 4 others; True if `adapt` has the least."""
    injector_type, at, nominal = type_of(injector, WIDER), operating_points(FEW), injector.values
    of_type = cr.simulate_batch(injector, at, threads=1).injected_volume[0]
    errors = np.full((3, count, 3), np.nan)
    warned = 0
    for i in range(count):
        random = np.random.default_rng([i, 80])
        spreads = {n: WIDER * s for n, s in (TOLERANCES | {HOLE: HOLE_SPREAD}).items()}
        true = np.zeros(len(at))
        while not (true > 1e-9).all():
            changed = {n: nominal[n] * (1.0 + s * random.standard_normal()) for n, s in spreads.items()}
            specimen = injector.with_values(changed)
            true = cr.simulate_batch(specimen, at, time_step=FINE, threads=1).injected_volume[0]
        k, order = i % len(FEW), random.permutation(len(FEW))
        for j, measured_points in enumerate((2, 3, 4)):
            rows = [r for r in order.tolist() if r != k][:measured_points]
            data = measure_points(tuple(at[r] for r in rows), true[rows], random)
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                adapted = cr.parts.adapt(injector_type, data, flow_spread=2.0 * WIDER * HOLE_SPREAD, threads=1)
            warned += bool(caught)
            adapted_volume = cr.simulate_batch(adapted.injector, at, threads=1).injected_volume[0, k]
            by_flow = predict_by_flow(injector, data, at[k])
            errors[j, i] = np.array([adapted_volume, by_flow, of_type[k]]) / true[k] - 1.0
    rms, worst = 100.0 * np.sqrt(np.mean(errors**2, axis=1)), 100.0 * np.abs(errors).max(axis=1)
    for j, measured_points in enumerate((2, 3, 4)):
        texts = "".join(f"{a:8.1f} ({b:4.0f})" for a, b in zip(rms[j], worst[j], strict=True))
        print(f"{injector.name:10}{measured_points:3}{texts}", flush=True)
    print(f"{injector.name}: {warned} of {3 * count} adapted models miss a reference or inject nothing somewhere")
    return bool((np.argmin(rms, axis=1) == 0).all())


def main() -> None:
    """Print the doubts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sound", type=int, default=100, help="number of sound parts")
    parser.add_argument("--z-hole", type=int, default=0, help="parts with a Z-hole 4 %% too small, and too large")
    parser.add_argument("--few", type=int, default=0, help="parts of each type given few quantities, and nothing else")
    args = parser.parse_args()
    if args.few:
        print("type    given   rms error (largest) of the quantity left out, %: adapt, flow factor alone, type")
        sys.exit(not all([leave_points_out(cr.load_injector(name), args.few) for name in TYPES]))
    count = args.sound
    injector = cr.load_injector(INJECTOR)
    sources = injector.sources | {"valve.lift": cr.models.Source("E", "not gauged")}
    injector_type = type_of(replace(injector, sources=sources))
    doubted, missed = 0, []
    for seed in range(count):
        sentences, change = verdict(injector_type, seed, {})
        doubted += bool(sentences)
        if sentences:
            print(f"sound part {seed}: {'; '.join(sentences)} [{change}]", flush=True)
    print(f"{doubted} of {count} sound parts are doubted")
    for i, (name, defect) in enumerate(DEFECTS.items()):
        sentences, change = verdict(injector_type, 1000 + i, defect)
        missed += [] if sentences else [name]
        print(f"{name}: {'; '.join(sentences) or 'NO DOUBT'} [{change}]", flush=True)
    for factor in (0.96, 1.04):
        parts = [verdict(injector_type, 2000 + i, {Z_HOLE: factor}) for i in range(args.z_hole)]
        if parts:
            print(f"Z-hole {factor - 1.0:+.0%}: {sum(bool(doubts) for doubts, _ in parts)} of {len(parts)} are doubted")
    sys.exit(bool(missed) or doubted > 0.05 * count)


if __name__ == "__main__":
    main()
