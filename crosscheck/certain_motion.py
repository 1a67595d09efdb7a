"""A certain motion: accelerations from first principles in ball arithmetic, integrated to float64 with an error bound.

Collocation on Chebyshev's nodes, segment by segment.  What is solved for are the platform's accelerations at the nodes:
each pass puts a motion and its accelerations into the platform's equations, and takes away what the driving forces
leave of them.  No formula of the paper and no engine has a part in it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import flint
import numpy as np
from flint import arb
from numpy.polynomial import chebyshev

from ..models.scene import Scene
from .engines.reference_ import COLUMNS, PRECISIONS, NotCertified, accelerated, certified_forward
from .trajectory import Trajectory

NODES = 16
"""Of a segment: its accelerations are a polynomial of degree 15."""

TAIL = 1e-13
"""Of the accelerations' last two coefficients, over the largest one: what they leave out is less, integrated twice."""

ROOM = 0.03
"""Share of `TAIL` below which the next segment is made longer."""

SETTLED = 1e-15
"""Change of a pass over the accelerations after which nothing is left to change."""

ROUGH = 1e-10
"""Change of a pass over the accelerations from which it may stop to shrink: where a leg is steep, a state's rounding is
many times its own in the accelerations."""

LOST = 10.0
"""Such a change leads away."""

MOST_PASSES = 25
SHORTEST = 1e-6
"""Segment [s] at which the motion is given up."""

BETWEEN = (-0.97, 0.11)
"""Places of a segment, on [-1, 1], where the equations are looked at once more."""


class Motion(NamedTuple):
    """States of the platform, world axes, SI units, and how far they are from a solution.

    ``position, velocity, angular_velocity`` (nt, 3), ``quaternion`` (nt, 4).  ``defect`` [m/s^2, rad/s^2]: the largest
    difference between its accelerations and those that belong to its states, met between the nodes.
    """

    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    defect: float


class _Grid:
    """Nodes on [-1, 1], both ends among them, and what integrates from -1 to each of them."""

    def __init__(self, n: int) -> None:
        self.x = -np.cos(np.pi * np.arange(n) / (n - 1))
        self.coefficients = np.linalg.inv(chebyshev.chebvander(self.x, n - 1))
        integrals = np.array([chebyshev.chebval(self.x, chebyshev.chebint(c, lbnd=-1)) for c in np.eye(n)]).T
        self.integral = integrals @ self.coefficients

    def at(self, x: np.ndarray, values: np.ndarray) -> np.ndarray:
        """A polynomial, given at the nodes (n, k), at other places (m,)."""
        return chebyshev.chebval(x, self.coefficients @ values).T.reshape(len(x), values.shape[1])


def _half_turns(w: np.ndarray) -> np.ndarray:
    """Matrices (n, 4, 4) that make the rate of a quaternion of it."""
    x, y, z = 0.5 * w.T
    o = np.zeros_like(x)
    return np.moveaxis(np.array([[o, -x, -y, -z], [x, o, -z, y], [y, z, o, -x], [z, -y, x, o]]), -1, 0)


class _Segment:
    """A polynomial motion from a state (13,), of length h."""

    def __init__(self, grid: _Grid, t: float, h: float, start: np.ndarray, a: np.ndarray) -> None:
        self.grid, self.t, self.h, self.start = grid, t, h, start
        self.times, self.rough = t + 0.5 * h * (grid.x + 1.0), np.inf
        self.set(a)

    def set(self, a: np.ndarray) -> None:
        """Take accelerations (n, 6) at the nodes, and the states (n, 13) that follow."""
        n, S = len(a), 0.5 * self.h * self.grid.integral
        self.a = a
        v, w = self.start[7:10] + S @ a[:, :3], self.start[10:] + S @ a[:, 3:]
        turning = np.einsum("jk,kab->jakb", S, _half_turns(w)).reshape(4 * n, 4 * n)
        q = np.linalg.solve(np.eye(4 * n) - turning, np.tile(self.start[3:7], n)).reshape(n, 4)
        self.states = np.hstack([self.start[:3] + S @ v, q, v, w])

    def size(self) -> float:
        """Largest of the accelerations, one unit at least."""
        return max(float(np.abs(self.a).max()), 1.0)

    def tail(self) -> float:
        """Last coefficients of the accelerations over the largest one."""
        return float(np.abs((self.grid.coefficients @ self.a)[-2:]).max()) / self.size()


class _Solver:
    """A scene under driving forces."""

    def __init__(self, scene: Scene, forces: Callable[[np.ndarray], np.ndarray], n: int) -> None:
        self.scene, self.forces, self.grid = scene, forces, _Grid(n)
        self.columns = list(COLUMNS[scene.freedom])

    def _row(self, state: np.ndarray) -> dict[str, list[float]]:
        position, quaternion, velocity, w = (x.tolist() for x in np.split(state, [3, 7, 10]))
        return {"position": position, "quaternion": quaternion, "velocity": velocity, "angular_velocity": w}

    def solved(self, state: np.ndarray, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Certified accelerations (6,), and their matrix in float64."""
        found, A = certified_forward(self.scene, self._row(state), F.tolist())
        a = [float(x) for v in (*found["a"], *found["alpha"]) for x in v]
        return np.array(a), np.array([[float(x) for x in row] for row in A.tolist()])

    def correction(self, state: np.ndarray, a: np.ndarray, F: np.ndarray, A: np.ndarray) -> np.ndarray:
        """What accelerations (6,) lack, from what is left of the platform's equations."""
        for bits in PRECISIONS:
            with flint.ctx.workprec(bits):
                left = accelerated(self.scene, self._row(state), a.tolist()).left_over([arb(f) for f in F.tolist()])
                if all(x.is_finite() for x in left) and max(float(x.rad()) for x in left) < 1e-20 * self.weight:
                    break
        else:
            raise NotCertified(f"reference: the platform's equations are not certain at {PRECISIONS[-1]} bits")
        out = np.zeros(6)
        out[self.columns] = -np.linalg.solve(A, np.array([float(x) for x in left]))
        return out

    @property
    def weight(self) -> float:
        """Of the platform under a unit of acceleration, a force [N] to compare with."""
        return self.scene.platform.mass

    def segment(self, t: float, h: float, start: np.ndarray) -> tuple[_Segment, np.ndarray] | None:
        """The motion on [t, t + h] with its matrices; None if it is too long for one polynomial."""
        F = self.forces(np.array([t]))[0]
        first = self.solved(start, F)[0]
        segment = _Segment(self.grid, t, h, start, np.tile(first, (len(self.grid.x), 1)))
        F = self.forces(segment.times)
        pairs = [self.solved(s, f) for s, f in zip(segment.states, F, strict=True)]
        matrices = np.array([A for _, A in pairs])
        segment.set(np.array([a for a, _ in pairs]))
        for _ in range(MOST_PASSES):
            each = zip(segment.states, segment.a, F, matrices, strict=True)
            change = np.array([self.correction(*parts) for parts in each])
            segment.set(segment.a + change)
            before, segment.rough = segment.rough, float(np.abs(change).max() / segment.size())
            settled = segment.rough <= SETTLED or (before < ROUGH and not 2.0 * segment.rough < before)
            if settled or not segment.rough < LOST:
                break
        good = segment.rough <= ROUGH and segment.tail() <= max(TAIL, 10.0 * segment.rough)
        return (segment, matrices) if good else None

    def defect(self, segment: _Segment, matrices: np.ndarray) -> float:
        """Largest lack of accelerations between the nodes."""
        x = np.array(BETWEEN)
        states, a = segment.grid.at(x, segment.states), segment.grid.at(x, segment.a)
        F = self.forces(segment.t + 0.5 * segment.h * (x + 1.0))
        nearest = [int(np.argmin(np.abs(segment.grid.x - place))) for place in x]
        each = zip(states, a, F, matrices[nearest], strict=True)
        return max(float(np.abs(self.correction(*parts)).max()) for parts in each)


def certain_motion(
    scene: Scene, start: Trajectory, forces: Callable[[np.ndarray], np.ndarray], t: np.ndarray, n: int = NODES
) -> Motion:
    """The platform's motion from a trajectory's first sample under driving forces.

    Parameters
    ----------
    scene : Scene
    start : pose and twist at t[0]; its joint coordinates are not read.
    forces : F(t) of (k,) times [s], (k, N) in N.
    t : ndarray, shape (nt,)
        Output times [s], increasing.
    n : nodes of a segment.

    Raises
    ------
    NotCertified
        The motion is too fast for segments of a microsecond, or the equations have no certain solution.
    """
    solver = _Solver(scene, forces, n)
    state = np.concatenate(
        [x[0] for x in (start.position, start.unit_quaternion, start.velocity, start.angular_velocity)]
    )
    now, end, h = float(t[0]), float(t[-1]), 0.25 * float(t[-1] - t[0])
    out, defect = [state[None]], 0.0
    while now < end:
        h = min(h, end - now)
        if h > 0.5 * (end - now):
            h = end - now if h > 0.99 * (end - now) else 0.5 * (end - now)  # no sliver at the end
        solved = solver.segment(now, h, state)
        if solved is None:
            h *= 0.5
            if h < SHORTEST:
                raise NotCertified(f"reference: t = {now:.9g} s: the motion is too fast to follow")
            continue
        segment, matrices = solved
        defect = max(defect, solver.defect(segment, matrices))
        last = now + h if now + h < end * (1.0 - 1e-12) else end
        due = t[(t > now) & (t <= last)]
        out.append(segment.grid.at(2.0 * (due - now) / h - 1.0, segment.states))
        state, now = segment.states[-1], last
        if segment.tail() < max(ROOM * TAIL, segment.rough):
            h *= 1.5
    y = np.concatenate(out)
    q = y[:, 3:7] / np.linalg.norm(y[:, 3:7], axis=1, keepdims=True)
    return Motion(y[:, :3], q, y[:, 7:10], y[:, 10:], defect)
