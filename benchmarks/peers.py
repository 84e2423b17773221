"""Other solvers on the same compiled right-hand side."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from commonrail.engine.operating_point import OperatingPoint
from commonrail.engine.reference import Resolution, _Model
from commonrail.engine.solution import Solution
from commonrail.injector.definition import Injector

COARSE = Resolution((120, 60), 1e-5)


def scipy_solution(injector: Injector, point: OperatingPoint, interval: float, method: str) -> Solution:
    """Another of SciPy's solvers in place of LSODA."""
    return _PeerModel(injector, point, method).solve(interval)


def sundials_solution(injector: Injector, point: OperatingPoint, interval: float) -> Solution:
    """SUNDIALS CVODE (BDF, banded) through scikit-sundae, calling back into the compiled right-hand side."""
    return _PeerModel(injector, point, "CVODE").solve(interval)


class _PeerModel(_Model):
    """The reference's model, another solver; the drive's switching is followed in the same segments."""

    def __init__(self, injector: Injector, point: OperatingPoint, method: str) -> None:
        super().__init__(injector, point, COARSE, None)
        self.method = method

    def solve(self, interval: float) -> Solution:
        """Simulate and sample."""
        samples = round(self.point.duration / interval)
        time = self.point.start + interval * np.arange(samples + 1)
        return self.solution(time, *self.run(time))

    def _solve(self, start: float, stop: float, y: Any, inside: Any) -> Any:
        if self.method == "CVODE":
            return self._cvode(start, stop, y, inside)

        def switches(t: float, y: Any) -> float:
            return self._past_limit(t, y)

        def never(t: float, y: Any) -> float:
            return -1.0

        switches.terminal, switches.direction = True, 1.0  # type: ignore[attr-defined]
        at = np.append(inside, stop) if not len(inside) or inside[-1] < stop else inside
        self._evaluations = 10**9
        result = solve_ivp(
            self._rhs,
            (start, stop),
            y,
            self.method,
            t_eval=at,
            events=[never, never, switches],
            rtol=self.resolution.relative,
            atol=self._scales() * self.resolution.relative,
        )
        self._last = result.y[:, -1].copy() if result.status == 0 else self._last
        return result

    def _cvode(self, start: float, stop: float, y: Any, inside: Any) -> Any:
        from sksundae.cvode import CVODE

        self._evaluations = 10**9

        def rates(t: float, y: Any, dy: Any) -> None:
            dy[:] = self._rhs(t, np.asarray(y))

        def events(t: float, y: Any, values: Any) -> None:
            values[0] = self._past_limit(t, np.asarray(y))

        events.terminal, events.direction = [True], [1]  # type: ignore[attr-defined]
        solver = CVODE(
            rates,
            method="BDF",
            rtol=self.resolution.relative,
            atol=self._scales() * self.resolution.relative,
            linsolver="band",
            lband=self._band,
            uband=self._band,
            max_num_steps=1_000_000,
            eventsfn=events,
            num_events=1,
        )
        at = np.concatenate(([start], inside, [] if len(inside) and inside[-1] >= stop else [stop]))
        raw = solver.solve(at, y)
        hit = raw.t_events is not None and len(np.atleast_1d(raw.t_events)) > 0
        self._last = np.asarray(raw.y[-1]).copy()
        keep = np.isin(raw.t, inside) | np.isclose(raw.t, stop)
        result = type("Result", (), {})()
        result.success, result.status, result.t = True, 1 if hit else 0, raw.t[keep]
        result.y = np.asarray(raw.y)[keep].T
        none = np.empty(0)
        result.t_events = [none, none, np.atleast_1d(raw.t_events) if hit else none]
        result.y_events = [none, none, np.atleast_2d(raw.y_events) if hit else none]
        return result
