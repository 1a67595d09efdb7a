"""What engines answer for a state that is ready: the same as a whole run, and as their knobs are set."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from stewart_crosscheck.crosscheck.engine import DynamicsResult, load_engine
from stewart_crosscheck.crosscheck.kkt import State
from stewart_crosscheck.crosscheck.problem import Staged, pose
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names


@pytest.mark.parametrize("name", scene_names())
def test_inverse_hooks_answer_what_a_run_answers(engine_name: str, name: str) -> None:
    scene = load_scene(name)
    trajectory = from_scene(scene, 5)
    engine: Any = load_engine(engine_name)(scene)
    want = engine.inverse_dynamics(trajectory)
    state = engine.state(trajectory)
    F, reactions = engine.all_reactions(state, trajectory.undetermined)
    np.testing.assert_array_equal(F, want.F)
    np.testing.assert_array_equal(reactions, want.reactions)
    np.testing.assert_array_equal(engine.driving_forces(state, trajectory.undetermined), want.F)


@pytest.mark.parametrize("name", [name for name in scene_names() if name != "collinear"])
def test_a_single_sample_answers_as_a_block_does(engine_name: str, name: str) -> None:
    """Few samples are solved another way, which shows in the last digits alone."""
    scene = load_scene(name)
    engine: Any = load_engine(engine_name)(scene)
    state = engine.state(from_scene(scene, 15))
    F, reactions = engine.all_reactions(state)
    a = engine.accelerate(state, F)
    few = 4e-15 * np.abs(reactions).max()  # roundings of two direct solves of condition 20
    for k in (0, 7, 14):
        one = State(*(x[k : k + 1] for x in state))
        F_1, reactions_1 = engine.all_reactions(one)
        np.testing.assert_allclose(F_1[0], F[k], rtol=0, atol=few)
        np.testing.assert_allclose(reactions_1[0], reactions[k], rtol=0, atol=few)
        np.testing.assert_allclose(engine.accelerate(one, F[k : k + 1])[0], a[k], rtol=0, atol=1e-12 * np.abs(a).max())


def test_forward_hooks_answer_what_a_run_answers(
    engine_name: str, hexapod: Scene, trajectory: Trajectory, truth: DynamicsResult
) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    want = engine.forward_dynamics(trajectory, truth.F)
    solved = engine.solved(engine.state(trajectory), truth.F)
    np.testing.assert_array_equal(engine.platform_acceleration(trajectory, solved), want.platform)


KNOBS: dict[str, list[dict[str, Any]]] = {
    "mujoco": [{"impedance": 0.9}, {"integrator": "Euler"}, {"integrator": "implicitfast"}, {"time_constant": 20.0}],
    "pinocchio": [{"mu": 10.0}, {"iterations": 1, "mu": 1e-2}],
    "dart": [{"reduction": 0.0}],
}
SOLVER_KNOBS: dict[str, dict[str, Any]] = {
    "mujoco": {"impedance": 0.9},
    "pinocchio": {"mu": 10.0},
    "dart": {"time_step": 1e-3},
}


def test_the_solver_obeys_its_knob(engine_name: str, hexapod: Scene, trajectory: Trajectory) -> None:
    engine: Any = load_engine(engine_name)(hexapod)
    state, F = engine.state(trajectory), np.full((len(trajectory.t), 6), 100.0)
    before = engine.solved(state, F)
    for knob, value in SOLVER_KNOBS[engine_name].items():
        assert getattr(engine, knob) != value
        setattr(engine, knob, value)
    after = engine.solved(state, F)
    assert np.abs(after - before).max() > 1e-6 * np.abs(before).max()


def test_own_steps_obey_their_knobs(engine_name: str, hexapod: Scene) -> None:
    """Every knob moves where the steps go."""
    problem = pose(hexapod, 0.02, 2)
    plain: Any = load_engine(engine_name)(hexapod)
    before = plain.own_steps(problem, Staged(problem, 4), 4)
    for knobs in KNOBS[engine_name]:
        engine: Any = load_engine(engine_name)(hexapod)
        for knob, value in knobs.items():
            assert getattr(engine, knob) != value
            setattr(engine, knob, value)
        after = engine.own_steps(problem, Staged(problem, 4), 4)
        assert np.abs(after.q - before.q).max() > 1e-13, knobs  # m: the same steps give the same numbers
