"""DART's world around an engine's skeleton: its loops, and settings that are global in DART."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ..kkt import State

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
    """
    dart, sk = engine.dart, engine.skeleton
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
        for (rod, tip), (platform, _) in engine.loops:
            solver.addConstraint(joint(rod, platform, rod.getWorldTransform().multiply(tip)))
        yield world
    finally:
        joint.setErrorReductionParameter(before[0])
        joint.setConstraintForceMixing(before[1])
        solver.removeAllConstraints()  # before the skeleton goes
        world.removeSkeleton(sk)
