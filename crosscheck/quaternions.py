"""Quaternion motions, arrays (nt, 4), scalar first, carried as 2-jets (q, q', q'').

omega = 2 vec(q' q*) and alpha = 2 vec(q'' q*), in world axes.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial.polynomial import polyval

Jet = tuple[np.ndarray, np.ndarray, np.ndarray]


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """Rotation matrices (nt, 3, 3) of quaternions (nt, 4), scalar first, of any length but zero."""
    w, x, y, z = quaternion.T
    n = 2.0 / (w * w + x * x + y * y + z * z)
    rows = [
        [1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)],
        [n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)],
        [n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def times(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Quaternion product, (nt, 4) each."""
    scalar = p[:, :1] * q[:, :1] - np.sum(p[:, 1:] * q[:, 1:], axis=1, keepdims=True)
    return np.hstack([scalar, p[:, :1] * q[:, 1:] + q[:, :1] * p[:, 1:] + np.cross(p[:, 1:], q[:, 1:])])


def product(p: Jet, q: Jet) -> Jet:
    """Product rule for two quaternion jets."""
    return (
        times(p[0], q[0]),
        times(p[1], q[0]) + times(p[0], q[1]),
        times(p[2], q[0]) + 2.0 * times(p[1], q[1]) + times(p[0], q[2]),
    )


def turn(axis: int, angle: Jet) -> Jet:
    """Jet of a rotation by an angle about a coordinate axis."""
    half, dhalf, ddhalf = (0.5 * x[:, None] for x in angle)
    one, n = np.zeros(4), np.zeros(4)
    one[0] = n[1 + axis] = 1.0
    q = np.cos(half) * one + np.sin(half) * n
    turned = np.cos(half) * n - np.sin(half) * one  # n q
    return q, dhalf * turned, ddhalf * turned - dhalf**2 * q


def exponential(x: Jet) -> Jet:
    """Jet of the rotation vector x (nt, 3): q = (cos |x|/2, sin(|x|/2)/|x| x), by its series near |x| = 0."""
    m = np.sum(x[0] ** 2, axis=1, keepdims=True)  # |x|^2
    dm = 2.0 * np.sum(x[0] * x[1], axis=1, keepdims=True)
    ddm = 2.0 * np.sum(x[1] ** 2 + x[0] * x[2], axis=1, keepdims=True)
    # C = cos(sqrt m / 2), S = sin(sqrt m / 2) / sqrt m and their derivatives in m: C' = -S/4, S' = (C/2 - S)/(2m).
    small = m < 1e-2
    safe = np.where(small, 1.0, m)
    C, S = np.cos(np.sqrt(m) / 2), np.sin(np.sqrt(safe) / 2) / np.sqrt(safe)
    dS = (C / 2 - S) / (2 * safe)
    ddS = (-S / 8 - 3 * dS) / (2 * safe)
    n = m / 4  # S = sum (-n)^k / (2 (2k+1)!)
    S, dS, ddS = (
        np.where(small, polyval(n, series) / (2 * 4**k), closed)
        for k, (series, closed) in enumerate(zip(SERIES, (S, dS, ddS), strict=True))
    )
    C1, C2 = -S / 4, -dS / 4
    q = np.hstack([C, S * x[0]])
    dq = np.hstack([C1 * dm, dS * dm * x[0] + S * x[1]])
    ddq = np.hstack(
        [
            C2 * dm**2 + C1 * ddm,
            (ddS * dm**2 + dS * ddm) * x[0] + 2.0 * dS * dm * x[1] + S * x[2],
        ]
    )
    return q, dq, ddq


def of_angles(kind: str, x: Jet) -> Jet:
    """Jet of `cardan_xyz` angles or of a `rotation_vector`, as in the scene file."""
    if kind == "rotation_vector":
        return exponential(x)
    turns = [turn(axis, (x[0][:, axis], x[1][:, axis], x[2][:, axis])) for axis in range(3)]
    return product(product(turns[0], turns[1]), turns[2])


def sinc_series(order: int) -> list[float]:
    """Coefficients in n of the order-th derivative of sum (-n)^k / (2k+1)!, enough for n < 1/400."""
    terms = [(-1.0) ** k / float(np.prod(np.arange(1, 2 * k + 2, dtype=float))) for k in range(9)]
    for _ in range(order):
        terms = [k * c for k, c in enumerate(terms)][1:]
    return terms


SERIES = [sinc_series(order) for order in range(3)]


def normalised(u: Jet) -> Jet:
    """Jet of u/|u| for a quaternion jet u."""
    m = [np.sum(u[0] ** 2, axis=1, keepdims=True), 2.0 * np.sum(u[0] * u[1], axis=1, keepdims=True)]
    m.append(2.0 * np.sum(u[1] ** 2 + u[0] * u[2], axis=1, keepdims=True))
    f = m[0] ** -0.5
    df = -0.5 * f / m[0] * m[1]
    ddf = -0.5 * f / m[0] * m[2] + 0.75 * f / m[0] ** 2 * m[1] ** 2
    return u[0] * f, u[1] * f + u[0] * df, u[2] * f + 2.0 * u[1] * df + u[0] * ddf


def angular(q: Jet) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration (nt, 3), world axes, of a jet of unit quaternions."""
    conjugate = q[0] * np.array([1.0, -1.0, -1.0, -1.0])
    return 2.0 * times(q[1], conjugate)[:, 1:], 2.0 * times(q[2], conjugate)[:, 1:]
