"""Low-passes and lags of signals with equal intervals; each keeps the sum of a signal that comes back to rest.

Signals are arrays (..., samples). Every function treats each signal by itself: the same bits alone or among others.
"""

from __future__ import annotations

import math
from enum import StrEnum

import numpy as np

from commonrail.arrays import Floats

__all__ = ["LowPass", "first_order", "look_ahead", "low_pass"]


_TAIL = 30.0  # e-foldings after which the response of the zero-phase filter has died away, below rounding
_SEEN = 7.0  # e-foldings of it that a simulation must reach beyond the last sample: 0.1 %
_FASTEST = 0.49  # largest cut-off of a Butterworth filter, as a share of the sampling frequency


class LowPass(StrEnum):
    """Laws of a low-pass of order n with the cut-off frequency f_c."""

    BUTTERWORTH = "butterworth"
    """Causal, 1/√2 of the amplitude at f_c (bilinear transform)."""

    CASCADE = "cascade"
    """Causal, n equal first-order lags in a row, each with 1/√2 of the amplitude at f_c."""

    ZERO_PHASE = "zero-phase"
    """Amplitude 1/(1 + (f/f_c)^2n), 1/2 at f_c, without phase: a filter applied to a recorded signal."""


def low_pass(signal: Floats, interval: float, law: LowPass, order: int, cutoff: float) -> Floats:
    """Filtered signals; each rests at zero before its first sample and after its last.

    Parameters
    ----------
    signal : (..., samples)
    interval : float
        Time between samples [s].
    law : LowPass
    order : int
        n, 1 or greater.
    cutoff : float
        f_c [Hz]; infinite for no filter. A Butterworth filter above 0.49 of the sampling frequency takes that.
    """
    if math.isinf(cutoff):
        return signal
    if law is LowPass.ZERO_PHASE:
        return _zero_phase(signal, interval, order, cutoff)
    if law is LowPass.BUTTERWORTH:
        return _butterworth(signal, interval, order, cutoff)
    for _ in range(order):
        signal = first_order(signal, 2.0 * math.pi * cutoff * interval)
    return signal


def first_order(signal: Floats, decay: float, rest: float = 0.0) -> Floats:
    """First-order lag: means over the intervals of a signal constant over each, or values of one linear between them.

    Both cases have the same recursion, with e = exp(−d) and m = (1 − e)/d:
    y_k = (1 − m) u_k + (m − e) u_(k−1) + e y_(k−1).

    Parameters
    ----------
    signal : (..., samples)
    decay : float
        d, interval over time constant; infinite for no lag.
    rest : float
        Value before the first sample.
    """
    if math.isinf(decay):
        return signal
    from scipy.signal import lfilter  # takes a third of a second to import

    keep, mean = math.exp(-decay), -math.expm1(-decay) / decay
    before = np.full((*signal.shape[:-1], 1), mean * rest)
    return np.asarray(lfilter([1.0 - mean, mean - keep], [1.0, -keep], signal, zi=before)[0])


def look_ahead(law: LowPass, order: int, cutoff: float) -> float:
    """Time [s] that a filter sees ahead of a sample; zero for a causal one.

    Parameters
    ----------
    law, order, cutoff
        As in `low_pass`.
    """
    if law is not LowPass.ZERO_PHASE or math.isinf(cutoff):
        return 0.0
    return _SEEN * _slowest(order, cutoff)


def _slowest(order: int, cutoff: float) -> float:
    """Time constant [s] of the slowest part of the zero-phase filter's response."""
    return 1.0 / (2.0 * math.pi * cutoff * math.sin(math.pi / (2 * order)))


def _butterworth(signal: Floats, interval: float, order: int, cutoff: float) -> Floats:
    from scipy.signal import butter, sosfilt

    sections = butter(order, min(cutoff * interval, _FASTEST), fs=1.0, output="sos")
    return np.asarray(sosfilt(sections, signal))


def _zero_phase(signal: Floats, interval: float, order: int, cutoff: float) -> Floats:
    """Product with the amplitude in the frequency domain; zeros behind the signal keep its ends apart."""
    samples = signal.shape[-1]
    tail = math.ceil(_TAIL * _slowest(order, cutoff) / interval)
    padded = 1 << (samples + min(tail, 16 * samples) - 1).bit_length()
    frequency = np.fft.rfftfreq(padded, interval)
    amplitude = 1.0 / (1.0 + (frequency / cutoff) ** (2 * order))
    return np.asarray(np.fft.irfft(np.fft.rfft(signal, padded) * amplitude, padded)[..., :samples])
