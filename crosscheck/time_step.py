"""What two steps in time with velocity-level loops leave undone, by Taylor's series in the step."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..models.scene import Scene
from .kkt import State, Terms
from .native import Hard


class Moving(Protocol):
    """An engine that assembles its terms and moves its positions along velocities."""

    scene: Scene

    def terms(self, state: State) -> Terms:
        """As `KktEngine.terms`."""
        ...

    def moved(self, q: np.ndarray, v: np.ndarray, step: float) -> np.ndarray:
        """Positions after so many seconds at velocities (nt, nv)."""
        ...

    def in_world(self, x: np.ndarray) -> np.ndarray:
        """Linear and angular part (nt, 6) of the platform's velocities or accelerations, world axes."""
        ...


def defects(
    engine: Moving,
    state: State,
    terms: Terms,
    hard: Hard,
    dt: float,
    mixing: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Force and closure defect of the second of two steps from the pose one step earlier.

    Written with w = J'[v] v, which is dJ v.  The first step starts with J v = -dt w at the earlier pose and takes
    that away: its loop forces are beside the wanted ones by r, which is p = 2 A^-1 w but for softness, A = J M^-1 J^T.
    So the second one starts beside the wanted state: with a_1 = a + M^-1 J^T r, at v + dt a_1 and, by dt^2 a_1, at
    another pose.  What it solves there:

    - forces are in balance: the force defect is the difference of the terms here and there;
    - J v stays zero from the earlier pose to this one, and not at a point: J a + J'[v] v is dt J''[v, v] v / 2;
    - the lever of the platform goes to the rod's tip, across the gap: dt^2 w / 2 and dt^2 w before the two steps give
      dt (omega x w) / 2;
    - mixing yields by C = CFM (1/kg + diag A) per force: r = (A + C)^-1 (A p - C lambda), and the second step's forces
      are off by as much as C makes of that.  Heavy machines, whose A is small, are soft by the whole.
    """
    axes = list(engine.scene.loop_axes)

    def rows(x: np.ndarray) -> np.ndarray:
        return x[..., axes].reshape(len(x), -1)

    v, J, w = state.v, terms.J, terms.gap_acceleration
    M, A, _, a, multipliers = hard
    p = 2.0 * np.linalg.solve(A, rows(w)[..., None])
    C = mixing * (1.0 + np.einsum("tii->ti", A))
    soft = A + C[..., None] * np.eye(C.shape[1])
    beside = np.linalg.solve(soft, A @ p - (C * multipliers)[..., None])[..., 0]
    a_1 = a + np.linalg.solve(M, J.transpose(0, 2, 1) @ beside[..., None])[..., 0]
    here = engine.terms(State(state.q, v, a))
    there = engine.terms(State(engine.moved(state.q, a_1, dt * dt), v + dt * a_1, a))
    later, earlier = (
        engine.terms(State(engine.moved(state.q, v, step), v, 0 * a)).gap_acceleration for step in (dt, -dt)
    )
    ddJ = (later - earlier) / (2.0 * dt)
    lever = np.cross(engine.in_world(v)[:, None, 3:], w)
    closure = rows(here.gap_acceleration - there.gap_acceleration + 0.5 * dt * (ddJ + lever))
    force = here.tau - there.tau + np.einsum("tij,ti->tj", there.J - J, multipliers)
    yielding = np.linalg.solve(soft, A @ (C * beside)[..., None])[..., 0]
    return force, closure + yielding
