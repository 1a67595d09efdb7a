"""DART from the URDF and the loop list: terms, then its own inverse dynamics; and its own steps in time."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, Law, ModelFacts, require_finite
from ..kkt import Assembly, Loops, State, Terms, tree_facts
from ..native import Answer, Free, Hard, in_plane
from ..problem import Problem, Staged
from ..ranges import require_version
from ..stepping import Seen, SteppingEngine
from ..time_step import defects
from ..trajectory import Trajectory
from .dart_chains import column_count, leg_axes, loop_rows
from .dart_rotation import outside_series
from .dart_world import accelerations, closed, last_steps

TIME_STEP = 1e-6
"""Of World.step, s: the error is proportional to it, and rounding of velocities, divided by it, is a hundredth yet."""

TURN = 1e-3
"""Of a hinge in one step, rad: Taylor's series of what a steep leg's forces do is far from its first term beyond."""

REDUCTION = 0.2
"""Error reduction (ERP) of simulations: the share of a gap that a step takes back. Without it gaps add up."""

MIXING = 1e-9
"""Constraint force mixing: the least that DART takes; a row yields by as much of its own J M^-1 J^T, and of 1/kg."""


class DartEngine(SteppingEngine):
    """The skeleton of the URDF, closed by the points of the loop list."""

    name: ClassVar[str] = "dart"
    package: ClassVar[str] = "dartpy"
    handles: ClassVar[tuple[str, ...]] = ("dart", "skeleton", "loops", "ends", "platform", "leg_bodies")
    objects: ClassVar[str | None] = "dartpy"
    setting: ClassVar[str] = "computeInverseDynamics"
    turns_first: ClassVar[bool] = True
    law: ClassVar[Law] = Law(
        "time_step",
        "World.step keeps J v = 0 at the pose before the step, so that two steps in a row give the acceleration of a"
        " state beside the wanted one (see `defects`); the error was measured at 1.00 times this law from 1e-3 to"
        " 1e-7 s",
    )

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import dartpy

        self.dart: Any = require_version(type(self), dartpy)
        self.scene = scene
        models = models or write_models(scene)
        closures = json.loads(models[f"{scene.name}.loops.json"])
        options = self.dart.utils.DartLoaderOptions()
        options.mDefaultRootJointType = self.dart.utils.DartLoaderRootJointType.FIXED
        loader = self.dart.utils.DartLoader()
        loader.setOptions(options)
        self.skeleton = loader.parseSkeletonString(models[f"{scene.name}.urdf"], "")
        if self.skeleton is None:
            raise EngineError(f"{self.name}: the URDF could not be read")
        self.require_nv(self.skeleton.getNumDofs())
        self.skeleton.setGravity(np.array(closures["gravity"]))
        self.loops = [
            [(self._body(loop[end]["link"]), np.array(loop[end]["point"])) for end in ("child", "parent")]
            for loop in closures["loops"]
        ]
        self.ends = [loop[end] for end in (0, 1) for loop in self.loops]
        self.platform, self.pins = self._body("platform"), np.array([pin for _, (_, pin) in self.loops])
        self.leg_bodies = [self.skeleton.getBodyNode(j.child) for j in self.tree_joints]
        self.time_step, self.reduction = TIME_STEP, REDUCTION

    def _body(self, name: str) -> Any:
        body = self.skeleton.getBodyNode(name)
        if body is None:
            raise EngineError(f"{self.name}: the URDF has no link {name!r}")
        return body

    def facts(self) -> ModelFacts:
        """URDF wants a link between two joints; DART leaves it without mass if the file says zero."""
        bodies = map(self.skeleton.getBodyNode, range(self.skeleton.getNumBodyNodes()))
        return tree_facts({b.getName(): b.getMass() for b in bodies}, self.skeleton.getNumDofs(), self.scene.nc)

    def velocity_index(self, coordinate: str) -> int:
        """Index of a joint coordinate in the skeleton."""
        return self.skeleton.getJoint(coordinate).getIndexInSkeleton(0)

    def state(self, trajectory: Trajectory) -> State:
        """A free joint: rotation vector, then position; velocities and accelerations angular, linear, in world axes."""
        nt, nv = len(trajectory.t), self.skeleton.getNumDofs()
        q, v, a = np.zeros((nt, nv)), np.zeros((nt, nv)), np.zeros((nt, nv))
        own = self.scene.platform_coordinates
        index = {name: self.velocity_index(name) for name in self.scene.coordinates}
        if self.scene.freedom == "planar":  # one joint of three coordinates, world axes
            index |= {name: self.velocity_index("platform") + n for n, name in enumerate(own)}
        else:
            index |= {name: self.velocity_index(name) for name in own}
        for name, j in index.items():
            q[:, j], v[:, j], a[:, j] = trajectory.q[name], trajectory.v[name], trajectory.a[name]
        if self.scene.freedom != "spatial":
            return State(q, v, a)
        j = self.velocity_index("platform")
        for k, (R, p) in enumerate(zip(trajectory.rotation, trajectory.position, strict=True)):
            T = self.dart.math.Isometry3()
            T.set_rotation(R)
            T.set_translation(p)
            q[k, j : j + 6] = self.dart.dynamics.FreeJoint.convertToPositions(T)
        q[:, j : j + 3] = outside_series(q[:, j : j + 3])
        v[:, j : j + 6] = np.hstack([trajectory.angular_velocity, trajectory.velocity])
        a[:, j : j + 6] = np.hstack([trajectory.angular_acceleration, trajectory.acceleration])
        return State(q, v, a)

    def assemble(self, state: State, with_tree: bool = False) -> Assembly:
        """``computeInverseDynamics`` under the load, Jacobians of the loop points, ``getBodyForce`` of leg bodies."""
        sk, scene, n = self.skeleton, self.scene, len(state.q)
        body_forces = [body.getBodyForce for body in self.leg_bodies] if with_tree else []
        tau, force = np.empty((n, scene.nv)), np.empty((n, 6 * len(body_forces)))
        jacobians, world = [(body.getJacobian, point) for body, point in self.ends], self.dart.dynamics.Frame.World()
        columns = np.empty((n, 6, column_count(scene)))
        inverse_dynamics, forces = sk.computeInverseDynamics, sk.getForces
        sk.clearExternalForces()
        for k in self._each(state):
            if scene.load:
                sk.clearExternalForces()  # they add up
                self._push_load()
            inverse_dynamics(True, False, False)  # with external forces; by default they are left out
            tau[k] = forces()
            np.concatenate([jacobian(point, world) for jacobian, point in jacobians], axis=1, out=columns[k])
            if with_tree:
                np.concatenate([body_force() for body_force in body_forces], out=force[k])
        J = loop_rows(scene, self.layout, columns[:, 3:])
        if not with_tree:
            return Assembly(tau, J)
        R, lever = leg_axes(scene, columns, np.array([tip for _, tip in self.ends[: scene.N]]))
        return Assembly(tau, J, wrench.from_dart(force.reshape(n, -1, 6), R), lever)

    def gaps(self, state: State) -> Loops:
        """Positions, velocities and accelerations of the loop points."""
        sk, scene, out = self.skeleton, self.scene, Loops.empty(len(state.q), self.scene.N)
        hulls = [sk.getJoint(c).getTransformFromParentBodyNode().translation() for c in scene.hull_coordinates]
        N, rods = scene.N, self.ends[: scene.N]
        for k in self._each(state):
            at = np.array([body.getWorldTransform().multiply(point) for body, point in self.ends])
            acceleration = np.array([body.getLinearAcceleration(point) for body, point in self.ends])
            out.gap[k], out.gap_acceleration[k] = at[:N] - at[N:], acceleration[:N] - acceleration[N:]
            axis = at[:N] - hulls
            out.L[k] = np.sqrt(np.einsum("ia,ia->i", axis, axis))
            out.dL[k] = np.einsum("ia,ia->i", axis, [rod.getLinearVelocity(tip) for rod, tip in rods]) / out.L[k]
        return out

    def free(self, state: State) -> Free:
        """``getMassMatrix``, `assemble` at a = 0, derivatives of the Jacobians."""
        sk, scene, n = self.skeleton, self.scene, len(state.q)
        state = state._replace(a=np.zeros_like(state.v))
        h, J, *_ = self.assemble(state)
        M, columns = np.empty((n, scene.nv, scene.nv)), np.empty((n, 3, column_count(scene)))
        derivatives, world = [(b.getLinearJacobianDeriv, p) for b, p in self.ends], self.dart.dynamics.Frame.World()
        for k in self._each(state):
            M[k] = sk.getMassMatrix()
            np.concatenate([derivative(point, world) for derivative, point in derivatives], axis=1, out=columns[k])
        return Free(M, h, J, np.einsum("tij,tj->ti", loop_rows(scene, self.layout, columns), state.v))

    @property
    def forward_setting(self) -> str:
        """The second of two steps."""
        return f"World.step, BallJointConstraint, second of two steps, dt {self.time_step:g} s, ERP 0, CFM {MIXING:g}"

    def answer(self, state: State, terms: Terms, F: np.ndarray, hard: Hard) -> Answer:
        """`own_solution`, and the loop forces that its second step leaves behind."""
        sk, scene, dt = self.skeleton, self.scene, self.time_step
        rods, axes = [ends[0] for ends in self.loops], list(scene.loop_axes)
        of_tree = np.array([sk.getDof(d).getTreeIndex() for d in range(sk.getNumDofs())])
        a, loop_forces = np.empty_like(state.v), np.zeros((len(F), scene.N, 3))
        with closed(self, state, dt, 0.0, MIXING) as world:
            for k in last_steps(self, world, state, self._driving(F)):
                R = [rod.getWorldTransform().rotation() for rod, _ in rods]
                world.step(True)
                a[k] = accelerations(self, k)
                for i, (rod, tip) in enumerate(rods):
                    # DART gives J^T lambda alone, leg by leg, and as it stands at the new pose, turned with the rod.
                    tree = rod.getTreeIndex()
                    J = sk.getLinearJacobian(rod, tip)[axes][:, of_tree == tree]
                    force_W = np.zeros(3)
                    force_W[axes] = np.linalg.solve(J.T, sk.getConstraintForces(tree))
                    loop_forces[k, i] = R[i] @ rod.getWorldTransform().rotation().T @ force_W
        # Velocities are rounded before they are divided by the time step; accelerations may be far below them.
        slow_down = max(1.0, float(np.abs(state.v).max() / max(np.abs(hard.a).max(), np.finfo(float).tiny)))
        left = defects(self, state, terms, hard, dt, MIXING)
        hinges = [self.velocity_index(c) for c in scene.coordinates if not c.startswith("s")]
        slow = np.abs(state.v[:, hinges]).max(axis=1) * dt < TURN
        return Answer(a, loop_forces, *left, condition=slow_down / dt, valid=slow)

    def own_solution(self, state: State, F: np.ndarray) -> np.ndarray:
        """Accelerations of the second of two ``World.step``."""
        a = np.empty_like(state.v)
        with closed(self, state, self.time_step, 0.0, MIXING) as world:
            for k in last_steps(self, world, state, self._driving(F)):
                world.step(True)
                a[k] = accelerations(self, k)
        return a

    def _driving(self, F: np.ndarray) -> np.ndarray:
        """Generalized forces (nt, nv) of driving forces: DART takes accelerations of zero for what is not finite."""
        require_finite(self.name, F=F)
        return F @ self.layout.pushes[0].T

    def push(self, tau: np.ndarray) -> None:
        """Forces and load of the next step, which clears them."""
        self.skeleton.setForces(tau)
        self._push_load()

    def _push_load(self) -> None:
        if load := self.scene.load:
            self.platform.addExtForce(np.array(load.force), np.array(load.point), False, True)
            self.platform.addExtTorque(np.array(load.moment), False)

    def see(self, state: State) -> Seen:
        """Transform and velocity of the platform, ``computeKineticEnergy``, ``computePotentialEnergy``."""
        sk, platform = self.skeleton, self.platform
        out = Seen.empty(len(state.q))
        for k in self._each(state):
            T = platform.getWorldTransform()
            out.position[k], out.rotation[k] = T.translation(), T.rotation()
            out.velocity[k], out.angular_velocity[k] = platform.getLinearVelocity(), platform.getAngularVelocity()
            out.kinetic[k], out.potential[k] = sk.computeKineticEnergy(), sk.computePotentialEnergy()
        return out

    native_dt, native_order = 4e-4, 1
    native_integrator = "World.step"
    native_setting = f"BallJointConstraint, ERP {REDUCTION:g}, CFM {MIXING:g}, F of the middle of a step"

    def own_steps(self, problem: Problem, F: Staged, steps: int) -> State:
        """``World.step``, semi-implicit Euler.

        A step projects the velocity onto J v = 0 at the pose before it: what the first one makes of a velocity that is
        consistent at this pose, or one step earlier, is the same.
        """
        sk, start, tau = self.skeleton, self.state(problem.start), np.zeros(self.scene.nv)
        n, actuated = len(problem.grid), self.layout.actuated
        q, v = np.empty((2, n, self.scene.nv))
        with closed(self, start, F.dt, self.reduction, MIXING) as world:
            for k in range(n):
                q[k], v[k] = sk.getPositions(), sk.getVelocities()
                for step in range(steps if k < n - 1 else 0):
                    tau[actuated] = F.values[2 * (k * steps + step) + 1]
                    self.push(tau)
                    world.step(True)
                accelerations(self, k)
        return State(q, v, np.zeros_like(v))

    def moved(self, q: np.ndarray, v: np.ndarray, step: float) -> np.ndarray:
        """Positions after so many seconds at velocities (nt, nv)."""
        state, out = State(q, v, np.zeros_like(v)), np.empty_like(q)
        for k in range(len(out)):
            self.set(state, k)
            self.skeleton.integratePositions(step)
            out[k] = self.skeleton.getPositions()
        return out

    def in_world(self, x: np.ndarray) -> np.ndarray:
        """Linear and angular part (nt, 6) of the platform's velocities or accelerations, which are in world axes."""
        j = self.velocity_index(self.scene.platform_coordinates[0] if self.scene.freedom == "point" else "platform")
        if self.scene.freedom != "spatial":
            return in_plane(x[:, j : j + self.scene.platform_equations])
        return np.hstack([x[:, j + 3 : j + 6], x[:, j : j + 3]])

    def platform_acceleration(self, trajectory: Trajectory, a: np.ndarray) -> np.ndarray:
        """A free joint accelerates in world axes."""
        return self.in_world(a)

    def _each(self, state: State) -> Iterator[int]:
        """Number of every sample, after its state is set; DART only prints when it refuses one: it is read back.

        Of an angle or a length that is not finite DART makes the identity.
        """
        require_finite(self.name, q=state.q)
        sk, held = self.skeleton, State(*(np.empty_like(x) for x in state))
        for k in range(len(state.q)):
            self.set(state, k)
            held.q[k], held.v[k], held.a[k] = sk.getPositions(), sk.getVelocities(), sk.getAccelerations()
            yield k
        for got, want in zip(held, state, strict=True):
            if (wrong := got != want).any():
                raise EngineError(f"{self.name}: refused the state of sample {np.argwhere(wrong)[0][0]}")

    def set(self, state: State, k: int) -> None:
        """State of one sample."""
        sk = self.skeleton
        for put, x in zip((sk.setPositions, sk.setVelocities, sk.setAccelerations), state, strict=True):
            put(x[k])


ENGINE = DartEngine
