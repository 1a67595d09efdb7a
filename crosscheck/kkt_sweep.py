"""What is timed of every engine with hard loops; a file in `benches` adds the knobs of its own solver and steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..models.scene import Scene
from .engine import EngineError, load_engine
from .kkt import KktEngine, State
from .problem import Staged
from .stepping import SteppingEngine, continuous
from .sweep import MANY, Case, Inputs, Plan, Ready, parts

HARD = "hard loops"


class Knob(NamedTuple):
    """A setting of an engine's own solver or steps: how it reads, and the attributes that make it so."""

    setting: str
    values: dict[str, Any]
    steps: int = 0
    """Of an integrator, per interval of the problem's grid."""


@dataclass(frozen=True)
class KktSweep:
    """Sweep of a `SteppingEngine`: hard loops over batches, its own solver over its knobs, steps in time.

    ``solver``: knobs of ``solved``; ``own``: those of ``own_steps``, by integrator.
    """

    engine: str
    solver: Sequence[Knob]
    own: dict[str, Sequence[Knob]]
    native: str = "native"

    def cases(self, scene: Scene, plan: Plan) -> Iterator[Case]:
        """All tasks on hard loops, then the engine's own solver, each over batches; then steps in time."""
        for task in ("driving_forces", "all_reactions", "forward_step"):
            for batch in plan.engine_batches:
                yield Case(task, self.engine, "kkt", "", HARD, batch, exact=True)
        for knob in plan.some(self.solver):
            for batch in plan.engine_batches if knob is self.solver[-1] else (min(MANY, plan.engine_batches[-1]),):
                yield self._case("forward_step", self.native, knob.setting, knob, batch)
        for steps in plan.some((1, 2, 4)):
            yield Case("simulate", self.engine, "kkt", "", f"RK4, {_dt(steps)}", knobs=(("steps", steps),))
        for integrator, knobs in self.own.items():
            for knob in plan.some(knobs):
                setting = ", ".join(x for x in (integrator, knob.setting, _dt(knob.steps)) if x)
                yield self._case("simulate", self.native, setting, knob)

    def _case(self, task: str, route: str, setting: str, knob: Knob, batch: int = 1) -> Case:
        knobs = (*knob.values.items(), *([("steps", knob.steps)] if knob.steps else []))
        return Case(task, self.engine, route, "", setting, batch, knobs)

    def ready(self, case: Case, inputs: Inputs) -> Ready:
        """The engine on its own model file with the case's knobs, its states ready made."""
        engine = load_engine(case.engine)(inputs.scene, inputs.models)
        if not isinstance(engine, SteppingEngine):
            raise EngineError(f"{case.engine}: got {type(engine).__name__}, expected an engine that goes on in time")
        knobs = dict(case.knobs)
        steps = knobs.pop("steps", 0)
        for name, value in knobs.items():
            if not hasattr(engine, name):
                raise EngineError(f"{case.engine}: no knob {name!r}")
            setattr(engine, name, value)
        return _steps(engine, case, inputs, steps) if steps else _samples(engine, case, inputs)


def _dt(steps: int) -> str:
    return f"dt {1e-2 / steps:.3g} s"


def _samples(engine: SteppingEngine, case: Case, inputs: Inputs) -> Ready:
    """A task on states, one by one or many at a time."""
    trajectory, state = inputs.trajectory, engine.state(inputs.trajectory)
    index = parts(len(trajectory.t), case.batch)
    states = [State(*(x[i] for x in state)) for i in index]
    samples = sum(map(len, index))
    moving = [(s, trajectory.undetermined[i]) for s, i in zip(states, index, strict=True)]
    if case.task == "driving_forces":
        return Ready(
            moving,
            lambda part: engine.driving_forces(*part),
            lambda out, pick: np.concatenate(out)[pick],
            samples,
            engine,
        )
    if case.task == "all_reactions":

        def both(out: list[Any], pick: np.ndarray) -> Any:
            return tuple(np.concatenate(x)[pick] for x in zip(*out, strict=True))

        return Ready(moving, lambda part: engine.all_reactions(*part), both, samples, engine)
    solve = engine.accelerate if case.route == KktEngine.route else engine.solved
    given = [(s, inputs.F[i]) for s, i in zip(states, index, strict=True)]

    def platform(out: list[Any], pick: np.ndarray) -> np.ndarray:
        return engine.platform_acceleration(trajectory, np.concatenate(out)[pick])

    return Ready(given, lambda part: solve(*part), platform, samples, engine)


def _steps(engine: SteppingEngine, case: Case, inputs: Inputs, steps: int) -> Ready:
    """One second of motion; one sample."""
    problem = inputs.problem
    F = Staged(problem, steps)

    def run(F: Staged) -> State:
        if case.route == KktEngine.route:
            return engine.runge_kutta(problem, F, steps, engine.accelerate)
        return engine.own_steps(problem, F, steps)

    def poses(out: list[State], _: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = slice(None, None, problem.parts)
        seen = engine.see(State(*(x[at] for x in out[0])))
        return seen.position, continuous(seen.rotation)

    return Ready([F], run, poses)
