"""The second problem of dynamics: accelerations from driving forces, for arrays of samples and for single states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from . import stewart
from .backends import answer
from .evaluate import FORWARD_DYNAMICS, Mechanism, in_floats
from .samples import blocks, checked, part
from .solve import LIMIT, SingularPose, row_scaled
from .stewart import Equations, LegState, Parameters, PlanarParameters, PlatformMotion, Scalar, SecondProblem


class Form(NamedTuple):
    """A form of the equations, and the power of 1/s by which its rounding grows without and with spin inertia.

    ``stiff``: the power of 1/L, over the levers of a leg: a short one is stiff across.
    """

    equations: Equations
    loss: float
    loss_spinning: float
    stiff: float


FORMS = {
    "compliance": Form(stewart.compliance_equations, 0.0, 1.0, 2.0),  # z_n has the rounding of l over s
    "reduced": Form(stewart.reduced_equations, 0.0, 2.0, 2.0),  # 1/s^2 in the matrix
    "paper": Form(stewart.paper_equations, 1.0, 1.0, 0.0),  # q_o'' and q_o'^2 s cancel between (31) and the loads
}
"""Forms of (7), (8), (31) by name."""

PLANAR_FORMS = {
    "compliance": stewart.planar_reduced_equations,  # no planar leg is steep: one form serves for both
    "reduced": stewart.planar_reduced_equations,
    "paper": stewart.planar_paper_equations,
}
"""Forms of (32), (34) or (35), (36) by the same names."""


@dataclass(frozen=True)
class Accelerations:
    """Of the platform, world axes: ``ddC_p`` (nt, 3) m/s^2, ``dw_p`` (nt, 3) rad/s^2.

    ``condition`` (nt,): row-scaled, of the equations of a form that was asked for by name; else 1.
    """

    ddC_p: np.ndarray
    dw_p: np.ndarray
    condition: np.ndarray | float = 1.0


def _require(good: np.ndarray, values: np.ndarray, first_sample: int, name: str, limit: str) -> None:
    """Raise SingularPose for the first leg and sample that are not good; both arrays (N, nt) or (N,)."""
    if not good.all():
        leg, sample = np.argwhere(~np.atleast_2d(good.T).T)[0]
        value = float(np.atleast_2d(values.T).T[leg, sample])
        raise SingularPose(first_sample + int(sample), int(leg) + 1, name, value, limit)


def _levers(P: Mechanism) -> float:
    """What a leg's length is compared with: levers on the platform, and the rod's tip from its centre of mass [m]."""
    return max(sum(abs(x) for x in p) for p in P.p) + abs(P.leg.a)


def _stiffness(form: str, P: Mechanism, L: np.ndarray) -> np.ndarray:
    """What a form multiplies rounding by for legs of such lengths, at least 1."""
    return np.maximum(1.0, _levers(P) / L) ** FORMS[form].stiff


def require_length(P: Parameters | PlanarParameters, L: np.ndarray, first_sample: int) -> None:
    """Raise SingularPose for a leg of no length; ``L`` (N, nt) or (N,)."""
    least = _levers(P) / LIMIT
    _require(L >= least, L, first_sample, "length", f"below {least:.0e} m: no leg is left")


def _growth(
    name: str, P: Parameters, legs: Sequence[LegState], in_time: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """L, s, and what a form multiplies rounding by, (N, nt) or (N,).

    Rounding grows as the form says; a base or spin inertia that moves also needs q_o' = V . z_n / s, where z_n has the
    rounding of l over s: q_o'^2 adds rates squared over s^2, against accelerations of 1 rad/s^2 or, but for a motion in
    time that has become so fast, of rates squared.
    """
    L, s, dq_n, w = np.array([(k.L, k.s, k.dq_n, k.w) for k in legs]).swapaxes(0, 1)
    form = FORMS[name]
    with np.errstate(all="ignore"):  # what overflows is refused
        rates = dq_n * dq_n + w * w
        own = 1.0 if in_time else np.maximum(1.0, rates.max(axis=0))
        moving = rates / (s * s) / own if P.leg.spins else 0.0
        return L, s, (s ** -(form.loss_spinning if P.leg.spins else form.loss) + moving) * _stiffness(name, P, L)


def require_not_steep(
    name: str, P: Parameters, legs: Sequence[LegState], first_sample: int = 0, in_time: bool = False
) -> None:
    """Raise SingularPose for a leg of no length, or so steep that a form leaves fewer than four digits."""
    L, s, growth = _growth(name, P, legs, in_time)
    require_length(P, L, first_sample)
    limit = f"in the form {name!r} rounding grows by up to {growth.max():.0e}, expected at most {LIMIT:.0e}"
    _require(_stiffness(name, P, L) <= LIMIT, L, first_sample, "length", limit)
    _require(growth <= LIMIT, s, first_sample, "sin q_n", limit)


def growth_of_rounding(P: Mechanism, motion: PlatformMotion, form: str) -> np.ndarray:
    """What one of `FORMS` multiplies rounding by at each sample (nt,), at least 1, by its steepest or shortest leg."""
    found = [np.ones(0)]
    for _, m in blocks(checked(motion)):
        with np.errstate(all="ignore"):
            if isinstance(P, PlanarParameters):
                legs = [stewart.planar_leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
                growth = _stiffness(form, P, np.array([k.L for k in legs]))
            else:
                legs = [stewart.leg_kinematics(P.leg, p, O, m, np.sqrt) for p, O in zip(P.p, P.O, strict=True)]
                growth = _growth(form, P, legs)[2]
        found.append(growth.max(axis=0))
    return np.maximum(np.concatenate(found), 1.0)


def _careful_form(P: Mechanism, motion: PlatformMotion) -> str:
    """The form that leaves most digits where the smallest one is in doubt."""
    return min(("compliance", "paper"), key=lambda form: float(growth_of_rounding(P, motion, form).max()))


def _guarded(name: str, first_sample: int = 0, in_time: bool = False) -> Equations:
    """The equations of a form, refusing poses that it is not for."""
    if name not in FORMS:
        raise ValueError(f"form: got {name!r}, expected one of {', '.join(FORMS)}")

    def equations(P: Any, motion: PlatformMotion, legs: Any, F: Sequence[Scalar]) -> Any:
        if isinstance(P, PlanarParameters):
            require_length(P, np.array([k.L for k in legs]), first_sample)
            return PLANAR_FORMS[name](P, motion, legs, F)
        require_not_steep(name, P, legs, first_sample, in_time)
        return FORMS[name].equations(P, motion, legs, F)

    return equations


def _second_problem(
    P: Mechanism, motion: PlatformMotion, F: Any, sqrt: Any, solve: Any, form: Equations
) -> SecondProblem:
    if isinstance(P, PlanarParameters):
        return stewart.planar_second_problem(P, motion, F, sqrt, solve, form)
    return stewart.second_problem(P, motion, F, sqrt, solve, form)


def _no_inverse(sample: int, condition: float) -> ArithmeticError:
    return ArithmeticError(
        f"sample {sample}: row-scaled condition {condition:.3g}, above {LIMIT:g}: no accelerations follow, because"
        " masses or moments of inertia vanish"
    )


def accelerations(P: Mechanism, motion: PlatformMotion, F: Sequence[float], form: str = "compliance") -> SecondProblem:
    """Platform accelerations of one state as plain floats: for integrators, without condition test.

    Raises
    ------
    SingularPose
        A leg too steep for the form, or of no length.
    ArithmeticError
        The matrix has no inverse.
    """

    def solve(rows: Any, right: Any) -> list[float]:
        return np.linalg.solve(np.array(rows), np.array(right)).tolist()

    try:
        return _second_problem(P, motion, F, math.sqrt, solve, _guarded(form, in_time=True))
    except (np.linalg.LinAlgError, ZeroDivisionError):
        raise _no_inverse(0, math.inf) from None


def forward_dynamics(
    P: Mechanism, motion: PlatformMotion, F: np.ndarray, form: str | None = None, backend: str | None = None
) -> Accelerations:
    """Platform accelerations under driving forces, for any number of samples and any N >= 1 of legs.

    The joint accelerations are those of `inverse_kinematics` once ddC_p, dw_p stand in the motion.

    Parameters
    ----------
    P : Parameters or PlanarParameters
    motion : PlatformMotion
        Arrays, world axes: C_p, dC_p, w_p (nt, 3) and R (nt, 3, 3), SI units.  Its accelerations are not read.
    F : ndarray, shape (nt, N)
        Driving forces [N], + extends the leg.
    form : name of one of `FORMS`
        ``compliance`` serves steep legs, ``reduced`` is the smallest, ``paper`` is the paper's own (7), (8), (31), by
        NumPy.  None: the smallest, on a back end; ``compliance`` for blocks where it loses digits.
    backend : as in `inverse_dynamics`
        Only without a form.

    Raises
    ------
    SingularPose
        A leg too steep for the form, or of no length.
    ArithmeticError
        Row-scaled condition above 1e12.
    ValueError
        Wrong shape, a value that is not finite or makes accelerations that are not, an unknown form or back end.
    """
    zero = np.zeros(np.shape(motion.C_p))
    P, motion = in_floats(P), checked(motion._replace(ddC_p=zero, dw_p=zero))
    F = np.asarray(F, dtype=float)
    expected = (len(zero), len(P.p))
    if F.shape != expected:
        raise ValueError(f"F: got shape {F.shape}, expected {expected}: one force per sample and leg")
    out = np.zeros((6, len(F)))
    if form is None:
        inputs = [motion.C_p, motion.R, motion.dC_p, motion.w_p, F]
        for block in answer(P, FORWARD_DYNAMICS, inputs, backend, out):
            m = part(motion, block)
            _in_form(_careful_form(P, m), P, m, F[block], out[:, block], block.start)
    elif backend is None:
        return Accelerations(out[:3].T, out[3:].T, _in_form(form, P, motion, F, out, 0))
    else:
        raise ValueError(f"backend: got {backend!r} together with the form {form!r}, expected one of them")
    return Accelerations(out[:3].T, out[3:].T)


def _in_form(name: str, P: Mechanism, motion: PlatformMotion, F: np.ndarray, out: np.ndarray, first: int) -> np.ndarray:
    """Accelerations (6, nt) by one of `FORMS`, refusing what it leaves too few digits for; condition (nt,)."""
    conditions = np.empty(len(F))
    if not np.isfinite(F).all():
        sample = int(np.argwhere(~np.isfinite(F))[0][0])
        raise ValueError(f"F: sample {first + sample} is not finite: {F[sample].tolist()}")
    for block, m in blocks(motion, first):
        start = first + block.start

        def solve(rows: Any, right: Any, start: int = start, block: slice = block) -> list[np.ndarray]:
            A = np.empty((block.stop - block.start, len(rows), len(rows)))
            for i, row in enumerate(rows):
                for j, x in enumerate(row):
                    A[:, i, j] = x
            b = np.stack(np.broadcast_arrays(*right), axis=-1)
            length, condition = row_scaled(A)
            conditions[block] = condition
            worst = int(np.argmax(condition))
            if not condition[worst] <= LIMIT:
                raise _no_inverse(start + worst, float(condition[worst]))
            return list(np.linalg.solve(A / length[..., None], (b / length)[..., None])[..., 0].T)

        with np.errstate(all="ignore"):  # a vertical leg overflows; it is refused by name
            one = _second_problem(P, m, list(F[block].T), np.sqrt, solve, _guarded(name, start))
        out[:3, block], out[3:, block] = one.ddC_p, one.dw_p
        bad = np.flatnonzero(~np.isfinite(out[:, block]).all(axis=0))
        if len(bad):
            raise ValueError(f"sample {start + int(bad[0])}: accelerations are beyond what float64 holds")
    return conditions
