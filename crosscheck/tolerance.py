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
    "float64 through one direct solve: every route was measured below 3e-15 at a condition of 8, so below 2e-14 at the"
    " 40 that is still called easy, with some room for other machines; a mass off by 1e-6 of itself lies at 1e-8",
)
CLOSURE = Tolerance(
    "closure",
    1e-14,
    "positions, velocities and accelerations of two points of one model: rounding of some ten operations, measured"
    " below 2e-15",
)
RADIUS = Tolerance(
    "proven_radius",
    1e-15,
    "the balls are narrower than 1e-20; what is left is the rounding to float64, 2e-16 for three components",
)

LAW_FACTOR = 3.0
"""What an engine's own solver may be off by, over the law of its error: the theory is of first order, and rounding in
it has one sign for all. On regular poses the ratio was measured at 1.00."""

LAW_LIMIT = 0.1
"""Share of the scale above which a bound from a law says nothing, and the theory of first order with it."""

FOLLOWS = Tolerance(
    "follows",
    1e-11,
    "m and rad in the first second, then growing with time, and as a small error of this motion does: adaptive steps"
    " near round-off were measured at 4e-14 to 7e-13; steps of any size have the same rounding",
)
ENERGY = Tolerance(
    "energy",
    1e-11,
    "of the energy exchanged: a hundred steps near round-off; it measures 3e-14 on the hexapod and 2e-13 in the plane",
)
QUADRATURE = Tolerance(
    "quadrature",
    1e-9,
    "of the energy exchanged: the work of an engine is a quintic spline through the power at a hundred times a second,"
    " measured at 1e-10",
)
ACCELERATIONS = Tolerance(
    "accelerations",
    1e-12,
    "of the largest tip acceleration: two solutions in a row, with M and with J M^-1 J^T, whose condition is a few"
    " hundred; measured below 2e-14",
)

NEAR = 0.1
"""Of the longest leg, and rad: an error beyond it no longer falls with the step as its law says."""

EASY_CONDITION = 40.0
EASY_SIN_Q_N = 0.01
EASY_SIN_Q_N_OF_LOOPS = 0.1


def of_forces(condition: np.ndarray, sin_q_n: np.ndarray) -> np.ndarray:
    """How much wider `ROUND_OFF` is at each sample, at least 1.

    Forces react to rounding like the row-scaled condition.  Where base or spin inertia loads a steep leg, the force
    grows as 1/s^3 and rounding of the pose alone changes it by 1e-16/s of itself: errors were measured at a twentieth
    of the bound from s = 1e-2 down to 1e-8.  A number that is not known widens nothing.
    """
    return np.fmax(np.fmax(1.0, condition / EASY_CONDITION), EASY_SIN_Q_N / sin_q_n)


def of_accelerations(share: np.ndarray, sin_q_n: np.ndarray) -> np.ndarray:
    """How much wider `ROUND_OFF` is at each sample for what forces, over the platform's mass, accelerate it by.

    ``share``: the largest force of the sample over mass and scale of accelerations: its rounding is one of theirs.
    Steep legs add that of the pose, as for forces; the condition does not, it is in the forces already.
    """
    return np.fmax(1.0, share) * np.fmax(1.0, EASY_SIN_Q_N / sin_q_n)


def of_loops(sin_q_n: np.ndarray, derivative: int) -> np.ndarray:
    """How much wider `CLOSURE` is at each sample, at least 1, at position, velocity or acceleration level (0, 1, 2).

    The base of a moving steep leg turns with q_o' as 1/s and q_o'' as 1/s^2, and engines add such numbers up before
    they cancel at the tip: 2e-18/s^2 was measured for MuJoCo's accelerations, a fiftieth of the bound.
    """
    return np.fmax(1.0, EASY_SIN_Q_N_OF_LOOPS / sin_q_n) ** derivative
