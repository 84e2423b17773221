"""Chain of nine masses on seven cylinders: a law of one mass or one cylinder, unrolled over all of them.

Masses 1…6 stand at the ends of the plunger's five cylinders, masses 7…9 at the ends of the needle's two. Kernels see
straight-line code: no loop, no array.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from commonrail.physics.law import physics


class Nine(NamedTuple):
    """One value for each of the nine masses: positions [m], velocities [m/s] or forces [N]."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float
    i8: float
    i9: float


class Seven(NamedTuple):
    """One value for each cylinder: stiffness [N/m], mass [kg] or damping [N s/m]."""

    i1: float
    i2: float
    i3: float
    i4: float
    i5: float
    i6: float
    i7: float


def each(kind: type, law: Callable[..., float], shared: str = "") -> Callable[..., Any]:
    """Function of the same arguments as `law` that takes `kind`s, applies it field by field, and returns a `kind`.

    `kind`: `Nine` or `Seven`; `law` (function of float): law of one mass or one cylinder; `shared`: names of the
    arguments that are one number for all.
    """
    arguments = law.__code__.co_varnames[: law.__code__.co_argcount]
    one = ", ".join(name if name in shared.split() else f"{name}.{{0}}" for name in arguments)
    values = ", ".join(f"law({one})".format(field) for field in kind._fields)  # type: ignore[attr-defined]
    names: dict[str, Any] = {"__name__": __name__, "law": physics(law), "kind": kind}
    text = f"def unrolled({', '.join(arguments)}):\n    return kind({values})\n"
    exec(compile(text, f"<{law.__name__} of each of {kind.__name__}>", "exec"), names)
    return physics(names["unrolled"])  # type: ignore[no-any-return]


@physics
def across(z: Nine) -> Seven:
    """Differences over each cylinder: the upper mass's value less the lower's, in its unit.

    `z`: positions [m] or velocities [m/s].
    """
    return Seven(
        i1=z.i1 - z.i2,
        i2=z.i2 - z.i3,
        i3=z.i3 - z.i4,
        i4=z.i4 - z.i5,
        i5=z.i5 - z.i6,
        i6=z.i7 - z.i8,
        i7=z.i8 - z.i9,
    )


@physics
def around(m: Seven) -> Nine:
    """Sums over the cylinders that end at each mass, in the unit of the cylinders' values; `m`: masses [kg]."""
    return Nine(
        i1=m.i1,
        i2=m.i1 + m.i2,
        i3=m.i2 + m.i3,
        i4=m.i3 + m.i4,
        i5=m.i4 + m.i5,
        i6=m.i5,
        i7=m.i6,
        i8=m.i6 + m.i7,
        i9=m.i7,
    )


@physics
def nodal_forces(s: Seven, joint: float) -> Nine:
    """Forces on the masses [N], positive when opening, from those in the cylinders and in the joint.

    `s`: forces in the cylinders [N], positive in tension; `joint`: force between plunger and needle [N], positive in
    tension; masses that touch give zero or less.
    """
    return Nine(
        i1=-s.i1,
        i2=s.i1 - s.i2,
        i3=s.i2 - s.i3,
        i4=s.i3 - s.i4,
        i5=s.i4 - s.i5,
        i6=s.i5 - joint,
        i7=joint - s.i6,
        i8=s.i6 - s.i7,
        i9=s.i7,
    )
