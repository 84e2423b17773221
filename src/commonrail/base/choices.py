"""Choices that files, the command line and Python name by the same words."""

from enum import Enum


class Actuation(Enum):
    """Force that opens the needle.

    SERVO: a control valve relieves the control chamber above the plunger, as in the paper. DIRECT: the armature lifts
    the needle.
    """

    SERVO = "servo"
    DIRECT = "direct"


class Body(Enum):
    """Motion of plunger and needle."""

    FLEXIBLE = "flexible"
    RIGID = "rigid"


class Boundary(Enum):
    """Supply of the injector."""

    IDEAL = "ideal"
    VOLUME = "volume"


class Drive(Enum):
    """Source of the voltage."""

    REGULATED = "regulated"
    PWM = "pwm"
    VOLTAGE = "voltage trace"
    CURRENT = "current trace"
    FREE_WHEEL = "free-wheel"

    @property
    def is_trace(self) -> bool:
        """True if it is a measured voltage or current."""
        return self in (Drive.VOLTAGE, Drive.CURRENT)


class Laws(Enum):
    """Set of laws that a kernel computes.

    EXTENDED adds to the paper's laws the shape of the nozzle's discharge, the laminar length of the valve's gap and
    the friction of the guides. Where all of these are zero both give the same injection, and PAPER is faster.
    """

    PAPER = "paper"
    EXTENDED = "extended"


class Engine(Enum):
    """Integrator of a simulation."""

    LANES = "lanes"
    CUDA = "cuda"
    REFERENCE = "reference"


class Precision(Enum):
    """Numbers that the lanes compute in."""

    F64 = "f64"
    F32 = "f32"
