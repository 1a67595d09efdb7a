"""The planar examples, (32)-(36), as rows of the audit, with their misprints and the inconsistency of example 3."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import stewart
from .audit import Case, Measure, equation, largest, misprint, miss, per_leg, planar, planar_legs, stacked
from .audit_equations import EXACT, wanted_loads

BAR, POINT = ("planar3",), ("pointmass2", "collinear", "collinear_sagging")


# --- Planar mechanisms: (32)-(36) -------------------------------------------------------------------------------------


def planar_missing(case: Case, form: str = "planar_platform_equations_printed", motion: Any = None) -> np.ndarray:
    """Left less right sides (nt, 2 or 3) of (32), (35) over their scales, with certified driving forces.

    ``motion``: another one for the platform's own terms.
    """
    P, found = planar(case), planar_legs(case)
    loads = [stewart.planar_loads_printed(P.leg, k, P.g) for k in found]
    rows, right = getattr(stewart, form)(P, motion or case.components, found, loads)
    F = per_leg(case.truth["F"])
    return np.array(
        [
            (sum(c * x for c, x in zip(row, F, strict=True)) - b) / (case.moment if j == 2 else case.force)
            for j, (row, b) in enumerate(zip(rows, right, strict=True))
        ]
    ).T


def _planar_platform(case: Case) -> float:
    forms = ("planar_platform_equations_printed", "planar_platform_equations")
    return largest(np.abs(planar_missing(case, form)).max() for form in forms)


def _planar_loads(case: Case) -> float:
    P, want = planar(case), wanted_loads(case)
    found = []
    for form in (stewart.planar_loads_printed, stewart.planar_loads):
        F_is, M_in = zip(*(form(P.leg, k, P.g) for k in planar_legs(case)), strict=True)
        found += [
            miss(stacked(F_is), want["F_is"], case.force),
            miss(stacked(M_in), want["M_in"], case.moment),
        ]
    return largest(found)


def _certified_legs(case: Case) -> list[stewart.PlanarLegState]:
    return [k._replace(L=L) for k, L in zip(planar_legs(case), per_leg(case.truth["L"]), strict=True)]


def _loops_1(case: Case) -> float:
    P = planar(case)
    gaps = stewart.loops_of_example_1(_certified_legs(case), case.components, P.p[2][0], P.O[1][0])
    return float(np.abs(gaps).max())


def _loops_2(case: Case) -> float:
    return float(np.abs(stewart.loops_of_example_2(_certified_legs(case), case.components, planar(case).O[1][0])).max())


# --- Misprints and example 3 ------------------------------------------------------------------------------------------


def _row(axis: int, position: bool) -> Measure:
    """Miss of the first or second equation of (32), with p'' or, as printed, with p in its place."""

    def residual(case: Case) -> float:
        motion = case.components
        platform = motion._replace(ddC_p=motion.C_p) if position else motion
        return float(np.abs(planar_missing(case, motion=platform)[:, axis]).max())

    return residual


def _first_equation(x_r_x_n: float) -> Measure:
    """The x_r component of (7) with x_r . x_n = c, or with the sign that the text gives it."""

    def residual(case: Case) -> float:
        P, F = planar(case), per_leg(case.truth["F"])
        total = P.m_p * case.components.ddC_p[0]
        for k, F_i in zip(planar_legs(case), F, strict=True):
            F_is, M_in = stewart.planar_loads_printed(P.leg, k, P.g)
            total = total + (F_i - F_is) * k.s - M_in * x_r_x_n * k.c / k.L
        return float(np.abs(total).max()) / case.force

    return residual


def _sag(case: Case) -> float:
    """The y_p'' that the reference accepts, the second equation of (35) with it, and F_1 - F_2."""
    P, a, F = planar(case), case.components.ddC_p, case.truth["F"]
    return largest(
        (
            np.abs(stewart.sag_of_example_3(P, planar_legs(case)) / a[1] - 1.0).max(),
            np.abs(planar_missing(case)[:, 1]).max(),
            np.abs(F[:, 0] - F[:, 1] - stewart.difference_of_example_3(P, a[0])).max() / case.force,
        )
    )


def _no_sag(case: Case) -> float:
    """The second equation of (35) when the pin stays on x_r, y_p'' = 0: it holds no driving force."""
    x, y, z = case.components.ddC_p
    straight = case._replace(motion=case.motion._replace(ddC_p=np.stack([x, 0.0 * y, z], axis=1)))
    return float(np.abs(planar_missing(straight)[:, 1]).max())


# --- The rows ---------------------------------------------------------------------------------------------------------

PLANAR = [
    equation("(32)", "driving forces of the bar on three legs",
             "planar_platform_equations_printed planar_platform_equations", BAR, _planar_platform),
    equation("(33)", "loads of a planar leg, gravity along -y_r", "planar_loads_printed planar_loads", (*BAR, *POINT),
             _planar_loads, refuses=("planar3_inclined",)),
    equation("(34)", "loops of the bar on three legs", "loops_of_example_1", BAR, _loops_1, **EXACT),
    equation("(35)", "driving forces of the point mass on two legs",
             "planar_platform_equations_printed planar_platform_equations", POINT, _planar_platform),
    equation("(36)", "loops of the point mass on two legs", "loops_of_example_2", POINT, _loops_2, **EXACT),
]  # fmt: skip

PLANAR_MISPRINTS = [
    misprint("example 1, x_r . x_n", "(32)", "direction of a guide in the first equation",
             "planar_platform_equations_printed", BAR, (_first_equation(1.0), _first_equation(-1.0)),
             prints="x_r . x_n = -c", correct="x_r . x_n = c, by (9); (32) itself is right"),
    misprint("example 1, dots, x_r", "(32)", "acceleration of the bar, first equation before (32)",
             "planar_platform_equations_printed", BAR, (_row(0, False), _row(0, True)),
             prints="m_p x_r . (O_r C_p - g)", correct="m_p x_r . ((O_r C_p)'' - g)", scan=True),
    misprint("example 1, dots, y_r", "(32)", "acceleration of the bar, second equation before (32)",
             "planar_platform_equations_printed", BAR, (_row(1, False), _row(1, True)),
             prints="m_p y_r . (O_r C_p - g)", correct="m_p y_r . ((O_r C_p)'' - g)", scan=True),
    misprint("example 3, y_p'' = 0", "(35)", "two legs in line under gravity; F_1 - F_2 holds either way",
             "sag_of_example_3 difference_of_example_3", ("collinear_sagging",), (_sag, _no_sag),
             prints="the pin stays on x_r: no forces give that motion, the second equation of (35) misses",
             correct="the pin sags with y_p'' = g_y (m_p + sum m_q/L) / (m_p + sum J_q/L^2), or gravity is absent"),
]  # fmt: skip
