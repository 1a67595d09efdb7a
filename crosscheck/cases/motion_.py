"""Motions from creeping to absurd, short legs, and angles where a branch, an arc cosine or three angles would fail.

All of these are regular: what they cost in digits is in the sensitivity.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ..hard import Case, Point, Row, decades
from .machines import (
    BAR,
    DW,
    NONE,
    PIN,
    SPATIAL,
    TURNED,
    UNTURNED,
    A,
    V,
    Vector,
    W,
    changed,
    floats,
    minus,
    plus,
    scaled,
    turned,
    with_first,
)

RIM = floats(turned(TURNED, PIN))
"""Platform pin of leg 1 and where it is from the centre, without rounding."""

CENTRE: Vector = (-RIM[0], -RIM[1], -RIM[2])
"""With the tip of leg 1 in the world's origin the smallest components of that leg are exact."""


def _hexapod(foot: Vector, a: float = 0.37) -> Point:
    """The built-in hexapod, leg 1 from a foot to the world's origin, in general motion."""
    hexapod = changed("hexapod", {})
    to_origin = minus(CENTRE, SPATIAL.position)
    hull = with_first([plus(pin, to_origin) for pin in hexapod.hull.pins], foot)
    pins = {"hull": {"pins": hull}, "platform": {"pins": with_first(hexapod.pins, PIN)}}
    return Point(changed(hexapod, {"leg": {"a": a}, **pins}), SPATIAL._replace(position=CENTRE))


def _in_motion(velocity: float, acceleration: float, gravity: Vector = (0.0, -9.81, 0.0)) -> Point:
    """Twist and accelerations times a factor each."""
    twist, rates = ((scaled(k, x), scaled(k, y)) for k, x, y in ((velocity, V, W), (acceleration, A, DW)))
    return Point(changed("hexapod", {"gravity": gravity}), Row(SPATIAL.position, TURNED, *twist, *rates))


def _slide(q_s: float) -> Point:
    """A leg of a length that is a number (3-4-5), so that q_s is exact but for the rounding of a."""
    return _hexapod((0.28125, -0.375, 0.0), 0.46875 - q_s)


def _short(length: float) -> Point:
    return _hexapod((0.48 * 0.37 * length, -0.6 * 0.37 * length, 0.64 * 0.37 * length))


def _level(angle: float) -> Point:
    """Leg 1 from outside, at an angle to the horizontal plane."""
    return _hexapod((0.875 * math.cos(angle), -0.875 * math.sin(angle), 0.0))


def _branch(angle: float) -> Point:
    """Leg 1 with q_o at an angle from pi: it leans along +x_r."""
    return _hexapod((-0.375 * math.cos(angle), -0.875, -0.375 * math.sin(angle)))


def _planar(foot: Callable[[float], Vector]) -> Callable[[float], Point]:
    """The bar on three legs, unturned: the tip of leg 1 is in the world's origin; its leg points anywhere."""

    def at(angle: float) -> Point:
        bar = changed("planar3", {})
        pins = ((-0.4375, 0.0, 0.0), (-0.375, 0.0625, 0.0), (0.4375, 0.0, 0.0))
        hull = (foot(angle), (0.75, -0.9375, 0.0), (1.25, -0.75, 0.0))
        row = BAR._replace(position=(0.4375, 0.0, 0.0), quaternion=UNTURNED)
        return Point(changed(bar, {"platform": {"pins": pins}, "hull": {"pins": hull}}), row)

    return at


def _platform_axes(from_quaternion: Sequence[float], quaternion: Sequence[float]) -> Point:
    """The built-in hexapod, its platform axes laid so that a quaternion stands for the usual pose."""
    w, x, y, z = from_quaternion
    back = (w, -x, -y, -z)
    pins = [floats(turned(back, pin)) for pin in changed("hexapod", {}).pins]
    row = SPATIAL._replace(quaternion=tuple(quaternion))
    return Point(changed("hexapod", {"platform": {"pins": pins}}), row)


def _half_turn(angle: float) -> Point:
    """A turn short of pi by an angle, about an axis without zeros."""

    def turn(delta: float) -> tuple[float, ...]:
        return (math.sin(delta / 2.0), *scaled(math.cos(delta / 2.0) / 7.0, (2.0, 3.0, 6.0)))

    return _platform_axes(turn(0.0), turn(angle))


def _gimbal(angle: float) -> Point:
    """Rx Ry Rz with the middle angle short of a right one: quaternions (w, x, y, z) with w near y and x = z."""

    def turn(delta: float) -> tuple[float, ...]:
        w = 2.0**-10
        y = w - math.sqrt(2.0) * math.sin(delta / 2.0)
        x = math.sqrt((1.0 - w * w - y * y) / 2.0)
        return (w, x, y, x)

    return _platform_axes(turn(0.0), turn(angle))


def _down(angle: float) -> Vector:
    return (0.875 * math.sin(angle), 0.875 * math.cos(angle), 0.0)


def _along(angle: float) -> Vector:
    return (0.875 * math.cos(angle), -0.875 * math.sin(angle), 0.0)


ANGLES = (*decades(-1, -16), 0.0)
SPEEDS = decades(-12, 8)[::2]
STARTS = decades(-2, -20)[::2]
SLIDES = (*decades(-1, -13), 0.0)
LENGTHS = (1.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002, 0.0011, *decades(-4, -8))

CASES = (
    Case("motion_speed", "Motion k times as fast, accelerations by k^2", "k", SPEEDS, lambda k: _in_motion(k, k * k)),
    Case("motion_twist", "Velocities alone times k", "k", SPEEDS, lambda k: _in_motion(k, 1.0)),
    Case("motion_start", "Start from rest, no gravity", "accelerations", STARTS, lambda k: _in_motion(0.0, k, NONE)),
    Case("motion_slide", "Rod's centre of mass near the hull pin", "q_s of leg 1, m", SLIDES, _slide),
    Case("motion_short", "Short leg", "length of leg 1 over a", LENGTHS, _short),
    Case("motion_level", "Level leg", "angle to the horizontal, rad", ANGLES, _level),
    Case("motion_branch", "Base turned by half a turn", "pi - q_o of leg 1, rad", ANGLES, _branch),
    Case("motion_down_planar", "Leg of a bar straight down", "pi - q_n of leg 1, rad", ANGLES, _planar(_down)),
    Case("motion_level_planar", "Leg of a bar along x_r", "pi/2 - q_n of leg 1, rad", ANGLES, _planar(_along)),
    Case("motion_half_turn", "Platform axes turned by half a turn", "angle short of it, rad", ANGLES, _half_turn),
    Case("motion_gimbal", "Middle one of three Cardan angles a right one", "angle short of it, rad", ANGLES, _gimbal),
)
