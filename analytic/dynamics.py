"""The formulas of `stewart` on arrays of samples: blocks, condition test, results by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import stewart
from .solve import LIMIT, SingularPose, solve_samples
from .stewart import LegState, NotDeterminate, Parameters, PlatformMotion

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

    ``F, L, dL`` (nt, N); ``F_r, F_s, F_n, F_o, M_s, M_n, M_o`` (nt, N, 3); ``condition`` (nt,): row-scaled, (7), (8).
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


def _components(motion: PlatformMotion) -> PlatformMotion:
    """Arrays (n, 3), (n, 3, 3) as tuples of contiguous arrays (n,): samples last."""

    def vector(a: np.ndarray) -> tuple[np.ndarray, ...]:
        return tuple(np.ascontiguousarray(a[:, j]) for j in range(3))

    R = tuple(vector(motion.R[:, j]) for j in range(3))
    C_p, dC_p, w_p, ddC_p, dw_p = (vector(a) for a in (motion.C_p, motion.dC_p, motion.w_p, motion.ddC_p, motion.dw_p))
    return PlatformMotion(C_p, R, dC_p, w_p, ddC_p, dw_p)


def _blocks(motion: PlatformMotion) -> Iterator[tuple[slice, PlatformMotion]]:
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


def _refuse_vertical(legs: list[LegState], first_sample: int, reason: str) -> None:
    s = np.array([k.s for k in legs])
    leg, sample = np.unravel_index(int(np.argmin(s)), s.shape)
    if not s[leg, sample] * LIMIT >= 1.0:
        raise SingularPose(first_sample + int(sample), int(leg) + 1, "sin q_n", float(s[leg, sample]), reason)


def _stack(vectors: Any) -> np.ndarray:
    """A list over legs of vectors of arrays (n,) as (n, N, 3)."""
    return np.moveaxis(np.array(vectors), -1, 0)


def inverse_kinematics(P: Parameters, motion: PlatformMotion) -> LegCoordinates:
    """Joint coordinates, rates and accelerations of every leg from the platform's motion, (19), (31).

    ``motion`` holds arrays (nt, 3) and R (nt, 3, 3). Branch 0 < q_n < pi, q_o in (-pi, pi], continued without jumps.

    Raises
    ------
    SingularPose
        A leg is vertical: q_o is undefined.
    """
    parts: list[np.ndarray] = []
    for block, m in _blocks(motion):
        legs = [stewart.leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
        _refuse_vertical(legs, block.start, "the leg is vertical and its base angle undefined")
        rates = [stewart.hinge_rates(k) for k in legs]
        columns = [
            (np.arctan2(k.so, k.co), np.arctan2(k.s, k.c), k.q_s, h.dq_o, k.dq_n, k.dq_s, h.ddq_o, h.ddq_n, k.ddq_s)
            for k, h in zip(legs, rates, strict=True)
        ]
        parts.append(np.array(columns))
    q = np.concatenate(parts, axis=2).transpose(1, 2, 0)
    q[0] = np.unwrap(q[0], axis=0)
    return LegCoordinates(*q)


def inverse_dynamics(P: Parameters, motion: PlatformMotion) -> InverseDynamics:
    """Driving forces (7), (8) and joint reactions (23)-(29) for any number of samples.

    Parameters
    ----------
    P : Parameters
    motion : PlatformMotion
        Arrays, world axes: C_p, dC_p, w_p, ddC_p, dw_p (nt, 3) and R (nt, 3, 3), SI units.

    Raises
    ------
    SingularPose
        Row-scaled condition above 1e12, or sin q_n < 1e-12 where a base or a spin inertia loads it.
    NotDeterminate
        N is not 6; the error carries what is determined.
    ValueError
        Wrong shape or a value that is not finite.
    """
    parts: list[list[np.ndarray]] = []
    for block, m in _blocks(motion):
        conditions: list[np.ndarray] = []

        def solve(rows: Any, right: Any, start: int = block.start, out: list[np.ndarray] = conditions) -> Any:
            X, condition = solve_samples(rows, right, start)
            out.append(condition)
            return X

        with np.errstate(all="ignore"):  # a vertical leg overflows; it is refused by name just below
            state = stewart.determined(P, m, np.sqrt)
        if P.leg.spins:
            _refuse_vertical(state.legs, block.start, "a vertical leg with base or spin inertia")
        one = stewart.driven(P, m, state, solve)
        parts.append(
            [
                np.array(one.F).T,
                *(_stack(v) for v in zip(*one.forces, strict=True)),
                *(_stack(v) for v in zip(*one.moments, strict=True)),
                np.array([k.L for k in one.legs]).T,
                np.array([k.dq_s for k in one.legs]).T,
                conditions[0],
            ]
        )
    return InverseDynamics(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def driving_forces(P: Parameters, motion: PlatformMotion) -> np.ndarray:
    """Driving forces, (7), (8). Returns (nt, N) in N, + extends the leg. Errors as `inverse_dynamics`."""
    return inverse_dynamics(P, motion).F


__all__ = [
    "InverseDynamics",
    "LegCoordinates",
    "NotDeterminate",
    "SingularPose",
    "driving_forces",
    "inverse_dynamics",
    "inverse_kinematics",
]
