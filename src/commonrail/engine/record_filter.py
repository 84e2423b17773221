"""Low-pass filter for records of pressure sensors, whose noise would make the feed pipe ring."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from commonrail.base.arrays import Floats

# The noise is estimated from 5 to 10 kHz: waves of rails and lines have nearly decayed there, and most sensors respond.
TOP, LOWEST = 10e3, 100.0  # upper end of this octave, and lowest default cut-off, above pump and control [Hz]
MARGIN = 4.0  # cut-off over signal frequency; the loss at corners of the signal falls with 1/f
STANDS_OUT = 3.0  # power of a signal over the noise power, in a band of half an octave
FEWEST = 32  # samples needed to separate signal from noise
CHI = 0.4549  # median of χ² with one degree of freedom over its mean
NEIGHBOURS = 9  # frequencies whose mean power is compared with the noise power


class Filtered(NamedTuple):
    """Record (samples,), evenly spaced if something was removed, cut-off [Hz], and rms of the removed part."""

    time: Floats
    value: Floats
    cut_off: float
    removed: float


def low_pass(time: Floats, value: Floats, cut_off: float | None = None) -> Filtered:
    """Low-pass a record without a shift in time.

    Up to the cut-off f_c its cosine transform is unchanged, above √2 f_c it is zero, and in between the gain falls
    as a half cosine. The transform is that of the record minus its regression line. With the default cut-off a Wiener
    filter also removes the noise between the waves: the gain is further multiplied by

        max(1 − 3 N/P, 0)

    P being the power of a frequency and its neighbours, N that of the noise (Wiener 1949, Extrapolation, Interpolation,
    and Smoothing of Stationary Time Series; three times the noise, since its power scatters).

    Parameters
    ----------
    time, value : (samples,)
        An uneven record is first interpolated, linearly, at the median of its intervals.
    cut_off : float, optional
        [Hz]. Default: four times the frequency up to which the record stands out from its noise, from 100 Hz to
        20 kHz; a record too short or too slow (below 20 kHz) to show its noise is unchanged.
    """
    from scipy.fft import dct, idct

    if cut_off is None and len(time) < FEWEST:
        return Filtered(time, value, np.inf, 0.0)
    span = float(time[-1] - time[0])
    count = min(round(span / float(np.median(np.diff(time)))), 10 * len(time)) + 1
    even = np.linspace(time[0], time[-1], count)
    record = np.interp(even, time, value)
    line = np.polynomial.Polynomial.fit(even, record, 1)(even)
    content, frequency = dct(record - line, norm="ortho"), np.arange(count) / (2.0 * span)
    weight = np.ones(count)
    octave = (frequency > 0.5 * TOP) & (frequency <= TOP)
    if cut_off is None and (frequency[-1] < 0.99 * TOP or np.count_nonzero(octave) < NEIGHBOURS):
        return Filtered(time, value, np.inf, 0.0)
    if cut_off is None:
        power = content**2
        noise = float(np.median(power[octave])) / CHI
        cut_off = max(MARGIN * _highest_signal(power, frequency, noise), LOWEST)
        # corners and ends of the record affect the octave of the noise, and the last octave less
        steady = min(noise, float(np.median(power[frequency > 0.5 * frequency[-1]])) / CHI)
        mean = np.convolve(power, np.full(NEIGHBOURS, 1.0 / NEIGHBOURS), "same")
        weight = np.maximum(1.0 - STANDS_OUT * steady / np.maximum(mean, np.finfo(float).tiny), 0.0)
    elif cut_off >= frequency[-1]:
        return Filtered(time, value, cut_off, 0.0)
    fall = np.clip((frequency / cut_off - 1.0) / (2.0**0.5 - 1.0), 0.0, 1.0)
    gain = weight * (0.5 + 0.5 * np.cos(np.pi * fall))
    smooth = line + idct(content * gain, norm="ortho")
    return Filtered(even, smooth, cut_off, float(np.mean((record - smooth) ** 2) ** 0.5))


def _highest_signal(power: Floats, frequency: Floats, noise: float) -> float:
    """Upper end [Hz] of the highest half octave below 5 kHz that stands out from the noise, 0 if there is none."""
    upper = 0.5 * TOP
    while upper > LOWEST * 2.0**0.5:
        band = power[(frequency > upper / 2.0**0.5) & (frequency <= upper)]
        if len(band) and band.sum() > STANDS_OUT * noise * (len(band) + STANDS_OUT):  # few bins scatter more
            return upper
        upper /= 2.0**0.5
    return 0.0
