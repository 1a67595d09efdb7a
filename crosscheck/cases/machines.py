"""What the cases are made of: scenes with other numbers, turned pins without rounding, and a motion of everything."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from ...models.scene import Scene, load_scene
from ..hard import Row

Vector = tuple[float, float, float]

TURNED = (4062 / 4096, 256 / 4096, -421 / 4096, 186 / 4096)
"""A turn by 15 degrees about no special axis; its length is 1 + 3e-8."""

UNTURNED = (1.0, 0.0, 0.0, 0.0)

DYADIC = (2**24 + 1) / 2**32
"""Pins that are small integers times this are turned by `TURNED` to float64 without rounding."""

NONE: Vector = (0.0, 0.0, 0.0)

PIN = (89 * DYADIC, -10 * DYADIC, 16 * DYADIC)
"""Such a pin near that of the built-in hexapod's leg 1."""

V, A = (0.31, -0.23, 0.17), (0.87, 1.31, -0.59)
W, DW = (0.5, -0.75, 0.625), (1.75, -1.25, 2.5)
"""Velocities and accelerations of a platform's centre and of its turning [m/s, m/s^2, rad/s, rad/s^2]."""

SPATIAL = Row((0.021, 0.943, -0.017), TURNED, V, W, A, DW)
POINT = Row((0.517, 0.842, 0.0), UNTURNED, (*V[:2], 0.0), NONE, (*A[:2], 0.0), NONE)
BAR = POINT._replace(
    position=(0.713, 0.886, 0.0),
    quaternion=(math.cos(0.066), 0.0, 0.0, math.sin(0.066)),
    angular_velocity=(0.0, 0.0, 0.5),
    angular_acceleration=(0.0, 0.0, 1.75),
)
"""General motions of the built-in machines hexapod, pointmass2 and planar3, at poses in their midst."""


def changed(scene: str | Scene, changes: Mapping[str, Any]) -> Scene:
    """A scene with other numbers and without motion, validated as a file would be; None takes a key away."""
    start = load_scene(scene) if isinstance(scene, str) else scene
    return Scene.model_validate(
        _merged(start.model_dump(exclude_none=True, by_alias=True), {"motion": None, **changes})
    )


def _merged(table: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    for key, new in changes.items():
        if new is None:
            table.pop(key, None)
        elif isinstance(new, Mapping) and key in table:
            table[key] = _merged(table[key], new)
        else:
            table[key] = new
    return table


THIN = {"base": None, "guide": {"J_y": 0.0}, "rod": {"J_z": 0.0}}
"""Changes of a spatial leg that leave it no inertia about y_r and about its own axis."""


def with_first(rows: Sequence[Vector], *first: Vector) -> tuple[Vector, ...]:
    """Rows of which the first ones are others."""
    return (*first, *rows[len(first) :])


def turned(quaternion: Sequence[float], p: Vector) -> tuple[Fraction, ...]:
    """R p, exact: with a quaternion of float64 it is rational."""
    w, x, y, z = (Fraction(c) for c in quaternion)
    n = 2 / (w * w + x * x + y * y + z * z)
    R = (
        (1 - n * (y * y + z * z), n * (x * y - w * z), n * (x * z + w * y)),
        (n * (x * y + w * z), 1 - n * (x * x + z * z), n * (y * z - w * x)),
        (n * (x * z - w * y), n * (y * z + w * x), 1 - n * (x * x + y * y)),
    )
    return tuple(sum((a * Fraction(b) for a, b in zip(row, p, strict=True)), Fraction(0)) for row in R)


def floats(v: Sequence[Fraction]) -> Vector:
    """Nearest float64."""
    x, y, z = (float(c) for c in v)
    return x, y, z


def plus(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """Sum, rounded once."""
    return floats([Fraction(x) + Fraction(y) for x, y in zip(a, b, strict=True)])


def minus(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """Difference, rounded once."""
    return floats([Fraction(x) - Fraction(y) for x, y in zip(a, b, strict=True)])


def scaled(k: float, v: Sequence[float]) -> Vector:
    """Product k v."""
    x, y, z = v
    return (k * x, k * y, k * z)


def cross(a: Sequence[Any], b: Sequence[Any]) -> tuple[Fraction, ...]:
    """Vector product, exact."""
    (ax, ay, az), (bx, by, bz) = ([Fraction(c) for c in v] for v in (a, b))
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
