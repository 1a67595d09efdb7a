"""The numbered equations (1)-(31) as rows of the audit: adding one is adding an entry to `EQUATIONS`.

What a formula gives is measured against certified forces and moments, or against the pose.  Never against another
formula of the text: the joint rates that the formulas need are the only thing that comes from them, and a mistake
there shows as a miss of the forces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from . import stewart
from .audit import (
    GEOMETRY,
    Case,
    LegAt,
    Measure,
    equation,
    largest,
    legs,
    miss,
    per_leg,
    spatial,
    stacked,
)

ANY_GRAVITY = ("hexapod", "hexapod_inclined")
VERTICAL = ("hexapod",)


# --- Legs: (1)-(6), (9)-(11), (18), (19), (20)-(31) -------------------------------------------------------------------


def wanted_loads(case: Case) -> dict[str, np.ndarray]:
    """F_is, M_in, M_io (nt, N) that the certified F_r and F call for, by components along the guide's axes."""
    F_r, L = case.truth["F_r"], case.truth["L"]
    s = case.axes[:, :, 0, 1]  # x_n . y_r
    return {
        "F_is": case.along(1, F_r) + case.truth["F"],
        "M_in": -L * case.along(0, F_r),
        "M_io": s * L * case.along(2, F_r),
    }


def loads_by(form: str, a: LegAt, g: Any) -> dict[str, Any]:
    """F_is, M_in, M_io of a leg by one of the forms of `stewart`."""
    more = (a.k,) if form == "leg_loads" else (a.k, a.h)
    F_is, M_in, M_io_s = getattr(stewart, form)(a.leg, *more, g)
    return {"F_is": F_is, "M_in": M_in, "M_io": M_io_s * a.k.s}


def of_loads(name: str, *forms: str) -> Measure:
    """Miss of a load by each of the forms, the largest."""

    def residual(case: Case) -> float:
        want, scale = wanted_loads(case)[name], case.force if name == "F_is" else case.moment
        g = spatial(case).g
        return largest(miss(stacked([loads_by(f, a, g)[name] for a in legs(case)]), want, scale) for f in forms)

    return residual


def of_legs(value: Callable[[Case, LegAt], Any], want: Callable[[Case], Any], scale: str) -> Measure:
    """Miss of something that each leg has; ``scale``: force, moment, or m for lengths and cosines."""

    def residual(case: Case) -> float:
        unit = 1.0 if scale == "m" else getattr(case, scale)
        return miss(stacked([value(case, a) for a in legs(case)]), want(case), unit)

    return residual


def of_reactions(name: str) -> Measure:
    """Miss of a joint force or moment by the printed form and by the one in use, the larger."""

    def residual(case: Case) -> float:
        g, forces = spatial(case).g, name.startswith("F")
        printed, used = [], []
        for a, F in zip(legs(case), per_leg(case.truth["F"]), strict=True):
            loads = stewart.leg_loads(a.leg, a.k, g)
            if forces:
                printed.append(stewart.joint_forces_printed(a.leg, a.k, a.h, a.loads, F, g))
                used.append(stewart.joint_forces(a.leg, a.k, loads, F - loads.F_is, g))
            else:
                printed.append(stewart.joint_moments_printed(a.leg, a.k, a.h, a.loads, g))
                used.append(stewart.joint_moments(a.leg, a.k, loads))
        scale = case.force if forces else case.moment
        return largest(miss(stacked([getattr(v, name) for v in x]), case.truth[name], scale) for x in (printed, used))

    return residual


def _inertia(case: Case) -> float:
    q_s = case.truth["L"] - spatial(case).leg.a
    got = stacked([stewart.inertia(spatial(case).leg, q) for q in per_leg(q_s)])
    return largest(miss(got[..., j], case.inertia[..., j], float(case.inertia[..., j].max())) for j in range(3))


def _cosines(case: Case) -> float:
    got = [stewart.cosines_printed(a.k) for a in legs(case)]
    return largest(miss(stacked([v[j] for v in got]), case.axes[:, :, j], 1.0) for j in range(2))


def _axes(case: Case) -> float:
    found = [(a.k.x_n, a.k.y_n, a.k.z_n) for a in legs(case)]
    return largest(miss(stacked([v[j] for v in found]), case.axes[:, :, j], 1.0) for j in range(3))


def _lever(case: Case, a: LegAt) -> Any:
    return stewart.lever_printed(a.k, a.O, case.components.C_p)


def _loops(case: Case) -> float:
    """(31) with certified lengths, and the rate of the length along each leg."""
    found = legs(case)
    certified = [a.k._replace(L=L) for a, L in zip(found, per_leg(case.truth["L"]), strict=True)]
    C_p = case.components.C_p
    position = stacked([stewart.loop_printed(k, a.O, C_p) for a, k in zip(found, certified, strict=True)])
    rate = stacked([a.k.dq_s for a in found])
    return largest((miss(position, case.r, 1.0), miss(rate, case.truth["dL"], 1.0)))


# --- Platform: (7), (8), (12)-(17) ------------------------------------------------------------------------------------


def missing(case: Case, form: str, motion: Any = None) -> np.ndarray:
    """Left less right sides (nt, 6) of (7), (8) with certified driving forces, by another motion if one is given."""
    found = legs(case)
    P, loads = spatial(case), [a.loads for a in found]
    rows, right = getattr(stewart, form)(P, motion or case.components, [a.k for a in found], loads)
    X = [F - load.F_is for F, load in zip(per_leg(case.truth["F"]), loads, strict=True)]
    return np.array([sum(c * x for c, x in zip(row, X, strict=True)) - b for row, b in zip(rows, right, strict=True)]).T


def of_forces(form: str, motion: Callable[[Case], Any] = lambda case: None) -> Measure:
    """Miss of the three equations of forces."""
    return lambda case: miss(missing(case, form, motion(case))[:, None, :3], 0.0, case.force)


def of_moments(form: str) -> Measure:
    """Miss of the three equations of moments."""
    return lambda case: miss(missing(case, form)[:, None, 3:], 0.0, case.moment)


def of_M(axis: int) -> Measure:
    """Miss of M_x, M_y or M_z: moment about C_p of what the platform takes from the legs square to them."""

    def residual(case: Case) -> float:
        F_r = case.truth["F_r"]
        square = case.along(1, F_r)[..., None] * case.axes[:, :, 1] - F_r
        want = np.cross(case.r, square).sum(axis=1)[:, axis]
        C_p = case.components.C_p
        return miss(sum(stewart.moments_printed(a.k, a.O, C_p, a.loads)[axis] for a in legs(case)), want, case.moment)

    return residual


def _balance(case: Case) -> float:
    levers, F_r = per_leg(case.r), per_leg(case.truth["F_r"])
    force, moment = stewart.platform_balance_printed(spatial(case), case.components, levers, F_r)
    return largest((miss(stacked([force]), 0.0, case.force), miss(stacked([moment]), 0.0, case.moment)))


# --- The rows ---------------------------------------------------------------------------------------------------------

LOADS_23 = "leg_loads_printed leg_loads"
REACTIONS = "joint_forces_printed joint_forces"
MOMENTS = "joint_moments_printed joint_moments"
EXACT = {"tolerance": GEOMETRY}
INCLINED = {"refuses": ("hexapod_inclined",)}

EQUATIONS = [
    equation(
        "(1)", "reaction on a rod's tip along the guide's axes", "joint_reaction_r", ANY_GRAVITY,
        lambda case: miss(
            stacked([
                stewart.joint_reaction_r(a.k, a.loads, F - a.loads.F_is)
                for a, F in zip(legs(case), per_leg(case.truth["F"]), strict=True)
            ]),
            case.truth["F_r"],
            case.force,
        ),
    ),
    equation("(2)", "load of a rod along its axis", LOADS_23, ANY_GRAVITY,
             of_loads("F_is", "leg_loads_printed", "leg_loads")),
    equation("(3)", "load about the guide's hinge", LOADS_23, ANY_GRAVITY,
             of_loads("M_in", "leg_loads_printed", "leg_loads")),
    equation("(4)", "load about the base's hinge", LOADS_23, ANY_GRAVITY,
             of_loads("M_io", "leg_loads_printed", "leg_loads")),
    equation("(5)", "inertia and first moment of guide and rod about their common pin", "inertia", ANY_GRAVITY,
             _inertia, **EXACT),
    equation("(6)", "balance of a rod: tip reaction from its load and the guide's", "rod_balance_printed", ANY_GRAVITY,
             of_legs(lambda case, a: stewart.rod_balance_printed(
                 a.leg, a.k, a.h, per_leg(case.truth["F_s"])[a.i], spatial(case).g),
                 lambda case: case.truth["F_r"], "force")),
    equation("(7)", "driving forces: the platform's forces", "platform_equations_printed", ANY_GRAVITY,
             of_forces("platform_equations_printed")),
    equation("(8)", "driving forces: the platform's moments about C_p", "platform_equations_printed", ANY_GRAVITY,
             of_moments("platform_equations_printed")),
    equation("(9)", "direction cosines of x_n, y_n", "cosines_printed", ANY_GRAVITY, _cosines, **EXACT),
    equation("(10)", "hull pin seen from C_p", "hull_pin_printed", ANY_GRAVITY,
             of_legs(lambda case, a: stewart.hull_pin_printed(a.O, case.components.C_p),
                     lambda case: case.r - case.truth["L"][..., None] * case.axes[:, :, 1], "m"), **EXACT),
    equation("(11)", "arms of the driving forces about C_p", "arms_printed", ANY_GRAVITY,
             of_legs(lambda case, a: stewart.arms_printed(a.k, a.O, case.components.C_p),
                     lambda case: np.cross(case.r, case.axes[:, :, 1]), "m"), **EXACT),
    equation("(12)", "moment of the legs' loads about C_p, x_r", "moments_printed", ANY_GRAVITY, of_M(0)),
    equation("(13)", "moment of the legs' loads about C_p, y_r", "moments_printed", ANY_GRAVITY, of_M(1)),
    equation("(14)", "moment of the legs' loads about C_p, z_r", "moments_printed", ANY_GRAVITY, of_M(2)),
    equation("(15)", "motion of the platform under the reactions", "platform_balance_printed", ANY_GRAVITY, _balance),
    equation("(16)", "(15), forces, with (1) put in", "platform_equations", ANY_GRAVITY,
             of_forces("platform_equations")),
    equation("(17)", "(15), moments, with (1) put in", "platform_equations", ANY_GRAVITY,
             of_moments("platform_equations")),
    equation("(18)", "guide axes in the world", "leg_kinematics", ANY_GRAVITY, _axes, **EXACT),
    equation("(19)", "lever of a platform pin by the loop through the leg", "lever_printed", ANY_GRAVITY,
             of_legs(_lever, lambda case: case.r, "m"), **EXACT),
    equation("(20)", "(2) in joint rates, gravity along -y_r", "leg_loads_scalar", VERTICAL,
             of_loads("F_is", "leg_loads_scalar"), **INCLINED),
    equation("(21)", "(3) in joint rates, gravity along -y_r", "leg_loads_scalar", VERTICAL,
             of_loads("M_in", "leg_loads_scalar"), **INCLINED),
    equation("(22)", "(4) in joint rates, gravity along -y_r", "leg_loads_scalar", VERTICAL,
             of_loads("M_io", "leg_loads_scalar"), **INCLINED),
    equation("(23)", "F_r, on the rod from the platform", REACTIONS, ANY_GRAVITY, of_reactions("F_r")),
    equation("(24)", "F_s, on the rod from the guide", REACTIONS, ANY_GRAVITY, of_reactions("F_s")),
    equation("(25)", "F_n, on the guide from the base", REACTIONS, ANY_GRAVITY, of_reactions("F_n")),
    equation("(26)", "F_o, on the base from the hull", REACTIONS, ANY_GRAVITY, of_reactions("F_o")),
    equation("(27)", "M_s about the rod's centre of mass", MOMENTS, ANY_GRAVITY, of_reactions("M_s")),
    equation("(28)", "M_n about O_n", MOMENTS, ANY_GRAVITY, of_reactions("M_n")),
    equation("(29)", "M_o about O_o", MOMENTS, ANY_GRAVITY, of_reactions("M_o")),
    equation("(30)", "y_n x F_r by the loads", "y_x_F_r_printed", ANY_GRAVITY,
             of_legs(lambda case, a: stewart.y_x_F_r_printed(a.k, a.loads),
                     lambda case: np.cross(case.axes[:, :, 1], case.truth["F_r"]), "force")),
    equation("(31)", "loops through the legs, by components, and the rate of a leg's length",
             "loop_printed leg_kinematics", ANY_GRAVITY, _loops, **EXACT),
]  # fmt: skip
