"""Growth of small errors of a motion whose driving forces are held: nothing in an open loop takes them back."""

from __future__ import annotations

import numpy as np

from .forward import Mechanism, forward_dynamics
from .stewart import PlanarParameters, PlatformMotion

STEP = 1e-5
"""Of central differences, m, rad, m/s, rad/s: their error, of third derivatives and of rounding, is some 1e-10."""


def _turn(R: np.ndarray, axis: int, angle: float) -> np.ndarray:
    """Rotations (nt, 3, 3) turned about a world axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    T = np.eye(3)
    T[i, i] = T[j, j] = np.cos(angle)
    T[j, i], T[i, j] = np.sin(angle), -np.sin(angle)
    return T @ R


def linearised(P: Mechanism, motion: PlatformMotion, F: np.ndarray) -> np.ndarray:
    """Matrices of the equations for small deviations of pose and twist, driving forces as given.

    Parameters
    ----------
    P : Parameters or PlanarParameters
    motion : PlatformMotion
        Arrays (nt, 3), R (nt, 3, 3), world axes; accelerations are not read.
    F : ndarray, shape (nt, N)
        Driving forces [N].

    Returns
    -------
    ndarray, shape (nt, 2n, 2n)
        Of (position, turn; velocity, angular velocity), world axes; n = 6, or 3 in a plane, 2 for a point.
    """
    nt = len(F)
    free = [0, 1, 2, 3, 4, 5]
    if isinstance(P, PlanarParameters):
        free = [0, 1, 5][: P.equations]

    def accelerations(of: str, axis: int, by: float) -> np.ndarray:
        x = np.array(getattr(motion, of), dtype=float)
        if of == "R":
            x = _turn(x, axis, by)
        else:
            x[:, axis] += by
        a = forward_dynamics(P, motion._replace(**{of: x}), F)
        return np.hstack([a.ddC_p, a.dw_p])[:, free]

    n = len(free)
    A = np.zeros((nt, 2 * n, 2 * n))
    A[:, range(n), range(n, 2 * n)] = 1.0
    if n == 6:
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):  # a turn d of R moves on by w x d
            A[:, 3 + i, 3 + k], A[:, 3 + k, 3 + i] = motion.w_p[:, j], -motion.w_p[:, j]
    for column, part in enumerate((*free, *(6 + f for f in free))):
        name = ("C_p", "R", "dC_p", "w_p")[part // 3]
        up, down = (accelerations(name, part % 3, step) for step in (STEP, -STEP))
        A[:, n:, column] = (up - down) / (2.0 * STEP)
    return A


def growth_rates(P: Mechanism, motion: PlatformMotion, F: np.ndarray) -> np.ndarray:
    """Rate [1/s] (nt,) of the fastest growing deviation: largest real part of the eigenvalues of `linearised`."""
    return np.linalg.eigvals(linearised(P, motion, F)).real.max(axis=1)
