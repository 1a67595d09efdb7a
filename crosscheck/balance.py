"""Newton-Euler residual of every body from an engine's own reactions: says who is wrong.

Motion comes from the joint coordinates by the chain rule, masses from the scene; no formula of the paper, no engine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..models.scene import Scene
from . import wrench
from .trajectory import Trajectory


class _BodyMotion(NamedTuple):
    """One body: mass, centre of mass and its acceleration (nt, 3), rate of its angular momentum about it (nt, 3)."""

    mass: float
    com: np.ndarray
    acceleration: np.ndarray
    dH: np.ndarray


def _rotating(axes: np.ndarray, J: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """I alpha + omega x I omega, world axes; axes (nt, 3, 3) have the body's axes as columns."""
    inertia = axes @ J @ axes.transpose(0, 2, 1)

    def times(v: np.ndarray) -> np.ndarray:
        return np.einsum("tij,tj->ti", inertia, v)

    return times(alpha) + np.cross(omega, times(omega))


def _leg(scene: Scene, trajectory: Trajectory, i: int) -> tuple[dict[str, _BodyMotion], dict[str, np.ndarray]]:
    """Bodies of leg i, and the points of its joints."""
    leg, pin = scene.leg, np.array(scene.hull.pins[i - 1])
    still = np.zeros((len(trajectory.t), 1))  # a planar leg has no base angle
    (q_o, q_n, q_s), (v_o, v_n, v_s), (a_o, a_n, a_s) = (
        [x[f"{c}{i}"][:, None] if f"{c}{i}" in x else still for c in "ons"]
        for x in (trajectory.q, trajectory.v, trajectory.a)
    )
    up = np.array([0.0, 1.0, 0.0])
    x_o = np.hstack([np.cos(q_o), 0 * q_o, -np.sin(q_o)])
    z = np.hstack([np.sin(q_o), 0 * q_o, np.cos(q_o)])
    x, y = np.cos(q_n) * x_o + np.sin(q_n) * up, np.cos(q_n) * up - np.sin(q_n) * x_o
    omega_o, alpha_o = v_o * up, a_o * up
    omega, alpha = omega_o + v_n * z, alpha_o + a_n * z + np.cross(omega_o, v_n * z)

    def carried(r: np.ndarray) -> np.ndarray:
        """Acceleration of a point fixed in the guide."""
        return np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))

    axes = np.stack([x, y, z], axis=2)
    J_x, guide, rod = leg.guide.central_J_x, leg.guide, leg.rod
    bodies = {
        f"guide{i}": _BodyMotion(
            guide.mass,
            pin + guide.com * y,
            carried(guide.com * y),
            _rotating(axes, np.diag([J_x, guide.J_y, J_x]), omega, alpha),
        ),
        f"rod{i}": _BodyMotion(
            rod.mass,
            pin + q_s * y,
            carried(q_s * y) + a_s * y + 2 * np.cross(omega, v_s * y),
            _rotating(axes, np.diag([rod.J_x, rod.J_z, rod.J_x]), omega, alpha),
        ),
    }
    if leg.base:
        bodies[f"base{i}"] = _BodyMotion(leg.base.mass, pin + 0 * y, 0 * y, leg.base.J_z * alpha_o)
    at_pin = pin + 0 * y
    points = {f"o{i}": at_pin, f"n{i}": at_pin, f"s{i}": pin + q_s * y, f"r{i}": pin + (q_s + leg.a) * y}
    return bodies, points


def balance(scene: Scene, trajectory: Trajectory, reactions: np.ndarray, length: float) -> dict[str, np.ndarray]:
    """Newton-Euler residual of each body [N].

    Parameters
    ----------
    reactions : ndarray, shape (nt, nj, 6)
        As in `DynamicsResult`.
    length : float
        Turns moments into forces, m: the longest leg.

    Returns
    -------
    dict
        Body name to ndarray, shape (nt,): the larger of the force residual and the moment residual about the body's
        centre of mass over `length`.
    """
    bodies, points = {}, {}
    for i in scene.legs:
        for target, part in zip((bodies, points), _leg(scene, trajectory, i), strict=True):
            target.update(part)
    R = trajectory.rotation
    bodies["platform"] = _BodyMotion(
        scene.platform.mass,
        trajectory.position,
        trajectory.acceleration,
        _rotating(R, np.array(scene.platform.tensor), trajectory.angular_velocity, trajectory.angular_acceleration),
    )
    # The sum of all wrenches on a body about its centre of mass, less its rate of momentum, is zero.
    residual = {}
    for name, b in bodies.items():
        weight = b.mass * (np.array(scene.gravity) - b.acceleration)
        residual[name] = wrench.from_parts(-b.dH, weight)
    if scene.load:
        load = wrench.from_parts(np.array(scene.load.moment), np.array(scene.load.force)) + np.zeros((len(R), 6))
        point = trajectory.position + R @ np.array(scene.load.point)
        residual["platform"] += wrench.shifted(load, point, trajectory.position)
    for joint, on_child in zip(scene.joints, reactions.transpose(1, 0, 2), strict=True):
        point = points[joint.name]
        residual[joint.child] += wrench.shifted(on_child, point, bodies[joint.child].com)
        if joint.parent in bodies:
            residual[joint.parent] -= wrench.shifted(on_child, point, bodies[joint.parent].com)
    return {
        name: np.maximum(np.linalg.norm(w[:, 3:], axis=1), np.linalg.norm(w[:, :3], axis=1) / length)
        for name, w in residual.items()
    }
