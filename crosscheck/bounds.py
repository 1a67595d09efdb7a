"""What an engine may be off by at each sample: rounding, the law of its own solver, inertia that its format adds."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..models.scene import Scene
from .engine import HULL, LOOPS, PLATFORM, DynamicsResult, values
from .scales import Scales
from .tolerance import (
    CLOSURE,
    EASY_AMPLIFICATION,
    LAW_FACTOR,
    RADIUS,
    ROUND_OFF,
    TERMS,
    of_accelerations,
    of_cancelling,
    of_forces,
    of_positions,
    times_easier,
)
from .trajectory import Trajectory


def allowed(
    scene: Scene,
    at: Trajectory,
    result: DynamicsResult,
    truth: DynamicsResult,
    name: str,
    size: Scales,
    floor: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Largest error over the scale, and what it is called, at each sample of `at`.

    These are the result's; of its `checks`, any of the trajectory's.

    Nothing of it hangs on what the engine answers.  ``floor``: smallest moment of inertia [kg m^2] that its format has.
    """
    arm = max(1.0, abs(scene.leg.a) / size.length) if name == "M_s" else 1.0  # a rod may be far longer than its leg
    if result is truth:
        return np.full(len(result.samples), RADIUS.value * arm), np.full(len(result.samples), RADIUS.name)
    if name in LOOPS:
        still = CLOSURE.value * of_positions(at.reach)
        if name == "loop_acc":  # MuJoCo counts gravity among accelerations
            still *= of_cancelling(math.hypot(*scene.gravity) / size.of(name))
        bound = np.maximum(still, of_turning_loops(scene, at, name, size))
        return bound, _names(CLOSURE.name, bound / CLOSURE.value)
    solved = result.platform is not None
    spread = np.fmax(1.0, at.condition)  # of forces on the platform, among the driving forces
    if not solved and (name.startswith("M") or name in ("balance", *HULL)):  # they go along the legs, and sums cancel
        spread = np.ones_like(spread)
    if name in PLATFORM:  # of a route that has the truth's samples
        wider = wider_accelerations(scene, at, truth, size)
    else:  # driving forces that are given react to nothing
        wider = of_forces(np.ones_like(spread) if solved else spread, at.sin_q_n, at.reach)
        wider *= of_cancelling(burden(scene, at, size) / size.force)
    if solved:
        wider = np.maximum(wider, times_easier(result.mobility)) * max(1.0, result.amplification / EASY_AMPLIFICATION)
    turning = of_turning_legs(scene, at, name, size, solved) * spread
    summed = name in ("balance", *HULL) and not solved
    added = of_floor(scene, at, name, size, floor, summed) * spread
    rounding = np.maximum(ROUND_OFF.value * wider * arm, turning)
    if result.law is None:
        names = _names(ROUND_OFF.name, rounding / ROUND_OFF.value)
        return rounding + added, np.where(added > rounding, "inertia_floor", names)
    law = values(scene, replace(result, **result.predicted), name)
    off = np.linalg.norm(law, axis=2).max(axis=1) / size.of(name)
    bound = np.where(result.valid, LAW_FACTOR * off + rounding + added, np.inf)
    return bound, np.full(len(off), f"law_of_{result.law.name}")


def _names(name: str, wider: np.ndarray) -> np.ndarray:
    return np.where(wider > 1.0, f"{name}_ill_conditioned", name)


def wider_accelerations(scene: Scene, at: Trajectory, truth: DynamicsResult, size: Scales) -> np.ndarray:
    """How much wider a tolerance of the platform's accelerations is at each sample of the truth, at least 1.

    A driving force accelerates its rod too, from which the loops' forces take nearly all again: of what it would get
    alone 1.4e-16 was measured to be left, and a tenth of it counts.
    """
    largest = np.linalg.norm(truth.reactions[..., 3:], axis=2).max(axis=1)
    share = max(0.1 / scene.leg.rod.mass / size.acceleration, *(_per_force(scene, name, size) for name in PLATFORM))
    return of_accelerations(largest * share, at.sin_q_n, at.reach)


def _per_force(scene: Scene, name: str, size: Scales) -> float:
    """What a force on a pin makes of a quantity, per newton and over its scale; accelerations of the platform alone."""
    response = {"a": 1.0 / scene.platform.mass, "alpha": size.lever / scene.platform.least_inertia}
    return response.get(name, size.of(name) / size.force) / size.of(name)


def burden(scene: Scene, at: Trajectory, size: Scales) -> np.ndarray:
    """Weights, inertial forces and load (nt,) [N] that the platform's equations add up."""

    def length(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x, axis=-1)

    turning = length(at.angular_acceleration) + length(at.angular_velocity) ** 2
    tip = length(at.acceleration) + size.lever * turning
    load = scene.load
    outside = length(np.array(load.force)) + length(np.array(load.moment)) / size.lever if load else 0.0
    return sum(body.mass for body in scene.bodies) * (length(np.array(scene.gravity)) + tip) + outside


def _turning(scene: Scene, at: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of the angular velocity [1/s] and of its square plus the angular acceleration [1/s^2] of legs, (nt, N).

    The axes of o and n are square to each other, and the first one turns the second.
    """
    hinges = "on" if scene.topology == "spatial" else "n"
    v, a = (np.array([[np.abs(x[f"{c}{i}"]) for i in scene.legs] for c in hinges]) for x in (at.v, at.a))
    return v.sum(axis=0).T, (v.sum(axis=0) ** 2 + a.sum(axis=0)).T


def _legs(scene: Scene, at: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Lengths [m] and sines of the legs, (nt, N)."""
    q_s, q_n = (np.array([at.q[f"{c}{i}"] for i in scene.legs]).T for c in "sn")
    return q_s + scene.leg.a, np.abs(np.sin(q_n)) if scene.topology == "spatial" else np.ones_like(q_n)


def of_turning_loops(scene: Scene, at: Trajectory, name: str, size: Scales) -> np.ndarray:
    """Rounding (nt,), over the scale, of a tip's velocity or acceleration: terms cancel where a leg turns fast."""
    speed, square = _turning(scene, at)
    largest = {"loop_pos": np.zeros_like(speed), "loop_vel": speed, "loop_acc": square}[name]
    terms = (_legs(scene, at)[0] * largest).max(axis=1) * of_positions(at.reach)
    return TERMS * np.finfo(float).eps * terms / size.of(name)


def of_turning_legs(scene: Scene, at: Trajectory, name: str, size: Scales, solved: bool) -> np.ndarray:
    """Rounding (nt,), over the scale, of the forces that legs need to turn, by the lever L.

    A leg that passes the vertical turns its base so fast that large terms cancel.  Where accelerations are `solved`
    for, the lever of its hinge o, which is L sin q_n, counts.
    """
    leg, (L, sine) = scene.leg, _legs(scene, at)
    inertia = leg.guide.J_x + leg.rod.J_x + leg.rod.mass * (L - leg.a) ** 2
    lever = L * sine if solved else L
    force = np.finfo(float).eps * of_positions(at.reach) * (inertia * _turning(scene, at)[1] / lever).sum(axis=1)
    return force * _per_force(scene, name, size)


def of_floor(scene: Scene, at: Trajectory, name: str, size: Scales, floor: float, summed: bool = False) -> np.ndarray:
    """Bound of the change (nt,), over the scale, when moments of inertia below `floor` are raised to it.

    A body with angular velocity w and acceleration dw needs at most J (|dw| + w^2) more; the passive hinges of a leg
    turn that into forces across it by the levers L and L sin q_n, which leaves sums against momentum (`summed`) alone.
    """
    leg, platform = scene.leg, scene.platform
    moments = [leg.guide.central_J_x, leg.rod.J_x]
    moments += [leg.guide.J_y, leg.rod.J_z] if scene.topology == "spatial" else []
    moments += [leg.base.J_z] if leg.base else []
    L, sine = _legs(scene, at)
    lever = L if summed else L * sine
    force = sum(max(0.0, floor - J) for J in moments) * (_turning(scene, at)[1] / lever).sum(axis=1)
    if scene.freedom == "planar":
        turning = np.abs(at.angular_acceleration[:, 2]) + at.angular_velocity[:, 2] ** 2
        force += max(0.0, floor - platform.least_inertia) * turning / size.lever
    return force * _per_force(scene, name, size)
