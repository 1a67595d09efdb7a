"""What the processes of `stress` do: certified answers, and those of every method of an engine, point by point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..models import write_models
from .certainty import Certain, certain_forward, certain_inverse
from .engine import (
    DynamicsResult,
    Engine,
    EngineError,
    Failure,
    is_forward,
    load_engine,
    require_complete,
    require_finite,
)
from .hard import FORWARD, INVERSE, Accelerated, Point
from .native import SolverEngine, growth_of_rounding
from .processes import failure_of
from .trajectory import Trajectory, TrajectoryError, instant


class Method(NamedTuple):
    """One way of an engine to answer one problem; of the forward one with reactions, or with accelerations alone."""

    route: str
    problem: str
    with_reactions: bool = True


Answer = DynamicsResult | Accelerated
"""One sample; of the exact forms of the forward problem accelerations alone."""


def attempt(task: Callable[..., Any], *args: Any) -> Any:
    """What a task returns, or a Failure with what it raised; a missing package is no answer to what was asked."""
    try:
        return task(*args)
    except ImportError:
        raise
    except (EngineError, TrajectoryError) as e:
        return Failure(str(e))
    except Exception as e:  # whatever a library raises: loud, and no answer
        return failure_of(e)


def certain(points: Sequence[Point]) -> list[dict[str, Certain | Failure]]:
    """A task: certified answers to both problems at each point."""
    return [{INVERSE: attempt(certain_inverse, p), FORWARD: attempt(certain_forward, p)} for p in points]


def methods(engine: type[Engine]) -> list[Method]:
    """Methods of an engine: what it declares as forms, else its routes and, for hard loops, their forward dynamics."""
    if forms := getattr(engine, "forms", None):
        return [Method(r, problem, problem == INVERSE) for problem, routes in forms.items() for r in routes]
    found = [Method(engine.route, INVERSE)]
    if issubclass(engine, SolverEngine):
        found.append(Method(engine.route, FORWARD, with_reactions=False))
    return [*found, Method(engine.forward_route, FORWARD)] if is_forward(engine) else found


def answers(name: str, points: Sequence[Point]) -> list[dict[Method, Answer | Failure]]:
    """A task: the answers of every method of an engine at each point."""
    engine = load_engine(name)
    return [dict(_answers(engine, point)) for point in points]


def _answers(engine: type[Engine], point: Point) -> Iterator[tuple[Method, Answer | Failure]]:
    for method in methods(engine):  # each one on an engine of its own: what one leaves behind is not met by the next
        yield method, attempt(_answer, engine, point, method)


def _answer(engine: type[Engine], point: Point, method: Method) -> Answer:
    made: Any = engine(point.scene, write_models(point.scene))
    if hasattr(engine, "forms"):
        answer = made.form(method.problem, method.route, point.row, point.forces)
        names = ("F", "reactions") if isinstance(answer, DynamicsResult) else ("platform",)
        require_finite(engine.name, **{name: getattr(answer, name) for name in names})
        return answer
    at = instant(point.scene, point.row, inverse=method.problem == INVERSE)
    if method.problem == INVERSE:
        answer = made.inverse_dynamics(at)
    elif method.route == engine.route:
        return _accelerations(made, at.without_accelerations(), np.array([point.forces]))
    else:
        answer = made.forward_dynamics(at.without_accelerations(), np.array([point.forces]))
    require_complete(engine.name, engine, method.route, point.scene, at, answer)
    return answer


def _accelerations(engine: SolverEngine, at: Trajectory, F: np.ndarray) -> Accelerated:
    known = engine.state(at)
    state = known._replace(a=np.zeros_like(known.a))
    require_finite(engine.name, q=state.q, v=state.v)
    a = engine.platform_acceleration(at, engine.accelerate(state, F))
    require_finite(engine.name, a=a)
    growth = growth_of_rounding(engine.free(state), state.v, engine.layout)
    return Accelerated(a, float(growth.max()))
