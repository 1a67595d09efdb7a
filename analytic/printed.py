"""The first problem by the equations as printed, and the rounding that they are known to leave.

For comparison: `dynamics` uses forms without cancellation.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import stewart
from .dynamics import require_not_vertical
from .evaluate import flat
from .samples import InverseDynamics, blocks, checked
from .solve import longest_lever, solve_samples
from .stewart import LegState, Parameters, PlatformMotion

EPS = float(np.finfo(float).eps)

NO_DIGITS = 0.1
"""Rounding over the largest driving force that leaves none."""


def inverse_dynamics_printed(P: Parameters, motion: PlatformMotion) -> tuple[InverseDynamics, np.ndarray]:
    """Driving forces and joint reactions by (7)-(14), (20)-(29) as printed, and the rounding of a force (nt,) [N].

    The rounding is estimated from the terms that cancel in (20)-(22) and in the arms (11), times the condition of (7),
    (8); measured errors lie below ten times the estimate.

    Raises
    ------
    SingularPose
        A vertical leg, or a condition above 1e12.
    ArithmeticError
        The rounding is more than a tenth of the largest driving force.
    NotDeterminate
        N is not 6.
    ValueError
        Gravity is not along -y_r.
    """
    motion = checked(motion)
    if len(P.p) != P.equations:
        raise stewart.NotDeterminate(len(P.p), P.equations, None)
    out, rounding = InverseDynamics.zeros(len(motion.C_p), len(P.p)), np.zeros(len(motion.C_p))
    lever = longest_lever(P.p)
    for block, m in blocks(motion):
        condition = np.zeros(0)

        def solve(rows: Any, right: Any, first: int = block.start) -> Any:
            nonlocal condition
            X, condition = solve_samples(rows, right, lever, first)
            return X

        with np.errstate(all="ignore"):
            legs = [stewart.leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
            require_not_vertical(legs, block.start, "(22) divides by it")
            found = stewart.first_problem_printed(P, m, np.sqrt, solve)
            left = sum(_rounding(P, k) for k in legs)
            arms = sum(EPS * np.sqrt(stewart.dot(x, x)) / lever for x in (stewart.sub(O, m.C_p) for O in P.O))
            largest = np.max(np.abs(np.array(found.F)), axis=0)
            rounding[block] = condition * (left + arms * largest)
        worst = int(np.argmax(rounding[block] / largest))
        if not rounding[block][worst] <= NO_DIGITS * largest[worst]:
            raise ArithmeticError(
                f"sample {block.start + worst}: the equations as printed leave no digits: rounding of up to"
                f" {rounding[block][worst]:.3g} N in forces of {largest[worst]:.3g} N; a leg is too steep for (22)"
            )
        out.numbers[:, block] = flat(found)
    return out, rounding


def _rounding(P: Parameters, k: LegState) -> Any:
    """Half a unit in the last place of the terms of (20)-(22), as forces on the tip [N]."""
    J_q, J_y, m_q = stewart.inertia(P.leg, k.q_s)
    h = stewart.hinge_rates(k)
    ddq_o, dq_o = abs(h.ddq_o), abs(h.dq_o)
    swing = 2.0 * P.leg.m_s * abs(k.q_s * k.dq_s)
    about_o = (P.leg.J_oz + 2.0 * J_q + J_y) * ddq_o / k.s + 2.0 * (J_q + J_y) * abs(k.dq_n) * dq_o + swing * k.s * dq_o
    about_n = J_q * abs(h.ddq_n) + (J_q + J_y) * k.s * dq_o * dq_o + swing * abs(k.dq_n) + abs(m_q * P.g[1])
    along = P.leg.m_s * (abs(k.ddq_s) + abs(k.q_s) * (k.s * k.s * dq_o * dq_o + k.dq_n * k.dq_n) + abs(P.g[1]))
    return EPS * ((about_o + about_n) / k.L + along)
