"""Simulation in all coordinates, the paper's own: platform and joints, with the loops (31) as constraints that drift.

(7), (8) and (31) differentiated twice give every acceleration (index 1).  What differentiation forgets, the gaps of
the loops and their rates, can be left alone, damped after Baumgarte, or projected away after each step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from . import stewart
from .forward import require_not_steep
from .integrate import SimulationError, integrate, require_followed
from .orientation import quaternion_rate, rotation, turned
from .simulate import Forces, Simulation, State, forces_at
from .stewart import LegState, Parameters, PlatformMotion

OPEN = 0.1
"""Largest gap of a loop over its leg: beyond it the legs are not those of the mechanism any more."""

MOST_PROJECTIONS = 8
"""Newton steps of a projection: two are enough for the gap of one integration step."""


@dataclass(frozen=True)
class ConstrainedSimulation(Simulation):
    """A simulation in all coordinates; ``nfev`` counts solutions of the (3N + 6) x (3N + 6) system.

    ``q, dq`` (nt, N, 3): q_o, q_n, q_s of each leg, rad and m, and their rates; ``gap, dgap`` (nt, N): distance
    [m] and speed [m/s] between the tip of a leg and its platform pin.
    """

    q: np.ndarray
    dq: np.ndarray
    gap: np.ndarray
    dgap: np.ndarray


class _Coordinates:
    """The state vector C_p, quaternion, q; dC_p, w_p, dq; work, taken apart: q is (3N,)."""

    def __init__(self, P: Parameters, y: np.ndarray) -> None:
        n = 3 * len(P.p)
        numbers = y.tolist()
        self.quaternion, self.q = numbers[3:7], numbers[7 : 7 + n]
        self.dC_p, self.w_p, self.dq = numbers[7 + n : 10 + n], numbers[10 + n : 13 + n], numbers[13 + n : 13 + 2 * n]
        self.motion = PlatformMotion(
            tuple(numbers[:3]),
            rotation(self.quaternion),
            tuple(self.dC_p),
            tuple(self.w_p),
            stewart.ZERO,
            stewart.ZERO,
        )
        self.legs: list[LegState] = []
        for i, p in enumerate(P.p):
            o, n_, q_s = self.q[3 * i : 3 * i + 3]
            do, dn, ds = self.dq[3 * i : 3 * i + 3]
            sines = (math.sin(o), math.cos(o), math.sin(n_), math.cos(n_))
            self.legs.append(stewart.leg_from_joints(P.leg, stewart.apply(self.motion.R, p), sines, q_s, (do, dn, ds)))

    def gaps(self, P: Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Gap (3N,) [m] of (31) and its rate (3N,) [m/s]."""
        pairs = [stewart.loop_gap(k, O, self.motion) for k, O in zip(self.legs, P.O, strict=True)]
        gap, rate = np.array(pairs).transpose(1, 0, 2).reshape(2, -1)
        return gap, rate

    def moved(self, d: np.ndarray) -> np.ndarray:
        """C_p, quaternion, q after a small change d of (C_p, turn, q)."""
        position = np.array(self.motion.C_p) + d[:3]
        return np.concatenate([position, turned(self.quaternion, d[3:6].tolist()), np.array(self.q) + d[6:]])


def _nearest(P: Parameters, at: _Coordinates, gap: np.ndarray) -> np.ndarray:
    """The smallest change of (C_p, turn, q) that closes a gap to first order, measured by the mass matrix."""
    G = np.array(stewart.loop_rows(at.legs))
    M = np.diag(np.concatenate([np.zeros(6), *(stewart.joint_inertia(P.leg, k) for k in at.legs)]))
    M[:6, :6] = stewart.platform_inertia(P, at.motion)
    MG = np.linalg.solve(M, G.T)
    return -MG @ np.linalg.solve(G @ MG, gap)


def _project(P: Parameters, y: np.ndarray) -> np.ndarray:
    """The state with loops closed: positions by Newton until the gap stops to shrink, then velocities in one step."""
    n = 7 + 3 * len(P.p)
    before = math.inf
    for _ in range(MOST_PROJECTIONS):
        at = _Coordinates(P, y)
        gap = at.gaps(P)[0]
        if not np.abs(gap).max() < 0.5 * before:
            break
        before = float(np.abs(gap).max())
        y = np.concatenate([at.moved(_nearest(P, at, gap)), y[n:]])
    at = _Coordinates(P, y)
    y = y.copy()
    y[n:-1] += _nearest(P, at, at.gaps(P)[1])
    return y


def _joints(P: Parameters, motion: PlatformMotion) -> tuple[list[float], list[float]]:
    """Joint coordinates and rates (3N,) of a closed mechanism."""
    q, dq = [], []
    legs = stewart.held_legs(P, motion, math.sqrt)[1]
    require_not_steep("paper", P, legs, in_time=True)
    for k in legs:
        q += [math.atan2(k.so, k.co), math.atan2(k.s, k.c), k.q_s]
        dq += [k.w / k.s, k.dq_n, k.dq_s]
    return q, dq


def _require_closed(t: float, at: _Coordinates, gap: np.ndarray) -> None:
    """Raise SimulationError if a loop is open by more than a share of its leg."""
    open_by = np.linalg.norm(gap.reshape(-1, 3), axis=1)
    share = open_by / np.array([abs(k.L) for k in at.legs])
    if not share.max() <= OPEN:
        i = int(np.argmax(~(share <= OPEN)))
        limit = f"expected at most {OPEN:g} of the leg, which is {at.legs[i].L:.3g} m"
        raise SimulationError(t, f"the loop of leg {i + 1} came open by {open_by[i]:.3g} m, {limit}")


def simulate_constrained(
    P: Parameters,
    initial: State,
    F: Forces,
    t: np.ndarray,
    dt: float | None = None,
    gain: float = 0.0,
    projection: bool = False,
) -> ConstrainedSimulation:
    """The motion under driving forces F(t) in all coordinates, loops closed at t[0]; any N >= 1 of legs.

    Parameters
    ----------
    P, initial, F, t, dt
        As in `simulate`.
    gain : rate [1/s] at which Baumgarte's terms, -2 gain gap' - gain^2 gap, close a gap; 0 leaves it alone.
    projection : whether positions, then velocities are projected onto the constraints after each step.

    Raises
    ------
    SimulationError
        As `simulate`; a loop that came open, or a hinge that turns too far in a step dt.
    SingularPose
        A leg too steep at t[0]: its base angle is not determined.
    ValueError
        Unusable times, initial state or gain.
    """
    if not 0.0 <= gain < math.inf:
        raise ValueError(f"gain: got {gain}, expected 0 or a positive rate in 1/s")
    N = len(P.p)
    n = 7 + 3 * N
    hinges = [f"{name}{i + 1}" for i in range(N) for name in ("q_o", "q_n")]

    def derivative(now: float, y: np.ndarray) -> np.ndarray:
        at = _Coordinates(P, y)
        require_not_steep("paper", P, at.legs, in_time=True)
        gap, rate = at.gaps(P)
        _require_closed(now, at, gap)
        if dt is not None:
            require_followed(now, np.array(at.dq).reshape(N, 3)[:, :2].ravel(), hinges, dt)
        forces = forces_at(P, F, now)
        rows, right = stewart.paper_equations(P, at.motion, at.legs, forces)
        b = np.array(right)
        if gain > 0.0:
            b[6:] -= 2.0 * gain * rate + gain * gain * gap
        dv = np.linalg.solve(np.array(rows), b)
        power = sum(stewart.power(P, at.motion, at.legs, forces))
        dq = quaternion_rate(at.quaternion, (at.w_p[0], at.w_p[1], at.w_p[2]))
        return np.concatenate([at.dC_p, dq, at.dq, dv, [power]])

    start = initial.unit()
    C_p, R = tuple(start[:3].tolist()), rotation(start[3:7].tolist())
    twist = tuple(start[7:10].tolist()), tuple(start[10:].tolist())
    q, dq = _joints(P, PlatformMotion(C_p, R, *twist, stewart.ZERO, stewart.ZERO))
    y = np.concatenate([start[:7], q, start[7:], dq, [0.0]])
    y, nfev = integrate(derivative, y, t, dt, (lambda x: _project(P, x)) if projection else None)
    gaps = np.array([_Coordinates(P, x).gaps(P) for x in y]).reshape(-1, 2, N, 3)
    length = np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
    return ConstrainedSimulation(
        t=np.asarray(t, dtype=float), position=y[:, :3], quaternion=y[:, 3:7] / length,
        velocity=y[:, n : n + 3], angular_velocity=y[:, n + 3 : n + 6], work=y[:, -1], nfev=nfev,
        q=y[:, 7:n].reshape(-1, N, 3), dq=y[:, n + 6 : -1].reshape(-1, N, 3),
        gap=np.linalg.norm(gaps[:, 0], axis=2), dgap=np.linalg.norm(gaps[:, 1], axis=2),
    )  # fmt: skip
