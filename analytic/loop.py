"""One state after another without overhead: what a controller or an integrator calls thousands of times a second."""

from __future__ import annotations

import ctypes

import numpy as np

from .compiled import Compiled
from .dynamics import driving_forces, inverse_dynamics
from .evaluate import DRIVING_FORCES, FORWARD_DYNAMICS, INVERSE_DYNAMICS, REGULAR, Mechanism, in_floats
from .forward import forward_dynamics
from .stewart import PlatformMotion

PROBLEMS = {p.name: p for p in (DRIVING_FORCES, INVERSE_DYNAMICS, FORWARD_DYNAMICS)}


class ControlLoop:
    """One problem of a machine for one state at a time, by the compiled back end, in arrays that stay.

    Write a state into ``given``, call, read ``found``; world axes, SI units.

    Parameters
    ----------
    P : Parameters or PlanarParameters
    problem : what is asked
        ``driving_forces``: given (24,) are C_p, R by rows, dC_p, w_p, ddC_p, dw_p, found (N,) is F.
        ``inverse_dynamics``: the same given, found are the rows of `InverseDynamics.numbers` that a machine has.
        ``forward_dynamics``: given (18 + N,) are C_p, R by rows, dC_p, w_p, F, found (6,) are ddC_p, dw_p; in a plane
        x, y and the turn about z, of a point mass x and y.

    Raises
    ------
    NoCompiler
        On creation: there is no C compiler.
    ValueError
        On creation: an unknown problem.
    SingularPose, Infeasible, ArithmeticError, ValueError
        On a call: as the functions of these names; ``found`` then means nothing.
    """

    def __init__(self, P: Mechanism, problem: str = "driving_forces") -> None:
        if problem not in PROBLEMS:
            raise ValueError(f"problem: got {problem!r}, expected one of {', '.join(PROBLEMS)}")
        self._P, self._problem = in_floats(P), PROBLEMS[problem]
        self._code = Compiled(self._P, self._problem)
        self._given, self._found = np.zeros(sum(self._problem.widths(P))), np.zeros(len(self._code.rows))
        self._one = self._code.one
        self._pointers = [ctypes.c_void_p(a.ctypes.data) for a in (self._given, self._found, self._code.parameters)]

    @property
    def given(self) -> np.ndarray:
        """The state: write into it, another array can not take its place."""
        return self._given

    @property
    def found(self) -> np.ndarray:
        """The answer, until the next call."""
        return self._found

    def __call__(self) -> None:
        """Fill ``found`` from ``given``."""
        x, y, p = self._pointers
        if not self._one(x, y, p) >= REGULAR:
            self._doubt()

    def _doubt(self) -> None:
        C_p, *R, dC_p, w_p, ddC_p, dw_p = np.append(self.given[:18], np.zeros(6)).reshape(8, 1, 3)
        motion = PlatformMotion(C_p, np.stack(R, 1), dC_p, w_p, ddC_p, dw_p)
        if self._problem is FORWARD_DYNAMICS:
            a = forward_dynamics(self._P, motion, self.given[None, 18:])
            self.found[:] = np.hstack([a.ddC_p, a.dw_p])[0, self._code.rows]
            return
        motion = motion._replace(ddC_p=self.given[None, 18:21], dw_p=self.given[None, 21:])
        if self._problem is DRIVING_FORCES:
            self.found[:] = driving_forces(self._P, motion)[0]
        else:
            self.found[:] = inverse_dynamics(self._P, motion).numbers[self._code.rows, 0]
