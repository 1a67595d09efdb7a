"""Detection power: the smallest fault that `run` sees, of every number of a scene and of every term of the formulas.

Scene, trajectory and certified truth stay right, one engine gets one thing that is wrong, and the table of `run` says
whether anything fails.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import pandas as pd

from ..models import load_scene, scene_names, write_models
from ..models.scene import Scene
from .engine import REFERENCE, DynamicsResult, Engine, Failure, routes
from .power_elsewhere import of_other_terms
from .power_mistakes import MISTAKES, Mistake
from .power_parameters import parameters
from .power_tasks import (
    COLUMNS,
    DETECTED,
    NOT_RUN,
    Row,
    Survey,
    nobody,
    of_mistakes,
    of_parameters,
    of_terms,
    row,
    survey,
)
from .power_terms import terms
from .power_work import FORMULAS, Place
from .processes import Workers, dynamics
from .run import AGREE, DISAGREE, ENGINE_FAILED, choose_engines, new_run_id, provenance, require_determinate
from .trajectory import SAMPLES, Trajectory, from_scene

LIMIT = 300.0
"""Seconds for one task: a few faults, some tens of times what the slowest engine needs here."""

AT_ONCE = 4
"""Faults of one task: a crash costs these, which are then looked at one by one."""

ALSO = ("hexapod", "planar3", "tsai2000")
"""Scenes on which terms are looked at that the scene's own `run` does not evaluate."""

CERTIFY, SURVEY, PARAMETER, TERM, OTHER, MISTAKE = "truth", "survey", "parameters", "terms", "other terms", "mistakes"


class Task(NamedTuple):
    """What a process does: faults of a kind, by their places, on a scene."""

    kind: str
    engine: str
    scene: str
    items: tuple[int, ...] = ()


@dataclass(frozen=True)
class PowerReport:
    """The table, a row per fault, engine and route, columns `COLUMNS`, and what goes into run.json."""

    table: pd.DataFrame
    info: dict

    @property
    def status(self) -> int:
        """1: a public mistake is not caught, or something is wrong without any fault; 3: an engine failed to run."""
        if self.info["uncaught"] or self.info["disagree"]:
            return DISAGREE
        return ENGINE_FAILED if self.info["failed"] else AGREE


@dataclass
class _Look:
    """One look at everything: what is known so far, and what is asked next."""

    workers: Workers[Task]
    engines: Mapping[str, type[Engine]]
    scenes: Mapping[str, Scene]
    trajectories: Mapping[str, Trajectory]
    main: str
    mistakes: Sequence[Mistake]
    failed: dict[str, str]
    rows: list[Row] = field(default_factory=list)
    disagree: list[str] = field(default_factory=list)
    paths: dict[str, Path] = field(default_factory=dict)
    surveys: dict[str, Survey] = field(default_factory=dict)
    waiting: set[Task] = field(default_factory=set)
    elsewhere: bool = False
    tasks: int = 0

    def start(self, task: Task) -> None:
        """Give a task to the process of its engine."""
        self.tasks += 1
        self.waiting.add(task)
        scene, (kind, engine, name, items) = self.scenes[task.scene], task
        path = self.paths.get(name, Path())
        if kind == CERTIFY:
            motion = self.workers.shared(self.trajectories[name])
            self.workers.start(engine, task, dynamics, REFERENCE, scene, write_models(scene), motion, None)
        elif kind == SURVEY:
            self.workers.start(engine, task, survey, path, engine)
        elif kind == PARAMETER:
            self.workers.start(engine, task, of_parameters, path, engine, items, self.right(engine))
        elif kind == TERM:
            zero = self.surveys[FORMULAS].zero if engine == FORMULAS else frozenset[int]()
            right = self.right(engine)[self.engines[engine].route]
            self.workers.start(engine, task, of_terms, path, engine, items, right, zero)
        elif kind == OTHER:
            also = [self.paths[s] for s in dict.fromkeys((self.main, *ALSO)) if s in self.paths]
            self.workers.start(engine, task, of_other_terms, also, items)
        else:
            self.workers.start(engine, task, of_mistakes, path, engine, items, self.mistakes)

    def right(self, engine: str) -> dict[str, str]:
        """Digests of what an engine answers without a fault, by route."""
        return {route: seen.digest for route, seen in self.surveys[engine].right.items()}

    def split(self, kind: str, engine: str, items: Sequence[int]) -> None:
        """Start tasks for many faults on the main scene."""
        for first in range(0, len(items), AT_ONCE):
            self.start(Task(kind, engine, self.main, tuple(items[first : first + AT_ONCE])))

    def end(self, task: Task, outcome: Any) -> None:
        """Note what came of a task, and start those that waited for it."""
        if isinstance(outcome, Failure):
            self._failed(task, outcome)
        elif task.kind == CERTIFY:
            assert isinstance(outcome, DynamicsResult)
            name = task.scene
            self.paths[name] = self.workers.shared(Place(self.scenes[name], self.trajectories[name], outcome))
            if name == self.main:
                for engine in self.engines:
                    if engine != REFERENCE:
                        self.start(Task(SURVEY, engine, name))
            elif FORMULAS in self.engines:
                self.start(Task(MISTAKE, FORMULAS, name, tuple(range(len(self.mistakes)))))
        elif task.kind == SURVEY:
            self._surveyed(task.engine, outcome)
        else:
            self.rows += outcome
        self.waiting.discard(task)
        first = {(CERTIFY, REFERENCE), (TERM, FORMULAS)}
        if FORMULAS in self.surveys and not self.elsewhere and not any(t[:2] in first for t in self.waiting):
            self.elsewhere = True
            self._others()

    def _surveyed(self, engine: str, found: Survey) -> None:
        """Start all of an engine, unless its rows fail without a fault: then a fault says nothing."""
        wrong = [f"{engine} {route}: {s.refused or s.quantity}" for route, s in found.right.items() if s.detected]
        if wrong:
            self.disagree += wrong
            return
        self.surveys[engine] = found
        self.split(PARAMETER, engine, range(len(parameters(self.scenes[self.main]))))
        self.split(MISTAKE, engine, range(len(self.mistakes)))
        if engine == FORMULAS:
            self.split(TERM, engine, sorted(found.reached))
            for other in self.surveys:
                self._shared(other)
        elif FORMULAS in self.surveys:
            self._shared(engine)

    def _shared(self, engine: str) -> None:
        if engine != FORMULAS:
            self.split(TERM, engine, sorted(self.surveys[FORMULAS].shared))

    def _others(self) -> None:
        """Look elsewhere for the terms that nothing on the scene has seen."""
        seen = {r["number"] for r in self.rows if r["kind"] == TERM_KIND and r["verdict"] == DETECTED}
        left = [site.number for site in terms() if site.number not in seen]
        for first in range(0, len(left), 4 * AT_ONCE):
            self.start(Task(OTHER, FORMULAS, self.main, tuple(left[first : first + 4 * AT_ONCE])))

    def _failed(self, task: Task, failure: Failure) -> None:
        if len(task.items) > 1:
            for item in task.items:
                self.start(task._replace(items=(item,)))
            return
        self.failed.setdefault(task.engine, f"{task.kind} of {task.scene}: {failure.reason}")
        if task.kind != PARAMETER:  # rows of those that are missing are made in the end
            self.rows += [self._unknown(task, item, failure.reason) for item in task.items]

    def _unknown(self, task: Task, item: int, reason: str) -> Row:
        more = {"scene": task.scene, "engine": task.engine, "route": self.engines[task.engine].route, "reason": reason}
        if task.kind == MISTAKE:
            return row("mistake", item, self.mistakes[item].code, self.mistakes[item].name, **more)
        return nobody(item) | more


TERM_KIND = "term"


def power(
    scene: Scene,
    engines: Sequence[str] = (),
    samples: int = SAMPLES,
    mistakes: Sequence[Mistake] = MISTAKES,
    done: Callable[[str, int], None] = lambda line, total: None,
) -> PowerReport:
    """Plant every fault, one by one, and see what `run` says.

    Parameters
    ----------
    scene : with a motion of its own.
    engines : names; none means all. The formulas and the reference always run.
    samples : of the motion; `run` takes as many.
    mistakes : planted on every built-in scene, too.
    done : called with a line for people and the number of all tasks so far, after each of them.

    Raises
    ------
    UnknownEngine, SceneError, TrajectoryError
        Unusable input. A failure of an engine is no exception: its rows say so.
    """
    chosen = choose_engines([FORMULAS, *engines] if engines else ())
    require_determinate(scene)
    started, begun = datetime.now(UTC), perf_counter()
    scenes = {scene.name: scene} | {n: load_scene(n) for n in scene_names() if n != scene.name}
    trajectories = {name: from_scene(s, samples) for name, s in scenes.items()}
    able = {name: engine for name, engine in chosen.items() if not isinstance(engine, Failure)}
    failed = {name: engine.reason for name, engine in chosen.items() if isinstance(engine, Failure)}
    with Workers[Task](able, LIMIT) as workers:
        look = _Look(workers, able, scenes, trajectories, scene.name, mistakes, failed)
        for name in scenes if REFERENCE in able else ():
            look.start(Task(CERTIFY, REFERENCE, name))
        for task, outcome in workers.ended():
            look.end(task, outcome)
            done(f"{task.kind}, {task.engine}: {task.scene}", look.tasks)
    table = _table(look)
    planted = table[(table["kind"] == "mistake") & (table["verdict"] != NOT_RUN)]
    missed = set(planted["fault"]) - set(planted.loc[planted["verdict"] == DETECTED, "fault"])
    info = {
        **provenance(new_run_id("power", started), started, scene, chosen),
        "seconds": perf_counter() - begun,
        "samples": samples,
        "terms": len(terms()),
        "uncaught": [m.name for m in mistakes if m.name in missed],
        "disagree": look.disagree,
        "failed": failed,
    }
    report = PowerReport(table, info)
    info["status"] = report.status
    return report


KINDS = ("parameter", TERM_KIND, "sign", "mistake")


def _table(look: _Look) -> pd.DataFrame:
    """Every expected row: what an engine that did not run leaves out is `not run`."""
    rows = list(look.rows)
    have = {(r["engine"], r["number"]) for r in rows if r["kind"] == "parameter"}
    for name, engine in look.engines.items():
        if name == REFERENCE:
            continue
        why = look.failed.get(name) or look.failed.get(REFERENCE) or "its rows fail without any fault"
        for k, parameter in enumerate(parameters(look.scenes[look.main])):
            if (name, k) not in have:
                more = {"scene": look.main, "engine": name, "reason": why}
                rows += [row("parameter", k, parameter.group, parameter.name, route=r, **more) for r in routes(engine)]
    engines, scenes = list(look.engines), ["", *look.scenes]

    def place(r: Row) -> tuple[int, ...]:
        return KINDS.index(r["kind"]), scenes.index(r["scene"]), r["number"], engines.index(r["engine"] or FORMULAS)

    return pd.DataFrame(sorted(rows, key=place), columns=COLUMNS)
