"""DART's world around an engine's skeleton: its loops, its steps, and settings that are global in DART.

DART goes on where it can not: it prints that a setting is refused and keeps another one, takes accelerations of zero
for what is not finite, and closes loops of another mechanism at a pose where they are open.  So all of that is read
back.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ..engine import EngineError, require_finite
from ..kkt import State
from ..native import CLOSED, require_shut

if TYPE_CHECKING:
    from .dart_ import DartEngine


@contextlib.contextmanager
def closed(engine: DartEngine, state: State, dt: float, reduction: float, mixing: float) -> Iterator[Any]:
    """A world of the skeleton, closed at the first sample's pose; what is global in DART is put back after.

    Parameters
    ----------
    engine : whose skeleton and loops they are.
    state : with one sample at least.
    dt : time step [s].
    reduction, mixing : error reduction (ERP) and constraint force mixing (CFM) of the loops.

    Raises
    ------
    EngineError
        A loop is open at that pose, or DART takes another time step, reduction or mixing.
    """
    dart, sk, platform, rods = engine.dart, engine.skeleton, engine.platform, engine.ends[: engine.scene.N]
    joint = dart.constraint.BallJointConstraint
    world = dart.simulation.World()
    world.setGravity(sk.getGravity())  # it overwrites the skeleton's
    world.setTimeStep(dt)
    awake = world.getDeactivationOptions()
    awake.mEnabled = False
    world.setDeactivationOptions(awake)
    world.addSkeleton(sk)
    engine.set(state, 0)
    sk.clearExternalForces()  # which inverse dynamics leaves behind
    before = joint.getErrorReductionParameter(), joint.getConstraintForceMixing()
    solver = world.getConstraintSolver()
    try:
        joint.setErrorReductionParameter(reduction)
        joint.setConstraintForceMixing(mixing)
        held = world.getTimeStep(), joint.getErrorReductionParameter(), joint.getConstraintForceMixing()
        for name, got, want in zip(("time step", "ERP", "CFM"), held, (dt, reduction, mixing), strict=True):
            if got != want:
                raise EngineError(f"{engine.name}: {name}: got {want:g}, and DART would go on with {got:g}")
        tips, at = np.array([rod.getWorldTransform().multiply(tip) for rod, tip in rods]), platform.getWorldTransform()
        gap = tips - at.translation() - engine.pins @ at.rotation().T
        if not np.abs(gap).max() <= 1e-3 * CLOSED * np.abs(engine.pins).max():  # cheaper than to look at each leg
            gap, L = (np.linalg.norm(x, axis=1)[None] for x in (gap, tips - engine.scene.hull.pins))
            require_shut(engine.name, gap, CLOSED * L, "m")
        for (rod, _), tip in zip(rods, tips, strict=True):
            solver.addConstraint(joint(rod, platform, tip))
        yield world
    finally:
        joint.setErrorReductionParameter(before[0])
        joint.setConstraintForceMixing(before[1])
        solver.removeAllConstraints()  # before the skeleton goes
        world.removeSkeleton(sk)


def accelerations(engine: DartEngine, sample: int) -> np.ndarray:
    """What the last step gave (nv,). Raises EngineError where squares of velocities are beyond float64.

    DART then takes zero for the acceleration of whatever is not finite, and nothing else shows it.
    """
    speed = math.hypot(*engine.skeleton.getVelocities())
    if not math.isfinite(speed * speed):
        raise EngineError(f"{engine.name}: sample {sample}: velocities of {speed:.3g} are beyond what DART squares")
    return engine.skeleton.getAccelerations()


def last_steps(engine: DartEngine, world: Any, state: State, tau: np.ndarray) -> Iterator[int]:
    """Number of every sample, before the second of two ``World.step`` from the pose one step earlier.

    The first one makes the velocity consistent there: a step keeps J v = 0 at the pose before it, so that a single one
    from a moving state misses dJ v altogether.  ``tau`` (nt, nv): generalized forces.
    """
    require_finite(engine.name, q=state.q, v=state.v)
    for k in range(len(tau)):
        engine.set(state, k)
        engine.skeleton.integratePositions(-world.getTimeStep())
        engine.push(tau[k])
        world.step(True)
        engine.push(tau[k])
        yield k
