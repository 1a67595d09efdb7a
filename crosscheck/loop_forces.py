"""The linear system of driving forces and loop forces, [S J^T] [F; lambda] = tau, sample by sample.

Its structure is that of the mechanism: each leg's own passive equations leave its loop force one component free, along
a direction of the leg; the platform's equations give these.  Where a system has another structure, or lacks a rank, it
is solved as it stands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..models.scene import Scene
from .engine import EngineError, require_finite

RANK = 1e-12
"""Singular values below this share of the largest count as zero: rounding of the matrix is 1e-16."""

FEASIBLE = 1e-10
"""Residual of a singular system, over its right side or the weight of all bodies, that is still rounding.

A trajectory's own motion is feasible to 1e-14; what is above this is another model.
"""


FEW = 8
"""Samples up to which the whole system is faster: the elimination's many array operations cost by the call."""


class Layout(NamedTuple):
    """Where an engine keeps its velocities: leg by leg the ``passive`` (N, 2 or 1) and the ``actuated`` (N,) ones.

    ``platform`` (p,): its own.
    """

    passive: np.ndarray
    actuated: np.ndarray
    platform: np.ndarray

    @classmethod
    def of(cls, scene: Scene, index: Mapping[str, int]) -> Layout:
        """From the velocity index of every coordinate of the legs; what is left is the platform's."""
        by_leg = [[j for j in scene.joints if j.leg == i and not j.cut] for i in scene.legs]
        passive = [[index[c] for j in leg if not j.actuated for c in j.coordinates] for leg in by_leg]
        actuated = [index[c] for leg in by_leg for j in leg if j.actuated for c in j.coordinates]
        platform = sorted(set(range(scene.nv)) - set(index.values()))
        return cls(np.array(passive), np.array(actuated), np.array(platform))

    @property
    def chains(self) -> np.ndarray:
        """Velocities of each leg (N, 3 or 2), from the hull on."""
        return np.sort(np.column_stack([self.passive, self.actuated]), axis=1)

    def couples(self, J: np.ndarray) -> np.ndarray:
        """Whether a loop moves with a coordinate of another leg: (nt,), of Jacobians (nt, nc, nv)."""
        N = len(self.actuated)
        own = np.zeros((N, J.shape[2]), dtype=bool)
        own[:, self.platform] = True
        own[np.arange(N), self.actuated] = True
        own[np.arange(N)[:, None], self.passive] = True
        return ((J != 0.0) & np.repeat(~own, J.shape[1] // N, axis=0)).any(axis=(1, 2))


def forces(
    engine: str, tau: np.ndarray, J: np.ndarray, layout: Layout, undetermined: np.ndarray, weight: float
) -> tuple[np.ndarray, np.ndarray]:
    """As `solve`, but of many samples by elimination wherever the structure and the rank are there.

    ``layout``: whose velocity is which.
    """
    if len(tau) <= FEW:
        return solve(engine, tau, J, layout.actuated, undetermined, weight)
    (_, nc, nv), na = J.shape, len(layout.actuated)
    if nv != na + nc:
        raise EngineError(f"{engine}: the model has nv = {nv}, expected na + nc = {na} + {nc}")
    require_finite(engine, tau=tau, J=J)
    x = eliminate(tau, J, layout)
    left = undetermined | layout.couples(J) | ~np.isfinite(x).all(axis=1)
    if left.any():
        numbers = np.flatnonzero(left)
        x[left] = np.hstack(solve(engine, tau[left], J[left], layout.actuated, undetermined[left], weight, numbers))
    return x[:, :na], x[:, na:]


def eliminate(tau: np.ndarray, J: np.ndarray, layout: Layout) -> np.ndarray:
    """Forces and multipliers (nt, na + nc) of loops that couple no legs; not finite where a rank is missing.

    With c_1, c_2 the columns of a leg's passive coordinates in its rows of J, the loop force is l + u n: n is a unit
    vector across both (in a plane, across the one), l holds the passive equations.  The platform's equations give u.
    """
    (nt, nc, nv), N = J.shape, len(layout.actuated)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        t = np.ascontiguousarray(tau.T)
        rows = np.ascontiguousarray(J.transpose(1, 2, 0)).reshape(N, nc // N, nv, nt)  # samples last
        leg = np.arange(N)
        c_1 = rows[leg, :, layout.passive[:, 0]]
        if nc == 3 * N:
            c_2 = rows[leg, :, layout.passive[:, 1]]
            n = _cross(c_1, c_2)
            size = (n * n).sum(axis=1)
            along_1, along_2 = (t[layout.passive[:, k]] / size for k in (0, 1))
            l = along_1[:, None] * _cross(c_2, n) + along_2[:, None] * _cross(n, c_1)
        else:
            n = np.stack([-c_1[:, 1], c_1[:, 0]], axis=1)
            size = (n * n).sum(axis=1)
            l = (t[layout.passive[:, 0]] / size)[:, None] * c_1
        n /= np.sqrt(size)[:, None]
        on_platform = rows[:, :, layout.platform]
        A = (on_platform * n[:, :, None]).sum(axis=1).T
        b = (t[layout.platform] - (on_platform * l[:, :, None]).sum(axis=1).sum(axis=0)).T
        scale = np.linalg.norm(A, axis=2, keepdims=True)  # rows of moments and of forces
        try:
            u = np.linalg.solve(A / scale, b[..., None] / scale)[..., 0].T
        except np.linalg.LinAlgError:
            u = np.full((N, nt), np.nan)
        l += u[:, None] * n
        F = t[layout.actuated] - (rows[leg, :, layout.actuated] * l).sum(axis=1)
    return np.concatenate([F, l.reshape(nc, nt)]).T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of arrays (N, 3, nt)."""
    return np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)


def solve(
    engine: str,
    tau: np.ndarray,
    J: np.ndarray,
    actuated: Sequence[int] | np.ndarray,
    undetermined: np.ndarray,
    weight: float = 0.0,
    numbers: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Solve [S J^T] [F; lambda] = tau for every sample.

    Parameters
    ----------
    engine : name, for errors.
    tau, J : ndarray, shapes (nt, nv), (nt, nc, nv)
        As in `Terms`.
    actuated : velocity index of each actuated joint.
    undetermined : ndarray of bool, shape (nt,)
        Samples whose matrix is expected to lack one rank: F is the shortest that the equations allow.
    weight : of all bodies [N], which may cancel in tau.
    numbers : of the samples, for errors; by default from zero.

    Returns
    -------
    F : ndarray, shape (nt, na)
    multipliers : ndarray, shape (nt, nc)

    Raises
    ------
    EngineError
        nv is not na + nc, a term is not finite, the matrix is singular, or not as singular as expected, or no forces
        give the motion.
    """
    nt, nc, nv = J.shape
    na = len(actuated)
    if nv != na + nc:
        raise EngineError(f"{engine}: the model has nv = {nv}, expected na + nc = {na} + {nc}")
    require_finite(engine, tau=tau, J=J)
    K = np.zeros((nt, nv, nv))
    K[:, actuated, np.arange(na)] = 1.0
    K[:, :, na:] = J.transpose(0, 2, 1)
    length = np.linalg.norm(K, axis=2, keepdims=True)  # rows of hinges are moments, rows of slides are forces
    length[length == 0.0] = 1.0
    K, b = K / length, tau / length[..., 0]
    x, named = np.empty_like(b), np.arange(nt) if numbers is None else numbers
    try:
        x[~undetermined] = np.linalg.solve(K[~undetermined], b[~undetermined, :, None])[..., 0]
    except np.linalg.LinAlgError:
        sign, _ = np.linalg.slogdet(K[~undetermined])  # the same factors: a pivot is zero
        sample = named[~undetermined][np.argmax(sign == 0.0)]
        raise EngineError(
            f"{engine}: sample {sample}: the {nv} x {nv} matrix of actuators and loops is singular"
        ) from None
    for k in np.flatnonzero(undetermined):
        x[k] = _shortest(engine, int(named[k]), K[k], b[k], na, weight)
    require_finite(engine, forces=x)
    return x[:, :na], x[:, na:]


def _shortest(engine: str, sample: int, K: np.ndarray, b: np.ndarray, na: int, weight: float) -> np.ndarray:
    """Solution of a system of one rank too few with the shortest F. Raises EngineError."""
    U, sigma, Vh = np.linalg.svd(K)
    rank = int((sigma > RANK * sigma[0]).sum())
    if rank != len(b) - 1:
        raise EngineError(f"{engine}: sample {sample}: got rank {rank}, expected {len(b) - 1} of {len(b)}")
    x = Vh[:rank].T @ ((U.T @ b)[:rank] / sigma[:rank])
    residual = float(np.abs(K @ x - b).max())
    if residual > FEASIBLE * max(np.abs(b).max(), weight):
        raise EngineError(f"{engine}: sample {sample}: no forces give this motion: residual {residual:.6g} (N or N m)")
    free = Vh[rank]
    return x - free * (free[:na] @ x[:na]) / (free[:na] @ free[:na])
