"""Pinocchio from the URDF and the loop list: `rnea` and frame Jacobians; and its own `constraintDynamics`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, Law, ModelFacts
from ..kkt import Assembly, Loops, State, Terms, tree_facts
from ..native import Answer, Free, Hard, in_plane
from ..problem import Problem, Staged
from ..ranges import require_version
from ..stepping import Seen, SteppingEngine
from ..trajectory import Trajectory

MU, ITERATIONS = 1e-10, 5
"""Proximal parameter (1/kg) and steps. mu = 0 is exact in space and NaN in a plane, whose loops have a zero row."""


class PinocchioEngine(SteppingEngine):
    """The tree of the URDF, closed by the points of the loop list."""

    name: ClassVar[str] = "pinocchio"
    package: ClassVar[str] = "pin"
    handles: ClassVar[tuple[str, ...]] = ("pin",)
    objects: ClassVar[str | None] = None
    setting: ClassVar[str] = "rnea"
    law: ClassVar[Law] = Law(
        "proximal",
        "step n solves (A + mu) lambda_n = b + mu lambda_(n-1) from lambda_0 = 0 with A = J M^-1 J^T, so that"
        " (mu (A + mu)^-1)^n lambda is left; the error was measured at 1.000 times this law from mu = 1e-2 to 1e-12,"
        " down to rounding",
    )

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import pinocchio as pin

        self.pin: Any = require_version(type(self), pin)
        self.scene = scene
        models = models or write_models(scene)
        closures = json.loads(models[f"{scene.name}.loops.json"])
        self.model = pin.buildModelFromXML(models[f"{scene.name}.urdf"])
        self.model.gravity.linear = np.array(closures["gravity"])
        self.require_nv(self.model.nv)
        self.loops = [
            tuple(self._add_frame(loop["name"], loop[end]) for end in ("child", "parent")) for loop in closures["loops"]
        ]
        self.platform = self.model.getJointId("platform_y" if scene.freedom == "point" else "platform")
        self.data = self.model.createData()
        self.mu, self.iterations = MU, ITERATIONS
        self.closures, self.closure_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for tip, pinned in ([self.model.frames[f] for f in ends] for ends in self.loops):
            ends = (tip.parentJoint, tip.placement, pinned.parentJoint, pinned.placement)
            world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            self.closures.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self.model, *ends, world))
            self.closure_data.append(self.closures[-1].createData())
        self.solver_data = self.model.createData()
        pin.initConstraintDynamics(self.model, self.solver_data, self.closures, self.closure_data)

    def _add_frame(self, loop: str, end: Mapping[str, Any]) -> int:
        """One end of a loop: a point of a link, with the axes of its joint."""
        pin, model = self.pin, self.model
        if not model.existFrame(end["link"], pin.FrameType.BODY):
            raise EngineError(f"{self.name}: the URDF has no link {end['link']!r} that the loop list names")
        link = model.frames[model.getFrameId(end["link"], pin.FrameType.BODY)]
        placement = link.placement * pin.SE3(np.eye(3), np.array(end["point"]))
        return model.addFrame(
            pin.Frame(f"{loop}.{end['link']}", link.parentJoint, placement, pin.FrameType.OP_FRAME), False
        )

    def facts(self) -> ModelFacts:
        """URDF wants a link between two joints; its zero mass stays zero."""
        m = self.model
        masses = {m.names[j]: m.inertias[j].mass for j in range(1, m.njoints)}
        return tree_facts(masses, m.nv, self.scene.nc)

    def velocity_index(self, coordinate: str) -> int:
        """Index of a joint coordinate in v."""
        return self.model.joints[self.model.getJointId(coordinate)].idx_v

    def _scalar_coordinates(self) -> tuple[str, ...]:
        """Coordinates with a joint of their own: those of a planar platform share one."""
        scene = self.scene
        return (*scene.coordinates, *(scene.platform_coordinates if scene.freedom == "point" else ()))

    def state(self, trajectory: Trajectory) -> State:
        """Quaternion scalar last; a free flyer's twist and acceleration are spatial, in body axes."""
        m = self.model
        nt = len(trajectory.t)
        q, v, a = np.zeros((nt, m.nq)), np.zeros((nt, m.nv)), np.zeros((nt, m.nv))
        for name in self._scalar_coordinates():
            i, j = m.joints[m.getJointId(name)].idx_q, self.velocity_index(name)
            q[:, i], v[:, j], a[:, j] = trajectory.q[name], trajectory.v[name], trajectory.a[name]
        if self.scene.freedom == "point":
            return State(q, v, a)
        i, j = m.joints[self.platform].idx_q, self.velocity_index("platform")
        spatial = trajectory.acceleration - np.cross(trajectory.angular_velocity, trajectory.velocity)
        if self.scene.freedom == "planar":  # position, cosine and sine; the same twist, without what is zero
            q[:, i : i + 2], q[:, i + 2 : i + 4] = trajectory.position[:, :2], trajectory.rotation[:, :2, 0]
            for x, linear, angular in (
                (v, trajectory.velocity, trajectory.angular_velocity),
                (a, spatial, trajectory.angular_acceleration),
            ):
                x[:, j : j + 2], x[:, j + 2] = trajectory.in_body(linear)[:, :2], angular[:, 2]
            return State(q, v, a)
        q[:, i : i + 3], q[:, i + 3 : i + 7] = trajectory.position, trajectory.unit_quaternion[:, [1, 2, 3, 0]]
        v[:, j : j + 3], v[:, j + 3 : j + 6] = (
            trajectory.in_body(x) for x in (trajectory.velocity, trajectory.angular_velocity)
        )
        a[:, j : j + 3], a[:, j + 3 : j + 6] = (
            trajectory.in_body(x) for x in (spatial, trajectory.angular_acceleration)
        )
        return State(q, v, a)

    def assemble(self, state: State, with_tree: bool = False) -> Assembly:
        """``rnea`` under the load and its ``data.f``; the loop points' rows of ``data.J``."""
        pin, m, d, scene = self.pin, self.model, self.data, self.scene
        n, nl = len(state.q), len(self.tree_joints)
        tau, columns, points = np.empty((n, m.nv)), np.empty((n, 6, m.nv)), np.empty((n, 2, scene.N, 3))
        force, at, R = np.empty((n, nl, 6)), np.empty((n, nl, 3)), np.empty((n, nl, 3, 3))
        kept = (points.reshape(n, -1), force.reshape(n, -1), at.reshape(n, -1), R.reshape(n, -1, 3))
        seen = self._views[: 4 if with_tree else 1]
        rnea, jacobians, placements, J = pin.rnea, pin.computeJointJacobians, pin.updateFramePlacements, d.J
        for k, (q, v, a) in enumerate(zip(*state, strict=True)):
            jacobians(m, d, q)
            placements(m, d)
            tau[k] = rnea(m, d, q, v, a, self._load()) if scene.load else rnea(m, d, q, v, a)
            columns[k] = J
            for views, out in zip(seen, kept, strict=False):
                np.concatenate(views, out=out[k])
        end, leg, moving = self._chains
        sign = 1.0 - 2.0 * end
        last, at_last = columns.transpose(1, 2, 0), points.transpose(1, 2, 3, 0)  # products of short axes are slow
        of_ends = wrench.rows_of_point(last[:, moving], at_last[end, leg].transpose(1, 0, 2)) * sign[:, None]
        J = np.zeros((n, scene.N, len(scene.loop_axes), m.nv))
        J[:, leg, :, moving] = of_ends[: J.shape[2]].transpose(1, 2, 0)
        J = J.reshape(n, -1, m.nv)
        if not with_tree:
            return Assembly(tau, J)
        return Assembly(tau, J, wrench.from_pinocchio(force, R), points[:, 0, self.tree_legs] - at)

    @cached_property
    def _views(self) -> tuple[list[np.ndarray], ...]:
        """What Pinocchio writes: loops' ends, rods' first; force, origin and axes of every joint in the tree."""
        m, d = self.model, self.data
        index = [m.getJointId(j.coordinates[-1]) for j in self.tree_joints]
        return (
            [d.oMf[ends[e]].translation for e in (0, 1) for ends in self.loops],
            [d.f[j].vector for j in index],
            [d.oMi[j].translation for j in index],
            [d.oMi[j].rotation for j in index],
        )

    @cached_property
    def _chains(self) -> np.ndarray:
        """Columns (3, n): which end of which loop (from 0) moves with which velocity."""
        m, chains = self.model, []
        for leg, ends in enumerate(self.loops):
            for end, frame in enumerate(ends):
                joints = [m.joints[j] for j in m.supports[m.frames[frame].parentJoint] if j]
                chains += [(end, leg, j.idx_v + n) for j in joints for n in range(j.nv)]
        return np.array(chains).T

    def _kinematics(self, state: State) -> Iterator[tuple[int, list[np.ndarray]]]:
        """Number of every sample, and the classical accelerations of the loops' ends, tip and pin by turns."""
        pin, m, d = self.pin, self.model, self.data
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        frames = [f for ends in self.loops for f in ends]
        for k, (q, v, a) in enumerate(zip(*state, strict=True)):
            pin.forwardKinematics(m, d, q, v, a)
            pin.updateFramePlacements(m, d)
            yield k, [pin.getFrameClassicalAcceleration(m, d, f, world).linear for f in frames]

    def gaps(self, state: State) -> Loops:
        """Placements, velocities and classical accelerations of the loop points."""
        pin, m, d, scene = self.pin, self.model, self.data, self.scene
        out = Loops.empty(len(state.q), scene.N)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        tips, pins = ([d.oMf[ends[e]].translation for ends in self.loops] for e in (0, 1))
        hulls = [d.oMi[m.getJointId(c)].translation for c in scene.hull_coordinates]
        for k, accelerations in self._kinematics(state):
            velocity = [pin.getFrameVelocity(m, d, tip, world).linear for tip, _ in self.loops]
            at = np.array(tips)
            out.gap[k] = at - pins
            out.gap_acceleration[k] = np.subtract(accelerations[::2], accelerations[1::2])
            axis = at - hulls
            out.L[k] = np.sqrt(np.einsum("ia,ia->i", axis, axis))
            out.dL[k] = np.einsum("ia,ia->i", axis, velocity) / out.L[k]
        return out

    def free(self, state: State) -> Free:
        """``crba``, which fills the upper triangle, `assemble` and classical accelerations, both at a = 0."""
        pin, m, d, scene = self.pin, self.model, self.data, self.scene
        state = state._replace(a=np.zeros_like(state.v))
        h, J, *_ = self.assemble(state)
        M, drift = np.empty((*h.shape, m.nv)), np.empty((len(h), scene.N, 2, 3))
        for k, accelerations in self._kinematics(state):
            np.concatenate(accelerations, out=drift[k].reshape(-1))
            M[k] = pin.crba(m, d, state.q[k])
        M = np.triu(M) + np.triu(M, 1).transpose(0, 2, 1)
        drift = drift[:, :, 0] - drift[:, :, 1]
        return Free(M, h, J, drift[..., : len(scene.loop_axes)].reshape(len(h), scene.nc))

    @property
    def forward_setting(self) -> str:
        """No accuracy stops the steps before rounding does."""
        return f"constraintDynamics, CONTACT_3D, mu {self.mu:g}, {self.iterations} iterations"

    def answer(self, state: State, terms: Terms, F: np.ndarray, hard: Hard) -> Answer:
        """``constraintDynamics`` under driving forces and load, both as generalized forces."""
        a, loop_forces = np.empty_like(state.v), np.empty((len(F), self.scene.N, 3))
        for k, answer in enumerate(self._solved(state, F)):
            a[k], loop_forces[k] = answer, [loop.contact_force.linear for loop in self.closure_data]
        mu = self.mu * np.eye(self.scene.nc)
        shrink, left = np.linalg.solve(hard.A + mu, mu), hard.multipliers[..., None]
        for _ in range(self.iterations):
            left = shrink @ left
        return Answer(a, loop_forces, np.zeros_like(a), -(hard.A @ left)[..., 0])

    def own_solution(self, state: State, F: np.ndarray) -> np.ndarray:
        """What ``constraintDynamics`` returns."""
        a = np.empty_like(state.v)
        for k, answer in enumerate(self._solved(state, F)):
            a[k] = answer
        return a

    def _solved(self, state: State, F: np.ndarray) -> Iterator[np.ndarray]:
        """Accelerations (nv,) of ``constraintDynamics``, sample by sample."""
        pin, m, d, loops = self.pin, self.model, self.solver_data, (self.closures, self.closure_data)
        tau = np.zeros_like(state.v)
        tau[:, self.layout.actuated] = F
        solve, steps = pin.constraintDynamics, pin.ProximalSettings(0.0, self.mu, self.iterations)
        for q, v, forces in zip(state.q, state.v, tau, strict=True):
            if self.scene.load:
                pin.computeJointJacobians(m, self.data, q)
                J = pin.getJointJacobian(m, self.data, self.platform, pin.ReferenceFrame.LOCAL)
                forces += J.T @ self._load()[self.platform].vector
            yield solve(m, d, q, v, forces, *loops, steps)

    def platform_acceleration(self, trajectory: Trajectory, a: np.ndarray) -> np.ndarray:
        """From spatial, in body axes, to the acceleration of the point in world axes."""
        if self.scene.freedom == "point":
            return in_plane(a[:, [self.velocity_index(name) for name in self.scene.platform_coordinates]])
        j = self.velocity_index("platform")
        linear, angular = np.zeros((2, len(a), 3))
        if self.scene.freedom == "planar":
            linear[:, :2], angular[:, 2] = a[:, j : j + 2], a[:, j + 2]
        else:
            linear, angular = a[:, j : j + 3], a[:, j + 3 : j + 6]
        linear, angular = (np.einsum("tij,tj->ti", trajectory.rotation, x) for x in (linear, angular))
        return np.hstack([linear + np.cross(trajectory.angular_velocity, trajectory.velocity), angular])

    def see(self, state: State) -> Seen:
        """Placement and velocity of the platform's joint, ``computeKineticEnergy``, ``computePotentialEnergy``."""
        pin, m, d = self.pin, self.model, self.data
        out = Seen.empty(len(state.q))
        for k, (q, v) in enumerate(zip(state.q, state.v, strict=True)):
            out.kinetic[k] = pin.computeKineticEnergy(m, d, q, v)
            out.potential[k] = pin.computePotentialEnergy(m, d, q)
            at = d.oMi[self.platform]
            twist = pin.getVelocity(m, d, self.platform, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            out.position[k], out.rotation[k] = at.translation, at.rotation
            out.velocity[k], out.angular_velocity[k] = twist.linear, twist.angular
        return out

    native_dt, native_order = 4e-3, 4
    native_integrator = "RK4"
    native_setting = f"constraintDynamics, mu {MU:g}, {ITERATIONS} iterations; steps not Pinocchio's, it has none"

    def own_steps(self, problem: Problem, F: Staged, steps: int) -> State:
        """Pinocchio has no steps in time: its solver at the stages of ours."""
        return self.runge_kutta(problem, F, steps, self.solved)

    def _load(self) -> Any:
        """Outside forces of the scene's load; the placement of the platform must be current."""
        outside, load = self.pin.StdVec_Force(self.model.njoints, self.pin.Force.Zero()), self.scene.load
        if load:
            force, moment, point = (np.array(x) for x in (load.force, load.moment, load.point))
            self._push(outside, self.platform, point, force, moment)
        return outside

    def _push(self, outside: Any, joint: int, point: np.ndarray, force_W: np.ndarray, moment_W: np.ndarray) -> None:
        """Add a force at a point (joint axes) and a moment to the outside forces. Joint placements must be current."""
        R = self.data.oMi[joint].rotation
        outside[joint] += self.pin.Force(*wrench.to_pinocchio(force_W, moment_W, point, R))


ENGINE = PinocchioEngine
