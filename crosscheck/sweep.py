"""What `bench` does with an engine: its methods, each over its own knob. Adding a sweep is adding a file in `benches`.

A sweep lists its cases without the engine's package, and makes one ready in the engine's own process: everything that
is not the task itself (the model, the engine's own state of the same samples, forces) is there before the clock starts.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..models.scene import Scene
from . import benches
from .problem import Problem
from .trajectory import Trajectory

TASKS = ("driving_forces", "all_reactions", "forward_step", "simulate")
"""Forces of a motion; these and all reactions; accelerations from forces; one second of motion from forces."""

BASELINE, LEGS = "baseline", "legs"
"""Cases beside the tasks: what every time is compared with, and machines of other numbers of legs."""

SAMPLES = 100
"""Samples of the scene's motion that every case takes; larger batches repeat them."""

MANY = 1000
"""Samples at a time where a knob is swept, and where an engine is watched."""


class Case(NamedTuple):
    """One thing to time, a row of the table.

    ``backend``: of the formulas alone.  ``knobs``: what the setting means to the engine.  ``exact``: its error is
    rounding, and held to the tolerance of `run`.
    """

    task: str
    engine: str
    route: str
    backend: str
    setting: str
    batch: int = 1
    knobs: tuple[tuple[str, Any], ...] = ()
    exact: bool = False

    def __str__(self) -> str:
        """For progress and failures."""
        return " ".join(str(x) for x in (*self[:5], f"batch {self.batch}") if x)


class Plan(NamedTuple):
    """How much is done.

    ``batches`` of the formulas and ``engine_batches``: samples at a time, divisors or multiples of ``samples``.
    ``every``: how many-th value of a knob is taken.  ``rounds`` over all cases; a case that has taken ``most`` seconds
    leaves after the third.  ``least``: seconds of one timing.
    """

    batches: tuple[int, ...]
    engine_batches: tuple[int, ...]
    every: int
    rounds: int
    most: float
    least: float
    samples: int = SAMPLES

    def some(self, values: Sequence[Any]) -> Sequence[Any]:
        """Values of a knob, the first one among them."""
        return values[:: self.every]


FULL = Plan(tuple(10**k for k in range(7)), tuple(10**k for k in range(5)), 1, 5, 2.0, 0.05)
QUICK = Plan((1, 100, 10_000), (1, 1000), 3, 5, 0.3, 0.02)


@dataclass(frozen=True)
class Inputs:
    """What every engine is given: a scene, its models, samples of its motion, their certified forces, one problem.

    ``F`` (nt, N) [N].  ``problem``: one second of the motion under its own driving forces.
    """

    scene: Scene
    models: Mapping[str, str]
    trajectory: Trajectory
    F: np.ndarray
    problem: Problem


class Ready(NamedTuple):
    """A case with everything at hand.

    ``call(part)`` for all ``parts`` is what is timed, ``samples`` at a time.  ``read(results, pick)``: what it answers
    for the samples of the trajectory, which stand at ``pick`` among those of all parts: forces (nt, N); these and
    reactions (nt, nj, 6); accelerations (nt, 6) of the platform; its positions and quaternions in time.
    ``engine``: to be watched.
    """

    parts: Sequence[Any]
    call: Callable[[Any], Any]
    read: Callable[[list[Any], np.ndarray], Any]
    samples: int = 1
    engine: Any = None


class Sweep(Protocol):
    """Sweep of an engine."""

    def cases(self, scene: Scene, plan: Plan) -> Iterable[Case]:
        """Everything there is to time on a scene; known before the engine's package is."""
        ...

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """One of the cases, in the engine's process. Raises EngineError."""
        ...


def parts(samples: int, batch: int) -> list[np.ndarray]:
    """Indices of samples, `batch` at a time: all of them once, or one batch that repeats them."""
    return list(np.arange(samples).reshape(-1, batch)) if batch <= samples else [np.arange(batch) % samples]


def picked(samples: int, batch: int) -> np.ndarray:
    """Where each sample is looked up among those of `parts`: spread over the whole batch."""
    first = np.arange(samples)
    return first + samples * (first * (max(batch, samples) // samples) // samples)


def sweep_names() -> list[str]:
    """Engines that have a sweep."""
    return sorted(m.name.removesuffix("_") for m in pkgutil.iter_modules(benches.__path__) if m.name.endswith("_"))


def load_sweep(name: str) -> Sweep:
    """Sweep of an engine."""
    return importlib.import_module(f"{benches.__name__}.{name}_").SWEEP
