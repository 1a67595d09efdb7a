"""Simulation by an engine: Runge-Kutta steps on what it assembles, and its own way of going on in time.

Every engine is given the same forces at the same times and starts from the same state; what it reached, it says itself,
from its own model: pose, twist, gaps of the loops, energy.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import ClassVar, NamedTuple

import numpy as np

from ..analytic.integrate import SimulationError, integrate, require_followed
from ..models.scene import Scene
from .engine import EngineError, require_finite
from .kkt import State
from .native import SolverEngine, require_closed
from .problem import Problem, Staged
from .quaternions import times
from .trajectory import Trajectory


class Method(NamedTuple):
    """One way to integrate, a row of the results.

    ``steps`` per interval of the problem's grid; None: adaptive ones.  ``order`` of the error in the step.
    ``accelerates``: its accelerations are compared too.  ``unsupported``: why the scene has no such row.
    """

    route: str
    setting: str
    integrator: str
    steps: int | None = None
    order: int | None = None
    accelerates: bool = True
    unsupported: str = ""

    def dt(self, problem: Problem) -> float | None:
        """Step [s]."""
        return None if self.steps is None else problem.spacing / self.steps


@dataclass(frozen=True)
class Simulated:
    """Where an engine went, SI units, world axes.

    At the output times: ``position, velocity, angular_velocity`` (nt, 3) and ``quaternion`` (nt, 4) of length 1, q_w >=
    0 at first, continuous.  At the times of the problem's grid: ``kinetic, potential, work`` (n,) [J], energies and the
    work of forces and load since the start.  ``gap`` [m]: the largest of a loop.  ``seconds``: wall time.
    """

    position: np.ndarray
    quaternion: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    work: np.ndarray
    gap: float
    seconds: float

    @property
    def defect(self) -> np.ndarray:
        """Energy minus its first value minus the work done, (n,) [J]: zero for an exact solution."""
        total = self.kinetic + self.potential
        return total - total[0] - self.work


class Seen(NamedTuple):
    """What an engine's model says of some states.

    ``position`` (n, 3), ``rotation`` (n, 3, 3), ``velocity, angular_velocity`` (n, 3) of the platform, world axes;
    ``kinetic, potential`` (n,) [J].
    """

    position: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray

    @classmethod
    def empty(cls, n: int) -> Seen:
        """Arrays to fill."""
        return cls(*(np.empty((n, *shape)) for shape in ((3,), (3, 3), (3,), (3,), (), ())))


class Coordinates:
    """A state of all coordinates as one vector: the legs', C_p and a quaternion in R^4; the legs' rates, dC_p, w_p."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.n = scene, len(scene.coordinates)

    def pack(self, start: Trajectory) -> np.ndarray:
        """Vector of a trajectory's first sample."""
        q, v = ([x[name][0] for name in self.scene.coordinates] for x in (start.q, start.v))
        pose, twist = (start.position, start.unit_quaternion), (start.velocity, start.angular_velocity)
        return np.concatenate([q, *(x[0] for x in pose), v, *(x[0] for x in twist)])

    def unpack(self, t: np.ndarray, y: np.ndarray) -> Trajectory:
        """Trajectory of vectors (nt, ny), without accelerations."""
        names, own, n = self.scene.coordinates, self.scene.platform_coordinates, self.n
        q, v = y[:, : n + 7], y[:, n + 7 :]
        position, quaternion, velocity, w = q[:, n : n + 3], q[:, n + 3 :], v[:, n : n + 3], v[:, n + 3 :]
        angle = 2.0 * np.arctan2(quaternion[:, 3], quaternion[:, 0])
        zero, nan = np.zeros_like(position), np.full(len(t), np.nan)
        return Trajectory(
            t, position, quaternion, velocity, w, zero, zero,
            dict(zip(names, q.T, strict=False)) | dict(zip(own, (*position.T[:2], angle), strict=False)),
            dict(zip(names, v.T, strict=False)) | dict(zip(own, (*velocity.T[:2], w[:, 2]), strict=False)),
            dict.fromkeys((*names, *own), np.zeros(len(t))),
            condition=nan, undetermined=np.zeros(len(t), dtype=bool), sin_q_n=nan, reach=nan, source="",
        )  # fmt: skip

    def rate(self, y: np.ndarray, legs: np.ndarray, platform: np.ndarray) -> np.ndarray:
        """Derivative of a vector, from accelerations (n,) of the legs and (6,) of the platform."""
        n = self.n
        q, v = y[n + 3 : n + 7], y[n + 7 :]
        turning = 0.5 * times(np.concatenate([[0.0], v[n + 3 :]])[None], q[None])[0]
        return np.concatenate([v[: n + 3], turning, legs, platform])


class SteppingEngine(SolverEngine):
    """An engine that goes on in time on two routes; a subclass says what it assembles, sees and does by itself."""

    native_dt: ClassVar[float]
    """Larger one of two steps [s] of the engine's own way; the other is half of it."""
    native_order: ClassVar[int]
    native_integrator: ClassVar[str]
    native_setting: ClassVar[str]

    @abstractmethod
    def see(self, state: State) -> Seen:
        """What the engine's model says of states; their accelerations are not read."""

    @abstractmethod
    def own_steps(self, problem: Problem, F: Staged, steps: int) -> State:
        """States at the grid's times by the engine's own stepping, so many steps from one to the next."""

    @classmethod
    def methods(cls, problem: Problem) -> tuple[Method, ...]:
        """Both routes, each with two steps of which one is half of the other."""
        n = math.ceil(problem.spacing / cls.native_dt * (1.0 - 1e-12))
        own = (cls.forward_route, cls.native_setting, cls.native_integrator)
        return (
            *(Method(cls.route, "hard loops, unstabilised", "RK4", steps, 4) for steps in (1, 2)),
            *(Method(*own, steps, cls.native_order, accelerates=False) for steps in (n, 2 * n)),  # `run` has them
        )

    def accelerations(self, method: Method, trajectory: Trajectory, F: np.ndarray) -> np.ndarray:
        """Acceleration and angular acceleration (nt, 6) of the platform at given states, on the route `kkt`."""
        a = self.accelerate(self.state(trajectory), F)
        require_finite(self.name, a=a)
        return self.platform_acceleration(trajectory, a)

    def runge_kutta(
        self, problem: Problem, F: Staged, steps: int, accelerate: Callable[[State, np.ndarray], np.ndarray]
    ) -> State:
        """States at the grid's times by the classical method in all coordinates, the quaternion in R^4."""
        coordinates = Coordinates(self.scene)
        legs = [self.velocity_index(c) for c in self.scene.coordinates]
        hinges = {c for joint in self.scene.joints if joint.type != "prismatic" for c in joint.coordinates}
        turning = [k for k, c in enumerate(self.scene.coordinates) if c in hinges]
        names, first = [self.scene.coordinates[k] for k in turning], coordinates.n + 7

        def derivative(t: float, y: np.ndarray) -> np.ndarray:
            require_followed(t, y[first:][turning], names, problem.spacing / steps)
            motion = coordinates.unpack(np.array([t]), y[None])
            try:
                a = accelerate(self.state(motion), F(t)[None])
            except EngineError as e:
                raise EngineError(f"{e} (a stage at t = {t:.6g} s)") from None
            return coordinates.rate(y, a[0, legs], self.platform_acceleration(motion, a)[0])

        try:
            y, _ = integrate(derivative, coordinates.pack(problem.start), problem.grid, problem.spacing / steps)
        except SimulationError as e:
            raise EngineError(f"{self.name}: {e}") from None
        return self.state(coordinates.unpack(problem.grid, y))

    def simulate(self, problem: Problem, method: Method) -> Simulated:
        """The motion from the problem's start under its forces. Raises EngineError, never returns half an answer."""
        assert method.steps is not None
        from scipy.interpolate import make_interp_spline  # half a second, which `run` need not wait for

        F, at_start = Staged(problem, method.steps), self.state(problem.start)
        require_finite(self.name, q=at_start.q, v=at_start.v)
        require_closed(self.name, self.terms(at_start._replace(a=np.zeros_like(at_start.v))), at_start.v)
        start = perf_counter()
        if method.route == self.route:
            state = self.runge_kutta(problem, F, method.steps, self.accelerate)
        else:
            state = self.own_steps(problem, F, method.steps)
        seconds = perf_counter() - start
        require_finite(self.name, q=state.q, v=state.v)
        state = State(state.q, state.v, np.zeros_like(state.v))
        seen = self.see(state)
        power = np.sum(F.values[:: 2 * method.steps] * state.v[:, self.layout.actuated], axis=1)
        if load := self.scene.load:
            lever = np.einsum("tij,j->ti", seen.rotation, np.array(load.point))
            power += (seen.velocity + np.cross(seen.angular_velocity, lever)) @ load.force
            power += seen.angular_velocity @ load.moment
        spline = make_interp_spline(problem.grid, power, k=min(5, len(power) - 1))
        out = slice(None, None, problem.parts)
        return Simulated(
            position=seen.position[out],
            quaternion=continuous(seen.rotation[out]),
            velocity=seen.velocity[out],
            angular_velocity=seen.angular_velocity[out],
            kinetic=seen.kinetic,
            potential=seen.potential,
            work=spline.antiderivative()(problem.grid),
            gap=float(np.linalg.norm(self.gaps(state).gap, axis=2).max()),
            seconds=seconds,
        )


def continuous(R: np.ndarray) -> np.ndarray:
    """Unit quaternions (nt, 4), scalar first, of rotations (nt, 3, 3): q_w >= 0 at first, then without jumps."""
    from scipy.spatial.transform import Rotation

    q = Rotation.from_matrix(R).as_quat(canonical=True)[:, [3, 0, 1, 2]]
    sign = np.where(np.sum(q[1:] * q[:-1], axis=1) < 0.0, -1.0, 1.0)
    return q * np.concatenate([[1.0], np.cumprod(sign)])[:, None]
