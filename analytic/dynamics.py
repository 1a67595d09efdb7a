"""The formulas of `stewart` on arrays of samples: one call for every back end, which all fill the same arrays.

What a back end is in doubt about, singular poses and wrong motions among it, is looked at again by `_careful`, with
singular values.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from . import planar, stewart
from .backends import answer
from .evaluate import DRIVING_FORCES, INVERSE_DYNAMICS, Mechanism, Problem, answers, in_floats
from .samples import InverseDynamics, LegCoordinates, blocks, checked, part
from .solve import LIMIT, Infeasible, SingularPose, longest_lever, solve_determined, solve_samples
from .stewart import LegState, NotDeterminate, Parameters, PlanarParameters, PlatformMotion


def require_not_vertical(legs: Sequence[LegState], first_sample: int, reason: str) -> None:
    """Raise SingularPose for a leg whose sin q_n leaves no digits; ``reason``: why it matters."""
    s = np.array([k.s for k in legs])
    leg, sample = np.unravel_index(int(np.argmin(s)), s.shape)
    if not s[leg, sample] * LIMIT >= 1.0:
        raise SingularPose(first_sample + int(sample), int(leg) + 1, "sin q_n", float(s[leg, sample]), reason)


def inverse_kinematics(P: Mechanism, motion: PlatformMotion) -> LegCoordinates:
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
    found: list[np.ndarray] = []
    for block, m in blocks(motion):
        legs = [stewart.leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
        require_not_vertical(legs, block.start, "the leg is vertical and its base angle undefined")
        rates = [stewart.hinge_rates(k) for k in legs]
        columns = [
            (np.arctan2(k.so, k.co), np.arctan2(k.s, k.c), k.q_s, h.dq_o, k.dq_n, k.dq_s, h.ddq_o, h.ddq_n, k.ddq_s)
            for k, h in zip(legs, rates, strict=True)
        ]
        found.append(np.array(columns))
    q = np.concatenate(found, axis=2).transpose(1, 2, 0)
    q[0] = np.unwrap(q[0], axis=0)
    return LegCoordinates(*q)


def _overflow(sample: int) -> ValueError:
    return ValueError(f"sample {sample}: forces or reactions are beyond what float64 holds, and so is the motion")


def _require_out(out: np.ndarray, motion: PlatformMotion, shape: tuple[int, ...]) -> None:
    """Raise ValueError unless an array can be filled while a motion is read."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != float:
        got = f"{out.dtype} of shape {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise ValueError(f"out: got {got}, expected float64 of shape {shape}")
    if not out.flags.writeable:
        raise ValueError("out: got an array that can only be read, expected one to write into")
    for name, a in motion._asdict().items():
        if np.may_share_memory(out, a):
            raise ValueError(f"out: shares its memory with motion.{name}, expected an array of its own")


def _careful(
    P: Mechanism, problem: Problem, motion: PlatformMotion, out: np.ndarray, undetermined: np.ndarray, first: int
) -> None:
    """As a back end, with the condition of every sample: finds the answer, or the error that there is none."""
    lever = longest_lever(P.p)
    for block, m in blocks(motion, first):
        start = first + block.start

        def solve(rows: Any, right: Any, start: int = start, m: PlatformMotion = m, block: slice = block) -> Any:
            if isinstance(P, Parameters):
                return solve_samples(rows, right, lever, start)[0]
            F, _, undetermined[block] = solve_determined(rows, right, lever, planar.size(P, m, lever), start)
            return F

        with np.errstate(all="ignore"):  # a vertical leg overflows; it is refused by name just below
            if isinstance(P, Parameters) and P.leg.spins:
                legs = [stewart.leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
                require_not_vertical(legs, start, "a vertical leg with base or spin inertia")
            found, _ = answers(P, m, np.sqrt, solve, every=problem is INVERSE_DYNAMICS)
        for row, x in zip(problem.rows(P), found, strict=True):
            if not np.isfinite(x).all():
                raise _overflow(start + int(np.argmin(np.isfinite(np.broadcast_to(x, m.C_p[0].shape)))))
            out[row, block] = x


def _evaluate(
    P: Mechanism,
    problem: Problem,
    motion: PlatformMotion,
    backend: str | None,
    out: np.ndarray,
    undetermined: np.ndarray,
) -> None:
    """Fill ``out`` (rows, nt) and ``undetermined`` (nt,)."""
    undetermined[:] = False
    if len(P.p) != P.equations:
        _careful(P, problem, motion, out, undetermined, 0)  # says what is determined
    for block in answer(P, problem, motion, backend, out):
        _careful(P, problem, part(motion, block), out[:, block], undetermined[block], block.start)


def inverse_dynamics(
    P: Mechanism, motion: PlatformMotion, backend: str | None = None, out: InverseDynamics | None = None
) -> InverseDynamics:
    """Driving forces (7), (8) and joint reactions (23)-(29) for any number of samples; planar: (32), (35), (23)-(27).

    Parameters
    ----------
    P : Parameters or PlanarParameters
    motion : PlatformMotion
        Arrays, world axes: C_p, dC_p, w_p, ddC_p, dw_p (nt, 3) and R (nt, 3, 3), SI units.  That R is a rotation is
        taken for granted.
    backend : ``numpy``, ``float`` or ``compiled``
        None: plain floats for a single sample, NumPy for more.
    out : made by `InverseDynamics.zeros`
        Filled and returned, which spares new memory.

    Raises
    ------
    SingularPose
        Condition above 1e12, or sin q_n < 1e-12 where a base or a spin inertia loads it.
    Infeasible
        A planar mechanism in a singular state cannot move as prescribed, whatever the forces.
    NotDeterminate
        N is not 6 (planar: 3, or 2 for a point mass); the error carries what is determined.
    NoCompiler
        ``compiled`` needs a C compiler.
    ValueError
        Wrong shape, a value that is not finite, an unknown back end.
    """
    P, motion = in_floats(P), checked(motion)
    nt, N = len(motion.C_p), len(P.p)
    if out is None:
        out = InverseDynamics.zeros(nt, N)
    elif not isinstance(out, InverseDynamics):
        raise ValueError(f"out: got {type(out).__name__}, expected what InverseDynamics.zeros makes")
    else:
        _require_out(out.numbers, motion, (InverseDynamics.rows(N), nt))
        if not np.may_share_memory(out.F, out.numbers):
            raise ValueError("out: got a copy, whose arrays are no views of its numbers, expected what zeros makes")
    _evaluate(P, INVERSE_DYNAMICS, motion, backend, out.numbers, out.undetermined)
    return out


def driving_forces(
    P: Mechanism, motion: PlatformMotion, backend: str | None = None, out: np.ndarray | None = None
) -> np.ndarray:
    """Driving forces, (7), (8). Returns (nt, N) in N, + extends the leg. Parameters and errors as `inverse_dynamics`.

    ``out`` (nt, N), of any memory order, is filled and returned; without one, samples are last in memory.
    """
    P, motion = in_floats(P), checked(motion)
    nt, N = len(motion.C_p), len(P.p)
    if out is None:
        out = np.empty((N, nt)).T
    else:
        _require_out(out, motion, (nt, N))
    _evaluate(P, DRIVING_FORCES, motion, backend, out.T, np.empty(nt, dtype=bool))
    return out


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
