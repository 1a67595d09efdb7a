"""Rotation vectors that DART turns into the rotations they stand for."""

from __future__ import annotations

import numpy as np

SERIES = 1e-5, 2e-3
"""Angles [rad] between which DART's rotation of a free joint is off by a sixth of their third power: below 1e-3 it
takes the exponential's series without that term."""


def outside_series(vectors: np.ndarray) -> np.ndarray:
    """Rotation vectors (nt, 3) of the same rotations: those in `SERIES` go a full turn further."""
    angle = np.linalg.norm(vectors, axis=1)
    small = (angle > SERIES[0]) & (angle < SERIES[1])
    out = vectors.copy()
    out[small] *= 1.0 + 2.0 * np.pi / angle[small, None]
    return out
