"""The closed-form formulas as one engine among others."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from ... import analytic
from ...models.scene import Scene
from ..engine import DynamicsResult, EngineError, by_joint, engine_version
from ..problem import Problem, Staged
from ..quaternions import rotation
from ..stepping import Method, Simulated
from ..trajectory import Trajectory

GAIN = 20.0
"""Of Baumgarte's terms, 1/s: gaps close in a twentieth of a second, ten steps and more."""

DAE: dict[str, tuple[str, dict[str, Any]]] = {
    "RK4": ("all coordinates, unstabilised", {}),
    "RK4 + Baumgarte": (f"all coordinates, Baumgarte {GAIN:g} 1/s", {"gain": GAIN}),
    "RK4 + projection": ("all coordinates, projected after each step", {"projection": True}),
}
"""Integrators of the route `dae`, what they are, and the arguments that make them so."""


class AnalyticEngine:
    """The paper's formulas on NumPy arrays; reads no model file."""

    name: ClassVar[str] = "analytic"
    package: ClassVar[str] = "stewart-crosscheck"
    route: ClassVar[str] = "closed_form"
    checks: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        self.scene = scene
        self.backend = "numpy"

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        """Driving forces (7), (8) and joint reactions (23)-(29)."""
        start = perf_counter()
        D = analytic.inverse_dynamics(self.scene.parameters, trajectory.motion, self.backend)
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.route,
            setting=self.backend,
            samples=np.arange(len(trajectory.t)),
            F=D.F,
            reactions=by_joint(self.scene, vars(D)),
            L=D.L,
            dL=D.dL,
            seconds=perf_counter() - start,
        )

    @classmethod
    def methods(cls, problem: Problem) -> tuple[Method, ...]:
        """Minimal coordinates near round-off, which is the solution of every problem; the paper's own equations."""
        solution = Method(cls.route, "minimal coordinates, compliance form", "DOP853")
        if problem.scene.topology == "planar":
            reason = "simulation in all coordinates is written for spatial mechanisms"
            return solution, Method("dae", "all coordinates", "RK4", unsupported=reason)
        dae = (Method("dae", DAE[how][0], how, steps, 4) for how in DAE for steps in (1, 2))
        return solution, *dae

    def simulate(self, problem: Problem, method: Method) -> Simulated:
        """(7), (8), (31) in time. Raises EngineError."""
        P, first = self.scene.parameters, problem.start
        initial = analytic.State(
            first.position[0], first.unit_quaternion[0], first.velocity[0], first.angular_velocity[0]
        )
        staged = Staged(problem, method.steps) if method.steps else None
        start = perf_counter()
        try:
            if staged is None:
                s = analytic.simulate(P, initial, lambda t: problem.forces(np.array([t]))[0], problem.grid)
            else:
                assert isinstance(P, analytic.Parameters)
                s = analytic.simulate_constrained(
                    P, initial, staged, problem.grid, staged.dt, **DAE[method.integrator][1]
                )
        except (analytic.SimulationError, analytic.SingularPose) as e:
            raise EngineError(f"{self.name}: {e}") from None
        seconds = perf_counter() - start
        out = slice(None, None, problem.parts)
        kinetic, potential = analytic.energies(P, s.motion)
        return Simulated(
            s.position[out], s.quaternion[out], s.velocity[out], s.angular_velocity[out], kinetic, potential, s.work,
            gap=float(s.gap.max()) if isinstance(s, analytic.ConstrainedSimulation) else float("nan"), seconds=seconds,
        )  # fmt: skip

    def accelerations(self, method: Method, trajectory: Trajectory, F: np.ndarray) -> np.ndarray:
        """Acceleration and angular acceleration (nt, 6) of the platform under driving forces (nt, N)."""
        form = "compliance" if method.route == self.route else "paper"
        a = analytic.forward_dynamics(self.scene.parameters, trajectory.motion, F, form)
        return np.hstack([a.ddC_p, a.dw_p])

    def growth_rates(
        self, position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray, w: np.ndarray, F: np.ndarray
    ) -> np.ndarray:
        """Rate [1/s] (nt,) at which a small error of a motion grows fastest, driving forces (nt, N) held."""
        zero = np.zeros_like(position)
        motion = analytic.PlatformMotion(position, rotation(quaternion), velocity, w, zero, zero)
        return analytic.growth_rates(self.scene.parameters, motion, F)


ENGINE = AnalyticEngine
