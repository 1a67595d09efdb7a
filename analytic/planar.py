"""The planar formulas of `stewart`, (32)-(36), on arrays of samples."""

from __future__ import annotations

import numpy as np

from . import stewart
from .samples import LegCoordinates, blocks
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


def size(P: PlanarParameters, m: PlatformMotion, lever: float) -> np.ndarray:
    """Weights, inertial forces and load (nt,) [N] that the platform's equations add up."""
    tip = np.hypot(m.ddC_p[0], m.ddC_p[1]) + lever * (np.abs(m.dw_p[2]) + m.w_p[2] ** 2)
    mass = P.m_p + len(P.p) * (P.leg.m_n + P.leg.m_s)
    load = np.hypot(P.load.force[0], P.load.force[1]) + abs(P.load.moment[2]) / lever
    return mass * (np.hypot(P.g[0], P.g[1]) + tip) + load
