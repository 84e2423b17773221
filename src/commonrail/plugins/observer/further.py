"""Sensors in addition to the pressure: coil current and return flow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import block_diag

from commonrail.base.arrays import Bools, Floats
from commonrail.base.errors import ConfigurationError
from commonrail.base.text import quantity
from commonrail.physics.components import solenoid
from commonrail.plugins.observer.study import ObserverSettings, ShotRecord

# Rows of a trace that each sensor needs.
PATHS = {"current": ("solenoid.flux", "valve.lift"), "return": ("cumulative_flows.returned",)}
FADED = 0.3e-3  # time after the end of an energising without current [s]; chosen [E]
RESTING = 20e-6  # time with a closed valve in which only the guides leak to the return [s]
CURRENT_NOISE = 0.2  # default for a sample: 1 % of a usual peak [A]; an estimate [E]
# Share of the bend of the current over two samples by which it is not linear in the states: the slopes change a
# hundredfold where the regulator meets its limit within a sample. Chosen [E].
CORNER = 0.5
QUIETEST = 1e-4  # least noise of a sample of the current, as a share of the largest one, as for 12 bits


def coil_current(theta: Mapping[str, Floats], flux: Floats, lift: Floats) -> Floats:
    """Current of the coil (candidates, samples) [A], Eq. (11).

    `theta`: parameters (candidates, 1) by name; `flux` [Wb], `lift` of the valve [m]: (candidates, samples).
    """
    coil = solenoid.Parameters(*(theta[f"solenoid.{name}"] for name in solenoid.Parameters._fields))  # type: ignore[arg-type]
    gap = theta["valve.lift"] - lift
    return np.asarray(solenoid.circuit(solenoid.coefficients(coil), flux, gap).current)  # type: ignore[arg-type]


def select_current_samples(shot: ShotRecord, at: Floats) -> Bools:
    """Mark averaged samples at times (samples,) [s] in which the coil current counts."""
    last = shot.energisings[-1]
    return np.asarray((at > -1e-9) & (at < last.start + last.duration + FADED))


def read_meter(returned: Floats, time: Floats, period: float, gain: float) -> Floats:
    """Mass through the return line in a cycle, as a meter shows it (candidates, 1) [kg].

    The simulated mass, and after it the guides' leakage at rest, which flows before the valve opens.

    `returned` (candidates, samples): mass so far [kg] at `time` (samples,) [s]; `period` [s].
    """
    k = int(np.searchsorted(time, RESTING))
    leak = (returned[:, k] - returned[:, 0]) / (time[k] - time[0])
    return np.asarray((1.0 + gain) * (returned[:, -1] + leak * (period - time[-1])))[:, None]


def find_current_noise(shots: Sequence[ShotRecord]) -> float:
    """Standard deviation of a sample of the current before shots [A], at least that of 12 bits."""
    still = [shot.further["current"][shot.time < 0.0] for shot in shots]
    largest = max(float(np.abs(shot.further["current"]).max()) for shot in shots)
    return max(float(np.concatenate([current - current.mean() for current in still]).std()), QUIETEST * largest)


def check_further_sensors(shots: Sequence[ShotRecord], further: Sequence[str]) -> None:
    """Refuse a current that does not rise in the energisings, and a return flow without a whole cycle."""
    if "return" in further and not any("return" in shot.further for shot in shots):
        raise ConfigurationError(
            "The log holds no whole cycle of the return flow, from one shot to the next; give a longer log, or omit "
            "the return flow (--return-flow)."
        )
    if "current" in further:
        pairs = [(shot.further["current"], shot.time, shot.energisings[-1]) for shot in shots]
        rises = [
            now[flow].mean() - now[t < 0.0].mean() for now, t, end in pairs if any(flow := (t > 0.0) & (t < sum(end)))
        ]
        rise = float(np.median(rises)) if rises else 0.0
        if rise <= find_current_noise(shots):
            raise ConfigurationError(
                f"The current does not rise in the energisings: it is {quantity(rise, 'A', 2)} more than before them; "
                "check its column (--current), its sign and its clock."
            )


def join_covariances(
    first: Floats, alike: Floats, settings: ObserverSettings, shot: ShotRecord, shown: Floats, at: Floats
) -> Floats:
    """Covariance (rows, rows) of the pressure and all further sensors, with independent errors.

    Parameters
    ----------
    first : (samples, samples)
        Covariance of the pressure [Pa²].
    alike : (samples, samples)
        Correlation of the model error.
    settings : ObserverSettings
    shot : ShotRecord
    shown : (rows,)
        Simulated readings, those of the pressure first.
    at : (samples,)
        Times of averaged samples [s].
    """
    blocks = [first]
    if "current" in shot.further:
        flows = select_current_samples(shot, at)
        amperes = shown[len(at) : len(at) + int(flows.sum())]
        steep = np.gradient(amperes, at[flows]) if len(amperes) > 1 else 0.0
        lacking = np.hypot(settings.current_discrepancy * amperes, settings.current_timing * steep)
        noise = (settings.current_noise or CURRENT_NOISE) / settings.count_averaged_samples(shot.time) ** 0.5
        current_variances = noise**2 + (CORNER * np.convolve(amperes, (1.0, -2.0, 1.0), "same")) ** 2
        blocks.append(np.diag(current_variances) + np.outer(lacking, lacking) * alike[flows][:, flows])
    if "return" in shot.further:
        share = settings.return_shots * settings.return_deviation**2 + settings.return_discrepancy**2
        blocks.append(np.atleast_2d(share * shown[-1] ** 2))
    return np.asarray(block_diag(*blocks))
