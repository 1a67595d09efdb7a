"""Loops that coincide, and more or fewer of them than six: the platform is held, but rows of a loop solver may depend.

With any number of legs the accelerations under given forces have an answer; driving forces of a motion have one, and
only one, for six legs in space, three on a bar, two on a point mass.
"""

from __future__ import annotations

from collections.abc import Callable

from ..hard import Case, Point, Row, decades
from .machines import BAR, POINT, SPATIAL, Vector, changed

PLATFORM = ((0.41, 0.23), (-0.37, 0.27), (0.03, -0.45))
HULL = ((0.06, 0.93), (-0.88, -0.41), (0.79, -0.52))
"""Corners x, z of two triangles, every corner one of two legs."""

WIDE = 0.125
"""Between the two pins of a corner that no loops share [m]."""


def _octahedron(on_platform: float, on_hull: float) -> Point:
    """Six legs between two triangles; the pins of a corner lie one above the other, the lower one at y = 0."""
    platform = [(x, y, z) for x, z in PLATFORM for y in (0.0, on_platform)]
    corners = [(x, y, z) for x, z in HULL for y in (0.0, on_hull)]
    hull = [*corners[5:], *corners[:5]]  # leg 1 goes to the third corner, legs 2 and 3 to the first
    changes = {"name": "octahedron", "hull": {"pins": hull}, "platform": {"pins": platform}}
    return Point(changed("hexapod", changes), SPATIAL)


def _bar(separation: float) -> Point:
    """Legs 1 and 2 at one end of the bar, legs 2 and 3 at one hull pin, but for a separation along y_r."""
    platform = ((-0.43, 0.0, 0.0), (-0.43, separation, 0.0), (0.43, 0.0, 0.0))
    hull = ((0.0, 0.0, 0.0), (1.27, 0.0, 0.0), (1.27, separation, 0.0))
    return Point(changed("planar3", {"platform": {"pins": platform}, "hull": {"pins": hull}}), BAR)


def _between(pins: tuple[Vector, ...]) -> tuple[Vector, ...]:
    """Pins, and the middle ones of every two neighbours."""
    pairs = zip(pins, (*pins[1:], pins[0]), strict=True)
    return (*pins, *((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])) for a, b in pairs))


def _spatial(N: float) -> Point:
    hexapod = changed("hexapod", {})
    hull, platform = (_between(pins)[: int(N)] for pins in (hexapod.hull.pins, hexapod.pins))
    return Point(changed(hexapod, {"hull": {"pins": hull}, "platform": {"pins": platform}}), SPATIAL)


def _flat(name: str, row: Row) -> Callable[[float], Point]:
    """Hull pins on the ground, pins of a bar along it."""

    def at(N: float) -> Point:
        legs = range(int(N))
        hull = [(0.53 * k % 1.3, 0.017 * k, 0.0) for k in legs]
        platform = {"pins": [(0.61 * k % 0.9 - 0.45, 0.013 * k, 0.0) for k in legs]} if name == "planar3" else {}
        return Point(changed(name, {"hull": {"pins": hull}, "platform": platform}), row)

    return at


SEPARATIONS = (*decades(-1, -16), 0.0)
NUMBERS = tuple(float(N) for N in range(1, 13))

CASES = (
    Case(
        "loops_platform_pins",
        "Pairs of legs at one platform pin",
        "distance of the pins, m",
        SEPARATIONS,
        lambda d: _octahedron(d, WIDE),
    ),
    Case(
        "loops_hull_pins",
        "Pairs of legs at one hull pin",
        "distance of the pins, m",
        SEPARATIONS,
        lambda d: _octahedron(WIDE, d),
    ),
    Case(
        "loops_octahedron",
        "Pairs of legs at one pin on either side",
        "distance of the pins, m",
        SEPARATIONS,
        lambda d: _octahedron(d, d),
    ),
    Case("loops_bar", "Bar on legs that share pins", "distance of the pins, m", SEPARATIONS, _bar),
    Case("loops_legs", "Number of legs in space", "N", NUMBERS, _spatial),
    Case("loops_legs_bar", "Number of legs under a bar", "N", NUMBERS, _flat("planar3", BAR)),
    Case("loops_legs_point", "Number of legs at a point mass", "N", NUMBERS, _flat("pointmass2", POINT)),
)
