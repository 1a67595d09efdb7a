"""Hard motions in every engine: how far each one's way of going on in time is from the truth, and whether it says so.

Their `true_motion` is certain, and the sensitivity that of it to half-ulp changes of the start and the driving forces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..models import write_models
from .compare import UNSUPPORTED
from .credible import exchanged
from .engine import REFERENCE, Died, Engine, Failure
from .hard import Passage, TimeCase
from .outcome import ACCURATE, DEGRADED, NEAR_SENSITIVITY, REFUSED, SILENT
from .problem import GRID, Problem, pose
from .processes import Workers
from .simulation import Row, judge, pose_errors
from .stepping import Method, Simulated
from .tasks import simulated, simulates
from .tolerance import FOLLOWS, LAW_FACTOR
from .tolerance import LIMIT as VAGUE
from .true_motion import HALF_ULP, TrueMotion, true_motion

LIMIT = 300.0
"""Seconds of one simulation."""

MOST_STEPS = {"dae": 1_000, "kkt": 1_000, "pinocchio native": 1_000}
"""Of a route: where Python makes a step it takes a millisecond, in MuJoCo and DART 4e-5 s. A hundred thousand of the
former would take minutes, and are left out."""

QUANTITIES = ("pose", "turn", "energy", "gap")
"""Distance from the true position and largest gap of a loop over the longest leg, angle from the true pose [rad],
energy that is not accounted for over the energy exchanged."""


class _Task(NamedTuple):
    """What a process does: a case's value by its number, and a method, or the truth."""

    case: str
    value: int
    engine: str
    method: Method | None = None


@dataclass(frozen=True)
class _Posed:
    """A value of a case with its problem."""

    case: TimeCase
    value: float
    passage: Passage
    problem: Problem

    @property
    def motion(self) -> tuple[Any, ...]:
        """What values with the same true motion share."""
        return self.problem.scene.sha256, self.passage.duration, self.passage.intervals

    @classmethod
    def of(cls, case: TimeCase, value: float) -> _Posed:
        passage = case.at(value)
        longest = max(GRID, passage.step, passage.other)
        return cls(case, value, passage, pose(passage.scene, passage.duration, passage.intervals + 1, longest))

    def pairs(self, name: str, engine: type[Engine]) -> Iterator[tuple[Method, Method]]:
        """Methods of an engine with the step of the passage, and with the other one."""
        if not simulates(engine):
            return
        passage, problem, seen = self.passage, self.problem, set()
        for method in engine.methods(problem):
            kind = (method.route, method.integrator)
            if kind in seen or method.unsupported or (passage.settings and (name, kind[1]) not in passage.settings):
                continue
            seen.add(kind)
            most = MOST_STEPS.get(f"{name} {method.route}", MOST_STEPS.get(method.route, np.inf))
            if problem.duration > most * passage.step * (1.0 + 1e-9):
                continue
            own, other = (round(problem.spacing / step) for step in (passage.step, passage.other))
            adaptive = method.steps is None
            yield (
                method if adaptive else method._replace(steps=own),
                method if adaptive else method._replace(steps=other),
            )


def label(method: Method) -> str:
    """What the route of a method is called: its integrators share it, but for what they add."""
    return method.route + "".join(method.integrator.partition(" + ")[1:])


def labels(case: TimeCase, name: str, engine: type[Engine], every: int = 1) -> set[str]:
    """Routes of an engine that have rows in a case, at one value of the parameter or another."""
    values = (*case.values[:-1][::every], case.values[-1])
    return {label(own) for value in values for own, _ in _Posed.of(case, value).pairs(name, engine)}


def time_rows(
    cases: Sequence[TimeCase],
    engines: Mapping[str, type[Engine]],
    every: int = 1,
    failed: list[tuple[str, Failure]] | None = None,
    done: Callable[[str, int], None] = lambda line, total: None,
) -> list[dict[str, Any]]:
    """Rows of `stress` for hard motions: every method of every engine at every value.

    Parameters
    ----------
    cases : hard motions.
    engines : classes by name; without the reference no answer can be told right from wrong.
    every : so many-th value of a parameter is taken, and the last one.
    failed : gets the engines whose process crashed or was late, and how.
    done : called with a line for people and the number of all tasks, after each of them.
    """
    posed = {
        (case.name, k): _Posed.of(case, value)
        for case in cases
        for k, value in enumerate((*case.values[:-1][::every], case.values[-1]))
    }
    first: dict[tuple[Any, ...], _Task] = {}
    for key, p in posed.items():
        first.setdefault(p.motion, _Task(*key, REFERENCE))
    tasks = [*first.values()]
    for key, p in posed.items():
        for name, engine in engines.items():
            methods = dict.fromkeys(m for pair in p.pairs(name, engine) for m in pair)
            tasks += [_Task(*key, name, method) for method in methods]
    found: dict[_Task, Any] = {}
    if REFERENCE not in engines:
        tasks = [task for task in tasks if task.method]
        found |= dict.fromkeys(first.values(), Died("it did not run"))
    with Workers[_Task](engines, LIMIT) as workers:
        models = {key: write_models(p.problem.scene) for key, p in posed.items()}
        for task in tasks:
            key = task.case, task.value
            p = posed[key]
            if task.method is None:
                workers.start(REFERENCE, task, true_motion, p.problem)
            else:
                settings = p.passage.settings.get((task.engine, task.method.integrator))
                args = task.engine, models[key], p.problem, task.method, settings
                workers.start(task.engine, task, simulated, *args)
        for task, result in workers.ended():
            found[task] = result
            if failed is not None and isinstance(result, Died):
                failed.append((task.engine, result.about(task.case)))
            done(f"in_time: {task.case} {posed[task.case, task.value].value:g} {task.engine}", len(tasks))
    rows = []
    for key, p in posed.items():
        for name, engine in engines.items():
            for own, other in p.pairs(name, engine):
                results = {(name, m): found[_Task(*key, name, m)] for m in (own, other)}
                rows += _rows(p, name, own, results, found[first[p.motion]])
    return rows


def _rows(
    p: _Posed, name: str, method: Method, results: Mapping[Row, Simulated | Failure], true: TrueMotion | Failure
) -> Iterator[dict[str, Any]]:
    """A method's rows at one value."""
    own, case = results[name, method], p.case
    which = {
        "title": case.title, "case": case.name, "parameter": case.parameter, "value": p.value, "engine": name,
        "route": label(method), "problem": "in time",
    }  # fmt: skip
    nothing = {"max_rel_error": np.nan, "input_sensitivity": np.nan, "condition": np.nan}
    if isinstance(true, TrueMotion):
        nothing["condition"] = float(true.grown[-1])
    for quantity in QUANTITIES:
        if quantity == "gap" and method.steps is None:
            continue  # in minimal coordinates no loop can open
        row = which | nothing | {"quantity": quantity}
        if isinstance(true, Died):
            reason = f"nothing to compare with: the reference failed: {true.reason}"
            yield row | {"outcome": REFUSED, "reason": reason}
        elif isinstance(own, Failure):
            yield row | {"outcome": REFUSED, "reason": own.reason}
        elif isinstance(true, Failure):
            yield row | {"outcome": SILENT, "reason": f"an answer where there is no certain one: {true.reason}"}
        else:
            yield row | _judged(p.problem, true, name, method, results, own, quantity)


def _judged(
    problem: Problem, true: TrueMotion, name: str, method: Method, results: Mapping[Row, Simulated | Failure],
    own: Simulated, quantity: str,
) -> dict[str, Any]:  # fmt: skip
    numbers, wrong = judge(problem, true, (name, method), results)
    error, sensitivity = _error(problem, true, own, quantity)
    row = {"max_rel_error": error, "input_sensitivity": sensitivity}
    if error <= min(NEAR_SENSITIVITY * sensitivity, VAGUE):
        return row | {"outcome": ACCURATE, "reason": ""}
    beyond = f"{error / sensitivity:.1e} times the input sensitivity"
    if numbers["verdict"] == UNSUPPORTED:
        return row | {"outcome": DEGRADED, "reason": f"{beyond}; {numbers['reason']}"}
    if quantity == "gap":
        allowed = _gap_law(problem, method, results, name)
        found = "" if error <= allowed else f"gap {error:.1e} of the longest leg, allowed {allowed:.1e}"
    else:
        about = {"pose": ("pose", "order"), "turn": ("rotation", "order"), "energy": ("energy",)}[quantity]
        found = "; ".join(wrong[key] for key in about if key in wrong)
    if found:
        return row | {"outcome": SILENT, "reason": f"{beyond}; {found}"}
    return row | {"outcome": DEGRADED, "reason": f"{beyond}, within what the route states"}


def _error(problem: Problem, true: TrueMotion, own: Simulated, quantity: str) -> tuple[float, float]:
    """A relative error, and what half-ulp inputs, or states, make of the quantity."""
    length = problem.length
    if quantity in ("pose", "turn"):
        errors = pose_errors(own, true.position, true.quaternion).max(axis=0)
        return (errors[0] / length, true.pose / length) if quantity == "pose" else (errors[1], true.turn)
    if quantity == "energy":
        turnover = exchanged(problem, own)
        rounded = 2.0 * HALF_ULP * (2.0 * own.kinetic + np.abs(own.potential) + np.abs(own.work))
        return float(np.abs(own.defect).max()) / turnover, float(rounded.max()) / turnover
    reach = length + float(np.abs(own.position).max()) + float(np.abs(problem.scene.hull.pins).max())
    return own.gap / length, 2.0 * HALF_ULP * reach / length


def _gap_law(problem: Problem, method: Method, results: Mapping[Row, Simulated | Failure], name: str) -> float:
    """What a gap may be over the longest leg: it falls with the step as the method's order says, down to rounding."""
    own = results[name, method]
    other_method, other = next((m, s) for (_, m), s in results.items() if m != method)
    assert isinstance(own, Simulated)
    assert isinstance(other, Simulated)
    assert method.steps is not None
    assert other_method.steps is not None
    assert method.order is not None
    ratio = method.steps / other_method.steps
    fine = max(ratio, 1.0 / ratio) ** method.order
    left = 1.0 / (fine - 1.0) if ratio > 1.0 else fine / (fine - 1.0)
    rounding = FOLLOWS.value * max(problem.duration, 1.0)
    return (LAW_FACTOR * left * abs(own.gap - other.gap) + rounding) / problem.length
