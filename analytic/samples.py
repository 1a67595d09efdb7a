"""Arrays of samples: checks, blocks of components, results by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .evaluate import VECTORS
from .stewart import PlatformMotion

BLOCK = 2048
"""Samples per block: 16 kB an array, so that what an operation reads and writes stays in the cache."""

LINE = 8
"""Numbers in a cache line: every row of results starts on one."""


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

    ``F, L, dL`` (nt, N); ``F_r, F_s, F_n, F_o, M_s, M_n, M_o`` (nt, N, 3).  ``undetermined`` (nt,): the equations leave
    a combination of driving forces free, and F is the shortest vector that fulfils them; only other combinations mean
    anything (F_1 - F_2 of two collinear legs).  ``numbers`` (24 N, nt): what all but that are views of, samples last.
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
    undetermined: np.ndarray
    numbers: np.ndarray

    @staticmethod
    def rows(N: int) -> int:
        """Rows of ``numbers``."""
        return N * (3 * len(VECTORS) + 3)

    @classmethod
    def zeros(cls, nt: int, N: int) -> InverseDynamics:
        """Arrays for nt samples of N legs, to be filled, as often as wanted."""
        columns = -(-nt // LINE) * LINE
        numbers = np.zeros((cls.rows(N), columns))[:, :nt]
        F, vectors, L, dL = np.split(numbers, [N, N * (3 * len(VECTORS) + 1), N * (3 * len(VECTORS) + 2)])
        F_r, F_s, F_n, F_o, M_s, M_n, M_o = vectors.reshape(len(VECTORS), N, 3, nt).transpose(0, 3, 1, 2)
        sure = np.zeros(nt, dtype=bool)
        return cls(F.T, F_r, F_s, F_n, F_o, M_s, M_n, M_o, L.T, dL.T, undetermined=sure, numbers=numbers)


def components(motion: PlatformMotion) -> PlatformMotion:
    """Arrays (n, 3), (n, 3, 3) as tuples of contiguous arrays (n,): samples last."""

    def vector(a: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(np.ascontiguousarray(a[:, j]) for j in range(3))

    R = tuple(vector(motion.R[:, j]) for j in range(3))
    C_p, dC_p, w_p, ddC_p, dw_p = (vector(a) for a in (motion.C_p, motion.dC_p, motion.w_p, motion.ddC_p, motion.dw_p))
    return PlatformMotion(C_p, R, dC_p, w_p, ddC_p, dw_p)


def _real(name: str, a: Any) -> np.ndarray:
    a = np.asarray(a)
    if a.dtype.kind not in "fiub":
        raise ValueError(f"motion.{name}: got {a.dtype}, expected real numbers")
    return a.astype(float, copy=False)


def checked(motion: PlatformMotion) -> PlatformMotion:
    """The motion as arrays of floats. Raises ValueError if a shape is wrong."""
    arrays = PlatformMotion(*(_real(name, a) for name, a in motion._asdict().items()))
    nt = len(arrays.C_p) if arrays.C_p.ndim else 0
    if nt == 0:
        raise ValueError(f"motion.C_p: got shape {arrays.C_p.shape}, expected (nt, 3) with at least one sample")
    for name, a in arrays._asdict().items():
        shape = (nt, 3, 3) if name == "R" else (nt, 3)
        if a.shape != shape:
            raise ValueError(f"motion.{name}: got shape {a.shape}, expected {shape}")
    return arrays


def require_finite(arrays: PlatformMotion, first_sample: int = 0) -> None:
    """Raise ValueError that names the first sample that is not finite."""
    for name, a in arrays._asdict().items():
        if not np.isfinite(a).all():
            sample = int(np.argwhere(~np.isfinite(a))[0][0])
            raise ValueError(f"motion.{name}: sample {first_sample + sample} is not finite: {a[sample].tolist()}")


def parts(nt: int, size: int = BLOCK) -> Iterator[slice]:
    """Slices of nt samples."""
    for start in range(0, nt, size):
        yield slice(start, min(start + size, nt))


def part(motion: PlatformMotion, block: slice) -> PlatformMotion:
    """Some samples of a motion."""
    return PlatformMotion(*(a[block] for a in motion))


def blocks(motion: PlatformMotion, first_sample: int = 0) -> Iterator[tuple[slice, PlatformMotion]]:
    """The motion in blocks of components. Raises ValueError for a wrong shape or what is not finite."""
    arrays = checked(motion)
    for block in parts(len(arrays.C_p)):
        some = part(arrays, block)
        require_finite(some, first_sample + block.start)
        yield block, components(some)
