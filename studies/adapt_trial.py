"""Adapt a type to sound and to defective parts, and count the doubts. All of its data are SYNTHETIC.

    python -m studies.adapt_trial               # a hundred sound parts and five defective ones of a CRI2-16
    python -m studies.adapt_trial --sound 20
    python -m studies.adapt_trial --sound 0 --z-hole 10   # and twenty parts whose Z-hole is 4 % too small or too large

The type has the values of the catalogue and, as spreads, tolerances such as makers keep: those that `cases/tolerance`
and `cases/family` assume, and estimates for the coil and the needle's seat. A part is drawn from them, simulated at
eight points at a finer step than the fit's, and measured with the scatter of a good bench, which `adapt` is told with
the spread of the flow. A defective part is a drawn one with one defect more. Exit status 1 if more than 5 % of the
sound parts are doubted, or a defect is not.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace

import numpy as np

import commonrail as cr

INJECTOR = "cri2-16"
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
ABSOLUTE, RELATIVE, FINE = 0.05e-9, 0.006, 0.25e-6  # scatter of the bench [m³], [1]; step of the truth [s]


def type_of(injector: cr.Injector) -> cr.InjectorType:
    """The type: values of the catalogue, spreads of the makers."""
    parameters = [
        cr.TypeParameter(name, value, share * value, 0.5 * value, 2.0 * value, "E", "maker's tolerance", share * value)
        for name, share, value in ((name, share, injector.values[name]) for name, share in TOLERANCES.items())
    ]
    return cr.InjectorType("trial", "made up", tuple(parameters), (cr.TypePart("none", "made up", {}),), injector)


def measured(injector: cr.Injector, random: np.random.Generator) -> cr.QuantityData:
    """Quantities of a part at the reference points, as a bench reads them."""
    at = tuple(cr.OperatingPoint(p * 1e6, t * 1e-6, horizon=t * 1e-6 + 3e-3) for p, t in POINTS)
    true = cr.simulate_batch(injector, at, time_step=FINE, threads=1).injected_volume[0]
    off = np.hypot(ABSOLUTE, RELATIVE * true)
    read = np.maximum(true + off * random.standard_normal(len(at)), 0.0)
    text = "studies/adapt_trial.py"
    return cr.QuantityData(
        "points", cr.Role.FIT, at, read, ABSOLUTE, RELATIVE, np.zeros(len(at), bool), 1.0, text, text
    )


def verdict(known: cr.InjectorType, seed: int, defect: dict[str, float]) -> tuple[list[str], str]:
    """Doubts of a part drawn from the tolerances, with a defect, and the change that explains it."""
    random, own = np.random.default_rng(seed), known.injector.values
    shares = TOLERANCES | {HOLE: HOLE_SPREAD}
    drawn = {name: own[name] * (1.0 + share * random.standard_normal()) for name, share in shares.items()}
    part = known.injector.with_values({n: drawn.get(n, own[n]) * defect.get(n, 1.0) for n in {*drawn, *defect}})
    try:
        doubts = cr.adapt(known, measured(part, random), flow_spread=2.0 * HOLE_SPREAD).doubts
    except cr.InputError as error:
        return [str(error)], ""
    return list(doubts.sentences), doubts.change


def main() -> None:
    """Print what is doubted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sound", type=int, default=100, help="number of sound parts")
    parser.add_argument("--z-hole", type=int, default=0, help="parts with a Z-hole 4 %% too small, and too large")
    args = parser.parse_args()
    count = args.sound
    injector = cr.load_injector(INJECTOR)
    known = type_of(replace(injector, sources=injector.sources | {"valve.lift": cr.Source("E", "not gauged")}))
    doubted, missed = 0, []
    for seed in range(count):
        sentences, change = verdict(known, seed, {})
        doubted += bool(sentences)
        if sentences:
            print(f"sound part {seed}: {'; '.join(sentences)} [{change}]", flush=True)
    print(f"{doubted} of {count} sound parts are doubted")
    for i, (name, defect) in enumerate(DEFECTS.items()):
        sentences, change = verdict(known, 1000 + i, defect)
        missed += [] if sentences else [name]
        print(f"{name}: {'; '.join(sentences) or 'NO DOUBT'} [{change}]", flush=True)
    for off in (0.96, 1.04):
        parts = [verdict(known, 2000 + i, {Z_HOLE: off}) for i in range(args.z_hole)]
        if parts:
            print(f"Z-hole {off - 1.0:+.0%}: {sum(bool(found) for found, _ in parts)} of {len(parts)} are doubted")
    sys.exit(bool(missed) or doubted > 0.05 * count)


if __name__ == "__main__":
    main()
