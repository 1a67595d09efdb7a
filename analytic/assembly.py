"""Initial assembly, or forward kinematics: the pose in which a hexapod's legs have given lengths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .orientation import rotation, turned
from .solve import LIMIT, conditioned, longest_lever, row_units
from .stewart import Parameters, add, apply, cross, sub

MOST_ITERATIONS = 50
"""Newton doubles the digits with each step: 5 to 10 from a good guess, so 50 means that there is no pose near by."""

LARGEST_TURN = 0.5
"""Longest step in orientation, rad: beyond, the lengths are far from linear in the turn."""

ROUNDINGS = 8.0 * 2.0**-52
"""A length is met within this much of the machine's size: some ten roundings."""


class AssemblyError(RuntimeError):
    """No pose was found from the guess: names what stopped the search, and how far the lengths were."""


@dataclass(frozen=True)
class Assembly:
    """A pose: ``position`` (3,) m and unit ``quaternion`` (4,), scalar first, of the platform; Newton steps taken.

    ``residual``: largest difference of a leg's length from the wanted one [m].
    """

    position: np.ndarray
    quaternion: np.ndarray
    iterations: int
    residual: float


Numbers = Sequence[float] | np.ndarray


def _numbers(name: str, values: Numbers, count: int) -> list[float]:
    array = np.asarray(values, dtype=float)
    if array.shape != (count,) or not np.isfinite(array).all():
        raise AssemblyError(f"{name}: got {array.tolist()}, expected {count} finite numbers")
    return array.tolist()


def assemble(P: Parameters, L: Numbers, position: Numbers, quaternion: Numbers) -> Assembly:
    """The pose near a guess in which the legs have the lengths L, by Newton on (31).

    A hexapod has up to 40 poses with the same lengths: the guess chooses.

    Parameters
    ----------
    P : Parameters
        N = 6; only the pins are read.
    L : lengths O_o O_r of the six legs [m].
    position, quaternion : guess of C_p [m] and of the orientation, scalar first, of any length but zero.

    Raises
    ------
    AssemblyError
        N is not 6, a number is not finite, a length or the quaternion is not positive, a singular pose on the way, or
        no pose after 50 steps.
    """
    if len(P.p) != 6:
        raise AssemblyError(f"N = {len(P.p)} legs: six lengths determine a pose, so N must be 6")
    wanted = _numbers("L", L, 6)
    if not min(wanted) > 0.0:
        raise AssemblyError(f"L: got {wanted}, expected positive lengths")
    C = _numbers("position", position, 3)
    q = _numbers("quaternion", quaternion, 4)
    if not math.hypot(*q) > 0.0:
        raise AssemblyError("quaternion: got length 0, expected a guess of the orientation")
    q = turned(q, (0.0, 0.0, 0.0))
    reach = max(wanted)
    enough = ROUNDINGS * (reach + np.abs(C).max() + np.abs(np.array([P.O, P.p])).max())
    lever = longest_lever(P.p)
    residual = math.inf
    for iteration in range(MOST_ITERATIONS + 1):
        columns, error = [], []
        R = rotation(q)
        for p, O, L_i in zip(P.p, P.O, wanted, strict=True):
            r = apply(R, p)
            l = add(sub((C[0], C[1], C[2]), O), r)
            length = math.hypot(*l)
            if length == 0.0:
                raise AssemblyError(f"leg {len(error) + 1}: length 0 after {iteration} steps: choose another guess")
            y = (l[0] / length, l[1] / length, l[2] / length)
            columns.append((*y, *cross(r, y)))
            error.append(L_i - length)
        residual = max(abs(e) for e in error)
        if residual <= enough:
            return Assembly(np.array(C), np.array(q), iteration, residual)
        scaled, condition, leg = conditioned(np.array(columns).T[None], lever)
        if not condition[0] <= LIMIT:
            raise AssemblyError(
                f"singular pose after {iteration} steps: condition {condition[0]:.3g}, above {LIMIT:g},"
                f" leg {leg[0]} the weakest; lengths are off by up to {residual:.3g} m: choose another guess"
            )
        d = np.linalg.solve(scaled[0].T, np.array(error)) / row_units(6, lever)
        d *= min(1.0, LARGEST_TURN / max(math.hypot(*d[3:]), 1e-300), reach / max(math.hypot(*d[:3]), 1e-300))
        C = (np.array(C) + d[:3]).tolist()
        q = turned(q, d[3:].tolist())
    raise AssemblyError(
        f"not converged in {MOST_ITERATIONS} steps: lengths are off by up to {residual:.3g} m: no pose near the guess"
        " has these lengths"
    )
