"""The true motion of a simulation, and how far half-ulp changes of its start and its driving forces move it.

It is the scene's own motion, whose driving forces are held against certified ones, or, where forces are given, a
`certain_motion`.  How changes grow is linearised along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .certain_motion import Motion, certain_motion
from .engine import EngineError
from .engines.analytic_ import AnalyticEngine
from .engines.reference_ import ReferenceEngine
from .problem import Problem
from .simulation import Solution
from .trajectory import along

FINE = 500
"""Intervals of a motion in which its linearised equations are taken for constant."""

CHECKED = 21
"""Times at which the driving forces of a motion are held against certified ones."""

ROUNDINGS = 1e-14
"""What these forces may be off by, over the largest: a few roundings; it counts among the inputs."""

HALF_ULP = 2.0**-54
"""Of a number from 1/2 to 1, such as the components of a quaternion; relative ones are twice as large at most."""


@dataclass(frozen=True)
class TrueMotion(Solution):
    """A motion with what half-ulp inputs make of it.

    ``grown`` (nt,): the largest factor between a small error at first and those of the pose up to each time.  ``pose``
    [m], ``turn`` [rad]: what inputs that are half an ulp off, and what is uncertain of the truth itself, move it by.
    """

    grown: np.ndarray
    pose: float
    turn: float

    def amplification(self, t: np.ndarray, since: float = 0.0) -> np.ndarray:
        """As measured along the motion, from the start."""
        return self.grown


def forces_defect(problem: Problem) -> float:
    """What the driving forces of the scene's motion are off by, over the largest. Raises EngineError."""
    t = np.linspace(0.0, problem.duration, CHECKED)
    F = ReferenceEngine(problem.scene).inverse_dynamics(along(problem.scene, t)).F
    off = float(np.abs(problem.forces(t) - F).max() / np.abs(F).max())
    if not off <= ROUNDINGS:
        raise EngineError(f"reference: the driving forces of the motion are off by {off:.1e} of the largest")
    return off


def true_motion(problem: Problem) -> TrueMotion:
    """Body of a worker process: the true motion and its sensitivity. Raises EngineError, ArithmeticError."""
    scene, t = problem.scene, problem.t
    parts = -(-FINE // (len(t) - 1))
    ends = np.linspace(0.0, problem.duration, parts * (len(t) - 1) + 1)
    middles = 0.5 * (ends[1:] + ends[:-1])
    both = np.sort(np.concatenate([t[1:-1], middles, [0.0, problem.duration]]))
    relative = 2.0 * HALF_ULP
    if problem.prescribed:
        motion = along(scene, both, inverse=False)
        found = Motion(motion.position, motion.unit_quaternion, motion.velocity, motion.angular_velocity, defect=0.0)
        relative = max(relative, forces_defect(problem))
    else:
        found = certain_motion(scene, problem.start, problem.forces, both)
    at, between = (
        np.searchsorted(both, t - 1e-9 * problem.spacing),
        np.searchsorted(both, middles - 1e-9 * problem.spacing),
    )
    position, quaternion, velocity, w = (x[between] for x in found[:4])
    A, B = AnalyticEngine(scene).linearised(position, quaternion, velocity, w, problem.forces(middles))
    grown_by = responses(A, B, problem.duration / len(middles))[parts - 1 :: parts]
    start = [x[0] for x in (problem.start.position, problem.start.velocity, problem.start.angular_velocity)]
    half = [0.5 * np.spacing(np.abs(x)) for x in start]
    inputs = np.concatenate([half[0], np.full(3, 4.0 * HALF_ULP), *half[1:], np.full(scene.N, relative)])
    uncertain = found.defect * t[1:] + 4.0 * HALF_ULP * np.abs(found.velocity).max()
    moved = np.abs(grown_by[:, :6]) @ inputs + np.abs(grown_by[:, :6, 6:12]).sum(axis=2) * uncertain[:, None]
    units = np.tile(np.repeat([problem.length, 1.0], 3), 2)
    shares = np.linalg.norm(grown_by[:, :6, :12] * units / units[:6, None], ord=2, axis=(1, 2))
    grown = np.maximum.accumulate([1.0, *shares])
    pose_, turn = (float(np.linalg.norm(moved[:, part], axis=1).max()) for part in (slice(0, 3), slice(3, 6)))
    return TrueMotion(
        against="motion" if problem.prescribed else "certain motion",
        position=found.position[at], quaternion=found.quaternion[at],
        growth=np.full(len(t), np.log(grown[-1]) / problem.duration), grown=grown,
        pose=max(pose_, 0.5 * float(np.spacing(np.abs(found.position).max()))), turn=max(turn, 2.0 * HALF_ULP),
    )  # fmt: skip


def responses(A: np.ndarray, B: np.ndarray, h: float) -> np.ndarray:
    """Deviations (nt, 12, 12 + N) after each of the intervals h, by those at first and by those of the forces."""
    from scipy.linalg import expm

    n, N = A.shape[1], B.shape[2]
    whole = np.zeros((len(A), n + N, n + N))
    whole[:, :n, :n], whole[:, :n, n:] = h * A, h * B
    out, now = np.empty((len(A), n, n + N)), np.eye(n + N)
    for k, step in enumerate(expm(whole)):
        now = step @ now
        out[k] = now[:n]
    return out
