"""Vectors and 2-jets in ball arithmetic: exact differentiation for the certified reference.

A quantity that moves is a 2-jet (x, x', x''), of balls or of vectors of balls; products follow the product rule.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from flint import arb

Vector = tuple[arb, arb, arb]
Jet = tuple[Any, Any, Any]  # value, first and second time derivative: of arb, or of Vector


def vector(values: Iterable[float | arb]) -> Vector:
    """Exact vector of three floats, or the vector of three balls."""
    x, y, z = (v if isinstance(v, arb) else arb(float(v)) for v in values)
    return x, y, z


def plus(*vs: Vector) -> Vector:
    """Sum of vectors."""
    return (sum((v[0] for v in vs), arb(0)), sum((v[1] for v in vs), arb(0)), sum((v[2] for v in vs), arb(0)))


def minus(a: Vector, b: Vector) -> Vector:
    """Difference a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def times(k: arb, a: Vector) -> Vector:
    """Product k a."""
    return (k * a[0], k * a[1], k * a[2])


def dot(a: Vector, b: Vector) -> arb:
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def apply(A: Sequence[Vector], b: Vector) -> Vector:
    """Product A b, `A` by rows."""
    return (dot(A[0], b), dot(A[1], b), dot(A[2], b))


def total(*xs: arb) -> arb:
    """Sum of balls."""
    return sum(xs, arb(0))


def bilinear(op: Callable[[Any, Any], Any], plus: Callable[..., Any], a: Jet, b: Jet) -> Jet:
    """Jet of a bilinear product, by the product rule."""
    middle = op(a[1], b[1])
    return op(a[0], b[0]), plus(op(a[1], b[0]), op(a[0], b[1])), plus(op(a[2], b[0]), middle, middle, op(a[0], b[2]))


def dot_jet(a: Jet, b: Jet) -> Jet:
    """Jet of a scalar product."""
    return bilinear(dot, total, a, b)


def cross_jet(a: Jet, b: Jet) -> Jet:
    """Jet of a vector product."""
    return bilinear(cross, plus, a, b)


def over(a: Jet, k: Jet) -> Jet:
    """Jet of the vector a over the scalar k."""
    x = 1 / k[0]
    dx = -k[1] * x * x
    inverse = (x, dx, -k[2] * x * x - 2 * k[1] * x * dx)
    return bilinear(lambda v, s: times(s, v), plus, a, inverse)


def sqrt_jet(x: Jet) -> Jet:
    """Jet of a square root."""
    root = x[0].sqrt()
    d = x[1] / (2 * root)
    return root, d, (x[2] - 2 * d * d) / (2 * root)


class Turning(NamedTuple):
    """Angular velocity and acceleration of a frame, and the frame's axes as jets."""

    axes: tuple[Jet, Jet, Jet]
    omega: Vector
    alpha: Vector


def turning(*axes: Jet) -> Turning:
    """From the axes of an orthonormal frame: omega = 1/2 sum e x e', alpha = 1/2 sum e x e''."""
    half = arb(1) / 2
    omega = times(half, plus(*(cross(e[0], e[1]) for e in axes)))
    alpha = times(half, plus(*(cross(e[0], e[2]) for e in axes)))
    return Turning((axes[0], axes[1], axes[2]), omega, alpha)


def angular_momentum_rate(body: Turning, J: tuple[arb, arb, arb]) -> Vector:
    """H' of H = sum J_k (omega . e_k) e_k, the angular momentum about the centre of mass."""
    dH = []
    for J_k, e in zip(J, body.axes, strict=True):
        h = J_k * dot(body.omega, e[0])
        dh = J_k * (dot(body.alpha, e[0]) + dot(body.omega, e[1]))
        dH.append(plus(times(dh, e[0]), times(h, e[1])))
    return plus(*dH)
