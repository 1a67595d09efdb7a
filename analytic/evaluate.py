"""The problems of dynamics as lists of numbers of any kind: what every back end is given, and what it fills.

A problem is evaluated on numbers of one kind - floats, arrays, balls, traced ones - in the order of its inputs, and
answers with its results and a regularity.  Where that is below `REGULAR`, results are not to be used.
"""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from . import stewart
from .solve import LIMIT, Ordered, eliminate, eliminate_symmetric, longest_lever
from .stewart import ZERO, FirstProblem, Leg, Load, Parameters, PlanarParameters, PlatformMotion, Scalar, Solve, Sqrt

Mechanism = Parameters | PlanarParameters

VECTORS = ("F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o")

REGULAR = 1.0
"""Least regularity of numbers that need no closer look."""


def in_floats(P: Mechanism) -> Mechanism:
    """The machine in plain floats: numbers of another kind are equal to them and not as exact.

    Raises ValueError for what is no finite number, for lists and arrays, and for a machine without legs.
    """
    if not P.p:
        raise ValueError("P: got no legs, expected one or more platform pins p and hull pins O")
    try:
        return _in_floats(P, "P")
    except TypeError:
        raise ValueError("P: got lists or arrays in it, expected numbers and tuples of numbers") from None


def _in_floats(x: Any, name: str) -> Any:
    kind = type(x)
    if kind is float and math.isfinite(x):
        return x
    if kind is tuple:
        values = tuple([_in_floats(v, name) for v in x])
        return x if all(map(operator.is_, values, x)) else values
    if isinstance(x, (Parameters, PlanarParameters, Leg, Load)):
        changed = {}
        for key, value in vars(x).items():
            if (new := value if value is None else _in_floats(value, f"{name}.{key}")) is not value:
                changed[key] = new
        return replace(x, **changed) if changed else x
    if isinstance(x, numbers.Real) and math.isfinite(x):
        return float(x)
    if isinstance(x, (numbers.Number, str)):
        raise ValueError(f"{name}: got {x!r}, expected a finite number")
    raise TypeError


class Problem(NamedTuple):
    """What is asked of a machine.

    ``widths``: numbers in each of the inputs; ``rows``: where each result belongs among the rows of the answer;
    ``evaluate(P, inputs, sqrt, ordered)``: results and regularity.
    """

    name: str
    widths: Callable[[Mechanism], tuple[int, ...]]
    rows: Callable[[Mechanism], list[int]]
    evaluate: Callable[[Mechanism, Sequence[Scalar], Sqrt, Ordered], tuple[list[Scalar], Scalar]]


# --- The first problem ------------------------------------------------------------------------------------------------


def motion_of(x: Sequence[Scalar]) -> PlatformMotion:
    """C_p, R by rows, dC_p, w_p, ddC_p, dw_p from 24 numbers."""
    C_p, *R, dC_p, w_p, ddC_p, dw_p = ((x[k], x[k + 1], x[k + 2]) for k in range(0, 24, 3))
    return PlatformMotion(C_p, tuple(R), dC_p, w_p, ddC_p, dw_p)


def _widths_of_motion(P: Mechanism) -> tuple[int, ...]:
    return 3, 9, 3, 3, 3, 3


def _rows_of_forces(P: Mechanism) -> list[int]:
    return list(range(len(P.p)))


def _rows_of_all(P: Mechanism) -> list[int]:
    """Rows of `InverseDynamics.numbers`; what always vanishes in a plane is left out."""
    N = len(P.p)
    rows = _rows_of_forces(P)
    for k, name in enumerate(VECTORS):
        axes: Sequence[int] = range(3)
        if isinstance(P, PlanarParameters):
            axes = range(2) if name[0] == "F" else (2,) if name == "M_s" else ()
        rows += [N + 3 * (k * N + leg) + axis for leg in range(N) for axis in axes]
    return [*rows, *range(N * (1 + 3 * len(VECTORS)), N * (3 + 3 * len(VECTORS)))]


def answers(
    P: Mechanism, motion: PlatformMotion, sqrt: Sqrt, solve: Solve, every: bool
) -> tuple[list[Scalar], Sequence[Any]]:
    """Driving forces, or all that `InverseDynamics` holds, in the order of its rows; and the legs' states.

    Raises
    ------
    NotDeterminate
        The number of legs is not that of the platform's equations.
    """
    planar = isinstance(P, PlanarParameters)
    if not every:
        found = stewart.planar_driven(P, motion, sqrt, solve) if planar else stewart.driven(P, motion, sqrt, solve)
        return found.F, found.legs
    if planar:
        plane = stewart.planar_problem(P, motion, sqrt, solve)
        R = plane.reactions
        vectors = [getattr(r, name) for name in ("F_r", "F_s", "F_n", "F_n") for r in R]  # no base: F_o = F_n
        return _flat(plane.F, vectors, [r.M_s for r in R], plane.legs), plane.legs
    space = stewart.first_problem(P, motion, sqrt, solve)
    return flat(space), space.legs


def flat(found: FirstProblem) -> list[Scalar]:
    """Results in the order of the rows of `InverseDynamics.numbers`."""
    vectors = [v for parts in (found.forces, found.moments) for by_name in zip(*parts, strict=True) for v in by_name]
    return _flat(found.F, vectors, [], found.legs)


def _flat(F: Sequence[Scalar], vectors: Sequence[Any], more: Sequence[Scalar], legs: Sequence[Any]) -> list[Scalar]:
    return [*F, *(x for v in vectors for x in v), *more, *(k.L for k in legs), *(k.dq_s for k in legs)]


WELL_POSED = 100.0 / LIMIT
"""Least determinant of (7), (8), times the sines of legs that spin, that needs no closer look.

A matrix A of n rows has a condition of at most 2/|det A| (|A|_F / sqrt n)^n (Guggenheimer, Edelman, Johnson 1995).
With moments over a power of two within sqrt 2 of the longest lever |A|_F^2 is at most 3 n, so that with moments over
the lever itself the condition is at most 2 sqrt 2 3^3/|det A|, below `LIMIT` here; and |det A| is at most 3^3, so that
the least of the sines is above 1/`LIMIT` too.
"""


def lever_unit(P: Mechanism) -> float:
    """The power of two nearest to the longest lever [m]: dividing moments by it rounds nothing."""
    return 2.0 ** round(math.log2(longest_lever(P.p)))


def _first_problem(every: bool) -> Callable[..., tuple[list[Scalar], Scalar]]:
    def evaluate(P: Mechanism, x: Sequence[Scalar], sqrt: Sqrt, ordered: Ordered) -> tuple[list[Scalar], Scalar]:
        determinants: list[Scalar] = []
        scale = 1.0 / lever_unit(P)

        def solve(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
            forces = 2 if isinstance(P, PlanarParameters) else 3
            if scale != 1.0:
                rows = [*rows[:forces], *([scale * a for a in row] for row in rows[forces:])]
                right = [*right[:forces], *(scale * b for b in right[forces:])]
            X, determinant = eliminate(rows, right, ordered)
            determinants.append(determinant)
            return X

        out, legs = answers(P, motion_of(x), sqrt, solve, every)
        regularity = abs(determinants[0]) * (REGULAR / WELL_POSED)
        if isinstance(P, Parameters) and P.leg.spins:
            for k in legs:
                regularity = regularity * k.s
        return out, regularity

    return evaluate


DRIVING_FORCES = Problem("driving_forces", _widths_of_motion, _rows_of_forces, _first_problem(every=False))
INVERSE_DYNAMICS = Problem("inverse_dynamics", _widths_of_motion, _rows_of_all, _first_problem(every=True))


# --- The second problem -----------------------------------------------------------------------------------------------

MOST_SPREAD = 1e-3
"""Least determinant of the 6 x 6 of the second problem over the product of its diagonal.

Scaled to a diagonal of ones its eigenvalues have the mean 1 and the product of the determinant, so that the condition
is at most n e over it: 2e4, which leaves twelve digits.
"""

STEEP = 0.05
"""Least sin q_n of a leg that spins: the 6 x 6 loses as much as 1/s^2, the form with compliances 1/s."""


def _widths_of_state(P: Mechanism) -> tuple[int, ...]:
    return 3, 9, 3, 3, len(P.p)


def _rows_of_accelerations(P: Mechanism) -> list[int]:
    if isinstance(P, PlanarParameters):
        return [0, 1, 5][: P.equations]
    return list(range(6))


def _second_problem(P: Mechanism, x: Sequence[Scalar], sqrt: Sqrt, ordered: Ordered) -> tuple[list[Scalar], Scalar]:
    pose, F = motion_of([*x[:18], *ZERO, *ZERO]), x[18:]
    spread: list[Scalar] = []

    def solve(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
        a, share = eliminate_symmetric(rows, right)
        spread.append(share)
        return a

    if isinstance(P, PlanarParameters):
        one = stewart.planar_second_problem(P, pose, F, sqrt, solve, stewart.planar_reduced_equations)
    else:
        one = stewart.second_problem(P, pose, F, sqrt, solve, stewart.reduced_equations)
    regularity = spread[0] * (REGULAR / MOST_SPREAD)
    if isinstance(P, Parameters) and P.leg.spins:
        for k in one.legs:
            _, (regularity,) = ordered(0, [regularity], [k.s * (REGULAR / STEEP)])
    return list(one.unknowns), regularity


FORWARD_DYNAMICS = Problem("forward_dynamics", _widths_of_state, _rows_of_accelerations, _second_problem)
