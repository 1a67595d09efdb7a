"""The closed-form formulas as one engine among others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from time import perf_counter
from typing import Any, ClassVar

import numpy as np

from ... import analytic
from ...models.scene import Scene
from ..engine import DynamicsResult, EngineError, Law, by_joint, engine_version
from ..hard import FORWARD, INVERSE, Accelerated, Row
from ..problem import Problem, Staged
from ..quaternions import rotation
from ..stepping import Method, Simulated
from ..trajectory import Trajectory

GAIN = 20.0
"""Of Baumgarte's terms, 1/s: gaps close in a twentieth of a second, ten steps and more."""

BAUMGARTE = "RK4 + Baumgarte"

DAE: dict[str, tuple[str, dict[str, Any]]] = {
    "RK4": ("all coordinates, unstabilised", {}),
    BAUMGARTE: (f"all coordinates, Baumgarte {GAIN:g} 1/s", {}),
    "RK4 + projection": ("all coordinates, projected after each step", {"projection": True}),
}
"""Integrators of the route `dae`, what they are, and the arguments that make them so."""


INVERSE_FORMS = ("closed_form", "printed")
"""Forms of the first problem, by route: without cancellation, and the scalar equations as printed."""

FORWARD_FORMS = {"closed_form": None, "6x6": "reduced", "6+N": "compliance", "dae": "paper"}
"""Forms of the second problem: route and name; the first one is chosen sample by sample."""

PRINTED = Law(
    "cancellation",
    "terms of (20)-(22) and of the arms (11) cancel: half a unit in the last place of each, times the condition",
)


def _motion(row: Row) -> analytic.PlatformMotion:
    p, q, v, w, a, dw = (np.array([x], dtype=float) for x in row)
    return analytic.PlatformMotion(p, rotation(q), v, w, a, dw)


def _states(
    position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray, w: np.ndarray
) -> analytic.PlatformMotion:
    zero = np.zeros_like(position)
    return analytic.PlatformMotion(position, rotation(quaternion), velocity, w, zero, zero)


class AnalyticEngine:
    """The paper's formulas on NumPy arrays; reads no model file."""

    name: ClassVar[str] = "analytic"
    package: ClassVar[str] = "stewart-crosscheck"
    route: ClassVar[str] = "closed_form"
    checks: ClassVar[tuple[str, ...]] = ()

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        self.scene = scene
        self.backend = "numpy"
        self.gain = GAIN

    def inverse_dynamics(self, trajectory: Trajectory) -> DynamicsResult:
        """Driving forces (7), (8) and joint reactions (23)-(29)."""
        start = perf_counter()
        D = analytic.inverse_dynamics(self.scene.parameters, trajectory.motion, self.backend)
        return replace(self._inverse(D, self.backend), seconds=perf_counter() - start)

    def _inverse(self, D: analytic.InverseDynamics, setting: str) -> DynamicsResult:
        return DynamicsResult(
            engine=self.name,
            version=engine_version(type(self)) or "",
            route=self.route,
            setting=setting,
            samples=np.arange(len(D.F)),
            F=D.F,
            reactions=by_joint(self.scene, vars(D)),
            L=D.L,
            dL=D.dL,
        )

    states_nothing: ClassVar[tuple[str, ...]] = ("closed_form",)
    """Routes that are accurate, or an error: no tolerance excuses them."""
    forms: ClassVar[Mapping[str, tuple[str, ...]]] = {INVERSE: INVERSE_FORMS, FORWARD: tuple(FORWARD_FORMS)}

    def form(self, problem: str, route: str, row: Row, F: tuple[float, ...]) -> DynamicsResult | Accelerated:
        """One instant by one of the `forms`. Raises EngineError."""
        try:
            if problem == FORWARD:
                motion, form = _motion(row), FORWARD_FORMS[route]
                a = analytic.forward_dynamics(self.scene.parameters, motion, np.array([F]), form)
                growth = analytic.growth_of_rounding(self.scene.parameters, motion, form or "compliance")
                growth = float(np.maximum(growth, a.condition)[0])
                return Accelerated(np.hstack([a.ddC_p, a.dw_p]), growth, rounding_alone=True)
            if route == self.route:
                return self._inverse(analytic.inverse_dynamics(self.scene.parameters, _motion(row), self.backend), "")
            return self._printed(_motion(row))
        except (ArithmeticError, ValueError) as e:  # what the formulas raise where they have no answer
            raise EngineError(f"{self.name}: {e}") from None

    def _accelerations(self, motion: analytic.PlatformMotion, F: np.ndarray, form: str | None) -> np.ndarray:
        a = analytic.forward_dynamics(self.scene.parameters, motion, F, form)
        return np.hstack([a.ddC_p, a.dw_p])

    def _printed(self, motion: analytic.PlatformMotion) -> DynamicsResult:
        P = self.scene.parameters
        if not isinstance(P, analytic.Parameters):
            raise EngineError(f"{self.name}: the printed scalar equations are those of a spatial mechanism")
        D, rounding = analytic.inverse_dynamics_printed(P, motion)
        result = self._inverse(D, "as printed")
        off = {name: np.ones_like(getattr(result, name)) for name in ("F", "reactions")}
        off["reactions"][..., :3] = D.L.max()
        return replace(result, law=PRINTED, predicted={name: x * rounding for name, x in off.items()})

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
                how: dict[str, Any] = DAE[method.integrator][1]
                how = {"gain": self.gain} if method.integrator == BAUMGARTE else how
                s = analytic.simulate_constrained(P, initial, staged, problem.grid, staged.dt, **how)
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
        return self._accelerations(trajectory.motion, F, "compliance" if method.route == self.route else "paper")

    def growth_rates(
        self, position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray, w: np.ndarray, F: np.ndarray
    ) -> np.ndarray:
        """Rate [1/s] (nt,) at which a small error of a motion grows fastest, driving forces (nt, N) held."""
        return analytic.growth_rates(self.scene.parameters, _states(position, quaternion, velocity, w), F)

    def linearised(
        self, position: np.ndarray, quaternion: np.ndarray, velocity: np.ndarray, w: np.ndarray, F: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Equations of small deviations of a motion, ``d' = A d + B e``, world axes.

        A (nt, 12, 12) of position, turn and their rates; B (nt, 12, N) of relative changes e of the driving forces.
        """
        motion = _states(position, quaternion, velocity, w)
        A = analytic.linearised(self.scene.parameters, motion, F)
        B = np.zeros((len(F), 12, self.scene.N))
        for i in range(self.scene.N):
            ends = [self._accelerations(motion, F * (1.0 + by * np.eye(self.scene.N)[i]), None) for by in (0.5, -0.5)]
            B[:, 6:, i] = ends[0] - ends[1]
        return A, B


ENGINE = AnalyticEngine
