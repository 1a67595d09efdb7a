"""Comparison of every engine with the certified truth: one row per engine, route and quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ..models.scene import Scene
from .balance import balance
from .engine import (
    HULL,
    LOOPS,
    PLATFORM,
    REFERENCE,
    DynamicsResult,
    Engine,
    Failure,
    Key,
    platform_quantity,
    quantity,
)
from .tolerance import (
    CLOSURE,
    EASY_CONDITION,
    LAW_FACTOR,
    LAW_LIMIT,
    RADIUS,
    ROUND_OFF,
    Tolerance,
    of_accelerations,
    of_forces,
    of_loops,
)
from .trajectory import Trajectory

PASS, FAIL, ERROR, UNSUPPORTED = "pass", "fail", "error", "unsupported"

NO_BOUND = f"the law of the engine's own solver allows more than {LAW_LIMIT:g} of the scale"
"""The one reason for a row to be unsupported."""

UNITS = {"F": "N", "M": "N m", "loop_pos": "m", "loop_vel": "m/s", "loop_acc": "m/s^2", "balance": "N"}
UNITS |= {"a": "m/s^2", "alpha": "rad/s^2"}


@dataclass(frozen=True)
class Scales:
    """What errors are divided by.

    The run's largest reaction force [N], longest leg [m], tip speed and acceleration, and the longest lever of a pin
    on the platform [m] (the longest leg where the platform is a point).
    """

    force: float
    length: float
    speed: float
    acceleration: float
    lever: float

    def of(self, name: str) -> float:
        """Scale of a quantity, in its unit."""
        special = {"balance": self.force, **dict(zip(LOOPS, (self.length, self.speed, self.acceleration), strict=True))}
        special |= {"a": self.acceleration, "alpha": self.acceleration / self.lever}
        return special.get(name, self.force * (self.length if name.startswith("M") else 1.0))


def unit(name: str) -> str:
    """Unit of a quantity."""
    return UNITS.get(name) or UNITS[name[0]]


def scales(scene: Scene, trajectory: Trajectory, truth: DynamicsResult) -> Scales:
    """Scales of a run, forces from the truth.

    Speeds and accelerations get one leg length per second (squared) on top, so that a motion at rest has a scale too;
    a run without any force gets 1 N.
    """
    reactions = [quantity(scene, n, truth.F, truth.reactions) for n in scene.quantities if n.startswith("F_")]
    force = max(float(np.linalg.norm(x, axis=2).max()) for x in reactions) or 1.0
    length = float(truth.L.max())
    r = np.einsum("tij,nj->tni", trajectory.rotation, np.array(scene.pins))
    w, dw = (x[:, None] for x in (trajectory.angular_velocity, trajectory.angular_acceleration))
    V = trajectory.velocity[:, None] + np.cross(w, r)
    A = trajectory.acceleration[:, None] + np.cross(dw, r) + np.cross(w, np.cross(w, r))
    return Scales(
        force,
        length,
        float(np.linalg.norm(V, axis=2).max()) + length,
        float(np.linalg.norm(A, axis=2).max()) + length,
        float(np.linalg.norm(r, axis=2).max()) or length,
    )


def expected(scene: Scene, engine: type[Engine] | None, route: str) -> tuple[str, ...]:
    """Quantities that an engine must deliver for a scene on one of its routes; an unknown engine: those of all."""
    if engine is None:
        return (*scene.quantities, *HULL)
    if route == engine.route:
        return (*scene.quantities, *HULL, *engine.checks)
    return (*scene.quantities[1:], *HULL, *forward_quantities(scene))  # F is handed in


def forward_quantities(scene: Scene) -> tuple[str, ...]:
    """Accelerations that the platform has."""
    return PLATFORM[:1] if scene.freedom == "point" else PLATFORM


def truth_of(results: Mapping[Key, DynamicsResult | Failure]) -> DynamicsResult | Failure:
    """Result of the certified reference."""
    return next(result for (name, _), result in results.items() if name == REFERENCE)


def values(scene: Scene, result: DynamicsResult, name: str) -> np.ndarray:
    """One quantity of a result, leg by leg as `quantity` gives it."""
    if name in PLATFORM:
        return platform_quantity(name, np.asarray(result.platform))
    return quantity(scene, name, result.F, result.reactions)


def certified(scene: Scene, truth: DynamicsResult, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Value and radius of one quantity of the truth, as `quantity` gives it: the hull's are no sum of reactions."""
    if name in HULL:
        part = slice(3, 6) if name.startswith("F") else slice(0, 3)
        return np.asarray(truth.hull)[:, None, part], truth.radius["hull"][:, None, part]
    return values(scene, truth, name), quantity(scene, name, truth.radius["F"], truth.radius["reactions"])


def _errors(
    scene: Scene, trajectory: Trajectory, result: DynamicsResult, truth: DynamicsResult, name: str, length: float
) -> tuple[np.ndarray, list[str]]:
    """Error of one quantity (samples, columns), and what the columns are: legs or bodies.

    Samples are those of the truth; of the engine's own checks they are all.
    """
    legs = [f"leg {i}" for i in scene.legs]
    if name == "balance":
        residual = balance(scene, trajectory, result.reactions, length)
        return np.stack(list(residual.values()), axis=1), list(residual)
    if name in LOOPS:
        return np.linalg.norm(result.loops[name], axis=2), legs
    if name in PLATFORM:
        given = np.hstack([trajectory.acceleration, trajectory.angular_acceleration])[truth.samples]
        error = values(scene, result, name) - platform_quantity(name, given)
        return np.linalg.norm(error, axis=2), ["platform"]
    want, error = certified(scene, truth, name)
    if result is not truth:
        error = values(scene, result, name)[np.isin(result.samples, truth.samples)] - want
    return np.linalg.norm(error, axis=2), ["hull"] if name in HULL else legs


def _judge(
    errors: np.ndarray,
    where: Sequence[str],
    t: np.ndarray,
    scale: float,
    allowed: np.ndarray,
    names: np.ndarray,
    limit: float,
) -> dict:
    """One row's numbers and verdict; each sample is held to its own tolerance. A NaN never passes.

    Samples whose tolerance is above `limit` are not judged.
    """
    share = errors / (scale * allowed[:, None])
    vague = allowed > limit
    fits = share <= 1.0
    passed = bool(fits.all())
    sample, column = (int(i) for i in np.unravel_index(int(np.argmax(errors if passed else share)), errors.shape))
    verdict = FAIL if not fits[~vague].all() else UNSUPPORTED if vague.any() else PASS
    max_abs = float(np.max(errors))  # NaN if any is
    return {
        "max_abs": max_abs,
        "rms": float(np.sqrt(np.mean(errors**2))),
        "max_rel": max_abs / scale,
        "scale": scale,
        "tolerance": float(allowed[sample]),
        "tolerance_name": str(names[sample]),
        "verdict": verdict,
        "reason": NO_BOUND if verdict == UNSUPPORTED else "",
        "where": f"{where[column]}, t = {t[sample]:.6g} s",
    }


def _tolerance(name: str, certified: bool, trajectory: Trajectory) -> tuple[Tolerance, np.ndarray]:
    """Tolerance of a quantity and how much wider it is at each sample of the trajectory."""
    if certified:
        return RADIUS, np.ones(len(trajectory.t))
    if name in ("balance", *HULL):  # sums of forces against momentum: errors that grow with the condition cancel
        return ROUND_OFF, np.ones(len(trajectory.t))
    if name in LOOPS:
        return CLOSURE, of_loops(trajectory.sin_q_n, LOOPS.index(name))
    return ROUND_OFF, of_forces(trajectory.condition, trajectory.sin_q_n)


def _allowed(
    scene: Scene, trajectory: Trajectory, result: DynamicsResult, truth: DynamicsResult, name: str, size: Scales
) -> tuple[np.ndarray, np.ndarray]:
    """Largest error over the scale, and what it is called, at each sample of the result."""
    if result.platform is not None:
        return _allowed_forward(scene, trajectory, result, name, size)
    tolerance, wider = _tolerance(name, result is truth, trajectory)
    wider = wider[result.samples]
    return tolerance.value * wider, np.where(wider > 1.0, f"{tolerance.name}_ill_conditioned", tolerance.name)


def _allowed_forward(
    scene: Scene, trajectory: Trajectory, result: DynamicsResult, name: str, size: Scales
) -> tuple[np.ndarray, np.ndarray]:
    """The same for an answer to driving forces: what its law predicts, and rounding."""
    condition, sin_q_n = trajectory.condition[result.samples], trajectory.sin_q_n[result.samples]
    largest = np.linalg.norm(result.reactions[..., 3:], axis=2).max(axis=1)
    if name in PLATFORM:
        wider = of_accelerations(largest / (scene.platform.mass * size.acceleration), sin_q_n)
    else:
        wider = of_forces(condition, sin_q_n)
    if result.law is None:
        return ROUND_OFF.value * wider, np.full(len(wider), ROUND_OFF.name)
    law = values(scene, replace(result, **result.predicted), name)
    off = np.linalg.norm(law, axis=2).max(axis=1) / size.of(name)
    rounding = ROUND_OFF.value * np.maximum(wider, result.law.condition / EASY_CONDITION)
    return LAW_FACTOR * off + rounding, np.full(len(off), f"law_of_{result.law.name}")


def agreement(
    run_id: str,
    scene: Scene,
    trajectory: Trajectory,
    engines: Mapping[str, type[Engine] | Failure],
    results: Mapping[Key, DynamicsResult | Failure],
) -> pd.DataFrame:
    """Every expected row of these routes, whether its engine ran or not.

    `where` and `reason` stand beside the published columns.
    """
    truth = truth_of(results)
    rows: list[dict] = []
    size = scales(scene, trajectory, truth) if isinstance(truth, DynamicsResult) else None
    for (name, route), result in results.items():
        engine = engines[name]
        for q in expected(scene, None if isinstance(engine, Failure) else engine, route):
            row = {
                "run_id": run_id,
                "scene": scene.name,
                "trajectory": trajectory.source,
                "engine": name,
                "engine_version": result.version if isinstance(result, DynamicsResult) else "",
                "route": route,
                "setting": result.setting if isinstance(result, DynamicsResult) else "",
                "quantity": q,
                "unit": unit(q),
            }
            row |= dict.fromkeys(("max_abs", "rms", "max_rel", "scale", "tolerance", "us_per_sample"), np.nan)
            row |= {"tolerance_name": "", "verdict": ERROR, "where": "", "reason": ""}
            if isinstance(result, Failure):
                row["reason"] = result.reason
            elif not isinstance(truth, DynamicsResult) or size is None:
                row["reason"] = "no certified truth to compare with"
            else:
                errors, where = _errors(scene, trajectory, result, truth, q, size.length)
                allowed, names = _allowed(scene, trajectory, result, truth, q, size)
                held = np.isin(result.samples, result.samples if q in (*LOOPS, "balance") else truth.samples)
                t = trajectory.t[result.samples[held]]
                limit = LAW_LIMIT if result.law else np.inf
                row |= _judge(errors, where, t, size.of(q), allowed[held], names[held], limit)
                row["us_per_sample"] = result.seconds / len(result.samples) * 1e6
            rows.append(row)
    return pd.DataFrame(rows)
