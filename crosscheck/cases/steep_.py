"""A leg nearly along the axis of its base: sin q_n of leg 1 from 1e-1 to 0, where q_o has no value.

With inertia about y_r or about the leg's axis (base, J_y, J_z) the base has to spin the faster the steeper the leg is;
a thin leg has none. All five other legs are the built-in hexapod's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ..hard import Case, Point, Row, decades
from .machines import DW, NONE, PIN, THIN, TURNED, Vector, W, changed, cross, minus, plus, turned, with_first

CENTRE = (0.0625, 0.9375, -0.03125)
LENGTH = 0.875
"""Of leg 1 along y_r [m]."""

RIM = turned(TURNED, PIN)
TIP = plus(CENTRE, RIM)


def _accelerating(v_tip: Vector, a_tip: Vector, w: Vector = W) -> Row:
    """A row with velocity and acceleration of leg 1's tip as given: exact, all numbers are short binary fractions."""
    v, a = minus(v_tip, cross(w, RIM)), minus(minus(a_tip, cross(DW, RIM)), cross(w, cross(w, RIM)))
    return Row(CENTRE, TURNED, v, w, a, DW)


# z_n of leg 1 is along z_r.
_MOTIONS = {
    "static": ("at rest", Row(CENTRE, TURNED, NONE, NONE, NONE, NONE)),
    "rest": ("accelerating from rest", _accelerating(NONE, (1.25, -0.875, 1.5), NONE)),
    "meridian": (
        "whose tip stays in the leg's vertical plane",
        _accelerating((0.375, 0.25, 0.0), (1.25, -0.875, 0.0)),
    ),
    "moving": ("in general motion", _accelerating((0.375, 0.25, -0.5), (1.25, -0.875, 1.5))),
}


def _at(row: Row, thin: bool) -> Callable[[float], Point]:
    def at(s: float) -> Point:
        foot = minus(TIP, (LENGTH * s / math.sqrt(1.0 - s * s), LENGTH, 0.0))
        pins = {
            part: {"pins": with_first(getattr(changed("hexapod", {}), part).pins, pin)}
            for part, pin in (("platform", PIN), ("hull", foot))
        }
        return Point(changed("hexapod", {"name": "steep", "leg": THIN if thin else {}, **pins}), row)

    return at


CASES = tuple(
    Case(
        f"steep_{name}{'_thin' if thin else ''}",
        f"Steep leg{' without inertia about its axis' if thin else ''}, {how}",
        "sin q_n of leg 1",
        (*decades(-1, -12), 0.0),
        _at(row, thin),
    )
    for thin in (False, True)
    for name, (how, row) in _MOTIONS.items()
)
