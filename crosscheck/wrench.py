"""The only code that shifts, rotates, reorders or negates wrenches.

A wrench here is (..., 6): moment [N m], then force [N], on the child from its parent, world axes, about the joint's
point. What each engine gives is said at each function.
"""

from __future__ import annotations

import numpy as np


def from_mujoco(cfrc_int: np.ndarray, center: np.ndarray, point: np.ndarray) -> np.ndarray:
    """MuJoCo's ``cfrc_int`` (..., 6): torque, force on the body from its parent, world axes, about ``center``."""
    return shifted(cfrc_int, center, point)


def from_pinocchio(force: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Pinocchio's ``data.f`` (..., 6): force, moment on the body from its parent, joint axes, about its origin."""
    return _rotate(R, np.concatenate([force[..., 3:], force[..., :3]], axis=-1))


def from_dart(wrench: np.ndarray, R: np.ndarray) -> np.ndarray:
    """DART's ``getBodyForce`` (..., 6): moment, force on the body from its parent, body axes, about its origin."""
    return _rotate(R, wrench)


def from_parts(moment: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Moment and force (..., 3) in world axes about the joint's point."""
    return np.concatenate([moment, force], axis=-1)


def of_loop(multiplier: np.ndarray) -> np.ndarray:
    """Multipliers (..., 3) of rows (point of the child) - (point of the parent), world axes: force on the child."""
    return np.concatenate([np.zeros_like(multiplier), multiplier], axis=-1)


def rows_of_point(columns: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Rows (3, n, nt) of points (3, n, nt) from Pinocchio's columns (6, n, nt): linear at the origin, angular.

    The transpose shifts a force at the point to the origin.
    """
    (x, y, z), (X, Y, Z) = columns[3:], point
    return columns[:3] + np.stack([y * Z - z * Y, z * X - x * Z, x * Y - y * X])


def less_force(wrench: np.ndarray, force: np.ndarray, lever: np.ndarray) -> np.ndarray:
    """Wrench (..., 6) less a force (..., 3) that acts at a lever from the point, world axes."""
    return wrench - from_parts(moment(lever, force), force)


def on_hull(on_children: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Total wrench (nt, 6) on the hull, about the mean of its pins, from those on the bodies that hang on it.

    ``on_children`` (nt, N, 6) about ``points`` (N, 3), the hull pins [m].
    """
    return -shifted(on_children, points, points.mean(axis=0)).sum(axis=1)


def to_pinocchio(
    force_W: np.ndarray, moment_W: np.ndarray, point: np.ndarray, R: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Force at a point (joint axes) and moment as Pinocchio's outside force: joint axes, about its origin."""
    at_point = _rotate(R.T, from_parts(moment_W, force_W))
    at_origin = shifted(at_point, point, np.zeros(3))
    return at_origin[3:], at_origin[:3]


def shifted(wrench: np.ndarray, point: np.ndarray, new_point: np.ndarray) -> np.ndarray:
    """The same wrench, its moment taken about another point (..., 3)."""
    force = wrench[..., 3:]
    return from_parts(wrench[..., :3] + moment(point - new_point, force), force)


def moment(lever: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Vector product (..., 3) by components: many times faster than `numpy.cross` on short vectors."""
    (x, y, z), (X, Y, Z) = ((a[..., 0], a[..., 1], a[..., 2]) for a in (lever, force))
    return np.stack([y * Z - z * Y, z * X - x * Z, x * Y - y * X], axis=-1)


def _rotate(R: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Both halves of a wrench from body to world axes; R = R_WB (..., 3, 3)."""
    halves = wrench.reshape(*wrench.shape[:-1], 2, 3)
    turned = sum(R[..., None, :, j] * halves[..., j, None] for j in range(3))  # einsum is slow on short axes
    return np.reshape(turned, wrench.shape)
