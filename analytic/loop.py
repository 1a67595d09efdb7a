"""One sample after another without overhead: what a controller calls a thousand times a second and more."""

from __future__ import annotations

import ctypes

import numpy as np

from .compiled import Compiled
from .dynamics import driving_forces
from .evaluate import DRIVING_FORCES, REGULAR, Mechanism
from .stewart import PlatformMotion


class ControlLoop:
    """Driving forces of one state at a time by the compiled back end, in arrays that stay.

    Write the state into ``motion`` (24,): C_p, R by rows, dC_p, w_p, ddC_p, dw_p, world axes, SI units; call; read
    ``F`` (N,) in N, + extends the leg.

    Raises
    ------
    NoCompiler
        On creation: there is no C compiler.
    SingularPose, Infeasible, ValueError
        On a call: as `driving_forces`; F keeps what it had, or holds numbers that mean nothing.
    """

    def __init__(self, P: Mechanism) -> None:
        self._P, self._code = P, Compiled(P, DRIVING_FORCES)
        self.motion, self.F = np.zeros(24), np.zeros(len(P.p))
        self._one = self._code.one
        self._pointers = [ctypes.c_void_p(a.ctypes.data) for a in (self.motion, self.F, self._code.parameters)]

    def __call__(self) -> None:
        """Fill ``F`` from ``motion``."""
        x, y, p = self._pointers
        if not self._one(x, y, p) >= REGULAR:
            self._doubt()

    def _doubt(self) -> None:
        C_p, *R, dC_p, w_p, ddC_p, dw_p = self.motion.reshape(8, 1, 3)
        self.F[:] = driving_forces(self._P, PlatformMotion(C_p, np.stack(R, 1), dC_p, w_p, ddC_p, dw_p))[0]
