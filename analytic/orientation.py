"""Orientations as unit quaternions, scalar first, and as the angles of a scene file, R = Rx Ry Rz (cardan_xyz)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, TypeAlias

import numpy as np

from .stewart import Scalar, Vector

LEAST_COS_BETA = 1e-8
"""Smallest |cos beta| that leaves half of the digits in the two other angles."""

Quaternion: TypeAlias = Iterable[Scalar]


class GimbalLock(ArithmeticError):
    """cos beta = 0: alpha and gamma turn about the same axis, and only their sum or difference is determined."""


def rotation(quaternion: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Rows of R_WP of a quaternion of any length but zero; components are numbers or arrays of samples."""
    w, x, y, z = quaternion
    n = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)),
        (n * (x * y + w * z), 1.0 - n * (x * x + z * z), n * (y * z - w * x)),
        (n * (x * z - w * y), n * (y * z + w * x), 1.0 - n * (x * x + y * y)),
    )


def quaternion_rate(quaternion: Quaternion, w_p: Vector) -> tuple[Scalar, ...]:
    """Rate q' = (0, w_p) q / 2 of a quaternion, w_p in world axes."""
    w, x, y, z = quaternion
    a, b, c = w_p
    return (
        -0.5 * (a * x + b * y + c * z),
        0.5 * (a * w + b * z - c * y),
        0.5 * (b * w + c * x - a * z),
        0.5 * (c * w + a * y - b * x),
    )


def turned(quaternion: Quaternion, turn: Iterable[float]) -> list[float]:
    """The unit quaternion of ``quaternion``, turned by a rotation vector in world axes [rad]."""
    x, y, z = turn
    angle = math.hypot(x, y, z)
    f = math.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
    product = quaternion_rate(quaternion, (2.0 * f * x, 2.0 * f * y, 2.0 * f * z))
    q = [math.cos(0.5 * angle) * a + d for a, d in zip(quaternion, product, strict=True)]
    length = math.hypot(*q)
    return [a / length for a in q]


def quaternion_from_cardan(angles: Any) -> np.ndarray:
    """Unit quaternions (..., 4) of angles alpha, beta, gamma (..., 3) [rad], R = Rx(alpha) Ry(beta) Rz(gamma)."""
    half = 0.5 * np.asarray(angles, dtype=float)
    (a, b, g), (A, B, G) = np.moveaxis(np.cos(half), -1, 0), np.moveaxis(np.sin(half), -1, 0)
    return np.stack(
        [a * b * g - A * B * G, A * b * g + a * B * G, a * B * g - A * b * G, a * b * G + A * B * g], axis=-1
    )


def cardan_from_quaternion(quaternion: Any) -> np.ndarray:
    """Angles alpha, beta, gamma (..., 3) [rad] of quaternions (..., 4), |beta| < pi/2.

    Raises
    ------
    GimbalLock
        |cos beta| below 1e-8.
    """
    R = rotation(np.moveaxis(np.asarray(quaternion, dtype=float), -1, 0))
    cos_beta = np.hypot(R[0][0], R[0][1])
    if not np.all(cos_beta >= LEAST_COS_BETA):
        raise GimbalLock(
            f"|cos beta| = {np.min(cos_beta):.3g}, expected at least {LEAST_COS_BETA:g}: at beta = +-90 deg the angles"
            " alpha and gamma are not determined; use the quaternion"
        )
    return np.stack(
        [np.arctan2(-R[1][2], R[2][2]), np.arctan2(R[0][2], cos_beta), np.arctan2(-R[0][1], R[0][0])], axis=-1
    )
