"""Inverse dynamics as a list of numbers of any kind, which every back end fills its arrays with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from . import stewart
from .solve import LIMIT, Ordered, eliminate, longest_lever
from .stewart import Parameters, PlanarParameters, PlatformMotion, Scalar, Solve, Sqrt

Mechanism = Parameters | PlanarParameters

VECTORS = ("F_r", "F_s", "F_n", "F_o", "M_s", "M_n", "M_o")

REGULAR = 100.0 / LIMIT
"""Least regularity that needs no closer look.

A matrix A of n rows has a condition of at most 2/|det A| (|A|_F / sqrt n)^n (Guggenheimer, Edelman, Johnson 1995).
With moments over a power of two within sqrt 2 of the longest lever |A|_F^2 is at most 3 n, so that with moments over
the lever itself the condition is at most 2 sqrt 2 3^3/|det A|, below `LIMIT` here; and |det A| is at most 3^3, so that
the least of the sines, which are factors of the regularity too, is above 1/`LIMIT`.
"""


class Slot(NamedTuple):
    """Where a number belongs: array of `InverseDynamics`, leg from 0, component, or None in an array of scalars."""

    name: str
    leg: int
    component: int | None = None


def slots(P: Mechanism, every: bool) -> list[Slot]:
    """What `numbers` gives, in its order: driving forces, or all; what always vanishes in a plane is left out."""
    legs = range(len(P.p))
    found = [Slot("F", i) for i in legs]
    if not every:
        return found
    planar = isinstance(P, PlanarParameters)
    for name in VECTORS:
        axes = (range(2) if name[0] == "F" else (2,) if name == "M_s" else ()) if planar else range(3)
        found += [Slot(name, i, axis) for i in legs for axis in axes]
    return [*found, *(Slot(name, i) for name in ("L", "dL") for i in legs)]


def rows(slots: Sequence[Slot], N: int) -> list[int]:
    """Row of each slot in `InverseDynamics.numbers`."""
    scalars = {"F": 0, "L": N * (1 + 3 * len(VECTORS)), "dL": N * (2 + 3 * len(VECTORS))}
    return [
        scalars[name] + leg if component is None else N + 3 * (VECTORS.index(name) * N + leg) + component
        for name, leg, component in slots
    ]


def lever_unit(P: Mechanism) -> float:
    """The power of two nearest to the longest lever [m]: dividing moments by it rounds nothing."""
    return 2.0 ** round(math.log2(longest_lever(P.p)))


def numbers(
    P: Mechanism, motion: PlatformMotion, sqrt: Sqrt, solve: Solve, every: bool
) -> tuple[list[Scalar], Sequence[Any]]:
    """Numbers of `slots` in their order, and the legs' states.

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
    vectors = [v for parts in (space.forces, space.moments) for by_name in zip(*parts, strict=True) for v in by_name]
    return _flat(space.F, vectors, [], space.legs), space.legs


def _flat(F: Sequence[Scalar], vectors: Sequence[Any], more: Sequence[Scalar], legs: Sequence[Any]) -> list[Scalar]:
    return [*F, *(x for v in vectors for x in v), *more, *(k.L for k in legs), *(k.dq_s for k in legs)]


def regular_numbers(
    P: Mechanism, motion: PlatformMotion, sqrt: Sqrt, ordered: Ordered, unit: float, every: bool
) -> tuple[list[Scalar], Scalar]:
    """As `numbers`, and a regularity: answers below `REGULAR` are not to be used.

    ``unit``: `lever_unit` of the machine, which moments are divided by.
    """
    determinants: list[Scalar] = []

    def solve(rows: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
        forces = 2 if isinstance(P, PlanarParameters) else 3
        scale = 1.0 / unit
        if scale != 1.0:
            rows = [*rows[:forces], *([scale * x for x in row] for row in rows[forces:])]
            right = [*right[:forces], *(scale * b for b in right[forces:])]
        X, determinant = eliminate(rows, right, ordered)
        determinants.append(determinant)
        return X

    out, legs = numbers(P, motion, sqrt, solve, every)
    regularity = abs(determinants[0])
    if isinstance(P, Parameters) and P.leg.spins:
        for k in legs:
            regularity = regularity * k.s
    return out, regularity
