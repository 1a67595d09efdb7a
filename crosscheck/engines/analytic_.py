"""The closed-form formulas as one engine among others."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import ClassVar

import numpy as np

from ... import analytic
from ...models.scene import Scene
from ..engine import DynamicsResult, by_joint, engine_version
from ..trajectory import Trajectory


class AnalyticEngine:
    """The paper's formulas on NumPy arrays; reads no model file."""

    name: ClassVar[str] = "analytic"
    package: ClassVar[str] = "stewart-crosscheck"
    route: ClassVar[str] = "closed_form"
    checks: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        self.scene = scene

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        """Driving forces (7), (8) and joint reactions (23)-(29)."""
        start = perf_counter()
        D = analytic.inverse_dynamics(self.scene.parameters, trajectory.motion)
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.route,
            setting="numpy",
            samples=np.arange(len(trajectory.t)),
            F=D.F,
            reactions=by_joint(self.scene, vars(D)),
            L=D.L,
            dL=D.dL,
            seconds=perf_counter() - start,
        )


ENGINE = AnalyticEngine
