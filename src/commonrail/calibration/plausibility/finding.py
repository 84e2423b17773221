"""One implausible thing about a study or its result."""

from __future__ import annotations

from typing import NamedTuple

from commonrail.base.errors import one_line


class Finding(NamedTuple):
    """A warning: the calibration runs, and its result should not be believed before this is looked at.

    Attributes
    ----------
    code : str
        Kind of the finding, an anchor of docs/howto/plausibility.md.
    subject : str
        Data set or parameter, or the study's title.
    sentence : str
        Where, what was found, what is expected and the cure; one line.
    """

    code: str
    subject: str
    sentence: str


def found(code: str, subject: str, text: str) -> Finding:
    """Finding whose sentence begins with its subject.

    `code`, `subject`: as in `Finding`; `text`: the sentence without its subject.
    """
    return Finding(code, subject, one_line(f"{subject}: {text}"))


# Every limit of the plausibility pass, with its reason; a usual range of a parameter stands at the parameter itself.
#
# All are set so that a sound study of a servo-hydraulic injector stays well inside: a warning must mean something.

# Before the fit: settings.
ENERGISING = (50e-6, 10e-3)  # [s] a coil needs some 100 us to open a valve; 10 ms are over 60° of crank at 1000 1/min
SAMPLING = (50e-9, 1e-3)  # [s] between samples of a curve, from 20 MHz down to one in 1 ms, which shows no flank
RAIL = (5e6, 400e6)  # [Pa] below, no servo valve opens a needle; no series injector is built for more than 300 MPa
CYLINDER = (0.05e6, 30e6)  # [Pa] from a bench at ambient pressure to peak combustion pressure
RETURN = (0.05e6, 5e6)  # [Pa] from ambient to the back pressure of piezo injectors with a hydraulic coupler, 1 MPa
BOUND_SLACK = 10.0  # a bound may lie outside the usual range of its parameter by this factor: a box may be generous

# Before the fit: data against the injector with its start values.
QUANTITY_TIMES = 3.0  # a drawing's injector is within a factor of 2 of its bench; units slip by 16.7, 60, 1000
QUANTITY_APART = 1e-9  # [m³] a smaller difference is a matter of the opening delay, whatever its factor
ONSET_SHARE = 0.05  # of the injected quantity marks the onset: an integral, so that noise does not trigger it
EARLIEST = 50e-6  # [s] onset after energising begins: coil, valve and control chamber take 150 us or more
LATEST = 3e-3  # [s] onset after the last energising begins: ten times the opening delay of a slow injector
ONSET_APART = 300e-6  # [s] onset, measured against simulated: drawings miss the delay by up to 150 us
HEAVY, LIGHT = 0.95, 0.01  # shares of J; of many sets, light is below a tenth of an equal share

# After the fit.
BARELY = 0.01  # fall of J, as a share of J of the start values: less than that, nothing was found
GOOD_FIT = 0.05  # relative error of every fitted set below which start values are good, and need not improve
LARGE_MISFIT = 0.30  # relative error beyond noise; start values taken from a drawing are as good as that
HALF = 0.5  # a shift or gain must bring J below this share
LONGEST_SHIFT, SHIFT_STEP = 0.5e-3, 5e-6  # [s] search for a shift; triggers and meter delays slip by less than 0.5 ms
LEAST_SHIFT = 20e-6  # [s] triggers and the delays of meters are known to some us; shots scatter as much
GAINS, GAIN_STEP = (0.2, 5.0), 0.01  # search for a gain; beyond, the quantity has told before the fit
LEAST_GAIN = 0.05  # distance of the gain from 1: rate meters are calibrated to 1 to 3 %
DENSITY_MATCH = 0.03  # between the gain and the density in g/cm³ or its inverse: the latter are 20 % from 1
AT_BOUNDS = 0.5  # share of the free parameters; single ones are told with the parameters in the report
