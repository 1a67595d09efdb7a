"""MuJoCo from the MJCF: assembler of M, h and J, then its own recursive Newton-Euler for the reactions.

MuJoCo's own loops are soft and its inverse dynamics does not see hard ones; what it assembles is exact to rounding.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.mjcf import FLOOR
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, ModelFacts
from ..kkt import KktEngine, State, Terms
from ..trajectory import Trajectory


class MujocoEngine(KktEngine):
    """qfrc and efc_J from ``mj_inverse``, reactions from ``mj_rnePostConstraint``; loops: `connect` between sites."""

    name: ClassVar[str] = "mujoco"
    package: ClassVar[str] = "mujoco"
    setting: ClassVar[str] = "mj_inverse, mj_rnePostConstraint"

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import mujoco

        self.mj: Any = mujoco
        self.scene = scene
        self.model = mujoco.MjModel.from_xml_string((models or write_models(scene))[f"{scene.name}.xml"])
        self.data = mujoco.MjData(self.model)
        self.require_nv(self.model.nv)
        self.tips, self.pins = ([self.model.site(f"{kind}{i}").id for i in scene.legs] for kind in ("tip", "pin"))
        self.platform = self.model.body("platform").id

    def facts(self) -> ModelFacts:
        """MuJoCo wants inertia about every axis, and closes a loop by three rows in a plane too."""
        m, scene = self.model, self.scene
        floors = []
        if count := int((m.body_inertia[1:] == FLOOR).any(axis=1).sum()):
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
            out.tau[k] = d.qfrc_inverse + d.qfrc_constraint - self._load()
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
        warned = {self.mj.mjtWarning(i).name: w.number for i, w in enumerate(d.warning) if w.number}
        if warned:
            raise EngineError(f"{self.name}: warnings {warned}")
        return wrench.from_mujoco(cfrc, center, point)

    def _evaluate(self, state: State, k: int) -> None:
        """Everything that MuJoCo derives from one state; the rows must be the loops' three each and nothing else."""
        mj, m, d, nc = self.mj, self.model, self.data, 3 * self.scene.N
        d.qpos, d.qvel, d.qacc = state.q[k], state.v[k], state.a[k]
        mj.mj_inverse(m, d)
        if d.nefc != nc or (d.efc_type != mj.mjtConstraint.mjCNSTR_EQUALITY).any():
            raise EngineError(f"{self.name}: the model gives {d.nefc} constraint rows, expected {nc} of its equalities")

    def _load(self) -> np.ndarray:
        """Generalized force (nv,) of the scene's load at the current state."""
        m, d, load = self.model, self.data, self.scene.load
        applied = np.zeros(m.nv)
        if load:
            point = d.xpos[self.platform] + d.xmat[self.platform].reshape(3, 3) @ load.point
            self.mj.mj_applyFT(m, d, np.array(load.force), np.array(load.moment), point, self.platform, applied)
        return applied


ENGINE = MujocoEngine
