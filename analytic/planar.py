"""The planar formulas of `stewart`, (32)-(36), on arrays of samples."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import stewart
from .samples import InverseDynamics, LegCoordinates, blocks
from .solve import longest_lever, solve_determined
from .stewart import PlanarParameters, PlatformMotion


def inverse_kinematics(P: PlanarParameters, motion: PlatformMotion) -> LegCoordinates:
    """Joint coordinates (nt, N) from (34), (36): q_o = 0, q_n in (-pi, pi] at first, continued without jumps."""
    parts = []
    for _, m in blocks(motion):
        legs = [stewart.planar_leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
        parts.append(
            np.array([(np.arctan2(k.s, k.c), k.q_s, k.dq_n, k.dq_s, k.ddq_n, k.ddq_s) for k in legs])
        )  # fmt: skip
    q_n, q_s, dq_n, dq_s, ddq_n, ddq_s = np.concatenate(parts, axis=2).transpose(1, 2, 0)
    zero = np.zeros_like(q_n)
    return LegCoordinates(zero, np.unwrap(q_n, axis=0), q_s, zero, dq_n, dq_s, zero, ddq_n, ddq_s)


def _size(P: PlanarParameters, m: PlatformMotion, lever: float) -> np.ndarray:
    """Weights, inertial forces and load (nt,) [N] that the platform's equations add up."""
    tip = np.hypot(m.ddC_p[0], m.ddC_p[1]) + lever * (np.abs(m.dw_p[2]) + m.w_p[2] ** 2)
    mass = P.m_p + len(P.p) * (P.leg.m_n + P.leg.m_s)
    load = np.hypot(P.load.force[0], P.load.force[1]) + abs(P.load.moment[2]) / lever
    return mass * (np.hypot(P.g[0], P.g[1]) + tip) + load


def inverse_dynamics(P: PlanarParameters, motion: PlatformMotion) -> InverseDynamics:
    """Driving forces (32), (35) and joint reactions (23)-(25), (27); vectors (nt, N, 3) with zeros off the plane.

    Raises
    ------
    SingularPose
        Condition above 1e12.
    Infeasible
        An equation vanishes for every leg (two collinear legs), and the motion does not fulfil it.
    NotDeterminate
        N is not 3, or not 2 for a point mass.
    """
    parts: list[list[np.ndarray]] = []
    lever = longest_lever(P.p)
    for block, m in blocks(motion):
        solved: list[tuple[np.ndarray, np.ndarray]] = []
        size = _size(P, m, lever)

        def solve(rows: Any, right: Any, size: np.ndarray = size, start: int = block.start, out: list = solved) -> Any:
            F, condition, undetermined = solve_determined(rows, right, lever, size, start)
            out.append((condition, undetermined))
            return F

        one = stewart.planar_problem(P, m, np.sqrt, solve)
        nt, N = len(one.legs[0].L), len(one.legs)
        zero = np.zeros((nt, N))

        def vectors(name: str, reactions: list = one.reactions, zero: np.ndarray = zero) -> np.ndarray:
            x, y = (np.array([getattr(reaction, name)[j] for reaction in reactions]).T for j in range(2))
            return np.stack([x, y, zero], axis=2)

        F_n, nothing = vectors("F_n"), np.zeros((nt, N, 3))
        M_s = np.stack([zero, zero, np.array([reaction.M_s for reaction in one.reactions]).T], axis=2)
        parts.append(
            [
                np.array(one.F).T, vectors("F_r"), vectors("F_s"), F_n, F_n, M_s, nothing, nothing,
                np.array([k.L for k in one.legs]).T, np.array([k.dq_s for k in one.legs]).T, *solved[0],
            ]
        )  # fmt: skip
    return InverseDynamics(*(np.concatenate(column) for column in zip(*parts, strict=True)))
