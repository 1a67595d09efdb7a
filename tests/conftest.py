"""Scenes, trajectories and truth that many tests share."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from stewart_crosscheck.analytic import Parameters, PlatformMotion, forward
from stewart_crosscheck.analytic.solve import row_scaled
from stewart_crosscheck.crosscheck.checks import checks, longest_leg
from stewart_crosscheck.crosscheck.engine import DynamicsResult, Engine, Failure, Key, load_engine
from stewart_crosscheck.crosscheck.trajectory import Trajectory, from_scene
from stewart_crosscheck.models import Scene, load_scene

# No time is asserted, and the fixture `engine_name` is a word, which no example can change.
_NO_CHECK = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
_ALWAYS: dict[str, Any] = {"deadline": None, "suppress_health_check": _NO_CHECK}
settings.register_profile("short", max_examples=8, derandomize=True, database=None, **_ALWAYS)
settings.register_profile("long", max_examples=1000, print_blob=True, **_ALWAYS)
settings.load_profile("short")  # `--hypothesis-profile long` comes later, and wins

ENGINES = {"mujoco": "mujoco", "pinocchio": "pinocchio", "dart": "dartpy"}
"""Engine name to the module that it needs."""


@pytest.fixture(scope="session")
def hexapod() -> Scene:
    return load_scene("hexapod")


@pytest.fixture(scope="session")
def trajectory(hexapod: Scene) -> Trajectory:
    return from_scene(hexapod, 21)


@pytest.fixture(scope="session")
def truth(hexapod: Scene, trajectory: Trajectory) -> DynamicsResult:
    return load_engine("reference")(hexapod).inverse_dynamics(trajectory)


@pytest.fixture(params=ENGINES)
def engine_name(request: pytest.FixtureRequest) -> str:
    """Name of an engine whose package is installed; skipped otherwise, unless REQUIRE_ENGINES names it."""
    name = request.param
    try:
        importlib.import_module(ENGINES.get(name, "stewart_crosscheck.analytic"))
    except ImportError:
        if name in os.environ.get("REQUIRE_ENGINES", "").split(","):
            raise
        pytest.skip(f"{ENGINES[name]} is not installed")
    return name


def keyed(
    scene: Scene, trajectory: Trajectory, engines: Mapping[str, type[Engine]], results: Mapping[str, Any]
) -> dict[Key, Any]:
    """Results of inverse dynamics by engine and route, each with the checks that its engine declares."""
    keys = {(name, engine.route): (engine, results[name]) for name, engine in engines.items()}
    return {key: with_checks(scene, trajectory, engine, result) for key, (engine, result) in keys.items()}


def with_checks(scene: Scene, trajectory: Trajectory, engine: type[Engine], result: Any) -> Any:
    """A result as it comes back from an engine's process."""
    if isinstance(result, Failure) or not engine.checks:
        return result
    return replace(result, checks=checks(scene, engine, trajectory, result, longest_leg(scene, trajectory)))


def parameters(scene: Scene) -> Parameters:
    """Parameters of a spatial scene."""
    P = scene.parameters
    assert isinstance(P, Parameters)
    return P


def one_sample(motion: PlatformMotion, k: int) -> PlatformMotion:
    """Sample k of a motion as plain floats."""
    return PlatformMotion(*(np.asarray(a)[k].tolist() for a in motion))


@pytest.fixture
def conditions(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Conditions of the forms of the second problem, as they are solved; none where a back end is beyond doubt."""
    found: list[np.ndarray] = []

    def recorded(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        length, condition = row_scaled(A)
        found.append(condition)
        return length, condition

    monkeypatch.setattr(forward, "row_scaled", recorded)
    return found


@pytest.fixture
def samples_as_floats(trajectory: Trajectory) -> list[PlatformMotion]:
    return [one_sample(trajectory.motion, k) for k in range(len(trajectory.t))]
