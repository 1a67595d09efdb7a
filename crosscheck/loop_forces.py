"""The linear system of driving forces and loop forces, [S J^T] [F; lambda] = tau, sample by sample.

Its structure is that of the mechanism: each leg's own passive equations leave its loop force one component free, along
a direction of the leg; the platform's equations give these.  Where a system has another structure, or lacks a rank, it
is solved as it stands.

LAPACK seldom raises where a matrix is singular: it returns forces of 1e18 N.  So both ways bound the condition of the
platform's equations A in `row_units`, whose columns are at most sqrt 2 long: it is at most 2^(n/2 + 1)/|det A|
(Guggenheimer, Edelman, Johnson 1995), and at most sqrt(2 n) |A^-1|_F.  Where that is above `LIMIT`, singular values
decide.
"""

from __future__ import annotations

import numpy as np

from ..analytic.solve import LIMIT
from .digits import require_held, require_legs
from .engine import EngineError, require_finite
from .layout import Layout

RANK = 1e-12
"""Singular values below this share of the largest count as zero: rounding of the matrix is 1e-16."""

FEASIBLE = 1e-10
"""Residual of a singular system, over its right side or the weight of all bodies, that is still rounding.

A trajectory's own motion is feasible to 1e-14; what is above this is another model.
"""


FEW = 8
"""Samples up to which the whole system is faster: the elimination's many array operations cost by the call."""


def forces(
    engine: str, tau: np.ndarray, J: np.ndarray, layout: Layout, undetermined: np.ndarray, weight: float
) -> tuple[np.ndarray, np.ndarray]:
    """As `solve`, but of many samples by elimination wherever the structure and the rank are there.

    ``layout``: whose velocity is which.
    """
    if len(tau) <= FEW:
        return solve(engine, tau, J, layout, undetermined, weight)
    na = _count(engine, J, layout)
    x = eliminate(tau, J, layout)
    left = undetermined | layout.couples(J) | ~np.isfinite(x).all(axis=1)
    if left.any():
        require_finite(engine, tau=tau, J=J)
        numbers = np.flatnonzero(left)
        x[left] = np.hstack(solve(engine, tau[left], J[left], layout, undetermined[left], weight, numbers))
    return x[:, :na], x[:, na:]


def eliminate(tau: np.ndarray, J: np.ndarray, layout: Layout) -> np.ndarray:
    """Forces and multipliers (nt, na + nc) of loops that couple no legs; not finite where they may have no digits.

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
            L_2 = (c_2 * c_2).sum(axis=1)
            lost = LIMIT**2 * size < L_2**2  # sin q_n = |c_1 x c_2|/L^2
        else:
            n = np.stack([-c_1[:, 1], c_1[:, 0]], axis=1)
            size = (n * n).sum(axis=1)
            l = (t[layout.passive[:, 0]] / size)[:, None] * c_1
            L_2, lost = size, np.zeros_like(size, dtype=bool)
        n /= np.sqrt(size)[:, None]
        on_platform = rows[:, :, layout.platform]
        A = np.einsum("lapt,lat->tpl", on_platform, n) / layout.units[:, None]
        b = (t[layout.platform].T - np.einsum("lapt,lat->tp", on_platform, l)) / layout.units
        lost = (lost | (LIMIT**2 * L_2 < layout.lever**2)).any(axis=0)
        lost |= ~(LIMIT * np.abs(np.linalg.det(A)) >= 2.0 ** (0.5 * N + 1.0))
        try:
            u = np.linalg.solve(A, b[..., None])[..., 0].T
        except np.linalg.LinAlgError:
            u = np.full((N, nt), np.nan)
        u[:, lost] = np.nan
        l += u[:, None] * n
        F = t[layout.actuated] - (rows[leg, :, layout.actuated] * l).sum(axis=1)
    return np.concatenate([F, l.reshape(nc, nt)]).T


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Vector products of arrays (N, 3, nt)."""
    return np.stack([a[:, i] * b[:, j] - a[:, j] * b[:, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=1)


def _count(engine: str, J: np.ndarray, layout: Layout) -> int:
    """Number of driving forces. Raises EngineError unless they and the loop forces are as many as the velocities."""
    (_, nc, nv), na = J.shape, len(layout.actuated)
    if nv != na + nc:
        raise EngineError(f"{engine}: the model has nv = {nv}, expected na + nc = {na} + {nc}")
    return na


def solve(
    engine: str,
    tau: np.ndarray,
    J: np.ndarray,
    layout: Layout,
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
    layout : whose velocity is which.
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
        nv is not na + nc, a term is not finite, a leg is too steep, the platform's equations or the whole matrix are
        singular, or not as singular as expected, or no forces give the motion.
    """
    na, named = _count(engine, J, layout), np.arange(len(J)) if numbers is None else numbers
    if undetermined.any():
        require_finite(engine, tau=tau, J=J)
        x, easy = np.empty_like(tau), ~undetermined
        if easy.any():
            x[easy] = np.hstack(solve(engine, tau[easy], J[easy], layout, undetermined[easy], weight, named[easy]))
        for k in np.flatnonzero(undetermined):
            x[k] = _shortest(engine, int(named[k]), *_whole(tau[k], J[k], layout)[:2], na, weight)
        return x[:, :na], x[:, na:]
    with np.errstate(over="ignore", invalid="ignore"):
        K, right, length = _whole(tau, J, layout)
        if not length.min() * LIMIT >= length.max():  # cheaper than to look at each leg
            require_finite(engine, tau=tau, J=J)
            require_legs(engine, length, layout, named)
        try:
            found = np.linalg.solve(K, right)
        except np.linalg.LinAlgError:
            found = np.full_like(right, np.nan)
        inverse = found[:, :na, 1:]
        lost = ~(2.0 * na * np.einsum("tij,tij->t", inverse, inverse) <= LIMIT**2)
    if lost.any():
        require_finite(engine, tau=tau, J=J)
        require_held(engine, J[lost], layout, named[lost])
    x = found[..., 0]
    if not np.isfinite(x.sum()):
        require_finite(engine, tau=tau, J=J, forces=x)
    return x[:, :na], x[:, na:]


def _whole(tau: np.ndarray, J: np.ndarray, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """[S J^T] (..., nv, nv), tau and unit wrenches (..., nv, 1 + p), both with rows over their lengths (..., nv)."""
    *many, nc, nv = J.shape
    driven, pushed = layout.pushes
    K, right = np.empty((*many, nv, nv)), np.empty((*many, nv, 1 + pushed.shape[1]))
    K[..., : nv - nc], K[..., nv - nc :] = driven, np.moveaxis(J, -1, -2)
    right[..., 0], right[..., 1:] = tau, pushed
    length = np.sqrt(np.einsum("...ij,...ij->...i", K, K))  # rows of hinges are moments, rows of slides are forces
    unit = np.where(length == 0.0, 1.0, length)[..., None]
    return K / unit, right / unit, length


def _shortest(engine: str, sample: int, K: np.ndarray, right: np.ndarray, na: int, weight: float) -> np.ndarray:
    """Solution of a system of one rank too few with the shortest F. Raises EngineError."""
    b = right[:, 0]
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
