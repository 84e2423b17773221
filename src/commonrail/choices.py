"""Choices that files, the command line and Python name by the same words."""

from enum import Enum

__all__ = ["Body", "Boundary", "Drive", "Engine", "Precision"]


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


class Engine(Enum):
    """Integrator of a simulation."""

    LANES = "lanes"
    CUDA = "cuda"
    REFERENCE = "reference"


class Precision(Enum):
    """Numbers that the lanes compute in."""

    F64 = "f64"
    F32 = "f32"
