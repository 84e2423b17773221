"""A meter of a bench: what it is called, its law and its quantities."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from commonrail.arguments import Quantity, chosen, mapping, number, plain_text, settle, whole
from commonrail.errors import ConfigurationError, nearest
from commonrail.injector.definition import Source
from commonrail.observation.low_pass import LowPass, look_ahead
from commonrail.observation.quantities import QUANTITIES, is_of_meter, parameter_name, parts_of
from commonrail.units import to_text

__all__ = ["HIGHEST_ORDER", "Meter"]

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
        Quantities by the names of `QUANTITIES` [SI]; what is not given is neutral. Texts with units are read. Those
        that a study fits (parameters such as ``meter.bench.delay``) start from here.
    law : LowPass
        Of the low-pass: "butterworth", "cascade" or "zero-phase".
    order : int
        Of the low-pass, 1 to 8.
    sources : mapping of str to Source
        Mark and source of quantities.

    Raises
    ------
    ConfigurationError
        If a quantity is unknown or outside its domain, both density and temperature are given, the shares of the echoes
        leave nothing of the direct signal, a late cut-off is given with a law that delays, or the name is no name.
    """

    name: str
    values: Mapping[str, float] = field(default_factory=dict)
    law: LowPass = LowPass.BUTTERWORTH
    order: int = 2
    sources: Mapping[str, Source] = field(default_factory=dict)

    if TYPE_CHECKING:  # what is accepted is wider than what is kept

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
        given = mapping(self.values, f"quantities of the meter {self.name}", '{"delay": "5 us"}')
        values = {key: self._read(key, value) for key, value in given.items()}
        if {"density", "temperature"} <= set(values):
            raise ConfigurationError(f"The meter {self.name} has a density and a temperature; keep one of them.")
        echoes = values.get("echo_share", 0.0) + values.get("second_echo_share", 0.0)
        if echoes >= 1.0:
            raise ConfigurationError(
                f"The shares of the echoes of the meter {self.name} add up to {echoes:g}, which leaves nothing of the "
                "direct signal; they must add up to less than 1."
            )
        law = chosen(self.law, LowPass, f"law of the meter {self.name}")
        if "late_cutoff" in values and law is not LowPass.ZERO_PHASE:
            raise ConfigurationError(
                f'The late_cutoff of the meter {self.name} needs the law "zero-phase", not "{law.value}": filters that '
                'delay by different times change the volume when they are blended; take "zero-phase", or remove '
                "late_cutoff."
            )
        mapping(self.sources, f"sources of the meter {self.name}", '{"delay": Source("M", "data sheet")}')
        settle(
            self,
            values=values,
            law=law,
            order=whole(self.order, f"order of the meter {self.name}", 1, HIGHEST_ORDER),
        )

    def _read(self, key: str, value: object) -> float:
        if key not in QUANTITIES:
            raise ConfigurationError(
                f"The meter {self.name} has no {key}{nearest(key, QUANTITIES)}; its quantities are "
                f"{', '.join(QUANTITIES)}."
            )
        q = QUANTITIES[key]
        found = number(value, q.unit, f"{key} of the meter {self.name}")
        if not q.domain.admits(found):
            raise ConfigurationError(
                f"The {key} of the meter {self.name} ({q.meaning}) must be {q.domain.value}, not "
                f"{to_text(found, q.unit)}."
            )
        return found

    @property
    def neutral(self) -> bool:
        """True if it shows what it is given."""
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
        """The same meter with what a fit has found.

        Parameters
        ----------
        best : mapping of str to float
            Values [SI] by the names of free parameters; those that are not the meter's are left out.
        source : Source, optional
            Of these values.
        """
        found = {parts_of(name)[1]: value for name, value in best.items() if self.owns(name)}
        if not found:
            return self
        sources = dict(self.sources) | ({} if source is None else dict.fromkeys(found, source))
        return replace(self, values={**self.values, **found}, sources=sources)
