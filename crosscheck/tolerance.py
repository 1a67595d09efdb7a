"""Named tolerances, each with its reason. All are relative to the scale of their quantity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Tolerance(NamedTuple):
    """A bound on an error over its scale, its name in the tables, and why it has this value."""

    name: str
    value: float
    why: str


ROUND_OFF = Tolerance(
    "round_off",
    1e-13,
    "float64 through one direct solve: every route stays below 1e-14 at a row-scaled condition below 40 and sin q_n"
    " above 0.2, and a relative change of 1e-6 in one mass, pin or inertia moves the forces by more than 1e-9",
)
CLOSURE = Tolerance(
    "closure",
    1e-13,
    "positions, velocities and accelerations of two points of one model: rounding of some ten operations, 1e-15",
)
RADIUS = Tolerance(
    "proven_radius",
    1e-15,
    "the balls are narrower than 1e-20; what is left is the rounding to float64, 2e-16 for three components",
)

EASY_CONDITION = 40.0
EASY_SIN_Q_N = 0.2


def _scaled(tolerance: Tolerance, factor: float) -> Tolerance:
    """The tolerance of a hard pose, under a name that says so. A NaN factor widens nothing."""
    if not factor > 1.0:
        return tolerance
    return tolerance._replace(name=f"{tolerance.name}_ill_conditioned", value=tolerance.value * factor)


def _steepness(sin_q_n: np.ndarray) -> float:
    return EASY_SIN_Q_N / float(np.min(sin_q_n))


def round_off(condition: np.ndarray, sin_q_n: np.ndarray) -> Tolerance:
    """`ROUND_OFF`, scaled by how hard the trajectory is.

    The forces react to half a unit in the last place of their inputs like the row-scaled condition, and like 1/s of
    a steep leg whose base or spin inertia is loaded: no float64 method can do better, so the bound grows with both.
    """
    return _scaled(ROUND_OFF, max(float(np.max(condition)) / EASY_CONDITION, _steepness(sin_q_n)))


def closure(sin_q_n: np.ndarray) -> Tolerance:
    """`CLOSURE`, scaled by 1/s: joint accelerations of a steep leg grow as 1/s^2 and reach the tip through s."""
    return _scaled(CLOSURE, _steepness(sin_q_n))
