"""Named tolerances, each with its reason. All are relative to the scale of their quantity."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Tolerance(NamedTuple):
    """A bound on an error over its scale, its name in the tables, and why it has this value.

    ``rounding``: the largest error that was measured where nothing was wrong; what changes below it says nothing.
    """

    name: str
    value: float
    why: str
    rounding: float


ROUND_OFF = Tolerance(
    "round_off",
    1e-13,
    "float64 through one direct solve: every route was measured below 3e-15 at a condition of 8, so below 2e-14 at the"
    " 40 that is still called easy, with some room for other machines; a mass off by 1e-6 of itself lies at 1e-8",
    3e-15,
)
CLOSURE = Tolerance(
    "closure",
    1e-14,
    "positions, velocities and accelerations of two points of one model: rounding of some ten operations, measured"
    " below 2e-15",
    2e-15,
)
RADIUS = Tolerance(
    "proven_radius",
    1e-15,
    "the balls are narrower than 1e-20; what is left is the rounding to float64, 2e-16 for three components",
    2e-16,
)

FEASIBLE = 1e-13
"""Residual of an equation that holds no driving force, over the weights and inertial forces that enter it.

The motion is a rounded one.  Ten times what a trajectory may bring, so that nobody refuses what was let in; where the
forces of all bodies are compared it is not above `ROUND_OFF`.
"""

LAW_FACTOR = 3.0
"""What an engine's own solver may be off by, over the law of its error: the theory is of first order, and rounding in
it has one sign for all. On regular poses the ratio was measured at 1.00."""

LIMIT = 0.1
"""Share of the scale above which a bound says nothing, and a theory of first order with it."""

FOLLOWS = Tolerance(
    "follows",
    1e-11,
    "m and rad in the first second, then growing with time, and as a small error of this motion does: adaptive steps"
    " near round-off were measured at 4e-14 to 7e-13; steps of any size have the same rounding",
    7e-13,
)
ENERGY = Tolerance(
    "energy",
    1e-11,
    "of the energy exchanged: a hundred steps near round-off; it measures 3e-14 on the hexapod and 2e-13 in the plane",
    2e-13,
)
QUADRATURE = Tolerance(
    "quadrature",
    1e-9,
    "of the energy exchanged: the work of an engine is a quintic spline through the power at a hundred times a second,"
    " measured at 1e-10",
    1e-10,
)
ACCELERATIONS = Tolerance(
    "accelerations",
    1e-12,
    "of the largest tip acceleration: two solutions in a row, with M and with J M^-1 J^T, whose condition is a few"
    " hundred; measured below 2e-14",
    2e-14,
)

NEAR = 0.1
"""Of the longest leg, and rad: an error beyond it no longer falls with the step as its law says."""

EASY_CONDITION = 40.0
EASY_SIN_Q_N = 0.01
EASY_REACH = 10.0
EASY_SHARE = 10.0
EASY_AMPLIFICATION = 10.0
"""Of rounding by an engine's own solver; velocities over DART's step of 1e-6 s were off by up to 6e-9 of the scale near
singular poses, where this allows 1e-8. Reasons of the others stand with the functions below."""

TERMS = 20.0
"""Roundings that add up to the acceleration of a tip whose leg passes the vertical: MuJoCo was off by one."""


def times_easier(condition: np.ndarray | float) -> np.ndarray:
    """How much larger a condition is than an easy one, at least 1; one that is not known widens nothing."""
    return np.fmax(1.0, np.asarray(condition) / EASY_CONDITION)


def of_positions(reach: np.ndarray) -> np.ndarray:
    """How much wider tolerances are at each sample, at least 1, because positions are in world axes.

    Engines take a leg and a lever from the difference of two positions, which are rounded to 1e-16 of themselves:
    errors were measured at a fiftieth of the bound from 1e3 to 1e8 shortest lengths off the origin.
    """
    return np.fmax(1.0, reach / EASY_REACH)


def of_cancelling(burden: np.ndarray | float) -> np.ndarray:
    """How much wider `ROUND_OFF` is at each sample, at least 1, because weights and inertial forces cancel.

    ``burden``: their sum over the scale: what falls freely is held by small forces, and what is a millimetre large has
    accelerations far below gravity.
    """
    return np.fmax(1.0, burden / EASY_SHARE)


def of_forces(condition: np.ndarray, sin_q_n: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """How much wider `ROUND_OFF` is at each sample, at least 1.

    Forces react to rounding like the condition.  Where base or spin inertia loads a steep leg, the force
    grows as 1/s^3 and rounding of the pose alone changes it by 1e-16/s of itself: errors were measured at a twentieth
    of the bound from s = 1e-2 down to 1e-8.  Each multiplies what the others leave; a number that is not known widens
    nothing.
    """
    return times_easier(condition) * np.fmax(1.0, EASY_SIN_Q_N / sin_q_n) * of_positions(reach)


def of_accelerations(share: np.ndarray | float, sin_q_n: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """How much wider `ROUND_OFF` is at each sample for what forces accelerate the platform by.

    ``share``: what the largest force of the sample would give the platform alone, over the scale: its rounding is one
    of theirs, measured at 1e-16 of it from 1e1 to 1e12.  Steep legs add that of the pose, as for forces; the condition
    does not, it is in the forces already.
    """
    return np.fmax(1.0, share / EASY_SHARE) * np.fmax(1.0, EASY_SIN_Q_N / sin_q_n) * of_positions(reach)
