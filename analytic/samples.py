"""Arrays of samples: checks, blocks of components, results by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .stewart import PlatformMotion

BLOCK = 2048
"""Samples per block, which keeps temporaries small."""


@dataclass(frozen=True)
class LegCoordinates:
    """Joint coordinates of every leg, each (nt, N): rad and m, per s, per s^2."""

    q_o: np.ndarray
    q_n: np.ndarray
    q_s: np.ndarray
    dq_o: np.ndarray
    dq_n: np.ndarray
    dq_s: np.ndarray
    ddq_o: np.ndarray
    ddq_n: np.ndarray
    ddq_s: np.ndarray


@dataclass(frozen=True)
class InverseDynamics:
    """Driving forces and joint reactions of every leg, world axes, in N and N m.

    ``F, L, dL`` (nt, N); ``F_r, F_s, F_n, F_o, M_s, M_n, M_o`` (nt, N, 3); ``condition`` (nt,): of (7), (8) or (32),
    (35), moments over the longest lever.  ``undetermined`` (nt,): the equations leave a combination of driving forces
    free, and F is the shortest vector that fulfils them; only other combinations mean anything (F_1 - F_2 of two
    collinear legs).
    """

    F: np.ndarray
    F_r: np.ndarray
    F_s: np.ndarray
    F_n: np.ndarray
    F_o: np.ndarray
    M_s: np.ndarray
    M_n: np.ndarray
    M_o: np.ndarray
    L: np.ndarray
    dL: np.ndarray
    condition: np.ndarray
    undetermined: np.ndarray


def _components(motion: PlatformMotion) -> PlatformMotion:
    """Arrays (n, 3), (n, 3, 3) as tuples of contiguous arrays (n,): samples last."""

    def vector(a: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(np.ascontiguousarray(a[:, j]) for j in range(3))

    R = tuple(vector(motion.R[:, j]) for j in range(3))
    C_p, dC_p, w_p, ddC_p, dw_p = (vector(a) for a in (motion.C_p, motion.dC_p, motion.w_p, motion.ddC_p, motion.dw_p))
    return PlatformMotion(C_p, R, dC_p, w_p, ddC_p, dw_p)


def blocks(motion: PlatformMotion) -> Iterator[tuple[slice, PlatformMotion]]:
    """Check shapes and finiteness, then hand out the motion in blocks of components."""
    arrays = PlatformMotion(*(np.asarray(a, dtype=float) for a in motion))
    nt = len(arrays.C_p) if arrays.C_p.ndim else 0
    if nt == 0:
        raise ValueError(f"motion.C_p: got shape {arrays.C_p.shape}, expected (nt, 3) with at least one sample")
    for name, a in arrays._asdict().items():
        shape = (nt, 3, 3) if name == "R" else (nt, 3)
        if a.shape != shape:
            raise ValueError(f"motion.{name}: got shape {a.shape}, expected {shape}")
        if not np.isfinite(a).all():
            sample = int(np.argwhere(~np.isfinite(a))[0][0])
            raise ValueError(f"motion.{name}: sample {sample} is not finite: {a[sample].tolist()}")
    for start in range(0, nt, BLOCK):
        block = slice(start, min(start + BLOCK, nt))
        yield block, _components(PlatformMotion(*(a[block] for a in arrays)))


def stack(vectors: Any) -> np.ndarray:
    """A list over legs of vectors of arrays (n,) as (n, N, 3)."""
    return np.moveaxis(np.array(vectors), -1, 0)
