"""Mistakes found in public hand-written codes of Stewart platforms, each planted at the same place of our text."""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from types import CodeType, ModuleType

from ..analytic import stewart
from . import quaternions
from .power_terms import code_of, swapped
from .power_work import Place, Planted, anew, right


@dataclass(frozen=True)
class Mistake:
    """A change of the text: in a function, each of some pieces by another one.

    ``code``: where such a mistake was found; ``states``: what is wrong; ``module``: of the function.
    """

    name: str
    code: str
    states: str
    function: str
    changes: tuple[tuple[str, str], ...]
    module: str = stewart.__name__

    @contextlib.contextmanager
    def planted(self, place: Place, engine: str, d: float) -> Iterator[Planted]:
        """The mistake, unless `d` is 0, and joint coordinates made with it."""
        with swapped(_MODULES[self.module], {self.function: _code(self)} if d else {}), right(place) as given:
            yield given._replace(trajectory=anew(place))


_MODULES: dict[str, ModuleType] = {m.__name__: m for m in (stewart, quaternions)}


@functools.cache
def _code(mistake: Mistake) -> CodeType:
    """Code of the changed function. Raises ValueError unless each piece of text is there, once."""
    module = _MODULES[mistake.module]
    text = inspect.getsource(getattr(module, mistake.function))
    for old, new in mistake.changes:
        if text.count(old) != 1:
            raise ValueError(f"{mistake.name}: {mistake.function}: got {text.count(old)} times {old!r}, expected 1")
        text = text.replace(old, new)
    (function,) = ast.parse(text).body
    assert isinstance(function, ast.FunctionDef)
    return code_of(module, function)


HOUCHANGMENG, KREX4715, STPLAT, ROBOOP = (
    "houchangmeng, example_inverse_dynamics.m",
    "krex4715, stewart_platform_Dynamics",
    "stplat class after Harib and Srinivasan",
    "ROBOOP, class Stewart",
)

_GYROSCOPIC = (("cross(w_P, apply(P.I_p, w_P))", "apply(P.I_p, cross(w_P, w_P))"),)

MISTAKES = (
    Mistake(
        "limb frame", HOUCHANGMENG, "a component of an axis of the leg's frame has the other sign",
        "leg_axes", (("(co * c, s, -so * c)", "(co * c, s, so * c)"),),
    ),
    Mistake(
        "moment sign", HOUCHANGMENG, "the y component of the legs' moments on the platform has the other sign",
        "platform_equations",
        (("*cross(k.r, k.y_n)))", "*(e * m for e, m in zip((1.0, -1.0, 1.0), cross(k.r, k.y_n)))))"),),
    ),
    Mistake(
        "centripetal twice", HOUCHANGMENG, "the centripetal acceleration of a platform pin is counted twice",
        "leg_kinematics", (("cross(w_p, cross(w_p, r)))", "mul(2.0, cross(w_p, cross(w_p, r))))"),),
    ),
    Mistake(
        "wrong frame", KREX4715, "an angular velocity is turned by the matrix of another frame",
        "platform_momentum_rate",
        (("w_P = apply_transposed(motion.R, motion.w_p)", "w_P = apply(motion.R, motion.w_p)"),),
    ),
    Mistake(
        "root of squares", KREX4715, "a moment of inertia is the root of the squares of two others",
        "driven",
        (
            (
                "[leg_loads(P.leg, k, P.g) for k in legs]",
                "[leg_loads(Leg(**vars(P.leg) | {'J_nx': sqrt(P.leg.J_nx * P.leg.J_nx + P.leg.J_ny * P.leg.J_ny)}),"
                " k, P.g) for k in legs]",
            ),
        ),
    ),
    Mistake(
        "times length", STPLAT, "the leg's angular velocity is multiplied by its length, where it is to be divided",
        "leg_kinematics",
        (("dq_n = -dot(V, x_n) / L", "dq_n = -dot(V, x_n) * L"), ("w = dot(V, z_n) / L", "w = dot(V, z_n) * L")),
    ),
    Mistake(
        "velocity for acceleration", STPLAT, "the leg's angular acceleration is taken from the velocity of its tip",
        "leg_kinematics", (("u=(dot(A, z_n) -", "u=(dot(V, z_n) -"), ("nu=-(dot(A, x_n) +", "nu=-(dot(V, x_n) +")),
    ),
    Mistake(
        "no gyroscopic moment", STPLAT, "the platform's gyroscopic moment is I (w x w), which is zero",
        "platform_momentum_rate", _GYROSCOPIC,
    ),
    Mistake(
        "inertia not symmetric", STPLAT, "an entry below the diagonal of the platform's inertia has the other sign",
        "platform_momentum_rate",
        (("apply(P.I_p, dw_P)", "apply((P.I_p[0], (-P.I_p[1][0], *P.I_p[1][1:]), P.I_p[2]), dw_P)"),),
    ),
    Mistake(
        "world position as arm", ROBOOP, "the velocity of a pin is w x its position in the world, not its arm",
        "leg_kinematics", (("V = add(dC_p, cross(w_p, r))", "V = add(dC_p, cross(w_p, add(C_p, r)))"),),
    ),
    Mistake(
        "no gyroscopic moment, platform", ROBOOP, "the platform's gyroscopic moment is I (w x w), which is zero",
        "platform_momentum_rate", _GYROSCOPIC,
    ),
    Mistake(
        "no gyroscopic moment, legs", ROBOOP, "the legs' gyroscopic moment is I (w x w), which is zero",
        "leg_loads",
        (("M_in + J_y * k.c * k.w * h.dq_o", "M_in"), ("M_io_s - J_y * k.c * k.dq_n * h.dq_o +", "M_io_s +")),
    ),
    Mistake(
        "rate of the axis", ROBOOP, "the rate of a leg's axis is divided by another length than the leg's",
        "leg_kinematics", (("w = dot(V, z_n) / L", "w = dot(V, z_n) / h"),),
    ),
    Mistake(
        "transposed for inverse", ROBOOP, "driving forces are J^T times the load, where J^-T is meant",
        "driven",
        (
            (
                "X = solve(*platform_equations(P, motion, legs, loads))",
                "rows, right = platform_equations(P, motion, legs, loads); solve(rows, right);"
                " X = [add(*((row[j] * b, 0.0, 0.0) for row, b in zip(rows, right)))[0] for j in range(6)]",
            ),
        ),
    ),
    Mistake(
        "rotation matrix", ROBOOP, "one entry of the platform's rotation matrix is wrong",
        "rotation", (("[n * (x * y + w * z), 1 - n", "[n * (x * y - w * z), 1 - n"),), quaternions.__name__,
    ),
)  # fmt: skip
"""Single mistakes, in the order of the four codes."""
