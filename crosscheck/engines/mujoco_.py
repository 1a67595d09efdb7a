"""MuJoCo from the MJCF: assembler of M, h and J, then its own recursive Newton-Euler; and its own soft loops.

Its inverse dynamics does not see hard loops; what it assembles is exact to rounding.  ``mj_forward`` softens them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.mjcf import FLOOR
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, Law, ModelFacts
from ..kkt import Assembly, Loops, State, Terms
from ..native import Answer, Free, Hard, in_plane
from ..problem import Problem, Staged
from ..ranges import require_version
from ..stepping import Seen, SteppingEngine
from ..trajectory import Trajectory
from .mujoco_steps import forward, only, own_steps, require_connected, require_motors

IMPEDANCE = 0.9999
"""Both ends of solimp: the hardest loops that MuJoCo does not clamp (mjMAXIMP)."""

TOLERANCE = 1e-15
"""Of the Newton solver: its one step is exact here, as no loop can open or slip; 0 would repeat it a hundred times."""

INTEGRATOR, TIME_CONSTANT = "RK4", 2.0
"""Of `own_steps`: one of mjtIntegrator, and of solref, in steps: the least that MuJoCo takes."""


class MujocoEngine(SteppingEngine):
    """Terms from ``mj_rne`` and ``efc_J``, reactions from ``mj_rnePostConstraint``; loops: `connect` between sites."""

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    handles: ClassVar[tuple[str, ...]] = ("mj",)
    objects: ClassVar[str | None] = None
    setting: ClassVar[str] = "mj_rne, mj_rnePostConstraint"
    inertia_floor: ClassVar[float] = FLOOR
    law: ClassVar[Law] = Law(
        "softness",
        "a row is softened by R, (1 - d)/d times what MuJoCo takes for J M^-1 J^T at the impedance d: the loops"
        " accelerate by -R lambda, and by what pulls their rounded gaps together; the error was measured at 1.000 times"
        " this law from d = 0.9 to 0.9999",
    )

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import mujoco

        self.mj: Any = require_version(type(self), mujoco)
        self.scene = scene
        try:
            self.model = mujoco.MjModel.from_xml_string((models or write_models(scene))[f"{scene.name}.xml"])
        except ValueError as e:
            raise EngineError(f"{self.name}: the MJCF is refused: {e}") from None
        self.model.body_sameframe[:] = self.model.site_sameframe[:] = 0  # else offsets below 1e-6 m count as zero
        self.data = mujoco.MjData(self.model)
        self.require_nv(self.model.nv)
        self.tips, self.pins = ([self.model.site(f"{kind}{i}").id for i in scene.legs] for kind in ("tip", "pin"))
        self.platform = self.model.body("platform").id
        self.motors = [self.model.actuator(f"F{i}").id for i in scene.legs]
        self.soft_model = copy.copy(self.model)  # the MJCF has MuJoCo's defaults
        self.soft_data = mujoco.MjData(self.soft_model)
        self.impedance, self.tolerance = IMPEDANCE, TOLERANCE
        self.integrator, self.time_constant = INTEGRATOR, TIME_CONSTANT
        require_connected(self)
        require_motors(self)

    def facts(self) -> ModelFacts:
        """MuJoCo wants inertia about every axis, and closes a loop by three rows in a plane too."""
        m, scene = self.model, self.scene
        floors = []
        if count := int((m.body_inertia[1:] <= FLOOR).any(axis=1).sum()):
            floors.append(f"{FLOOR:g} kg m^2 in place of a zero moment of inertia, bodies: {count}")
        rows = 3 * m.neq
        if rows > scene.nc:
            floors.append(f"loop rows along z_r, zero and left out: {rows - scene.nc} of {rows}")
        return ModelFacts(m.nbody - 1, 0, m.nv, rows, float(m.body_mass.sum()), tuple(floors))

    def velocity_index(self, coordinate: str) -> int:
        """Index of a joint coordinate in qvel."""
        return int(self.model.joint(coordinate).dofadr[0])

    def state(self, trajectory: Trajectory) -> State:
        """Quaternion scalar first; a free joint moves in world axes and turns in body axes."""
        m = self.model
        nt = len(trajectory.t)
        q, v, a = np.zeros((nt, m.nq)), np.zeros((nt, m.nv)), np.zeros((nt, m.nv))
        for name in (*self.scene.coordinates, *self.scene.platform_coordinates):
            i, j = int(m.joint(name).qposadr[0]), self.velocity_index(name)
            q[:, i], v[:, j], a[:, j] = trajectory.q[name], trajectory.v[name], trajectory.a[name]
        if self.scene.freedom != "spatial":
            return State(q, v, a)
        i, j = int(m.joint("platform").qposadr[0]), self.velocity_index("platform")
        q[:, i : i + 3], q[:, i + 3 : i + 7] = trajectory.position, trajectory.unit_quaternion
        v[:, j : j + 3], v[:, j + 3 : j + 6] = trajectory.velocity, trajectory.in_body(trajectory.angular_velocity)
        a[:, j : j + 3] = trajectory.acceleration
        a[:, j + 3 : j + 6] = trajectory.in_body(trajectory.angular_acceleration)
        return State(q, v, a)

    def assemble(self, state: State, with_tree: bool = False) -> Assembly:
        """``mj_rne`` and ``efc_J``; ``cfrc_int`` of every leg body, with zeros for MuJoCo's soft loop forces."""
        mj, m, d, scene = self.mj, self.model, self.data, self.scene
        rne_post, n = mj.mj_rnePostConstraint, len(state.q)
        tau, J = np.empty((n, m.nv)), np.empty((n, 3 * scene.N * m.nv))
        seen = [d.cfrc_int, d.subtree_com, d.xipos, d.xanchor, d.site_xpos] if with_tree else []
        copies = [np.empty((n, *x.shape)) for x in seen]
        for k in self._each(state):
            mj.mj_rne(m, d, 1, tau[k])
            if scene.load:
                tau[k] -= self.load(d)
            J[k] = d.efc_J
            if with_tree:
                d.efc_force[:] = 0.0
                rne_post(m, d)
                for copy_, x in zip(copies, seen, strict=True):
                    copy_[k] = x
        J = J.reshape(n, scene.N, 3, m.nv)[:, :, : len(scene.loop_axes)].reshape(n, scene.nc, m.nv)
        if not with_tree:
            return Assembly(tau, J)
        cfrc, com, xipos, xanchor, site = copies
        bodies, anchors, slides, tips = self._tree
        point = np.where(slides, xipos[:, bodies], xanchor[:, anchors])
        lever = site[:, tips] - point
        return Assembly(tau, J, wrench.from_mujoco(cfrc[:, bodies], com[:, m.body_rootid[bodies]], point), lever)

    @cached_property
    def _tree(self) -> tuple[np.ndarray, ...]:
        """Of every joint in the tree: numbers of its child and of its first coordinate, if it slides, rod's tip."""
        m, joints = self.model, self.tree_joints
        anchors, slides = [m.joint(j.coordinates[0]).id for j in joints], [[j.type == "prismatic"] for j in joints]
        tips = [self.tips[leg] for leg in self.tree_legs]
        return np.array([m.body(j.child).id for j in joints]), np.array(anchors), np.array(slides), np.array(tips)

    def gaps(self, state: State) -> Loops:
        """Positions, velocities and accelerations of the sites."""
        mj, m, d, scene = self.mj, self.model, self.data, self.scene
        out = Loops.empty(len(state.q), scene.N)
        anchors = [m.joint(c).id for c in scene.hull_coordinates]
        velocity, ends = np.empty((scene.N, 6)), np.empty((2, scene.N, 6))
        site, pairs = mj.mjtObj.mjOBJ_SITE, tuple(zip((self.tips, self.pins), ends, strict=True))
        for k in self._each(state):
            mj.mj_rnePostConstraint(m, d)  # accelerations of the bodies; they do not depend on forces
            for sites, accelerations in pairs:
                for i, s in enumerate(sites):
                    mj.mj_objectAcceleration(m, d, site, s, accelerations[i], 0)
            for i, s in enumerate(self.tips):
                mj.mj_objectVelocity(m, d, site, s, velocity[i], 0)
            tips = d.site_xpos[self.tips]
            out.gap[k] = tips - d.site_xpos[self.pins]
            out.gap_acceleration[k] = ends[0, :, 3:] - ends[1, :, 3:]
            axis = tips - d.xanchor[anchors]
            out.L[k] = np.sqrt(np.einsum("ia,ia->i", axis, axis))
            out.dL[k] = np.einsum("ia,ia->i", axis, velocity[:, 3:]) / out.L[k]
        return out

    def free(self, state: State) -> Free:
        """``mj_fullM``, ``mj_rne``; dJ v is a part of ``efc_aref``."""
        mj, m, d, scene = self.mj, self.model, self.data, self.scene
        n, nc = len(state.q), 3 * scene.N
        M, h, J = np.empty((n, m.nv, m.nv)), np.empty((n, m.nv)), np.empty((n, nc * m.nv))
        aref, pos, vel, kbip = np.empty((n, nc)), np.empty((n, nc)), np.empty((n, nc)), np.empty((n, nc * 4))
        for k in self._each(state):
            mj.mj_rne(m, d, 0, h[k])
            if scene.load:
                h[k] -= self.load(d)
            mj.mj_makeM(m, d)
            mj.mj_fullM(m, d, M[k])
            mj.mj_referenceConstraint(m, d)
            J[k], aref[k], pos[k], vel[k] = d.efc_J, d.efc_aref, d.efc_pos, d.efc_vel
            kbip[k] = d.efc_KBIP.ravel()
        stiffness, damping, impedance, _ = np.moveaxis(kbip.reshape(n, nc, 4), 2, 0)
        drift = -(aref + damping * vel + stiffness * impedance * pos)
        rows = [3 * i + axis for i in range(scene.N) for axis in scene.loop_axes]
        return Free(M, h, J.reshape(n, nc, m.nv)[:, rows], drift[:, rows])

    @property
    def forward_setting(self) -> str:
        """On a copy of the model: the MJCF has MuJoCo's defaults."""
        return f"mj_forward, Newton, tolerance {self.tolerance:g}, solimp {self.impedance:g}, solref default"

    def answer(self, state: State, terms: Terms, F: np.ndarray, hard: Hard) -> Answer:
        """`own_solution`, and how soft each row was."""
        scene = self.scene
        nt, axes = len(F), list(scene.loop_axes)
        a, (R, pull, loop_forces) = np.empty_like(state.v), np.empty((3, nt, scene.N, 3))
        with only(self.mj):
            for k, d in enumerate(forward(self, state, F)):
                stiffness, damping, impedance, _ = d.efc_KBIP.reshape(-1, 4).T
                pull[k] = -(damping * d.efc_vel + stiffness * impedance * d.efc_pos).reshape(-1, 3)
                a[k], loop_forces[k], R[k] = d.qacc, d.efc_force.reshape(-1, 3), d.efc_R.reshape(-1, 3)
        R, pull = (x[..., axes].reshape(nt, scene.nc) for x in (R, pull))
        soft = hard.A + R[..., None] * np.eye(scene.nc)  # (A + R) lambda = A lambda of hard loops
        closure = pull - R * np.linalg.solve(soft, hard.A @ hard.multipliers[..., None])[..., 0]
        stiffness = np.einsum("tii->ti", hard.A) / R  # the solver factors M + J^T R^-1 J
        return Answer(a, loop_forces, np.zeros_like(a), closure, float(stiffness.max()))

    def own_solution(self, state: State, F: np.ndarray) -> np.ndarray:
        """``qacc`` of ``mj_forward``."""
        a = np.empty_like(state.v)
        with only(self.mj):
            for k, d in enumerate(forward(self, state, F)):
                a[k] = d.qacc
        return a

    def platform_acceleration(self, trajectory: Trajectory, a: np.ndarray) -> np.ndarray:
        """A free joint accelerates in world axes and turns in body axes."""
        if self.scene.freedom != "spatial":
            return in_plane(a[:, [self.velocity_index(name) for name in self.scene.platform_coordinates]])
        j = self.velocity_index("platform")
        return np.hstack([a[:, j : j + 3], np.einsum("tij,tj->ti", trajectory.rotation, a[:, j + 3 : j + 6])])

    def see(self, state: State) -> Seen:
        """Pose and velocity of the platform's body, ``mj_energyPos``, ``mj_energyVel``."""
        mj, m, d = self.mj, self.model, self.data
        out, twist = Seen.empty(len(state.q)), np.empty(6)
        for k in self._each(state):
            mj.mj_energyPos(m, d)
            mj.mj_makeM(m, d)
            mj.mj_energyVel(m, d)  # by the mass matrix
            mj.mj_objectVelocity(m, d, mj.mjtObj.mjOBJ_XBODY, self.platform, twist, 0)
            out.position[k], out.rotation[k] = d.xpos[self.platform], d.xmat[self.platform].reshape(3, 3)
            out.angular_velocity[k], out.velocity[k] = twist[:3], twist[3:]
            out.potential[k], out.kinetic[k] = d.energy
        return out

    native_dt, native_order = 1e-3, 2
    native_integrator = f"mj_step {INTEGRATOR}"
    native_setting = (
        f"Newton, tolerance {TOLERANCE:g}, solimp {IMPEDANCE:g}, solref timeconst {TIME_CONSTANT:g} dt, F at the stages"
    )

    def own_steps(self, problem: Problem, F: Staged, steps: int) -> State:
        """``mj_step``."""
        return own_steps(self, problem, F, steps)

    def _each(self, state: State) -> Iterator[int]:
        """Number of every sample, after what MuJoCo derives from positions and velocities; accelerations are set."""
        mj, m, d = self.mj, self.model, self.data
        kinematics, com_pos, com_vel, make = mj.mj_kinematics, mj.mj_comPos, mj.mj_comVel, mj.mj_makeConstraint
        qpos, qvel, qacc = d.qpos, d.qvel, d.qacc
        for k, (q, v, a) in enumerate(zip(*state, strict=True)):
            qpos[:], qvel[:], qacc[:] = q, v, a
            kinematics(m, d)
            com_pos(m, d)
            com_vel(m, d)
            make(m, d)
            self.require_rows(d)
            yield k
        self.require_quiet(d)

    def require_quiet(self, d: Any) -> None:
        """Raise EngineError if MuJoCo has warned: it goes on, with a state or controls of its own choice."""
        if d.warning.number.any():
            warned = {self.mj.mjtWarning(i).name: w.number for i, w in enumerate(d.warning) if w.number}
            raise EngineError(f"{self.name}: warnings {warned}")

    def require_rows(self, d: Any) -> None:
        """Raise EngineError unless the constraint rows are the loops' three each and nothing else."""
        rows = 3 * self.scene.N
        if not d.ne == d.nefc == rows:
            raise EngineError(
                f"{self.name}: the model gives {d.nefc} constraint rows, expected {rows} of its equalities"
            )

    def load(self, d: Any) -> np.ndarray:
        """Generalized force (nv,) of the scene's load at the current positions."""
        m, load = self.model, self.scene.load
        applied = np.zeros(m.nv)
        if load:
            point = d.xpos[self.platform] + d.xmat[self.platform].reshape(3, 3) @ load.point
            self.mj.mj_applyFT(m, d, np.array(load.force), np.array(load.moment), point, self.platform, applied)
        return applied


ENGINE = MujocoEngine
