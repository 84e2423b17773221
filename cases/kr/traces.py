"""Write the traces that the study reads, from the file of their source.

Usage: python cases/kr/traces.py waveform_dataset.npz
(github.com/porous-reg/injector-roi-prediction, commit b7ffc17). The file holds X (traces, samples, 2) with coil current
[A] and rail pressure [bar], and y (traces, samples, 1) with the rate of injection [mg/ms], 5 us apart from -0.5 ms on.
It names no energising times: they follow from the end of the current.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HERE = Path(__file__).parent
START, STEP = -0.5, 0.005  # [ms]
NOMINAL = (250, 300, 350, 400, 450, 500, 550, 600, 650, 700, 800, 900, 1000, 1500, 2000, 3000, 4000, 5000)  # [us]
FLOWING = 0.7  # current above its zero that counts as energised [A]


def energising_time(time: Floats, current: Floats) -> int:
    """Nominal energising time [us] of a trace.

    The current falls 10 us late behind the hold phase, 15 us from the fall before it and 30 us from the peak.
    """
    zero = float(np.median(current[time < -0.05]))
    end = 1e3 * float(time[np.flatnonzero(current - zero > FLOWING)[-1]])
    late = 10.0 if end > 700.0 else 15.0 if end > 480.0 else 30.0
    return min(NOMINAL, key=lambda nominal: abs(nominal - (end - late)))


def write(source: Path, folder: Path) -> list[Path]:
    """Write one table for each energising time; returns their paths.

    Parameters
    ----------
    source : Path
        The file with X and y.
    folder : Path
        Made if it is missing.
    """
    content = np.load(source)
    traces, rates = np.asarray(content["X"], float), np.asarray(content["y"], float)[..., 0]
    time = START + STEP * np.arange(rates.shape[1])
    tables: dict[int, dict[str, Floats]] = {}
    for trace, rate in zip(traces, rates, strict=True):
        current, pressure = trace[:, 0], round(float(trace[1, 1]))
        columns = tables.setdefault(energising_time(time, current), {"t_ms": time})
        columns.setdefault(f"I_A_{pressure}bar", current)
        columns.setdefault(f"mdot_mg_ms_{pressure}bar", rate)
    folder.mkdir(exist_ok=True)
    written = []
    for nominal, columns in sorted(tables.items()):
        written.append(folder / f"kr_ET{nominal}us.csv")
        table = np.column_stack(list(columns.values()))
        np.savetxt(written[-1], table, "%.4f", ",", header=",".join(columns), comments="")
    return written


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit("Give the path of waveform_dataset.npz, and nothing else.")
    for path in write(Path(sys.argv[1]), HERE / "data"):
        print(path)
