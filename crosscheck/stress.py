"""Hard cases: every engine's methods where formulas and engines stop being right, and whether they say so."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter
from typing import Any, NamedTuple

import pandas as pd

from .certainty import Certain
from .engine import REFERENCE, Engine, Failure, crashed
from .hard import Case, Point, TimeCase, family_names, load_family
from .outcome import NO_DIGITS, SILENT, Place, judge
from .processes import Workers
from .run import AGREE, DISAGREE, ENGINE_FAILED, choose_engines, new_run_id, provenance
from .stress_time import time_rows
from .stress_work import Answer, answers, certain, methods

LIMIT = 60.0
"""Seconds for all points of a case in one engine, or for one point after a crash."""


class Plan(NamedTuple):
    """How much is done: every so many-th value of a parameter, and the last one."""

    every: int


POINT = ["case", "value", "engine", "route"]
"""What a row is about, beside its problem and quantity."""

NATIVE = "native"
"""The route of engines' own solvers: the others are ours, or assembled and solved by us."""

FULL, QUICK = Plan(1), Plan(6)


@dataclass(frozen=True)
class StressReport:
    """What was found: a row per case, value, method and quantity, and what goes into run.json."""

    table: pd.DataFrame
    info: dict

    @property
    def status(self) -> int:
        """1: an answer of ours is wrong and nobody says so; 3: an engine failed to run."""
        return DISAGREE if self.info["silent_of_ours"] else ENGINE_FAILED if self.info["failed"] else AGREE


class Task(NamedTuple):
    """Points of a case that an engine is asked about: their places among the values."""

    case: str
    engine: str
    values: tuple[int, ...]


@dataclass(frozen=True)
class _Posed:
    """A case with its points."""

    family: str
    case: Case
    values: tuple[float, ...]
    points: list[Point]

    @classmethod
    def of(cls, family: str, case: Case, plan: Plan) -> _Posed:
        values = (*case.values[:-1][:: plan.every], case.values[-1])
        return cls(family, case, values, [case.at(value) for value in values])


def pose(families: Sequence[str], plan: Plan) -> dict[str, _Posed]:
    """Cases at an instant by name, of all families if none is named. Raises UnknownFamily."""
    found = [(family, case) for family, case in _cases(families) if isinstance(case, Case)]
    return {case.name: _Posed.of(family, case, plan) for family, case in found}


def _cases(families: Sequence[str]) -> list[tuple[str, Case | TimeCase]]:
    return [(family, case) for family in dict.fromkeys(families or family_names()) for case in load_family(family)]


def stress(
    families: Sequence[str] = (),
    engines: Sequence[str] = (),
    plan: Plan = FULL,
    done: Callable[[str, int], None] = lambda line, total: None,
) -> StressReport:
    """Ask every method of every engine at every point of the families, and judge its answers by certified truth.

    Parameters
    ----------
    families, engines : names; none means all. The reference always runs.
    plan : how many values of each parameter.
    done : called with a line for people and the number of all tasks, after each of them.

    Raises
    ------
    UnknownFamily, UnknownEngine
        Unusable input. A failure of an engine is no exception: its rows are refusals with its reason.
    """
    posed, chosen = pose(families, plan), choose_engines(engines)
    motions = {case: family for family, case in _cases(families) if isinstance(case, TimeCase)}
    started, begun = datetime.now(UTC), perf_counter()
    able = {name: engine for name, engine in chosen.items() if not isinstance(engine, Failure)}
    failed = [(name, engine) for name, engine in chosen.items() if isinstance(engine, Failure)]
    found = _ask(posed, able, failed, done)
    rows = [row for name, p in posed.items() for row in _rows(p, able, found[name])]
    by_name = {case.name: family for case, family in motions.items()}
    rows += [
        {"family": by_name[row["case"]], **row} for row in time_rows(list(motions), able, plan.every, failed, done)
    ]
    table = pd.DataFrame(rows)
    ours = table[table["route"] != NATIVE]
    info = {
        **provenance(new_run_id("stress", started), started, None, chosen),
        "seconds": perf_counter() - begun,
        "families": list(dict.fromkeys(family for family, _ in _cases(families))),
        "plan": plan._asdict(),
        "silent_of_ours": _points(ours[ours["outcome"] == SILENT]),
        "without_digits_of_ours": _points(ours[ours["reason"].str.startswith(NO_DIGITS)]),
        "failed": {name: failure.reason for name, failure in reversed(failed)},
        "crashed": crashed(failed),
    }
    report = StressReport(table, info)
    info["status"] = report.status
    return report


def _points(rows: pd.DataFrame) -> int:
    """Points of methods among rows of quantities."""
    return len(rows.drop_duplicates([*POINT, "problem"]))


Found = dict[str, list[Any]]
"""By engine: what it says of each point of a case."""


def _ask(
    posed: Mapping[str, _Posed],
    engines: Mapping[str, type[Engine]],
    failed: list[tuple[str, Failure]],
    done: Callable[[str, int], None],
) -> dict[str, Found]:
    """What engines and reference say of every point, by case; a task that dies is done again point by point.

    ``failed``: gets the engines that failed even so, and how.
    """
    found: dict[str, Found] = {
        name: {engine: [None] * len(p.points) for engine in engines} for name, p in posed.items()
    }
    total = len(posed) * len(engines)
    with Workers[Task](engines, LIMIT) as workers:

        def start(task: Task) -> None:
            points = [posed[task.case].points[k] for k in task.values]
            if task.engine == REFERENCE:
                workers.start(task.engine, task, certain, points)
            else:
                workers.start(task.engine, task, answers, task.engine, points)

        for name, p in posed.items():
            for engine in engines:
                start(Task(name, engine, tuple(range(len(p.points)))))
        for task, outcome in workers.ended():
            if isinstance(outcome, Failure) and len(task.values) > 1:
                total += len(task.values)
                for k in task.values:
                    start(Task(task.case, task.engine, (k,)))
            else:
                parts = [outcome] if isinstance(outcome, Failure) else outcome
                if isinstance(outcome, Failure):
                    failed.append((task.engine, outcome.about(task.case)))
                for k, part in zip(task.values, parts, strict=True):
                    found[task.case][task.engine][k] = part
            done(f"{posed[task.case].family}: {task.case} {task.engine}", total)
    return found


def _rows(p: _Posed, engines: Mapping[str, type[Engine]], found: Found) -> Iterator[dict[str, Any]]:
    """Rows of a case."""
    case = p.case
    for k, (value, point) in enumerate(zip(p.values, p.points, strict=True)):
        truth = found[REFERENCE][k]
        places: dict[str, Place | Failure] = {}
        for name, engine in engines.items():
            if name == REFERENCE:
                continue
            said = found[name][k]
            for method in methods(engine):
                if method.problem not in places:
                    places[method.problem] = _place(point, truth, method.problem)
                answer: Answer | Failure = said if isinstance(said, Failure) else said[method]
                if isinstance(truth, Failure):
                    answer = Failure(f"nothing to compare with: the reference failed: {truth.reason}")
                which = {
                    "family": p.family, "title": case.title, "case": case.name, "parameter": case.parameter,
                    "value": value, "engine": name, "route": method.route, "problem": method.problem,
                }  # fmt: skip
                held = method.route in getattr(engine, "states_nothing", ())
                floor = getattr(engine, "inertia_floor", 0.0)
                for row in judge(point, places[method.problem], method, answer, floor, held):
                    yield which | row


def _place(point: Point, truth: Mapping[str, Certain | Failure] | Failure, problem: str) -> Place | Failure:
    certain = truth if isinstance(truth, Failure) else truth[problem]
    return certain if isinstance(certain, Failure) else Place.of(point, certain)
