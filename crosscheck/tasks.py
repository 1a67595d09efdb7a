"""The tasks of a simulation, each in a process of its engine: motions, accelerations, certified driving forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, TypeGuard

import numpy as np

from ..models.scene import Scene
from .credible import require_credible
from .engine import REFERENCE, DynamicsResult, Engine, EngineError, Failure, load_engine, require_finite
from .problem import Problem
from .processes import Workers, dynamics
from .simulation import Row
from .stepping import Method, Simulated
from .trajectory import Trajectory

SECONDS, SECONDS_PER_SECOND = 60.0, 60.0
"""Time limit of one simulation, and per simulated second: twenty times what the slowest needs here."""


class SimulatingEngine(Engine, Protocol):
    """An engine that goes on in time."""

    @classmethod
    def methods(cls, problem: Problem) -> tuple[Method, ...]:
        """What it does with a problem, one row each; known before its package is."""
        ...

    def simulate(self, problem: Problem, method: Method) -> Simulated:
        """The motion from the problem's start under its forces. Raises EngineError."""
        ...

    def accelerations(self, method: Method, trajectory: Trajectory, F: np.ndarray) -> np.ndarray:
        """Acceleration and angular acceleration (nt, 6) of the platform under driving forces (nt, N)."""
        ...


def simulates(engine: type[Engine]) -> TypeGuard[type[SimulatingEngine]]:
    """Whether an engine goes on in time."""
    return hasattr(engine, "simulate")


class _Task(NamedTuple):
    """What an engine's process does: a simulation, accelerations in given states, or certified driving forces."""

    engine: str
    method: Method | None = None
    still: bool = False


@dataclass
class Found:
    """Outcomes of the tasks."""

    certified: DynamicsResult | Failure | None = None
    simulated: dict[Row, Simulated | Failure] = field(default_factory=dict)
    accelerations: dict[tuple[str, str], np.ndarray | Failure] = field(default_factory=dict)


def simulated(
    name: str, models: Mapping[str, str], problem: Problem, method: Method, settings: Mapping[str, float] | None = None
) -> Simulated:
    """Body of a worker process; `settings` are attributes of the engine. Raises EngineError for what is no answer."""
    engine = load_engine(name)
    assert simulates(engine)
    made = engine(problem.scene, models)
    for attribute, value in (settings or {}).items():
        setattr(made, attribute, value)
    result = made.simulate(problem, method)
    if not isinstance(result, Simulated):
        raise EngineError(f"{name}: got {type(result).__name__}, expected a Simulated")
    nt = len(problem.t)
    for key, width in (("position", 3), ("quaternion", 4), ("velocity", 3), ("angular_velocity", 3)):
        got = np.shape(getattr(result, key))
        if got != (nt, width):
            raise EngineError(f"{name}: {key}: got shape {got}, expected shape {(nt, width)}")
        require_finite(name, **{key: getattr(result, key)})
    grid = (len(problem.grid),)
    for key in ("kinetic", "potential", "work"):
        if np.shape(getattr(result, key)) != grid:
            raise EngineError(f"{name}: {key}: got shape {np.shape(getattr(result, key))}, expected shape {grid}")
    require_finite(name, energy=result.defect)
    require_credible(name, problem, result)
    return result


def _accelerate(
    name: str, scene: Scene, models: Mapping[str, str], method: Method, trajectory: Trajectory, F: np.ndarray
) -> np.ndarray:
    """Body of a worker process."""
    engine = load_engine(name)
    assert simulates(engine)
    got = engine(scene, models).accelerations(method, trajectory, F)
    require_finite(name, accelerations=got)
    return got


def run_tasks(
    problem: Problem,
    models: Mapping[str, str],
    able: Mapping[str, tuple[Method, ...]],
    motion: Trajectory | None,
    done: Callable[[str], None],
) -> Found:
    """Outcome of every task; accelerations wait for the certified forces along a motion, if there is one."""
    scene, found = problem.scene, Found()
    names = [*able, *([REFERENCE] if motion is not None else [])]
    with Workers[_Task](names, SECONDS + SECONDS_PER_SECOND * problem.duration) as workers:
        if motion is not None:
            workers.start(REFERENCE, _Task(REFERENCE), dynamics, REFERENCE, scene, models, workers.shared(motion), None)
        for name, methods in able.items():
            for method in methods:
                if not method.unsupported:
                    workers.start(name, _Task(name, method), simulated, name, models, problem, method)
        for task, result in workers.ended():
            done(_line(problem, task, result))
            if task.method is None:
                found.certified = result
                if motion is not None and isinstance(result, DynamicsResult):
                    for name, method in _accelerating(able):
                        args = (name, scene, models, method, motion.without_accelerations(), result.F)
                        workers.start(name, _Task(name, method, still=True), _accelerate, *args)
            elif task.still:
                found.accelerations[task.engine, task.method.route] = result
            else:
                found.simulated[task.engine, task.method] = result
    return found


def _accelerating(able: Mapping[str, tuple[Method, ...]]) -> list[Row]:
    """One method of each route whose accelerations are compared."""
    methods = [(name, m) for name, methods in able.items() for m in methods if m.accelerates and not m.unsupported]
    return list({(name, m.route): (name, m) for name, m in reversed(methods)}.values())


def _line(problem: Problem, task: _Task, result: object) -> str:
    """What is said when a task has ended."""
    what = f"{task.engine} driving forces"
    if task.method is not None:
        dt = task.method.dt(problem)
        how = task.method.integrator + (f" {dt:.3g} s" if dt else "") if not task.still else "accelerations"
        what = f"{task.engine} {task.method.route} {how}"
    if isinstance(result, Failure):
        return f"{what} failed: {result.reason}"
    return f"{what} done" + (f" in {result.seconds:.2f} s" if isinstance(result, Simulated) else "")
