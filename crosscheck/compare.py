"""Comparison of every engine with the certified truth: one row per engine, route and quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..models.scene import Scene
from .bounds import allowed
from .checks import Worst
from .engine import (
    HULL,
    PLATFORM,
    REFERENCE,
    DynamicsResult,
    Engine,
    Failure,
    Key,
    platform_quantity,
    quantity,
    values,
)
from .scales import Scales, scales
from .tolerance import LIMIT
from .trajectory import Trajectory

if TYPE_CHECKING:
    import pandas as pd

PASS, FAIL, ERROR, UNSUPPORTED = "pass", "fail", "error", "unsupported"

NO_BOUND = f"the law of the engine's own solver allows more than {LIMIT:g} of the scale"
NO_DIGITS = (
    f"rounding in such a pose, or moments of inertia that the engine adds, may be more than {LIMIT:g} of the scale"
)
"""The reasons for a row to be unsupported."""

UNITS = {"F": "N", "M": "N m", "loop_pos": "m", "loop_vel": "m/s", "loop_acc": "m/s^2", "balance": "N"}
UNITS |= {"a": "m/s^2", "alpha": "rad/s^2"}


def unit(name: str) -> str:
    """Unit of a quantity."""
    return UNITS.get(name) or UNITS[name[0]]


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


def certified(scene: Scene, truth: DynamicsResult, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Value and radius of one quantity of the truth, as `quantity` gives it: the hull's are no sum of reactions."""
    if name in HULL:
        part = slice(3, 6) if name.startswith("F") else slice(0, 3)
        return np.asarray(truth.hull)[:, None, part], truth.radius["hull"][:, None, part]
    return values(scene, truth, name), quantity(scene, name, truth.radius["F"], truth.radius["reactions"])


def _errors(scene: Scene, trajectory: Trajectory, result: DynamicsResult, truth: DynamicsResult, name: str) -> Worst:
    """Error of one quantity at the samples of the truth; of the engine's own checks they are all."""
    if name in result.checks:
        return result.checks[name]
    if name in PLATFORM:
        given = np.hstack([trajectory.acceleration, trajectory.angular_acceleration])[truth.samples]
        error = values(scene, result, name) - platform_quantity(name, given)
        return Worst.of(np.linalg.norm(error, axis=2), ["platform"])
    want, error = certified(scene, truth, name)
    if result is not truth:
        error = values(scene, result, name)[np.isin(result.samples, truth.samples)] - want
    return Worst.of(np.linalg.norm(error, axis=2), ["hull"] if name in HULL else [f"leg {i}" for i in scene.legs])


def _allowed(
    scene: Scene,
    trajectory: Trajectory,
    engine: type[Engine] | Failure,
    result: DynamicsResult,
    truth: DynamicsResult,
    name: str,
    size: Scales,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times of the samples of `_errors`, what is `allowed` there, and its names."""
    floor = getattr(engine, "inertia_floor", 0.0)
    if name in result.checks:
        blocks = [allowed(scene, block, result, truth, name, size, floor) for block in trajectory.blocks()]
        bound, names = (np.concatenate(part) for part in zip(*blocks, strict=True))
        return trajectory.t, bound, names
    at, held = trajectory.at(result.samples), np.isin(result.samples, truth.samples)
    bound, names = allowed(scene, at, result, truth, name, size, floor)
    return at.t[held], bound[held], names[held]


def _judge(
    worst: Worst, scale: float, t: np.ndarray, allowed: np.ndarray, names: np.ndarray, vague_because: str
) -> dict:
    """One row's numbers and verdict; each sample is held to its own tolerance. A NaN never passes.

    Samples whose tolerance is above `LIMIT` are not judged.
    """
    share = worst.error / (scale * allowed)
    vague = allowed > LIMIT
    fits = share <= 1.0
    passed = bool(fits.all())
    sample = int(np.argmax(worst.error if passed else share))
    verdict = FAIL if not fits[~vague].all() else UNSUPPORTED if vague.any() else PASS
    max_abs = float(np.max(worst.error))  # NaN if any is
    return {
        "max_abs": max_abs,
        "rms": float(np.sqrt(np.mean(worst.square))),
        "max_rel": max_abs / scale,
        "scale": scale,
        "tolerance": float(allowed[sample]),
        "tolerance_name": str(names[sample]),
        "verdict": verdict,
        "share": float(share[sample]),
        "reason": vague_because if verdict == UNSUPPORTED else "",
        "where": f"{worst.columns[worst.column[sample]]}, t = {t[sample]:.6g} s",
    }


def agreement(
    run_id: str,
    scene: Scene,
    trajectory: Trajectory,
    engines: Mapping[str, type[Engine] | Failure],
    results: Mapping[Key, DynamicsResult | Failure],
) -> pd.DataFrame:
    """Every expected row of these routes, whether its engine ran or not.

    `where`, `reason` and `share`, the error there over what is allowed, stand beside the published columns.
    """
    import pandas as pd  # takes long, and engines need none

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
            row |= {"tolerance_name": "", "verdict": ERROR, "where": "", "share": np.nan, "reason": ""}
            if isinstance(result, Failure):
                row["reason"] = result.reason
            elif not isinstance(truth, DynamicsResult) or size is None:
                row["reason"] = "no certified truth to compare with"
            else:
                bound = _allowed(scene, trajectory, engine, result, truth, q, size)
                why = NO_BOUND if result.law else NO_DIGITS
                row |= _judge(_errors(scene, trajectory, result, truth, q), size.of(q), *bound, why)
                row["us_per_sample"] = result.seconds / (result.evaluated or len(result.samples)) * 1e6
            rows.append(row)
    return pd.DataFrame(rows)
