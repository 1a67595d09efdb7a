"""One problem of forward dynamics in every engine, each in a process of its own, and the analytic solution beside."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np

from ..models import write_models
from .engine import (
    REFERENCE,
    DynamicsResult,
    Failure,
    crashed,
    engine_version,
)
from .engines.analytic_ import AnalyticEngine
from .problem import Problem
from .run import choose_engines, new_run_id, provenance, require_determinate, status_of
from .simulation import Accelerated, Row, Solution, acceleration_errors, table
from .stepping import Method, Simulated
from .tasks import run_tasks, simulates
from .trajectory import SAMPLES, Trajectory, TrajectoryError, from_scene

if TYPE_CHECKING:
    import pandas as pd

ANALYTIC = AnalyticEngine.name


@dataclass(frozen=True)
class SimulationReport:
    """What a simulation found: the table, where every engine went, and what goes into run.json."""

    problem: Problem
    simulation: pd.DataFrame
    results: dict[Row, Simulated | Failure]
    info: dict

    @property
    def status(self) -> int:
        """As `status_of` its verdicts."""
        return status_of(self.simulation["verdict"])

    def states(self) -> pd.DataFrame:
        """Pose and twist at the output times, every engine and method."""
        import pandas as pd

        blocks = []
        for (name, method), s in self.results.items():
            if isinstance(s, Failure):
                continue
            block = pd.DataFrame(
                np.column_stack([self.problem.t, s.position, s.quaternion, s.velocity, s.angular_velocity]),
                columns=STATES_COLUMNS[4:],
            )
            which = (name, method.route, method.integrator, method.dt(self.problem))
            for k, (column, value) in enumerate(zip(STATES_COLUMNS[:4], which, strict=True)):
                block.insert(k, column, value)
            blocks.append(block.astype({"dt": float}))
        return pd.concat(blocks, ignore_index=True) if blocks else pd.DataFrame(columns=STATES_COLUMNS)


STATES_COLUMNS = [
    "engine", "route", "integrator", "dt", "t", "p_x", "p_y", "p_z", "q_w", "q_x", "q_y", "q_z",
    "v_x", "v_y", "v_z", "w_x", "w_y", "w_z",
]  # fmt: skip


def _certifiable(problem: Problem) -> Trajectory | None:
    """The scene's motion, if certified driving forces can be had for it."""
    scene = problem.scene
    if scene.motion is None or scene.nv != scene.na + scene.nc:
        return None
    try:
        return from_scene(scene, min(len(problem.t), SAMPLES))
    except TrajectoryError:
        return None  # forces were given, and the motion passes a singular pose


def simulate(
    problem: Problem,
    engines: Sequence[str] = (),
    done: Callable[[str], None] = lambda line: None,
) -> SimulationReport:
    """Simulate in every engine and compare with the motion, or with the analytic solution, which always runs.

    Parameters
    ----------
    problem : from `pose`.
    engines : names; none means all. The reference certifies the forces that accelerations are compared under.
    done : called with a line for people as each simulation ends.

    Raises
    ------
    UnknownEngine, SceneError
        Unusable input. An engine's own failure is no exception: it becomes `error` rows.
    """
    scene = problem.scene
    chosen = choose_engines([ANALYTIC, *engines] if engines else ())
    if scene.forces is None:
        require_determinate(scene)
    started, start = datetime.now(UTC), perf_counter()
    run_id = new_run_id(scene.name, started)
    models = write_models(scene)
    results: dict[Row, Simulated | Failure] = {}
    able: dict[str, tuple[Method, ...]] = {}
    for name, engine in chosen.items():
        if isinstance(engine, Failure):
            if name != REFERENCE:
                results[name, Method("", "", "")] = engine
            done(f"{name} failed: {engine.reason}")
        elif simulates(engine):
            able[name] = engine.methods(problem)
            results |= {(name, method): Failure("") for method in able[name]}
    motion = _certifiable(problem)
    reference = chosen[REFERENCE]
    found = run_tasks(problem, models, able, None if isinstance(reference, Failure) else motion, done)
    results |= found.simulated
    solution = _solution(problem, results)
    truth = reference if isinstance(reference, Failure) else found.certified
    accelerated: dict[tuple[str, str], Accelerated | Failure] = {}
    if motion is not None and isinstance(truth, DynamicsResult):
        for key, got in found.accelerations.items():
            floor = getattr(chosen[key[0]], "inertia_floor", 0.0)
            accelerated[key] = (
                got if isinstance(got, Failure) else acceleration_errors(scene, motion, got, truth, floor)
            )
    elif motion is not None and isinstance(truth, Failure):
        uncertified = Failure(f"no certified driving forces: {truth.reason}")
        accelerated = {(name, m.route): uncertified for name, m in results if m.accelerates}
    versions = {n: engine_version(e) or "" for n, e in chosen.items() if not isinstance(e, Failure)}
    rows = table(run_id, problem, solution, versions, results, accelerated)
    info = {
        **provenance(run_id, started, scene, chosen),
        "seconds": perf_counter() - start,
        "start": problem.start.source,
        "forces": f"{scene.source}: forces" if scene.forces else "inverse dynamics of the motion",
        "duration": problem.duration,
        "samples": len(problem.t),
        "against": solution.against if solution else "",
        "growth": _growth(problem, solution),
        "without_simulation": [n for n, e in chosen.items() if not isinstance(e, Failure) and not simulates(e)],
        "certified_samples": len(motion.t) if motion is not None and isinstance(truth, DynamicsResult) else 0,
        "failed": [
            {"engine": name, "route": m.route, "integrator": m.integrator, "dt": m.dt(problem), "reason": r.reason}
            for (name, m), r in results.items()
            if isinstance(r, Failure) and not m.unsupported
        ],
        "crashed": crashed((key[0], r) for key, r in [*results.items(), *accelerated.items(), ((REFERENCE,), truth)]),
    }
    report = SimulationReport(problem, rows, results, info)
    info["status"] = report.status
    return report


def _solution(problem: Problem, results: Mapping[Row, Simulated | Failure]) -> Solution | None:
    """The motion, or the analytic solution where the motion is none; None if that failed."""
    if problem.prescribed:
        against, s = "motion", problem.motion()
    else:
        against, s = "analytic", next((s for (n, m), s in results.items() if n == ANALYTIC and m.steps is None), None)
    if s is None or isinstance(s, Failure):
        return None
    quaternion = s.quaternion / np.linalg.norm(s.quaternion, axis=1, keepdims=True)
    motion = (s.position, quaternion, s.velocity, s.angular_velocity)
    growth = AnalyticEngine(problem.scene).growth_rates(*motion, problem.forces(problem.t))
    return Solution(against, s.position, quaternion, growth)


def _growth(problem: Problem, solution: Solution | None) -> dict:
    if solution is None:
        return {}
    return {
        "mean_rate": float(solution.growth.mean()),
        "max_rate": float(solution.growth.max()),
        "amplification": float(solution.amplification(problem.t)[-1]),
    }
