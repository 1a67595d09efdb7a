"""The formulas of `stewart` on arrays of samples: blocks, condition test, results by name."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import planar, stewart
from .samples import InverseDynamics, LegCoordinates, blocks, stack
from .solve import LIMIT, Infeasible, SingularPose, longest_lever, solve_samples
from .stewart import LegState, NotDeterminate, Parameters, PlanarParameters, PlatformMotion


def _refuse_vertical(legs: list[LegState], first_sample: int, reason: str) -> None:
    s = np.array([k.s for k in legs])
    leg, sample = np.unravel_index(int(np.argmin(s)), s.shape)
    if not s[leg, sample] * LIMIT >= 1.0:
        raise SingularPose(first_sample + int(sample), int(leg) + 1, "sin q_n", float(s[leg, sample]), reason)


def inverse_kinematics(P: Parameters | PlanarParameters, motion: PlatformMotion) -> LegCoordinates:
    """Joint coordinates, rates and accelerations of every leg from the platform's motion, (19), (31).

    ``motion`` holds arrays (nt, 3) and R (nt, 3, 3). Branch 0 < q_n < pi, q_o in (-pi, pi], continued without jumps.
    Planar: q_o = 0, q_n in (-pi, pi], continued without jumps.

    Raises
    ------
    SingularPose
        A spatial leg is vertical: q_o is undefined.
    """
    if isinstance(P, PlanarParameters):
        return planar.inverse_kinematics(P, motion)
    parts: list[np.ndarray] = []
    for block, m in blocks(motion):
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


def inverse_dynamics(P: Parameters | PlanarParameters, motion: PlatformMotion) -> InverseDynamics:
    """Driving forces (7), (8) and joint reactions (23)-(29) for any number of samples; planar: (32), (35).

    Parameters
    ----------
    P : Parameters or PlanarParameters
    motion : PlatformMotion
        Arrays, world axes: C_p, dC_p, w_p, ddC_p, dw_p (nt, 3) and R (nt, 3, 3), SI units.

    Raises
    ------
    SingularPose
        Condition above 1e12, or sin q_n < 1e-12 where a base or a spin inertia loads it.
    Infeasible
        A planar mechanism in a singular state cannot move as prescribed, whatever the forces.
    NotDeterminate
        N is not 6 (planar: 3, or 2 for a point mass); the error carries what is determined.
    ValueError
        Wrong shape or a value that is not finite.
    """
    if isinstance(P, PlanarParameters):
        return planar.inverse_dynamics(P, motion)
    parts: list[list[np.ndarray]] = []
    for block, m in blocks(motion):
        conditions: list[np.ndarray] = []

        def solve(rows: Any, right: Any, start: int = block.start, out: list[np.ndarray] = conditions) -> Any:
            X, condition = solve_samples(rows, right, longest_lever(P.p), start)
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
                *(stack(v) for v in zip(*one.forces, strict=True)),
                *(stack(v) for v in zip(*one.moments, strict=True)),
                np.array([k.L for k in one.legs]).T,
                np.array([k.dq_s for k in one.legs]).T,
                conditions[0],
                np.zeros_like(conditions[0], dtype=bool),
            ]
        )
    return InverseDynamics(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def driving_forces(P: Parameters | PlanarParameters, motion: PlatformMotion) -> np.ndarray:
    """Driving forces, (7), (8). Returns (nt, N) in N, + extends the leg. Errors as `inverse_dynamics`."""
    return inverse_dynamics(P, motion).F


__all__ = [
    "Infeasible",
    "InverseDynamics",
    "LegCoordinates",
    "NotDeterminate",
    "SingularPose",
    "driving_forces",
    "inverse_dynamics",
    "inverse_kinematics",
]
