"""Meters of a bench, between the injection and the recorded signal: laws, quantities and signals."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from commonrail.base.arguments import Quantity, enum_member, integer, mapping, number, plain_text, settle
from commonrail.base.arrays import Floats
from commonrail.base.errors import ConfigurationError, nearest
from commonrail.base.units import to_text
from commonrail.physics.injector import Source, parameter_quantities
from commonrail.physics.law import Domain, Q

# Low-passes and lags of signals with equal intervals; each keeps the sum of a signal that comes back to rest.
#
# Signals are arrays (..., samples). Every function treats each signal by itself: the same bits alone or among others.

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

    `signal`: (..., samples). `interval`: time between samples [s]. `order`: n, 1 or greater. `cutoff`: f_c [Hz];
    infinite for no filter. A Butterworth filter above 0.49 of the sampling frequency takes that.
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

    `signal`: (..., samples); `decay`: d, interval over time constant; infinite for no lag; `rest`: value before the
    first sample.
    """
    if math.isinf(decay):
        return signal
    from scipy.signal import lfilter  # takes a third of a second to import

    keep, mean = math.exp(-decay), -math.expm1(-decay) / decay
    before = np.full((*signal.shape[:-1], 1), mean * rest)
    return np.asarray(lfilter([1.0 - mean, mean - keep], [1.0, -keep], signal, zi=before)[0])


def look_ahead(law: LowPass, order: int, cutoff: float) -> float:
    """Time [s] that a filter sees ahead of a sample; zero for a causal one.

    Arguments as in `low_pass`.
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
    """Product with the amplitude in the frequency domain; zeros after the signal keep its ends from overlapping."""
    samples = signal.shape[-1]
    tail = math.ceil(_TAIL * _slowest(order, cutoff) / interval)
    padded = 1 << (samples + min(tail, 16 * samples) - 1).bit_length()
    frequency = np.fft.rfftfreq(padded, interval)
    amplitude = 1.0 / (1.0 + (frequency / cutoff) ** (2 * order))
    return np.asarray(np.fft.irfft(np.fft.rfft(signal, padded) * amplitude, padded)[..., :samples])


# Quantities of a meter: unit, meaning, domain and neutral value of each, and their names as free parameters.

PREFIX = "meter"  # of the dotted name of a free quantity: meter.bench.delay

_INF = float("inf")
_ECHO = "echo of the signal in the meter's tube"
_SECOND = "second echo of the signal in the meter's tube"

# A quantity without a default is absent unless it is given.
QUANTITIES: Mapping[str, Q] = {
    "delay": Q("s", "delay of the signal behind the flow", Domain.ANY, 0.0),
    "gain": Q("1", "factor on the rate or the quantity", Domain.POSITIVE, 1.0),
    "offset": Q("m3/s", "rate that is shown without flow", Domain.ANY, 0.0),
    "quantity_offset": Q("m3", "quantity per stroke that is shown without an injection", Domain.ANY, 0.0),
    "cutoff": Q("Hz", "cut-off frequency of the low-pass", Domain.POSITIVE, _INF),
    "late_cutoff": Q("Hz", "cut-off frequency of the low-pass after the opening peak", Domain.POSITIVE),
    "blend": Q("s", "time from the opening peak in which the late cut-off replaces the first", Domain.POSITIVE, 2e-4),
    "echo_share": Q("1", f"share of the {_ECHO}", Domain.ANY, 0.0),
    "echo_delay": Q("s", f"delay of the {_ECHO}", Domain.NON_NEGATIVE, 0.0),
    "echo_lag": Q("s", f"time constant of the {_ECHO}", Domain.NON_NEGATIVE, 0.0),
    "second_echo_share": Q("1", f"share of the {_SECOND}", Domain.ANY, 0.0),
    "second_echo_delay": Q("s", f"delay of the {_SECOND}", Domain.NON_NEGATIVE, 0.0),
    "second_echo_lag": Q("s", f"time constant of the {_SECOND}", Domain.NON_NEGATIVE, 0.0),
    "zeroing": Q("1", "share of the direct signal's peak below which the signal is set to zero", Domain.UNIT, 0.0),
    "density": Q("kg/m3", "density that makes the meter's volumes of masses", Domain.POSITIVE),
    "temperature": Q("K", "temperature of the fuel in the meter", Domain.POSITIVE),
}


def parameter_name(meter: str, quantity: str) -> str:
    """Dotted name of a quantity as a free parameter: meter.bench.delay."""
    return f"{PREFIX}.{meter}.{quantity}"


def is_of_meter(name: str) -> bool:
    """True for the dotted name of a meter's quantity, False for an injector's parameter."""
    return name.startswith(f"{PREFIX}.")


def parts_of(name: str) -> tuple[str, str]:
    """Meter and quantity of a dotted name."""
    _, meter, quantity = name.split(".", 2)
    return meter, quantity


def known_quantity(name: str) -> Q:
    """Unit, meaning and domain of a free parameter, of an injector or of a meter.

    Raises KeyError for an unknown name.
    """
    return QUANTITIES[parts_of(name)[1]] if is_of_meter(name) else parameter_quantities()[name]


HIGHEST_ORDER = 8  # of a low-pass
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,59}")


@dataclass(frozen=True)
class Meter:
    """A meter, through which simulated rates or quantities are seen before they are compared with measured ones.

    Attributes
    ----------
    name : str
        Letters, digits and underscores; data sets that name the same meter share its quantities.
    values : mapping of str to float
        Quantities by the names of `QUANTITIES` [SI]; absent ones are neutral. Texts with units are read. Quantities
        that a study fits (parameters such as ``meter.bench.delay``) start from here.
    law : LowPass
        Law of the low-pass: "butterworth", "cascade" or "zero-phase".
    order : int
        Order of the low-pass, 1 to 8.
    sources : mapping of str to Source
        Mark and source of quantities.

    Raises
    ------
    ConfigurationError
        If a quantity is unknown or outside its domain, both density and temperature are given, the shares of the echoes
        leave nothing of the direct signal, a late cut-off is given with a law that delays, or the name is not valid.
    """

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    law: LowPass = LowPass.BUTTERWORTH
    order: int = 2
    sources: Mapping[str, Source] = field(default_factory=dict)

    if TYPE_CHECKING:  # accepted types are wider than stored ones

        def __init__(
            self,
            name: str,
            values: Mapping[str, Quantity] = {},
            law: LowPass | str = LowPass.BUTTERWORTH,
            order: int = 2,
            sources: Mapping[str, Source] = {},
        ) -> None: ...

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(plain_text(self.name, "name of a meter")):
            raise ConfigurationError(
                f'The name of a meter must be letters, digits and underscores, such as "bench", not "{self.name}".'
            )
        stated = mapping(self.values, f"quantities of the meter {self.name}", '{"delay": "5 us"}')
        values = {key: self._read_quantity(key, value) for key, value in stated.items()}
        if {"density", "temperature"} <= set(values):
            raise ConfigurationError(f"The meter {self.name} has a density and a temperature; keep one of them.")
        echoes = values.get("echo_share", 0.0) + values.get("second_echo_share", 0.0)
        if echoes >= 1.0:
            raise ConfigurationError(
                f"The shares of the echoes of the meter {self.name} add up to {echoes:g}, which leaves nothing of the "
                "direct signal; they must add up to less than 1."
            )
        law = enum_member(self.law, LowPass, f"law of the meter {self.name}")
        if "late_cutoff" in values and law is not LowPass.ZERO_PHASE:
            raise ConfigurationError(
                f'The late_cutoff of the meter {self.name} needs the law "zero-phase", not "{law.value}": filters that '
                'delay by different times change the volume when they are blended; take "zero-phase", or remove '
                "late_cutoff."
            )
        sources = mapping(self.sources, f"sources of the meter {self.name}", '{"delay": Source("M", "data sheet")}')
        settle(
            self,
            values=values,
            sources=sources,
            law=law,
            order=integer(self.order, f"order of the meter {self.name}", 1, HIGHEST_ORDER),
        )

    def _read_quantity(self, key: str, value: object) -> float:
        if key not in QUANTITIES:
            raise ConfigurationError(
                f"The meter {self.name} has no {key}{nearest(key, QUANTITIES)}; its quantities are "
                f"{', '.join(QUANTITIES)}."
            )
        q = QUANTITIES[key]
        quantity = number(value, q.unit, f"{key} of the meter {self.name}")
        if not q.domain.admits(quantity):
            raise ConfigurationError(
                f"The {key} of the meter {self.name} ({q.meaning}) must be {q.domain.value}, not "
                f"{to_text(quantity, q.unit)}."
            )
        return quantity

    @property
    def neutral(self) -> bool:
        """True if the meter shows its input unchanged."""
        return all(QUANTITIES[key].default == value for key, value in self.values.items())

    @property
    def ahead(self) -> float:
        """Time [s] beyond the last sample that must be simulated; twice what the given values need."""
        cutoffs = [self.values[key] for key in ("cutoff", "late_cutoff") if key in self.values]
        seen = [look_ahead(self.law, self.order, cutoff) for cutoff in cutoffs]
        return 2.0 * (max(seen, default=0.0) + max(-self.values.get("delay", 0.0), 0.0))

    def parameter(self, quantity: str) -> str:
        """Name of a quantity as a free parameter."""
        return parameter_name(self.name, quantity)

    def owns(self, name: str) -> bool:
        """True for the dotted name of a quantity of this meter."""
        return is_of_meter(name) and parts_of(name)[0] == self.name

    def with_best(self, best: Mapping[str, float], source: Source | None = None) -> Meter:
        """The same meter with fitted values.

        Parameters
        ----------
        best : mapping of str to float
            Values [SI] by the names of free parameters; those of other meters are ignored.
        source : Source, optional
            Of these values.
        """
        fitted = {parts_of(name)[1]: value for name, value in best.items() if self.owns(name)}
        if not fitted:
            return self
        sources = dict(self.sources) | ({} if source is None else dict.fromkeys(fitted, source))
        return replace(self, values={**self.values, **fitted}, sources=sources)


# Signal that a meter shows of a simulated flow: filter, echoes, zeroing, then delay, gain and offset.


QuantityValues = Mapping[str, Floats]  # values of a meter's quantities, (candidates,) each

_ECHOES = ("echo", "second_echo")


class Flow(NamedTuple):
    """Simulated flow of candidates."""

    rates: Floats  # (candidates, steps): means over the steps; not finite for a failed simulation
    # begin of the first step and length of each [s]
    start: float
    step: float


def given_values(meter: Meter, columns: Mapping[str, Floats], candidates: int) -> dict[str, Floats]:
    """Values of a meter's quantities for each candidate; absent if a quantity has neither value nor default.

    `columns` (mapping of str to (candidates,)): quantities that vary.
    """
    stated = {key: q.default for key, q in QUANTITIES.items() if q.default is not None} | dict(meter.values)
    return {key: np.full(candidates, value) for key, value in stated.items()} | dict(columns)


def shown_rates(meter: Meter, meter_values: QuantityValues, flow: Flow, bounds: Floats) -> Floats:
    """Rates (candidates, samples) that a meter shows, means between the bounds of the samples.

    `meter_values` (mapping of str to (candidates,)): of `given_values`; `bounds` (samples + 1,): [s].

    Between steps the cumulated flow is a cubic with continuous slope (Catmull–Rom), so that a sample is a smooth
    function of the delay; with linear interpolation J has a kink at every step.
    """
    sound = np.isfinite(flow.rates).all(axis=1)
    shown = np.full((len(flow.rates), len(bounds) - 1), np.nan)
    if not sound.any():
        return shown
    sound_values = {key: values[sound] for key, values in meter_values.items()}
    rates = _after_zeroing(
        sound_values, *_with_echoes(sound_values, _direct(meter, sound_values, flow.rates[sound], flow.step), flow.step)
    )
    places = (bounds - flow.start - sound_values["delay"][:, None]) / flow.step
    cumulated = _interpolate_cumulated(flow.step * np.cumsum(rates, axis=1), places)
    means = np.diff(cumulated, axis=1) / np.diff(bounds)
    shown[sound] = sound_values["gain"][:, None] * means + sound_values["offset"][:, None]
    return shown


def shown_quantities(values: QuantityValues, quantities: Floats) -> Floats:
    """Quantities per stroke (candidates, points) that a meter shows of true ones, by gain and offset.

    `values` (mapping of str to (candidates,)): of `given_values`; `quantities` (candidates, points): [m³].
    """
    return np.asarray(values["gain"][:, None] * quantities + values["quantity_offset"][:, None])


def _direct(meter: Meter, values: QuantityValues, rates: Floats, step: float) -> Floats:
    """Low-passed signal; with a late cut-off, the two filters blended from the opening peak on."""
    early = _for_each(lambda signal, f: low_pass(signal, step, meter.law, meter.order, f), rates, values["cutoff"])
    if "late_cutoff" not in values:
        return early
    late = _for_each(lambda signal, f: low_pass(signal, step, meter.law, meter.order, f), rates, values["late_cutoff"])
    since = step * (np.arange(rates.shape[1]) - _opening_peaks(early)[:, None])
    share = np.clip(since / values["blend"][:, None], 0.0, 1.0)
    return np.asarray((1.0 - share) * early + share * late)


def _opening_peaks(signals: Floats) -> Floats:
    """Index of the first maximum above half of the greatest value of each signal, to a fraction of a step."""
    peaks = np.empty(len(signals))
    for i, signal in enumerate(signals):
        first = int(np.argmax(signal > 0.5 * signal.max()))
        falls = np.flatnonzero(np.diff(signal[first:]) < 0.0)
        k = first + int(falls[0]) if len(falls) else len(signal) - 1
        peaks[i] = k + _vertex(signal, k)
    return peaks


def _vertex(signal: Floats, k: int) -> float:
    """Distance of a parabola's top from the sample k, through it and both neighbours."""
    if not 0 < k < len(signal) - 1:
        return 0.0
    left, middle, right = signal[k - 1 : k + 2]
    curve = left - 2.0 * middle + right
    return float(0.5 * (left - right) / curve) if curve < 0.0 else 0.0


def _with_echoes(values: QuantityValues, direct: Floats, step: float) -> tuple[Floats, Floats]:
    """The direct signal, and it with its echoes, which take their shares from it: an echo makes no fuel."""
    left = 1.0 - np.sum([values[f"{echo}_share"] for echo in _ECHOES], axis=0)
    total = left[:, None] * direct
    for echo in _ECHOES:
        share = values[f"{echo}_share"]
        if share.any():
            steps = np.arange(direct.shape[1] + 1) - values[f"{echo}_delay"][:, None] / step
            late = np.diff(_interpolate_cumulated(np.cumsum(direct, axis=1), steps), axis=1)
            with np.errstate(divide="ignore"):
                decay = step / values[f"{echo}_lag"]
            total = total + share[:, None] * _for_each(first_order, late, decay)
    return direct, total


def _after_zeroing(values: QuantityValues, direct: Floats, total: Floats) -> Floats:
    """The signal, zero once the direct part has fallen to a share of its peak for good."""
    if not values["zeroing"].any():
        return total
    signal = total.copy()
    for i, share in enumerate(values["zeroing"]):
        level = share * direct[i].max()
        above = np.flatnonzero(direct[i] > level)
        if share > 0.0 and len(above) and above[-1] + 1 < direct.shape[1]:
            k = int(above[-1])
            share_of_step = (direct[i, k] - level) / (
                direct[i, k] - direct[i, k + 1]
            )  # of the next step, before the crossing
            signal[i, k + 1] *= share_of_step
            signal[i, k + 2 :] = 0.0
    return signal


def _for_each(law: Callable[[Floats, float], Floats], signals: Floats, values: Floats) -> Floats:
    """A law with one value for each signal; all at once where the values are the same."""
    if (values == values[0]).all():
        return law(signals, float(values[0]))
    return np.stack([law(signal, float(value)) for signal, value in zip(signals, values, strict=True)])


def _interpolate_cumulated(cumulated: Floats, places: Floats) -> Floats:
    """Cumulated signals (candidates, steps), zero before the first step, at places in steps (candidates, places)."""
    ends = np.pad(cumulated, ((0, 0), (3, 3)), mode="edge")
    ends[:, :3] = 0.0
    inside = np.clip(places, -1.0, cumulated.shape[1] + 1.0)
    below = np.floor(inside)
    u, k = inside - below, below.astype(np.intp) + 2  # `ends` begins two steps before the first one
    p0, p1, p2, p3 = (np.take_along_axis(ends, k + i, axis=1) for i in (-1, 0, 1, 2))
    bend = 2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + u * (3.0 * (p1 - p2) + p3 - p0)
    return np.asarray(p1 + 0.5 * u * (p2 - p0 + u * bend))
