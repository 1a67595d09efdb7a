"""The elimination leg by leg: it gives what the whole system gives, and leaves to it what it cannot do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from machines import random_planar, random_scene
from test_engines import hard_scene

from stewart_crosscheck.crosscheck import digits, loop_forces
from stewart_crosscheck.crosscheck.engine import load_engine
from stewart_crosscheck.crosscheck.kkt import Assembly
from stewart_crosscheck.crosscheck.loop_forces import eliminate, forces, solve
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene, scene_names

SCENES = [name for name in scene_names() if name != "collinear"]  # its forces are not determined


def assembled(engine_name: str, scene: Scene, trajectory: Trajectory) -> tuple[Any, Assembly]:
    engine: Any = load_engine(engine_name)(scene)
    return engine, engine.assemble(engine.state(trajectory))


def difference(engine: Any, assembly: Assembly) -> float:
    """Of forces and multipliers of both ways, over the largest of them."""
    tau, J = assembly.tau, assembly.J
    x = eliminate(tau, J, engine.layout)
    y = np.hstack(solve("x", tau, J, engine.layout, np.zeros(len(tau), dtype=bool)))
    return float(np.abs(x - y).max() / np.abs(y).max())


@pytest.mark.parametrize("name", SCENES)
def test_agrees_with_the_whole_system(engine_name: str, name: str) -> None:
    scene = load_scene(name)
    assert difference(*assembled(engine_name, scene, from_scene(scene, 21))) < 3e-15  # measured 3e-16 to 2e-15


@pytest.mark.parametrize(
    "scene",
    [random_scene(0), random_scene(1, base=False), random_planar(1, point=False), random_planar(2, point=True)],
    ids=["19 bodies", "13 bodies", "bar", "point mass"],
)
def test_agrees_with_the_whole_system_on_random_machines(engine_name: str, scene: Scene) -> None:
    assert difference(*assembled(engine_name, scene, from_scene(scene, 11))) < 1e-13  # condition below 60


@pytest.mark.parametrize(("kind", "distance"), [("steep", 1e-3), ("steep", 1e-6), ("parallel", 1e-6)])
def test_hard_poses_are_no_worse_than_by_the_whole_system(
    engine_name: str, kind: str, distance: float, hexapod: Scene
) -> None:
    """Both against certified forces: what both lose is rounding of the matrix times its condition (6e-17)."""
    scene, trajectory = hard_scene(hexapod, kind, distance)
    truth = load_engine("reference")(scene).inverse_dynamics(trajectory).F
    engine, (tau, J, *_) = assembled(engine_name, scene, trajectory)
    rounding = 1e-16 * trajectory.condition[0] * np.abs(truth).max()
    whole = np.abs(solve("x", tau, J, engine.layout, np.zeros(1, dtype=bool))[0] - truth).max()
    own = np.abs(eliminate(tau, J, engine.layout)[:, : scene.na] - truth).max()
    assert own < max(2.0 * whole, rounding)


def test_what_it_cannot_do_goes_to_the_whole_system(hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A loop that moves with another leg, a leg without a direction across its hinges, an undetermined sample."""
    engine, (tau, J, *_) = assembled("pinocchio", hexapod, from_scene(hexapod, 21))
    asked = []

    def whole(*arguments: Any) -> tuple[np.ndarray, np.ndarray]:
        asked.append(arguments[-1].tolist())
        return solve(*arguments)

    monkeypatch.setattr(loop_forces, "solve", whole)
    flags = np.zeros(21, dtype=bool)
    forces("x", tau, J, engine.layout, flags, 0.0)
    assert not asked
    coupled = J.copy()
    coupled[1, 0, engine.layout.passive[3, 0]] = 0.3
    F, multipliers = forces("x", tau, coupled, engine.layout, flags, 0.0)
    assert asked == [[1]]
    left = tau - np.einsum("tij,ti->tj", coupled, multipliers)
    left[:, engine.layout.actuated] -= F
    assert np.abs(left).max() < 1e-10  # N or N m of some thousand
    own = eliminate(tau, coupled, engine.layout)[1, :6]
    assert np.abs(own - F[1]).max() > 1e-3  # the elimination alone would be wrong


@pytest.mark.parametrize("samples", [3, 21], ids=["few", "many"])
def test_a_leg_without_a_direction_across_its_hinges_is_refused(samples: int, hexapod: Scene) -> None:
    engine, (tau, J, *_) = assembled("pinocchio", hexapod, from_scene(hexapod, samples))
    J[2][:, engine.layout.passive[0, 0]] = 0.0
    with pytest.raises(loop_forces.EngineError, match=r"^x: sample 2, leg 1: sin q_n = 0, expected at least 1e-12"):
        forces("x", tau, J, engine.layout, np.zeros(samples, dtype=bool), 0.0)


@pytest.mark.parametrize("name", ["hexapod", "planar3", "pointmass2"])
def test_the_cheap_bounds_miss_no_singularity(engine_name: str, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the limit is: elimination leaves every sample above it, and the whole system looks closer there."""
    scene = load_scene(name)
    motion = from_scene(scene, 201)
    engine, (tau, J, *_) = assembled(engine_name, scene, motion)
    condition = motion.condition
    looked: list[np.ndarray] = []
    monkeypatch.setattr(loop_forces, "require_held", lambda e, J, layout, named: looked.append(named))
    for limit in np.quantile(condition, [0.0, 0.1, 0.5, 0.9]):
        monkeypatch.setattr(loop_forces, "LIMIT", limit)
        with np.errstate(all="ignore"):
            monkeypatch.setattr(loop_forces, "require_legs", lambda *_: None)
            left = ~np.isfinite(eliminate(tau, J, engine.layout)).all(axis=1)
            looked.clear()
            solve("x", tau, J, engine.layout, np.zeros(len(tau), dtype=bool))
        above = set(np.flatnonzero(condition > limit * (1 + 1e-9)).tolist())
        assert above <= set(np.flatnonzero(left).tolist())
        assert above <= {int(k) for named in looked for k in named}
    monkeypatch.undo()
    assert np.isfinite(eliminate(tau, J, engine.layout)).all()


def test_the_condition_is_that_of_the_pose(engine_name: str, hexapod: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the engine's own Jacobians, whatever its axes: the number that trajectories are refused by."""
    motion = from_scene(hexapod, 5)
    engine, (_, J, *_) = assembled(engine_name, hexapod, motion)
    monkeypatch.setattr(digits, "LIMIT", 1.0)
    for k in range(5):
        with pytest.raises(loop_forces.EngineError, match=r"condition of the platform's equations = ") as error:
            digits.require_held("x", J[k : k + 1], engine.layout, np.array([k]))
        found = float(str(error.value).split(" = ")[1].split(",")[0])
        assert found == pytest.approx(motion.condition[k], rel=5e-3)  # three digits are printed
