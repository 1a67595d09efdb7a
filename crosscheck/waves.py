"""Components c0 + sum A sin(omega t + phi) of a scene file at any times, with two derivatives."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..models.tables import Component
from .quaternions import Jet


def sines(components: Sequence[Component], t: np.ndarray) -> Jet:
    """Values and two derivatives of n components at the times `t` (nt,) [s], each (nt, n)."""
    x, dx, ddx = (np.zeros((len(t), len(components))) for _ in range(3))
    for j, component in enumerate(components):
        x[:, j] = component.c0
        for amplitude, omega, phase in component.terms:
            angle = omega * t + phase
            x[:, j] += amplitude * np.sin(angle)
            dx[:, j] += amplitude * omega * np.cos(angle)
            ddx[:, j] -= amplitude * omega**2 * np.sin(angle)
    return x, dx, ddx
