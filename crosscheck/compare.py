"""Comparison of every engine with the certified truth: one row per engine, route and quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ..models.scene import Scene
from .balance import balance
from .engine import HULL, LOOPS, REFERENCE, DynamicsResult, Engine, Failure, quantity
from .tolerance import CLOSURE, RADIUS, ROUND_OFF, Tolerance, of_forces, of_loops
from .trajectory import Trajectory

PASS, FAIL, ERROR = "pass", "fail", "error"

UNITS = {"F": "N", "M": "N m", "loop_pos": "m", "loop_vel": "m/s", "loop_acc": "m/s^2", "balance": "N"}


@dataclass(frozen=True)
class Scales:
    """What errors are divided by: the run's largest reaction force [N], longest leg [m], tip speed and acceleration."""

    force: float
    length: float
    speed: float
    acceleration: float

    def of(self, name: str) -> float:
        """Scale of a quantity, in its unit."""
        special = {"balance": self.force, **dict(zip(LOOPS, (self.length, self.speed, self.acceleration), strict=True))}
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
    )


def expected(scene: Scene, engine: type[Engine]) -> tuple[str, ...]:
    """Quantities that an engine must deliver for a scene."""
    return (*scene.quantities, *HULL, *engine.checks)


def _errors(
    scene: Scene, trajectory: Trajectory, result: DynamicsResult, truth: DynamicsResult, name: str, length: float
) -> tuple[np.ndarray, list[str]]:
    """Error of one quantity (nt, columns), and what the columns are: legs or bodies."""
    legs = [f"leg {i}" for i in scene.legs]
    if name == "balance":
        residual = balance(scene, trajectory, result.reactions, length)
        return np.stack(list(residual.values()), axis=1), list(residual)
    if name in LOOPS:
        return np.linalg.norm(result.loops[name], axis=2), legs
    want, radius = certified(scene, truth, name)
    if result is truth:
        return np.linalg.norm(radius, axis=2), legs
    got = quantity(scene, name, result.F, result.reactions)[truth.samples]
    return np.linalg.norm(got - want, axis=2), ["hull"] if name in HULL else legs


def certified(scene: Scene, truth: DynamicsResult, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Value and radius of one quantity of the truth, as `quantity` gives it: the hull's are no sum of reactions."""
    if name in HULL:
        part = slice(3, 6) if name.startswith("F") else slice(0, 3)
        return np.asarray(truth.hull)[:, None, part], truth.radius["hull"][:, None, part]
    values = quantity(scene, name, truth.F, truth.reactions)
    return values, quantity(scene, name, truth.radius["F"], truth.radius["reactions"])


def _judge(
    errors: np.ndarray, where: Sequence[str], t: np.ndarray, scale: float, tolerance: Tolerance, wider: np.ndarray
) -> dict:
    """One row's numbers and verdict; each sample is held to its own tolerance. A NaN never passes."""
    share = errors / (scale * tolerance.value * wider[:, None])
    passed = bool((share <= 1.0).all())
    sample, column = (int(i) for i in np.unravel_index(int(np.argmax(errors if passed else share)), errors.shape))
    max_abs = float(np.max(errors))  # NaN if any is
    hard = wider[sample] > 1.0
    return {
        "max_abs": max_abs,
        "rms": float(np.sqrt(np.mean(errors**2))),
        "max_rel": max_abs / scale,
        "scale": scale,
        "tolerance": tolerance.value * float(wider[sample]),
        "tolerance_name": tolerance.name + ("_ill_conditioned" if hard else ""),
        "verdict": PASS if passed else FAIL,
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


def agreement(
    run_id: str,
    scene: Scene,
    trajectory: Trajectory,
    engines: Mapping[str, type[Engine] | Failure],
    results: Mapping[str, DynamicsResult | Failure],
) -> pd.DataFrame:
    """Every expected row, whether its engine ran or not; `where` and `reason` stand beside the published columns."""
    truth = results[REFERENCE]
    rows: list[dict] = []
    size = scales(scene, trajectory, truth) if isinstance(truth, DynamicsResult) else None
    for name, engine in engines.items():
        result = results[name]
        known = None if isinstance(engine, Failure) else engine
        for q in expected(scene, known) if known else (*scene.quantities, *HULL):
            row = {
                "run_id": run_id,
                "scene": scene.name,
                "trajectory": trajectory.source,
                "engine": name,
                "engine_version": result.version if isinstance(result, DynamicsResult) else "",
                "route": known.route if known else "",
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
                held = slice(None) if q in (*LOOPS, "balance") else truth.samples
                tolerance, wider = _tolerance(q, name == REFERENCE, trajectory)
                errors, where = _errors(scene, trajectory, result, truth, q, size.length)
                row |= _judge(errors, where, trajectory.t[held], size.of(q), tolerance, wider[held])
                row["us_per_sample"] = result.seconds / len(result.samples) * 1e6
            rows.append(row)
    return pd.DataFrame(rows)
