"""Speed against error: every engine's methods over their knobs, timed in turns, one at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter
from typing import Any

import pandas as pd

from ..models import write_models
from ..models.scene import Scene
from .bench_split import split, split_cases, split_table
from .bench_table import Timed, Truth, scaling, speed_error
from .bench_work import First, again, first, threads
from .benches.analytic_ import roofline
from .engine import REFERENCE, DynamicsResult, Engine, EngineError, Failure, crashed
from .problem import pose
from .processes import Workers, dynamics
from .run import AGREE, DISAGREE, ENGINE_FAILED, choose_engines, new_run_id, provenance, require_determinate
from .sweep import BASELINE, FULL, Case, Inputs, Plan, load_sweep, sweep_names
from .trajectory import from_scene

LIMIT = 60.0
"""Seconds for one visit of a case."""

LEAST_ROUNDS = 3
"""Of a case that takes long."""

OUTPUTS = 26
"""Of the second that is simulated: errors are taken 25 times a second, and steps are 10 ms or less."""

FORMULAS = "analytic"
YARDSTICK = "pinocchio"
"""Whose `rnea` is the yardstick of all times, whichever engines are asked for."""


@dataclass(frozen=True)
class BenchReport:
    """What was measured: the tables and what goes into run.json."""

    speed_error: pd.DataFrame
    scaling: pd.DataFrame
    split: pd.DataFrame
    info: dict

    @property
    def status(self) -> int:
        """1: an exact method is off by more than its tolerance; 3: a case failed to run."""
        return DISAGREE if self.info["wrong"] else ENGINE_FAILED if self.info["failed"] else AGREE


Ask = Callable[..., Any]
"""Outcome of a task in an engine's process, by its name: a value or Failure."""


def measure(
    cases: Sequence[Case],
    plan: Plan,
    start: Callable[[Case], tuple[First, Any] | Failure],
    visit: Callable[[Case, int], float | Failure],
    done: Callable[[str], None] = lambda line: None,
) -> dict[Case, Timed | Failure]:
    """Times of all cases in turns, so that what slows the machine for a while slows all of them.

    Parameters
    ----------
    start : makes a case ready: what `First` says, and its error.
    visit : seconds of so many calls of a case.
    done : called with a line for people after each visit.
    """
    ready: dict[Case, tuple[First, Any]] = {}
    failed: dict[Case, Failure] = {}
    seconds: dict[Case, list[float]] = {}
    for case in cases:
        outcome = start(case)
        if isinstance(outcome, Failure):
            failed[case] = outcome
        else:
            ready[case] = outcome
        done(f"round 0 of {plan.rounds}, making ready: {case}")
    for turn in range(plan.rounds):
        for case, (facts, _) in ready.items():
            spent = seconds.setdefault(case, [])
            if case not in failed and (turn < LEAST_ROUNDS or sum(spent) < plan.most):
                outcome = visit(case, facts.number)
                if isinstance(outcome, Failure):
                    failed[case] = outcome
                else:
                    spent.append(outcome)
            done(f"round {turn + 1} of {plan.rounds}: {case}")
    timed = {
        case: Timed([s / (facts.number * facts.samples) for s in seconds[case]], error, facts.peak)
        for case, (facts, error) in ready.items()
        if case not in failed
    }
    return {case: failed[case] if case in failed else timed[case] for case in cases}


def bench(
    scene: Scene,
    engines: Sequence[str] = (),
    plan: Plan = FULL,
    done: Callable[[str, int], None] = lambda line, total: None,
) -> BenchReport:
    """Time every method of every engine on one scene, and measure its error against certified truth.

    Parameters
    ----------
    engines : names; none means all. The reference always runs, and so does the yardstick.
    plan : how much of it.
    done : called with a line for people and the number of all visits, after each of them.

    Raises
    ------
    UnknownEngine, SceneError, TrajectoryError
        Unusable input.
    EngineError
        No certified truth. Any other engine's failure is no exception: its rows have no numbers.
    """
    chosen = choose_engines(engines)
    require_determinate(scene)
    started, begun = datetime.now(UTC), perf_counter()
    run_id = new_run_id(scene.name, started)
    models, trajectory = write_models(scene), from_scene(scene, plan.samples)
    alone = scene.model_copy(update={"forces": None, "initial": None})  # the motion's own forces and start
    problem = pose(alone, 1.0, OUTPUTS)
    cases = plan_cases(scene, list(chosen), plan)
    names = list(dict.fromkeys([REFERENCE, *(case.engine for case in cases)]))
    with Workers[str](names, LIMIT) as workers:

        def ask(engine: str, task: Callable[..., Any], *args: Any) -> Any:
            workers.start(engine, engine, task, *args)
            (outcome,) = (outcome for _, outcome in workers.ended())
            return outcome

        truth = ask(REFERENCE, dynamics, REFERENCE, scene, models, workers.shared(trajectory), None)
        if not isinstance(truth, DynamicsResult):
            raise EngineError(f"no certified truth: {truth.reason}")
        inputs = Inputs(scene, models, trajectory, truth.F, problem)
        judge = Truth(scene, trajectory, truth, problem)

        def start(case: Case) -> tuple[First, Any] | Failure:
            outcome = ask(case.engine, first, case, inputs, plan.least)
            if isinstance(outcome, Failure):
                return outcome
            try:
                return outcome, judge.error(case, outcome.answer, _floor(chosen.get(case.engine)))
            except EngineError as e:
                return Failure(str(e))

        total = len(cases) * (1 + plan.rounds)
        found = measure(
            cases, plan, start, lambda case, n: ask(case.engine, again, case, inputs, n), lambda line: done(line, total)
        )
        watched = {case: ask(case.engine, split, case, inputs) for case in split_cases(cases, plan)}
        limits = ask(FORMULAS, roofline, scene) if FORMULAS in names else None
        libraries = {name: ask(name, threads) for name in names}
    info = {
        **provenance(run_id, started, scene, chosen),
        "seconds": perf_counter() - begun,
        "plan": plan._asdict(),
        "seeds": {},
        "threads": {n: t for n, t in libraries.items() if not isinstance(t, Failure)},
        "roofline": None if isinstance(limits, Failure) else limits,
        "without_sweep": [name for name in chosen if name not in sweep_names()],
        **verdict(found),
        "crashed": crashed(
            [*((case.engine, r) for r_of in (found, watched) for case, r in r_of.items()), *libraries.items()]
        ),
    }
    report = BenchReport(speed_error(scene, found), scaling(scene, found), split_table(watched), info)
    info["status"] = report.status
    return report


def plan_cases(scene: Scene, engines: Sequence[str], plan: Plan) -> list[Case]:
    """Cases of engines that have a sweep, the yardstick first."""
    cases = [
        case for name in sweep_names() if name in (*engines, YARDSTICK) for case in load_sweep(name).cases(scene, plan)
    ]
    cases = [case for case in cases if case.engine in engines or case.task == BASELINE]
    return sorted(cases, key=lambda case: case.task != BASELINE)


def verdict(found: Mapping[Case, Timed | Failure]) -> dict:
    """What failed, what is off by more than its tolerance, and the yardstick."""
    baseline = next(((case, r) for case, r in found.items() if case.task == BASELINE), None)
    out: dict[str, Any] = {"baseline": None, "failed": [], "wrong": []}
    if baseline and isinstance(baseline[1], Timed):
        us, p10, p90 = baseline[1].us().tolist()
        out["baseline"] = {"what": baseline[0].setting, "us_per_sample": us, "us_p10": p10, "us_p90": p90}
    for case, result in found.items():
        which = {name: getattr(case, name) for name in ("task", "engine", "route", "backend", "setting", "batch")}
        if isinstance(result, Failure):
            out["failed"].append(which | {"reason": result.reason})
        elif case.exact and result.error and not result.error.share <= 1.0:
            out["wrong"].append(which | {"max_rel_error": result.error.relative, "over_tolerance": result.error.share})
    return out


def _floor(engine: type[Engine] | Failure | None) -> float:
    return getattr(engine, "inertia_floor", 0.0)
