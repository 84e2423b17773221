"""Settings of a sensitivity study."""

from __future__ import annotations

from enum import Enum

from commonrail.base.arguments import TIME_STEPS, Limits, settle
from commonrail.base.choices import Precision
from commonrail.base.declare import Choice, Number, OptionalNumber, setting, settings
from commonrail.base.errors import ConfigurationError


class Design(Enum):
    """Kind of study: Morris screens many parameters with few simulations, Sobol' divides the variance among them."""

    SOBOL = "sobol"
    MORRIS = "morris"


class OnFailure(Enum):
    """Policy for failed simulations: omit the effects that compare them, and say how many; or refuse the study."""

    OMIT = "omit"
    REFUSE = "refuse"


@settings
class SensitivitySettings:
    """Settings of a sensitivity study; `ConfigurationError` for a value of another kind or beyond its limits."""

    design: Choice[Design] = setting(
        default=Design.SOBOL, text="sobol divides the variance among parameters, morris screens many of them."
    )
    samples: int = setting(
        words="number of samples",
        default=0,
        limits=Limits(0, 2**20),
        text="Base points (a power of two) or trajectories, 4 or more. 0: 1024 base points or 50 trajectories.",
    )
    on_failure: Choice[OnFailure] = setting(
        words="policy for failures",
        default=OnFailure.OMIT,
        text="Omit the effects of failed simulations and count them, or refuse.",
    )
    most_failed: Number = setting(
        words="largest share of failures",
        default="10%",
        limits=Limits(0.0, 0.9),
        text="Share of failed simulations above which an output gets no indices.",
    )
    seed: int = setting(default=1, text="Seed of design and bootstrap.")
    time_step: OptionalNumber = setting(
        unit="s", default=None, limits=TIME_STEPS, text="Such as 1us. [default: that of the study, or 1us]"
    )
    precision: Choice[Precision] = setting(default=Precision.F64, text="Precision of the simulations.")
    resamples: int = setting(
        words="number of resamples",
        default=1000,
        limits=Limits(100, 100_000),
        text="Resamples of the bootstrap.",
        option=False,
    )
    confidence: Number = setting(
        default="95%", limits=Limits(0.5, 0.999), text="Probability of the intervals.", option=False
    )

    def __post_init__(self) -> None:
        samples = self.samples or (1024 if self.design is Design.SOBOL else 50)
        if samples < 4:
            raise ConfigurationError(f"The number of samples must be 4 or more, not {samples}.")
        if self.design is Design.SOBOL and samples & (samples - 1):
            raise ConfigurationError(
                f"The number of samples must be a power of two for Sobol' indices, such as "
                f"{1 << samples.bit_length()}, not {samples}."
            )
        settle(self, samples=samples)
