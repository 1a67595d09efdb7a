"""DART from the URDF and the loop list: mass matrix, bias and Jacobians, then its own inverse dynamics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ...models import write_models
from ...models.scene import Scene
from .. import wrench
from ..engine import EngineError, ModelFacts
from ..kkt import KktEngine, State, Terms, tree_facts
from ..trajectory import Trajectory


class DartEngine(KktEngine):
    """The skeleton of the URDF, closed by the points of the loop list."""

    name: ClassVar[str] = "dart"
    package: ClassVar[str] = "dartpy"
    setting: ClassVar[str] = "computeInverseDynamics"

    def __init__(self, scene: Scene, models: Mapping[str, str] | None = None) -> None:
        import dartpy

        self.dart: Any = dartpy
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
        self.platform = self._body("platform")

    def _body(self, name: str) -> Any:
        body = self.skeleton.getBodyNode(name)
        if body is None:
            raise EngineError(f"{self.name}: the URDF has no link {name!r}")
        return body

    def facts(self) -> ModelFacts:
        """URDF wants a link between two joints; DART leaves it without mass if the file says zero."""
        sk = self.skeleton
        masses = {b.getName(): b.getMass() for b in map(sk.getBodyNode, range(sk.getNumBodyNodes()))}
        return tree_facts(masses, sk.getNumDofs(), self.scene.nc)

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
        v[:, j : j + 6] = np.hstack([trajectory.angular_velocity, trajectory.velocity])
        a[:, j : j + 6] = np.hstack([trajectory.angular_acceleration, trajectory.acceleration])
        return State(q, v, a)

    def terms(self, state: State) -> Terms:
        """Mass matrix times accelerations plus bias less load, Jacobians and accelerations of the loop points."""
        sk, scene, load = self.skeleton, self.scene, self.scene.load
        out = Terms.empty(len(state.q), state.q.shape[1], scene)
        hulls = [sk.getJoint(c).getTransformFromParentBodyNode().translation() for c in scene.hull_coordinates]
        axes, rows = list(scene.loop_axes), len(scene.loop_axes)
        for k in range(len(state.q)):
            self._set(state, k)
            out.tau[k] = sk.getMassMatrix() @ state.a[k] + sk.getCoriolisAndGravityForces()
            if load:
                out.tau[k] -= sk.getLinearJacobian(self.platform, np.array(load.point)).T @ load.force
                out.tau[k] -= sk.getAngularJacobian(self.platform).T @ load.moment
            for i, ends in enumerate(self.loops):
                tip, pin = (body.getWorldTransform().multiply(point) for body, point in ends)
                J_tip, J_pin = (sk.getLinearJacobian(body, point) for body, point in ends)
                a_tip, a_pin = (body.getLinearAcceleration(point) for body, point in ends)
                out.J[k, rows * i : rows * (i + 1)] = (J_tip - J_pin)[axes]
                out.gap[k, i], out.gap_acceleration[k, i] = tip - pin, a_tip - a_pin
                axis = tip - hulls[i]
                out.L[k, i] = np.linalg.norm(axis)
                out.dL[k, i] = axis @ (J_tip @ state.v[k]) / out.L[k, i]
        return out

    def reactions(self, state: State, multipliers: np.ndarray) -> np.ndarray:
        """``getBodyForce`` of every leg body after inverse dynamics with the loop forces on the rods' tips."""
        sk = self.skeleton
        bodies = [sk.getBodyNode(j.child) for j in self.scene.joints if not j.cut]
        force, R = np.empty((len(state.q), len(bodies), 6)), np.empty((len(state.q), len(bodies), 3, 3))
        for k in range(len(state.q)):
            self._set(state, k)
            sk.clearExternalForces()  # addExtForce accumulates
            for (rod, tip), force_W in zip((ends[0] for ends in self.loops), multipliers[k], strict=True):
                rod.addExtForce(force_W, tip, False, True)
            sk.computeInverseDynamics(True, False, False)  # with external forces; by default they are left out
            for n, body in enumerate(bodies):
                force[k, n], R[k, n] = body.getBodyForce(), body.getWorldTransform().rotation()
        return wrench.from_dart(force, R)

    def _set(self, state: State, k: int) -> None:
        """State of one sample; DART only prints when it refuses one, so what it holds is read back."""
        sk = self.skeleton
        sk.setPositions(state.q[k])
        sk.setVelocities(state.v[k])
        sk.setAccelerations(state.a[k])
        held = (sk.getPositions(), sk.getVelocities(), sk.getAccelerations())
        if not all(np.array_equal(h, x[k]) for h, x in zip(held, state, strict=True)):
            raise EngineError(f"{self.name}: refused the state of sample {k}")


ENGINE = DartEngine
