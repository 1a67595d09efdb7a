"""Misprints of the paper that change a number, and controls: deliberate mistakes that must show.

Each row has two readings, the correct one and the printed one; both are measured like the equations.  The printed
readings live here and nowhere else.  Those of the planar examples are in `audit_planar`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import stewart
from .audit import (
    GEOMETRY,
    Case,
    Measure,
    control,
    largest,
    legs,
    misprint,
    miss,
    per_leg,
    spatial,
    stacked,
)
from .audit_equations import (
    ANY_GRAVITY,
    VERTICAL,
    loads_by,
    missing,
    of_forces,
    of_loads,
    of_moments,
    of_reactions,
    wanted_loads,
)

# --- Proof of statement 1 ---------------------------------------------------------------------------------------------


def _f_o(vector_of_load: bool) -> Measure:
    """z_n . F_s = f_o / (s L), f_o by the load F_is of the rod, or by the driving force F in its place."""

    def residual(case: Case) -> float:
        P, got = spatial(case), []
        y_r = (0.0, 1.0, 0.0)
        for a, F in zip(legs(case), per_leg(case.truth["F"]), strict=True):
            k = a.k
            force = stewart.rod_load_printed(P.leg, k, a.h, P.g) if vector_of_load else stewart.mul(F, k.y_n)
            moment = stewart.dot(y_r, stewart.cross(stewart.mul(k.L, k.y_n), force))
            got.append((moment - a.loads.M_io_s * k.s) / (k.s * k.L))
        return miss(stacked(got), case.along(2, case.truth["F_s"]), case.force)

    return residual


def _M_io_with_z(case: Case) -> float:
    """M_io by the proof with z q_o' x_n in the momentum, z = D - z_p of (10), in place of s q_o' x_n."""
    g, C_p, dC_p, got = spatial(case).g, case.components.C_p, case.components.dC_p, []
    for a in legs(case):
        leg, k, h = a.leg, a.k, a.h
        J_q, J_y, m_q = stewart.inertia(leg, k.q_s)
        dJ_q = 2.0 * leg.m_s * k.q_s * k.dq_s
        z = a.O[2] - C_p[2]
        K = (J_q * z * h.dq_o, J_y * k.c * h.dq_o, J_q * k.dq_n)
        dK = (
            dJ_q * z * h.dq_o + J_q * (z * h.ddq_o - dC_p[2] * h.dq_o),
            J_y * (k.c * h.ddq_o - k.s * k.dq_n * h.dq_o),
            dJ_q * k.dq_n + J_q * h.ddq_n,
        )
        omega_n = (k.s * h.dq_o, k.c * h.dq_o, k.dq_n)
        about_y_r = stewart.in_world(k, *stewart.add(dK, stewart.cross(omega_n, K)))[1]
        got.append(about_y_r - m_q * stewart.cross(k.y_n, g)[1] + leg.J_oz * h.ddq_o)
    return miss(stacked(got), wanted_loads(case)["M_io"], case.moment)


def _spin(J_y: Callable[[stewart.Leg], float]) -> Measure:
    """J_y of (5) by one of the readings."""

    def residual(case: Case) -> float:
        want = case.inertia[..., 1]
        return miss(np.full(want.shape, J_y(spatial(case).leg)), want, float(want.max()))

    return residual


# --- Statement 2 ------------------------------------------------------------------------------------------------------


def _at_rest(case: Case) -> stewart.PlatformMotion:
    """The motion with C_p where its second derivative belongs."""
    return case.components._replace(ddC_p=case.components.C_p)


def _arms(first_chain: bool) -> Measure:
    """C_p O_r x y_n by the first of the two chains of the proof, or by the second one, which is (11)."""

    def residual(case: Case) -> float:
        C_p, got = case.components.C_p, []
        for a in legs(case):
            x, y, z = stewart.hull_pin_printed(a.O, C_p)
            _, (yx, _, yz) = stewart.cosines_printed(a.k)
            s, c = a.k.s, a.k.c
            chain = (0.0 * x, y * yz - x * yz + z * yx - z * c, x * s - y * yx)
            got.append(chain if first_chain else stewart.arms_printed(a.k, a.O, C_p))
        return miss(stacked(got), np.cross(case.r, case.axes[:, :, 1]), 1.0)

    return residual


def _principal(y_of: int) -> Measure:
    """The rate of I_p w_p in principal axes, the cosines of y_p taken from axis number `y_of`."""

    def residual(case: Case) -> float:
        moments, axes = case.principal
        w, dw = case.motion.w_p, case.motion.dw_p
        daxes = np.cross(w[:, None], axes)
        pqr, dpqr = (np.einsum("tej,tj->te", axes, v) for v in (w, dw))
        chosen = [0, y_of, 2]
        got = stewart.platform_momentum_rate_principal(
            tuple(moments), per_leg(axes[:, chosen]), per_leg(daxes[:, chosen]), tuple(pqr.T), tuple(dpqr.T)
        )
        want = -np.cross(case.r, case.truth["F_r"]).sum(axis=1)
        return miss(stacked([got]), want[:, None], case.moment)

    return residual


# --- Statement 3 ------------------------------------------------------------------------------------------------------


def _F_o(with_base: bool) -> Measure:
    """F_o by the proof of (26), with or without the mass of the base."""

    def residual(case: Case) -> float:
        P, got = spatial(case), []
        for a, F_r in zip(legs(case), per_leg(case.truth["F_r"]), strict=True):
            leg, k = a.leg, a.k
            m_q = stewart.inertia(leg, k.q_s)[2]
            rate = stewart.second_derivative_along(k, a.h, m_q, leg.m_s * k.dq_s, leg.m_s * k.ddq_s)
            mass = leg.m_n + leg.m_s + (leg.m_o if with_base else 0.0)
            got.append(stewart.sub(stewart.sub(rate, stewart.mul(mass, P.g)), F_r))
        return miss(stacked(got), case.truth["F_o"], case.force)

    return residual


# --- Controls ---------------------------------------------------------------------------------------------------------


def _flipped_load(name: str, term: str, form: str) -> Measure:
    """M_in or M_io by one of the forms with the sign of one term changed."""

    def residual(case: Case) -> float:
        P, got = spatial(case), []
        for a in legs(case):
            G = P.g[1] * stewart.inertia(a.leg, a.k.q_s)[2] * a.k.s
            value = loads_by(form, a, P.g)[name]
            got.append(value - 2.0 * {"G": G, "J_oz": a.leg.J_oz * a.h.ddq_o}[term])
        return miss(stacked(got), wanted_loads(case)[name], case.moment)

    return residual


def _flipped_G_of_28(case: Case) -> float:
    g, got = spatial(case).g, []
    for a in legs(case):
        M_n = stewart.joint_moments_printed(a.leg, a.k, a.h, a.loads, g).M_n
        G = g[1] * stewart.inertia(a.leg, a.k.q_s)[2] * a.k.s
        got.append(stewart.sub(M_n, stewart.mul(2.0 * G, a.k.z_n)))
    return miss(stacked(got), case.truth["M_n"], case.moment)


def _flipped_M_io(case: Case) -> float:
    """(7), (8) with the sign of M_io changed: forces and moments of the legs' z_n loads counted the other way."""
    shift = np.zeros((len(case.r), 2, 3))
    for i, a in enumerate(legs(case)):
        f = stacked([stewart.mul(2.0 * a.loads.M_io_s / a.k.L, a.k.z_n)])[:, 0]
        shift += np.stack([f, np.cross(case.r[:, i], f)], axis=1)
    d = missing(case, "platform_equations_printed").reshape(-1, 2, 3) + shift
    return largest((miss(d[:, :1], 0.0, case.force), miss(d[:, 1:], 0.0, case.moment)))


def _platform(case: Case) -> float:
    form = "platform_equations_printed"
    return largest((of_forces(form)(case), of_moments(form)(case)))


# --- The rows ---------------------------------------------------------------------------------------------------------

MISPRINTS = [
    misprint("f_o, display", "(1)", "share of the base's hinge in F_s, proof of statement 1", "rod_load_printed",
             ANY_GRAVITY, (_f_o(True), _f_o(False)),
             prints="z_o . (L x F_i)", correct="z_o . (L x F_is), the vector of (6), as in the line before"),
    misprint("M_io, z_i for s_i", "(4)", "momentum of a leg, proof of statement 1", "leg_loads_printed", ANY_GRAVITY,
             (of_loads("M_io", "leg_loads_printed"), _M_io_with_z),
             prints="J_q z_i q_o' x_n, z_i being D - z_p", correct="J_q s_i q_o' x_n", scan=True),
    misprint("J_3^z = J_s^x", "(5)", "list of renamings, proof of statement 1", "inertia", ANY_GRAVITY,
             (_spin(lambda leg: stewart.inertia(leg, 0.0)[1]), _spin(lambda leg: leg.J_ny + leg.J_sx)),
             tolerance=GEOMETRY, prints="J_3^z = J_s^x, so that J_y = J_n^y + J_s^x",
             correct="J_3^z = J_s^z", scan=True),
    misprint("(7), dots", "(7)", "acceleration of the platform", "platform_equations_printed", ANY_GRAVITY,
             (of_forces("platform_equations_printed"), of_forces("platform_equations_printed", _at_rest)),
             prints="m_p (O_r C_p - g)", correct="m_p ((O_r C_p)'' - g)", scan=True),
    misprint("(16), dots", "(16)", "acceleration of the platform", "platform_equations", ANY_GRAVITY,
             (of_forces("platform_equations"), of_forces("platform_equations", _at_rest)),
             prints="m_p (O_r C_p - g)", correct="m_p ((O_r C_p)'' - g)", scan=True),
    misprint("C_p O_r x y_n, first chain", "(11)", "arms of the driving forces, proof of statement 2", "arms_printed",
             ANY_GRAVITY, (_arms(False), _arms(True)), tolerance=GEOMETRY,
             prints="x (s z_r - y^z y_r) + y (y^z y_r - y^x z_r) + z (y^x y_r - c y_r)",
             correct="x (c z_r - y^z y_r) + y (y^z x_r - y^x z_r) + z (y^x y_r - c x_r), the second chain", scan=True),
    misprint("cosines of y_p", "(8)", "principal axes of the platform, under (8)", "platform_momentum_rate_principal",
             ANY_GRAVITY, (_principal(1), _principal(2)),
             prints="y_p^x, y_p^y, y_p^z belong to the axis C_p z_p", correct="to the axis C_p y_p"),
    misprint("F_o, proof of (26)", "(26)", "weight of a whole leg", "joint_forces_printed", VERTICAL,
             (_F_o(True), _F_o(False)),
             prints="F_o = (m_n + m_s) g y + ...", correct="F_o = (m_o + m_n + m_s) g y + ..."),
]  # fmt: skip

CONTROLS = [
    control("-J_o^z in (4)", "(4)", "sign of the base's inertia", "leg_loads_printed", ANY_GRAVITY,
            (of_loads("M_io", "leg_loads_printed"), _flipped_load("M_io", "J_oz", "leg_loads_printed")),
            prints="- J_o^z q_o''", correct="+ J_o^z q_o''"),
    control("-M_io in (7), (8)", "(7), (8)", "sign of the base's load", "platform_equations_printed", ANY_GRAVITY,
            (_platform, _flipped_M_io), prints="+ M_io", correct="- M_io"),
    control("-G in (21)", "(21)", "sign of the leg's weight", "leg_loads_scalar", VERTICAL,
            (of_loads("M_in", "leg_loads_scalar"), _flipped_load("M_in", "G", "leg_loads_scalar")),
            prints="G = + g m_q s", correct="G = - g m_q s"),
    control("-G in (28)", "(28)", "sign of the leg's weight", "joint_moments_printed", VERTICAL,
            (of_reactions("M_n"), _flipped_G_of_28), prints="- G z_n", correct="+ G z_n"),
]  # fmt: skip
