"""What `simulate` asks: the same driving forces F(t) from the same start, and the times at which states are wanted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..models.scene import Scene
from .trajectory import SAMPLES, Trajectory, TrajectoryError, along, driving_forces, initial
from .waves import sines

SECONDS = 1.0
"""Duration without a motion that has one."""

LONGEST = 3600.0
"""Of a simulation, s: an hour has some million steps."""

GRID = 1e-2
"""Largest distance [s] of the times at which energy, work and gaps are taken: twenty of them in the fastest swing."""


@dataclass(frozen=True)
class Problem:
    """One simulation, the same for every engine.

    ``start``: pose and twist at t = 0, one sample (its accelerations mean nothing).  ``t`` (nt,): output times [s],
    evenly spaced from 0.  ``prescribed``: forces are those of the scene's motion and the start is on it, so that the
    motion is the exact solution.  ``interval``: largest distance of the grid's times [s].
    """

    scene: Scene
    start: Trajectory
    t: np.ndarray
    prescribed: bool
    interval: float = GRID

    @property
    def duration(self) -> float:
        """Last output time [s]."""
        return float(self.t[-1])

    @property
    def parts(self) -> int:
        """Intervals of the grid between two outputs."""
        return math.ceil(self.duration / (len(self.t) - 1) / self.interval * (1.0 - 1e-12))

    @property
    def grid(self) -> np.ndarray:
        """Times [s] that every step size hits: the output times, and what divides them into `interval` or less."""
        return np.linspace(0.0, self.duration, (len(self.t) - 1) * self.parts + 1)

    @property
    def spacing(self) -> float:
        """Distance of the grid's times [s]."""
        return self.duration / ((len(self.t) - 1) * self.parts)

    @property
    def length(self) -> float:
        """Longest leg at the start [m]."""
        tips = self.start.position[0] + np.array(self.scene.pins) @ self.start.rotation[0].T
        return float(np.linalg.norm(tips - np.array(self.scene.hull.pins), axis=1).max())

    def forces(self, t: np.ndarray) -> np.ndarray:
        """Driving forces (n, N) [N] at the times `t` (n,): the scene's own, or the inverse dynamics of its motion."""
        if self.scene.forces:
            return sines(self.scene.forces.legs, t)[0]
        return driving_forces(self.scene, t)

    def motion(self) -> Trajectory:
        """The scene's motion at the output times."""
        return along(self.scene, self.t, inverse=False)


class Staged:
    """Driving forces at the stages of steps dt, computed ahead: at the ends and in the middle of every step."""

    def __init__(self, problem: Problem, steps: int) -> None:
        n = 2 * steps * (len(problem.grid) - 1)
        self.dt = problem.spacing / steps
        self.values = problem.forces(np.linspace(0.0, problem.duration, n + 1))

    def __call__(self, t: float) -> np.ndarray:
        """Forces (N,) at a stage. Raises ValueError at any other time."""
        index = 2.0 * t / self.dt
        n = round(index)
        if not abs(index - n) < 1e-3:
            raise ValueError(f"t = {t!r} s is no stage of steps of {self.dt!r} s")
        return self.values[n]


def pose(scene: Scene, duration: float | None = None, samples: int = SAMPLES, interval: float = GRID) -> Problem:
    """The problem that a scene poses.

    Parameters
    ----------
    scene : with `[forces]` or `[motion]`, and with `[initial]` or `[motion]`.
    duration : s; None: the motion's, or 1 s.
    samples : output times, both ends included, two at least.
    interval : largest distance of the grid's times [s], which every step has to hit.

    Raises
    ------
    TrajectoryError
        A table is missing, the motion is too long, the start is singular, or it has no driving forces on the way.
    """
    if scene.forces is None and scene.motion is None:
        raise TrajectoryError(f"{scene.source}: forces: missing, expected a [forces] or a [motion] table")
    start = initial(scene)
    end = duration or (scene.motion.duration if scene.motion else SECONDS)
    if end > LONGEST:
        raise TrajectoryError(
            f"{scene.source}: motion.duration: got {end:g} s, expected at most {LONGEST:g} s for a simulation, or"
            " --duration"
        )
    t = np.linspace(0.0, end, samples)
    problem = Problem(scene, start, t, scene.forces is None and scene.initial is None, interval)
    if scene.forces is None:
        along(scene, problem.grid)
    return problem
