"""Parallel singularities: no forces hold the platform, and driving forces grow as one over the distance to there.

Forward dynamics is regular all the way. Positions are chosen so that the machine at zero is singular without rounding.
"""

from __future__ import annotations

import math

from ..hard import Case, Point, Row, decades
from .machines import NONE, POINT, SPATIAL, UNTURNED, Vector, changed, with_first

CIRCLE = ((16, 63), (-16, 63), (-63, -16), (-39, -52), (52, -39), (60, -25))
"""Whole numbers x, z with x^2 + z^2 = 65^2, in pairs about thirds of a turn."""


def _circles(across: float) -> tuple[tuple[Vector, ...], tuple[Vector, ...]]:
    """Hull pins O on a circle, platform pins half a quarter turn of O, and `across` times O to either side in turn.

    O x P is the same for all legs whatever `across` is: a screw about the vertical axis that no leg resists.
    """
    hull = tuple((x / 64, 0.0, z / 64) for x, z in CIRCLE)
    sides = (1, -1, 1, -1, 1, -1)
    platform = tuple(
        (z / 128 + side * across * x / 64, 0.0, -x / 128 + side * across * z / 64)
        for (x, z), side in zip(CIRCLE, sides, strict=True)
    )
    return hull, platform


def _yaw(delta: float) -> Point:
    """Pins in platform axes are those of the singular pose, so that the smallest turn away from it is exact."""
    hull, platform = _circles(0.25)
    scene = changed("hexapod", {"name": "yaw", "hull": {"pins": hull}, "platform": {"pins": platform}})
    turn = (math.cos(delta / 2.0), 0.0, math.sin(delta / 2.0), 0.0)
    return Point(scene, SPATIAL._replace(position=(0.0, 0.875, 0.0), quaternion=turn))


def _coincident(separation: float) -> Point:
    """Legs 1 and 2 side by side along z, which is zero in the pins of leg 1."""
    hexapod = changed("hexapod", {})
    pins = {
        part: {"pins": with_first(getattr(hexapod, part).pins, (x, y, 0.0), (x, y, separation))}
        for part, x, y in (("platform", 0.347, -0.041), ("hull", 0.947, 0.061))
    }
    return Point(changed(hexapod, {"name": "coincident", **pins}), SPATIAL)


def _similar(height: float) -> Point:
    """Platform pins half the hull's, all on circles: singular in every pose until leg 1's platform pin is raised."""
    hull, _ = _circles(0.0)
    flat = [(x / 2.0, 0.0, z / 2.0) for x, _, z in hull]
    platform = with_first(flat, (flat[0][0], height, flat[0][2]))
    scene = changed("hexapod", {"name": "similar", "hull": {"pins": hull}, "platform": {"pins": platform}})
    return Point(scene, SPATIAL)


def _flat(height: float) -> Point:
    """Pins of hull and platform in two horizontal planes, one upon the other at zero."""
    hull, platform = _circles(0.25)
    scene = changed("hexapod", {"name": "flat", "hull": {"pins": hull}, "platform": {"pins": platform}})
    turn = (math.cos(0.5), 0.0, math.sin(0.5), 0.0)
    return Point(scene, SPATIAL._replace(position=(0.021, height, -0.017), quaternion=turn))


def _in_line(angle: float) -> Point:
    """The point mass of the collinear scene, lifted, with gravity; leg 1 is at an angle to the line of its pins."""
    scene = changed("collinear", {"gravity": (0.0, -9.81, 0.0)})
    return Point(scene, POINT._replace(position=(0.75, 0.75 * math.tan(angle), 0.0)))


def _along_the_line(angle: float) -> Point:
    """Without gravity and moving along leg 1: forces stay finite, but only their difference has a value at 0."""
    x, y = 0.75, 0.75 * math.tan(angle)
    v, a = (0.31, 0.31 * math.tan(angle), 0.0), (0.87, 0.87 * math.tan(angle), 0.0)
    return Point(changed("collinear", {}), Row((x, y, 0.0), UNTURNED, v, NONE, a, NONE))


FROM_ONE = (*decades(0, -16), 0.0)
FROM_TENTH = (*decades(-1, -16), 0.0)

CASES = (
    Case("parallel_yaw", "Platform turned by a right angle against the hull", "angle from there, rad", FROM_ONE, _yaw),
    Case("parallel_coincident", "Two legs side by side", "distance of their pins, m", FROM_TENTH, _coincident),
    Case("parallel_similar", "Platform similar to the hull", "height of one of its pins, m", FROM_TENTH, _similar),
    Case("parallel_flat", "Platform in the plane of the hull", "height, m", FROM_TENTH, _flat),
    Case("parallel_in_line", "Point mass between two legs in line", "angle of leg 1, rad", FROM_TENTH, _in_line),
    Case(
        "parallel_along_line",
        "Point mass between two legs in line, moving along leg 1, no gravity",
        "angle of leg 1, rad",
        FROM_TENTH,
        _along_the_line,
    ),
)
