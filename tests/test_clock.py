"""The split of an adapter's time: every call of the library is seen, answers do not change, nothing stays behind."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stewart_crosscheck.crosscheck.clock import watching
from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.trajectory import Trajectory
from stewart_crosscheck.models import Scene

CALLS = {
    "mujoco": {"mj_rne", "mj_rnePostConstraint", "mj_makeConstraint", "mj_fullM", "mj_forward"},
    "pinocchio": {"rnea", "computeJointJacobians", "crba", "getFrameClassicalAcceleration", "constraintDynamics"},
    "dart": {"computeInverseDynamics", "getJacobian", "getBodyForce", "getMassMatrix", "step"},
}


def everything(engine: Any, trajectory: Trajectory) -> list[np.ndarray]:
    state = engine.state(trajectory)
    F, reactions = engine.all_reactions(state)
    return [F, reactions, engine.driving_forces(state), engine.accelerate(state, F), engine.solved(state, F)]


def test_the_library_is_seen_and_answers_do_not_change(
    engine_name: str, hexapod: Scene, trajectory: Trajectory
) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    want = everything(engine, trajectory)
    held = {name: getattr(engine, name) for name in engine.handles}
    with watching(engine) as spent:
        got = everything(engine, trajectory)
    assert set(spent) >= CALLS[engine_name]
    assert all(seconds > 0.0 for seconds in spent.values())
    for a, b in zip(got, want, strict=True):
        np.testing.assert_array_equal(a, b)
    for name, value in held.items():
        assert getattr(engine, name) is value
    seen = dict(spent)
    everything(engine, trajectory)
    assert spent == seen  # outside nobody watches


def test_handles_are_put_back_after_an_error(engine_name: str, hexapod: Scene) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    held = {name: getattr(engine, name) for name in engine.handles}
    inside = []

    def fails() -> None:
        with watching(engine):
            inside.append(getattr(engine, engine.handles[0]))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fails()
    assert inside[0] is not held[engine.handles[0]]
    for name, value in held.items():
        assert getattr(engine, name) is value


def test_a_handle_that_is_not_declared_is_not_seen(engine_name: str, hexapod: Scene, trajectory: Trajectory) -> None:
    """Without its handles an engine's calls all count as ours."""
    engine: Any = load_engine(engine_name)(hexapod)
    engine.handles = ()
    with watching(engine) as spent:
        everything(engine, trajectory)
    assert not spent
