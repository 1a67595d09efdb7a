"""Time integration of y' = f(t, y) for any mechanism: adaptive DOP853 of scipy, or classical Runge-Kutta steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from .solve import SingularPose

Derivative = Callable[[float, np.ndarray], np.ndarray]
Projection = Callable[[np.ndarray], np.ndarray]

RTOL, ATOL = 1e-13, 0.1
"""Error per step of DOP853: near its floor of 100 roundings (2e-14), so that what is left is round-off; and the
absolute one over the relative one."""

MOST_STEPS = 10_000
"""Of DOP853 between two output times; a smooth motion takes some 50 in its own time scale."""


MOST_TURN = 0.5
"""Of a hinge in one step, rad: with 1 rad the errors of the classical method were met beyond what its order lets one
expect, up to 0.2 rad within a tenth of it."""


class SimulationError(RuntimeError):
    """An integration that cannot go on: names the time and the reason."""

    def __init__(self, t: float, reason: str) -> None:
        super().__init__(f"t = {t:.9g} s: {reason}")
        self.t, self.reason = t, reason


def require_times(t: np.ndarray) -> np.ndarray:
    """Output times as an array. Raises ValueError unless there are two at least, finite and increasing."""
    t = np.asarray(t, dtype=float)
    if t.ndim != 1 or len(t) < 2 or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
        raise ValueError(f"t: got shape {t.shape}, expected at least two finite, increasing output times")
    return t


def require_followed(t: float, rates: np.ndarray, names: Sequence[str], dt: float) -> None:
    """Raise SimulationError if a hinge of these rates [rad/s] turns too far in a step dt [s] of fixed length."""
    k = int(np.argmax(np.abs(rates)))
    if not abs(rates[k]) * dt <= MOST_TURN:
        turn = abs(rates[k]) * dt
        raise SimulationError(
            t, f"{names[k]} turns by {turn:.3g} rad in a step of {dt:.3g} s, expected at most {MOST_TURN}"
        )


def _adaptive(
    f: Derivative, y: np.ndarray, t: np.ndarray, project: Projection | None, rtol: float
) -> Iterator[np.ndarray]:
    from scipy.integrate import DOP853  # half a second, which inverse dynamics need not wait for

    solver = DOP853(f, t[0], y, t[-1], rtol=rtol, atol=rtol * ATOL)
    due, steps = 1, 0
    while due < len(t):
        if steps == MOST_STEPS:
            reason = f"{MOST_STEPS} steps since the last output time: too fast to follow, in a singularity or beyond"
            raise SimulationError(float(solver.t), reason)
        steps += 1
        message = solver.step()
        if solver.status == "failed":
            raise SimulationError(float(solver.t), f"the integrator failed: {message}")
        between = solver.dense_output() if t[due] < solver.t else None
        while due < len(t) and t[due] <= solver.t:
            at = solver.y if between is None or t[due] == solver.t else between(t[due])
            yield at if project is None else project(at)
            due, steps = due + 1, 0
        if project is not None:
            solver.y = project(solver.y)
            solver.f = solver.fun(solver.t, solver.y)  # the first stage of the next step


def _fixed(f: Derivative, y: np.ndarray, t: np.ndarray, project: Projection | None, dt: float) -> Iterator[np.ndarray]:
    for start, end in pairwise(t):
        steps = math.ceil((end - start) / dt * (1.0 - 1e-12))  # an interval of n dt, rounded, takes n steps
        h = (end - start) / steps
        for n in range(steps):
            now = start + n * h
            k1 = f(now, y)
            k2 = f(now + 0.5 * h, y + 0.5 * h * k1)
            k3 = f(now + 0.5 * h, y + 0.5 * h * k2)
            k4 = f(now + h, y + h * k3)
            y = y + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            if project is not None:
                y = project(y)
        yield y


def integrate(
    f: Derivative,
    y: np.ndarray,
    t: np.ndarray,
    dt: float | None = None,
    project: Projection | None = None,
    rtol: float = RTOL,
) -> tuple[np.ndarray, int]:
    """States (nt, ny) at the times t, and the number of evaluations of f.

    Parameters
    ----------
    f : derivative of the state; its ArithmeticError or LinAlgError ends the integration.
    y : ndarray, shape (ny,)
        State at t[0].
    t : ndarray, shape (nt,)
        Output times [s].
    dt : largest step [s] of the classical Runge-Kutta method, order 4; None for DOP853.
    project : correction of the state after each step.
    rtol : of DOP853, relative error per step; by default at its tightest.

    Raises
    ------
    SimulationError
        A derivative that is not finite or cannot be computed, or steps that shrink or never end.
    ValueError
        Times, dt or rtol out of range.
    """
    t = require_times(t)
    if dt is not None and not 0.0 < dt < math.inf:
        raise ValueError(f"dt: got {dt}, expected a positive step in s, or None for adaptive steps")
    if not RTOL <= rtol < 1.0:
        raise ValueError(f"rtol: got {rtol}, expected at least {RTOL:g} and less than 1")
    count = 0

    def counted(now: float, at: np.ndarray) -> np.ndarray:
        nonlocal count
        count += 1
        try:
            rate = f(now, at)
        except SingularPose as e:
            raise SimulationError(now, f"leg {e.leg}: {e.name} = {e.value:.3g}, {e.limit}") from e
        except (ArithmeticError, np.linalg.LinAlgError) as e:
            raise SimulationError(now, str(e)) from e
        if not np.isfinite(rate).all():
            raise SimulationError(now, f"component {int(np.argmin(np.isfinite(rate)))} of the derivative is not finite")
        return rate

    y = np.asarray(y, dtype=float)
    states = _adaptive(counted, y, t, project, rtol) if dt is None else _fixed(counted, y, t, project, dt)
    return np.array([y, *states]), count
