"""A block and a table for each kind of measured data: what the contract of `test_contract` is tried on."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from commonrail.data.base import DataSet
from commonrail.data.simulator import Simulator
from commonrail.data.study_block import Context
from commonrail.physics.injector import Injector
from commonrail.readers.location import Place, Reach

STEP = 1e-6
ITSELF = np.empty((1, 0))
BLOCK = 'name = "data"\nrole = "fit"\nfile = "data.csv"\nweight = 2.5\nsource = "bench"\nsynthetic = "all of it"\n'
PRESSURES = 'cylinder_pressure = "5 MPa"\nreturn_pressure = "0.5 MPa"\n'


@dataclass(frozen=True)
class Sample:
    """Keys of a kind's own, its table of measured values [SI], and a cell in the first row of the table of 1e-9."""

    keys: str
    table: Callable[[np.ndarray], str]
    count: int
    cell: str = "1e-09"

    def read(self, kind: type[DataSet], injector: Injector, folder: Path, values: np.ndarray, more: str = "") -> Any:
        """Data set of a kind from files in a folder, with some measured values."""
        (folder / "data.csv").write_text(self.table(values), encoding="utf-8")
        block = tomllib.loads(f'kind = "{kind.kind}"\n{BLOCK}{PRESSURES}{self.keys}{more}')
        context = Context(injector, STEP, Reach(folder / "study.toml", False), Place("study.toml", "data[1]"))
        return kind.read_all(kind.model.model_validate(block), context)[0]

    def truth(self, kind: type[DataSet], injector: Injector, folder: Path) -> Any:
        """Data set whose measured values are those that the injector itself gives."""
        data = self.read(kind, injector, folder, np.full(self.count, 1e-8))
        values = data.simulated(Simulator(injector, (), STEP, 1), ITSELF)[0]
        return self.read(kind, injector, folder, values)


def curve_table(values: np.ndarray) -> str:
    """Rates, 5 us apart."""
    rows = (f"{5 * (i + 1)},{float(rate)!r}\n" for i, rate in enumerate(values))
    return "time [us],rate [m3/s]\n" + "".join(rows)


def map_table(values: np.ndarray, column: str = "quantity") -> str:
    """Quantities at two rail pressures."""
    places = ((60, 300), (60, 700), (160, 300), (160, 700))
    rows = (f"{rail},{time},{float(q)!r}\n" for (rail, time), q in zip(places, values, strict=True))
    return f"rail_pressure [MPa],energising_time [us],{column} [m3]\n" + "".join(rows)


def train_table(values: np.ndarray) -> str:
    """Rates of two injections of 400 us with given quantities, 5 us apart."""
    rates = np.zeros(600)
    for i, value in enumerate(values):
        first = 60 + 260 * i
        rates[first : first + 80] = value / 400e-6
    return curve_table(rates)


def plan_table(values: np.ndarray) -> str:
    """Deliveries and a return, with a band of 20 %."""
    places = ((60, 300, "delivery"), (60, 700, "delivery"), (160, 300, "delivery"), (160, 700, "return"))
    rows = (
        f"test {i},{measure},{rail},{time},{float(q)!r},20\n"
        for i, ((rail, time, measure), q) in enumerate(zip(places, values, strict=True))
    )
    return "test,measure,rail_pressure [MPa],energising_time [us],nominal [m3],half_band [%]\n" + "".join(rows)


TRAIN = """
rail_pressure = "160 MPa"
energisings = [{ start = "0 us", duration = "300 us" }, { start = "1300 us", duration = "300 us" }]
threshold = "1 mm3/ms"
features = [
  { feature = "quantity", injection = 1, tolerance = "0.1 mm3" },
  { feature = "quantity", injection = 2, tolerance = "0.2 mm3" },
]
"""

SAMPLES = {
    "rate": Sample('rail_pressure = "160 MPa"\nenergising_time = "400 us"\n', curve_table, 190),
    "quantities": Sample('absolute = "0.2 mm3"\nrelative = 0.05\n', map_table, 4),
    "return quantities": Sample(
        'absolute = "0.2 mm3"\nrelative = 0.05\nstroke_period = "40 ms"\n',
        partial(map_table, column="return_quantity"),
        4,
    ),
    "test plan": Sample('stroke_rate = "1000 1/min"\n', plan_table, 4),
    "features": Sample(TRAIN, train_table, 2, "0.0"),
}
