"""MuJoCo from the MJCF: assembler of M, h and J, then its own recursive Newton-Euler; and its own soft loops.

Its inverse dynamics does not see hard loops; what it assembles is exact to rounding.  ``mj_forward`` softens them.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.mjcf import FLOOR
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, Law, ModelFacts
from ..kkt import State, Terms
from ..native import Answer, Hard, in_plane
from ..problem import Problem, Staged
from ..stepping import Seen, SteppingEngine
from ..trajectory import Trajectory

IMPEDANCE = 0.9999
"""Both ends of solimp: the hardest loops that MuJoCo does not clamp (mjMAXIMP)."""

TOLERANCE = 1e-15
"""Of the Newton solver: its one step is exact here, as no loop can open or slip; 0 would repeat it a hundred times."""

INTEGRATOR, TIME_CONSTANT = "RK4", 2.0
"""Of `own_steps`: one of mjtIntegrator, and of solref, in steps: the least that MuJoCo takes."""


class MujocoEngine(SteppingEngine):
    """qfrc and efc_J from ``mj_inverse``, reactions from ``mj_rnePostConstraint``; loops: `connect` between sites."""

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    setting: ClassVar[str] = "mj_inverse, mj_rnePostConstraint"
    inertia_floor: ClassVar[float] = FLOOR
    law: ClassVar[Law] = Law(
        "softness",
        "a row is softened by R, (1 - d)/d times what MuJoCo takes for J M^-1 J^T at the impedance d: the loops"
        " accelerate by -R lambda, and by what pulls their rounded gaps together; the error was measured at 1.000 times"
        " this law from d = 0.9 to 0.9999",
    )

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import mujoco

        self.mj: Any = mujoco
        self.scene = scene
        self.model = mujoco.MjModel.from_xml_string((models or write_models(scene))[f"{scene.name}.xml"])
        self.data = mujoco.MjData(self.model)
        self.require_nv(self.model.nv)
        self.tips, self.pins = ([self.model.site(f"{kind}{i}").id for i in scene.legs] for kind in ("tip", "pin"))
        self.platform = self.model.body("platform").id
        self.impedance = IMPEDANCE
        self.integrator, self.time_constant = INTEGRATOR, TIME_CONSTANT

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

    def terms(self, state: State) -> Terms:
        """``mj_inverse`` counts soft loop forces that we do not want: adding qfrc_constraint takes them out again."""
        mj, m, d, scene = self.mj, self.model, self.data, self.scene
        nt = len(state.q)
        out = Terms.empty(nt, m.nv, scene)
        anchors = [m.joint(c).id for c in scene.hull_coordinates]
        velocity, acceleration = np.empty(6), np.empty((2, 6))
        for k in range(nt):
            self._evaluate(state, k)
            out.tau[k] = d.qfrc_inverse + d.qfrc_constraint - self._load(d)
            out.J[k] = d.efc_J.reshape(-1, 3, m.nv)[:, scene.loop_axes].reshape(scene.nc, m.nv)
            out.gap[k] = d.site_xpos[self.tips] - d.site_xpos[self.pins]
            axis = d.site_xpos[self.tips] - d.xanchor[anchors]
            out.L[k] = np.linalg.norm(axis, axis=1)
            mj.mj_rnePostConstraint(m, d)  # accelerations of the bodies; they do not depend on forces
            for i, ends in enumerate(zip(self.tips, self.pins, strict=True)):
                for e, site in enumerate(ends):
                    mj.mj_objectAcceleration(m, d, mj.mjtObj.mjOBJ_SITE, site, acceleration[e], 0)
                out.gap_acceleration[k, i] = acceleration[0, 3:] - acceleration[1, 3:]
                mj.mj_objectVelocity(m, d, mj.mjtObj.mjOBJ_SITE, ends[0], velocity, 0)
                out.dL[k, i] = axis[i] @ velocity[3:] / out.L[k, i]
        return out

    def reactions(self, state: State, multipliers: np.ndarray) -> np.ndarray:
        """``cfrc_int`` of every leg body, with the loop forces written over MuJoCo's soft ones."""
        m, d = self.model, self.data
        joints = [j for j in self.scene.joints if not j.cut]
        bodies = [m.body(j.child).id for j in joints]
        hinges = [m.joint(j.coordinates[0]).id for j in joints]
        at_com = np.array([[j.type == "prismatic"] for j in joints])
        shape = (len(state.q), len(bodies))
        cfrc, center, point = np.empty((*shape, 6)), np.empty((*shape, 3)), np.empty((*shape, 3))
        for k in range(len(state.q)):
            self._evaluate(state, k)
            d.efc_force[:] = multipliers[k].ravel()
            self.mj.mj_rnePostConstraint(m, d)
            cfrc[k], center[k] = d.cfrc_int[bodies], d.subtree_com[m.body_rootid[bodies]]
            point[k] = np.where(at_com, d.xipos[bodies], d.xanchor[hinges])
        self._require_quiet(d)
        return wrench.from_mujoco(cfrc, center, point)

    @property
    def forward_setting(self) -> str:
        """On a copy of the model: the MJCF has MuJoCo's defaults."""
        return f"mj_forward, Newton, tolerance {TOLERANCE:g}, solimp {self.impedance:g}, solref default"

    def answer(self, state: State, terms: Terms, F: np.ndarray, hard: Hard) -> Answer:
        """`solved`, and how soft each row was."""
        scene = self.scene
        nt, axes = len(F), list(scene.loop_axes)
        a, (R, pull, loop_forces) = np.empty_like(state.v), np.empty((3, nt, scene.N, 3))
        for k, d in enumerate(self._forward(state, F)):
            stiffness, damping, impedance, _ = d.efc_KBIP.reshape(-1, 4).T
            pull[k] = -(damping * d.efc_vel + stiffness * impedance * d.efc_pos).reshape(-1, 3)
            a[k], loop_forces[k], R[k] = d.qacc, d.efc_force.reshape(-1, 3), d.efc_R.reshape(-1, 3)
        R, pull = (x[..., axes].reshape(nt, scene.nc) for x in (R, pull))
        soft = hard.A + R[..., None] * np.eye(scene.nc)  # (A + R) lambda = A lambda of hard loops
        closure = pull - R * np.linalg.solve(soft, hard.A @ hard.multipliers[..., None])[..., 0]
        stiffness = np.einsum("tii->ti", hard.A) / R  # the solver factors M + J^T R^-1 J
        return Answer(a, loop_forces, np.zeros_like(a), closure, float(stiffness.max()))

    def solved(self, state: State, F: np.ndarray) -> np.ndarray:
        """``qacc`` of ``mj_forward``."""
        a = np.empty_like(state.v)
        for k, d in enumerate(self._forward(state, F)):
            a[k] = d.qacc
        return a

    def _forward(self, state: State, F: np.ndarray) -> Iterator[Any]:
        """``mj_forward`` of every sample: forces on the motors, the load among the applied forces, soft loops."""
        mj, m, scene = self.mj, copy.copy(self.model), self.scene
        beyond = np.argwhere(np.abs(F) > mj.mjMAXVAL)
        if len(beyond):
            k, i = beyond[0].tolist()
            raise EngineError(
                f"{self.name}: sample {k}: got {F[k, i]:.3g} N for leg {i + 1}, expected at most {mj.mjMAXVAL:g} N:"
                " MuJoCo sets all controls to zero beyond"
            )
        m.eq_solimp[:, :2] = self.impedance
        m.opt.tolerance = TOLERANCE
        d = mj.MjData(m)
        motors = [m.actuator(f"F{i}").id for i in scene.legs]
        for k in range(len(F)):
            d.qpos, d.qvel, d.ctrl[motors] = state.q[k], state.v[k], F[k]
            mj.mj_fwdPosition(m, d)
            d.qfrc_applied = self._load(d)
            mj.mj_forward(m, d)
            self._require_rows(d)
            yield d
        self._require_quiet(d)

    def platform_acceleration(self, trajectory: Trajectory, a: np.ndarray) -> np.ndarray:
        """A free joint accelerates in world axes and turns in body axes."""
        if self.scene.freedom != "spatial":
            return in_plane(a[:, [self.velocity_index(name) for name in self.scene.platform_coordinates]])
        j = self.velocity_index("platform")
        return np.hstack([a[:, j : j + 3], np.einsum("tij,tj->ti", trajectory.rotation, a[:, j + 3 : j + 6])])

    def mass_matrix(self, state: State) -> np.ndarray:
        """``mj_fullM``."""
        mj, m, d = self.mj, self.model, self.data
        M = np.empty((len(state.q), m.nv, m.nv))
        for k, q in enumerate(state.q):
            d.qpos = q
            mj.mj_fwdPosition(m, d)
            mj.mj_fullM(m, d, M[k])
        return M

    def see(self, state: State) -> Seen:
        """Pose and velocity of the platform's body, ``mj_energyPos``, ``mj_energyVel``."""
        mj, m, d = self.mj, self.model, self.data
        out, twist = Seen.empty(len(state.q)), np.empty(6)
        for k in range(len(state.q)):
            self._evaluate(state, k)
            mj.mj_energyPos(m, d)
            mj.mj_energyVel(m, d)
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
        """``mj_step``, forces and load set by its control callback, which every stage calls.

        Soft loops sag by (1 - d) timeconst^2 of the acceleration that loads them: of second order, as the time constant
        is so many steps.
        """
        mj, m = self.mj, copy.copy(self.model)
        m.opt.integrator = getattr(mj.mjtIntegrator, f"mjINT_{self.integrator.upper()}")
        m.opt.timestep, m.opt.tolerance = F.dt, TOLERANCE
        m.opt.disableflags |= mj.mjtDisableBit.mjDSBL_AUTORESET
        m.eq_solimp[:, :2], m.eq_solref[:] = self.impedance, (self.time_constant * F.dt, 1.0)
        d = mj.MjData(m)
        motors = [m.actuator(f"F{i}").id for i in self.scene.legs]
        start = self.state(problem.start)
        d.qpos, d.qvel = start.q[0], start.v[0]
        n = len(problem.grid)
        q, v = np.empty((n, m.nq)), np.empty((n, m.nv))
        q[0], v[0] = d.qpos, d.qvel

        def control(_: Any, d: Any) -> None:
            d.ctrl[motors] = F(d.time)
            d.qfrc_applied = self._load(d)

        before = mj.get_mjcb_control()
        mj.set_mjcb_control(control)
        try:
            for k in range(1, n):
                d.time = problem.grid[k - 1]  # not the sum of so many steps
                for _ in range(steps):
                    mj.mj_step(m, d)
                self._require_quiet(d)
                self._require_rows(d)
                q[k], v[k] = d.qpos, d.qvel
        finally:
            mj.set_mjcb_control(before)
        return State(q, v, np.zeros_like(v))

    def _evaluate(self, state: State, k: int) -> None:
        """Everything that MuJoCo derives from one state."""
        d = self.data
        d.qpos, d.qvel, d.qacc = state.q[k], state.v[k], state.a[k]
        self.mj.mj_inverse(self.model, d)
        self._require_rows(d)

    def _require_quiet(self, d: Any) -> None:
        """Raise EngineError if MuJoCo has warned: it goes on, with a state or controls of its own choice."""
        warned = {self.mj.mjtWarning(i).name: w.number for i, w in enumerate(d.warning) if w.number}
        if warned:
            raise EngineError(f"{self.name}: warnings {warned}")

    def _require_rows(self, d: Any) -> None:
        """Raise EngineError unless the constraint rows are the loops' three each and nothing else."""
        mj, nc = self.mj, 3 * self.scene.N
        if d.nefc != nc or (d.efc_type != mj.mjtConstraint.mjCNSTR_EQUALITY).any():
            raise EngineError(f"{self.name}: the model gives {d.nefc} constraint rows, expected {nc} of its equalities")

    def _load(self, d: Any) -> np.ndarray:
        """Generalized force (nv,) of the scene's load at the current positions."""
        m, load = self.model, self.scene.load
        applied = np.zeros(m.nv)
        if load:
            point = d.xpos[self.platform] + d.xmat[self.platform].reshape(3, 3) @ load.point
            self.mj.mj_applyFT(m, d, np.array(load.force), np.array(load.moment), point, self.platform, applied)
        return applied


ENGINE = MujocoEngine
