"""What a simulation may not do whatever its step: take the mechanism apart, or make energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .engine import EngineError
from .problem import Problem
from .tolerance import NEAR

if TYPE_CHECKING:
    from .stepping import Simulated

REST = 1e-3
"""Of the platform's kinetic energy at one leg length a second: what counts as exchanged when hardly any is."""


def exchanged(problem: Problem, s: Simulated) -> float:
    """Energy [J] that a simulation turns over: the largest change of kinetic or potential energy or work."""
    rest = REST * 0.5 * problem.scene.platform.mass * problem.length**2
    return float(max(np.ptp(s.kinetic), np.ptp(s.potential), np.ptp(s.work), rest))


def require_credible(engine: str, problem: Problem, s: Simulated) -> None:
    """Raise EngineError where a loop came open, or the energy is not that of the work done, by a tenth or more.

    Both are nobody's law: an error of a tenth no longer falls with the step as its order says, see `NEAR`.
    """
    if s.gap > NEAR * problem.length:
        raise EngineError(
            f"{engine}: a loop came open by {s.gap:.3g} m, expected at most {NEAR:g} of the longest leg, which is"
            f" {problem.length:.3g} m: take shorter steps, or softer gains"
        )
    defect, turnover = np.abs(s.defect), exchanged(problem, s)
    if not defect.max() <= NEAR * turnover:
        k = int(np.argmax(defect > NEAR * turnover))
        raise EngineError(
            f"{engine}: t = {problem.grid[k]:.6g} s: the energy is off by {defect[k]:.3g} J, expected at most {NEAR:g}"
            f" of the {turnover:.3g} J exchanged: take shorter steps, or softer gains"
        )
