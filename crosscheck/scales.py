"""What errors are divided by, from the certified truth and the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..models.scene import Scene
from .engine import LOOPS, DynamicsResult, quantity
from .trajectory import Trajectory


@dataclass(frozen=True)
class Scales:
    """What errors are divided by.

    The run's largest reaction force [N], longest leg [m], tip speed and acceleration, and the longest lever of a pin
    on the platform [m] (the longest leg where the platform is a point).
    """

    force: float
    length: float
    speed: float
    acceleration: float
    lever: float

    def of(self, name: str) -> float:
        """Scale of a quantity, in its unit."""
        special = {"balance": self.force, **dict(zip(LOOPS, (self.length, self.speed, self.acceleration), strict=True))}
        special |= {"a": self.acceleration, "alpha": self.acceleration / self.lever}
        return special.get(name, self.force * (self.length if name.startswith("M") else 1.0))


def scales(scene: Scene, trajectory: Trajectory, truth: DynamicsResult) -> Scales:
    """Scales of a run, forces from the truth.

    Speeds and accelerations get one leg length per second (squared) on top, so that a motion at rest has a scale too;
    a run without any force gets 1 N.
    """
    reactions = [quantity(scene, n, truth.F, truth.reactions) for n in scene.quantities if n.startswith("F_")]
    force = max(float(np.linalg.norm(x, axis=2).max()) for x in reactions) or 1.0
    length = float(truth.L.max())
    speed, acceleration, lever = np.max([_tips(scene, block) for block in trajectory.blocks()], axis=0).tolist()
    return Scales(force, length, speed + length, acceleration + length, lever or length)


def _tips(scene: Scene, at: Trajectory) -> list[float]:
    """Largest speed, acceleration and lever of a pin of the platform."""
    r = np.einsum("tij,nj->tni", at.rotation, np.array(scene.pins))
    w, dw = (x[:, None] for x in (at.angular_velocity, at.angular_acceleration))
    V = at.velocity[:, None] + np.cross(w, r)
    A = at.acceleration[:, None] + np.cross(dw, r) + np.cross(w, np.cross(w, r))
    return [float(np.linalg.norm(x, axis=2).max()) for x in (V, A, r)]
