"""DART 6.20: a free joint turned by less than 1e-3 rad is at a rotation that is off by a sixth of the angle cubed."""

from __future__ import annotations

import math

import numpy as np
import pytest
from known import control, defect

DART = pytest.mark.parametrize("engine_name", ["dart"], indirect=True)


def off(angle: float) -> float:
    """Largest entry by which the rotation about z differs."""
    import dartpy

    R = dartpy.dynamics.FreeJoint.convertToTransform(np.array([0.0, 0.0, angle, 0.0, 0.0, 0.0])).rotation()
    c, s = math.cos(angle), math.sin(angle)
    return float(np.abs(R - np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])).max())


@DART
@defect("The exponential's series for small angles lacks its third order", "dart_rotation.outside_series")
def test_small_angles_are_right(engine_name: str) -> None:
    control(off(1.01e-3) < 1e-15)
    control(off(5e-4 + 2.0 * math.pi) < 1e-15)  # a full turn on
    assert off(9.9e-4) < 1e-15
